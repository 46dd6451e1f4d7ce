"""The joint posterior of unknown poses and of every error: one object that all that follows a calibration reads."""
