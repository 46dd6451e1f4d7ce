"""Check of a covariance by the posterior."""
