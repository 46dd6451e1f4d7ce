"""`calibrate`, `Calibration` and its file."""

from .report import text as text  # registers the words of a calibration
