"""Covariances of poses, measured on the libraries whose conventions the toolkit names, by `measure`."""
