"""A calibration as text and figures."""
