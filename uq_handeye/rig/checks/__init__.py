"""Checks of a rig: new views, paths that should agree, and a proof of the global minimum."""
