"""Checks of a rig's estimate: paths that should agree, proof of the minimum."""
