"""Descriptions of arms in files: URDF, DH tables, and the calibrated kinematics of Universal Robots controllers."""
