"""`calibrate`, `Calibration` and its file."""

from . import sentences as sentences
