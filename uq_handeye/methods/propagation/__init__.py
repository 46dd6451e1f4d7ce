"""Propagation of the noise of the data to the covariance of a published X."""
