"""Is the covariance consistent: by the posterior."""
