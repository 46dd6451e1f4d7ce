"""Calibrations in use: planned, checked, verified, updated, watched as they grow."""
