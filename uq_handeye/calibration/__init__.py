"""`calibrate`, `Calibration` and its file."""

from .report import notebook as notebook  # registers the words of a calibration
