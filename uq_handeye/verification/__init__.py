"""Points that were seen and touched, and other data, against a calibration."""
