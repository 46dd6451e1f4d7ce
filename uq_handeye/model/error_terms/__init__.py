"""Errors of measured poses: the key that names one everywhere."""
