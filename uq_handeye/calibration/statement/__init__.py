"""The statement of a calibration: how accurate X is, which checks it passed, and whether it meets a tolerance."""
