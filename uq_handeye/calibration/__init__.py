"""`calibrate`, `Calibration` and its file."""

from ..fit.one_model import sentences as _of_noise  # noqa: F401
from . import sentences as sentences
from .evidence import sentences as _of_evidence  # noqa: F401  (words of results that are read from files)
from .report import notebook as notebook  # registers the words of a calibration
