"""New measurements against the joint posterior of a calibration: poses and touched points."""
