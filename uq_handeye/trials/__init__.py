"""Simulated rigs, and whether a covariance is consistent."""
