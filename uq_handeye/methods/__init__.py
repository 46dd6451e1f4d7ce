"""The closed form of the paper, the other published methods, and their covariances."""
