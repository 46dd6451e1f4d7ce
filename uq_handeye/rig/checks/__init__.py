"""Checks of a rig: by new views, by paths that should agree, proof of the minimum."""
