"""Over which noise levels a covariance is consistent."""
