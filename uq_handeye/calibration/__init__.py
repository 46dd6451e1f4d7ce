"""`calibrate`, `Calibration` and its file."""
