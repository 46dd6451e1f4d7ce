"""Cross-check of the covariance: everything side by side, and the relations that must hold."""
