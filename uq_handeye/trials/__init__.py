"""Simulated rigs, and tests whether a covariance is consistent."""
