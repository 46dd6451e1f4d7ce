"""Diagnostics of a calibration from its residuals and geometry."""

from . import sentences as sentences
from . import text as text  # registers the words of pose tables and points
