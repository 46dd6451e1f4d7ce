"""Drawings of a page: nodes by name, the rig of a calibration, a rig of several cameras, touched points."""
