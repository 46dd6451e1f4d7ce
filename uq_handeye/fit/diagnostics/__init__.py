"""Diagnostics of a calibration from its residuals and geometry."""

from . import input_sentences as input_sentences
from . import sentences as sentences
