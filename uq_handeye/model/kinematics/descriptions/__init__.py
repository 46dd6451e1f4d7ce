"""Descriptions of arms in files: URDF, DH tables, what a Universal Robots controller calibrated."""
