"""Is the covariance consistent: by simulation."""
