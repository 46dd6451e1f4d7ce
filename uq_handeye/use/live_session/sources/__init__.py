"""Sources of pairs of poses: each gives the next pair, or one when it is asked to take it."""
