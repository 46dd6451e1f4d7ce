"""Covariances without a noise model: sandwich and bootstrap."""
