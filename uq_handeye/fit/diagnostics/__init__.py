"""Diagnostics of a calibration from its residuals and geometry."""

from . import sentences as sentences
