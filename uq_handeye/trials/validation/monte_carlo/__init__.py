"""Check of a covariance by simulation."""
