"""Closed form of the paper, published methods, and their covariances."""
