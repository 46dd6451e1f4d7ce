"""A calibration in use: checks, updates, differences."""

from . import sentences as sentences
