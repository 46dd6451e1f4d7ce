"""A calibration in use: planned, checked, verified, updated, watched as it grows."""
