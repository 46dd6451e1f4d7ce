"""Errors of measured poses: the key that names one everywhere, its term, its size, and noise as covariances."""
