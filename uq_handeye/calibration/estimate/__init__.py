"""Parts of a calibration: X and W with their covariances, the fit, the errors that all poses share, the origin."""
