"""Simulated rigs, and tests of the consistency of a covariance."""
