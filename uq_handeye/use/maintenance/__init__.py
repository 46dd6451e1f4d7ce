"""A calibration in use: checks, updates, differences."""

from . import check_text as check_text  # registers the words of a check
from . import sentences as sentences
