"""Is the covariance consistent: everything side by side, and the relations that must hold."""
