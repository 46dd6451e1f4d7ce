"""A calibration in use: checks, updates, differences."""
