"""Covariances without a noise model: sandwich, HAC, jackknife, bootstrap."""
