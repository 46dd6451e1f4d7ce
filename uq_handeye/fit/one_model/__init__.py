"""The joint model of one calibration (T17): every error a component, every size a number with a prior."""
