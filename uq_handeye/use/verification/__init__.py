"""Verification of a calibration by points that were seen and touched."""

from . import sentences as sentences
from . import text as text  # registers the words of a verification
