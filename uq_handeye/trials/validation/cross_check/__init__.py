"""Cross-check of the covariance: all covariances of one problem, and the relations that must hold between them."""
