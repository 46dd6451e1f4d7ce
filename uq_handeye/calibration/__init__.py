"""`calibrate`, `Calibration` and its file."""

from . import sentences as sentences
from .report import notebook as notebook  # registers the words of a calibration
