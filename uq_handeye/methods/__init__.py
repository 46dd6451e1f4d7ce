"""From data to X by formula: the closed form of the paper, published methods, and their covariances."""
