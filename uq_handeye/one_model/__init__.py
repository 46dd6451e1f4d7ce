"""Errors of arms, cameras and clocks as components of one Gaussian model."""
