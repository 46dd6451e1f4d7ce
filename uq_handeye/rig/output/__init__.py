"""The result of a rig for people and for other programs."""
