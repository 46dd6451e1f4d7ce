"""Verification of a calibration by points that were seen and touched."""

from . import sentences as sentences
