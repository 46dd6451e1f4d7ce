"""`calibrate`, `Calibration` and its file."""

from ..noise_estimation import sentences as _of_noise  # noqa: F401  (words of results that are read from files)
from . import sentences as sentences
from .report import notebook as notebook  # registers the words of a calibration
