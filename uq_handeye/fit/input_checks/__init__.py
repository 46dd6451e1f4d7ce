"""Checks of the input for plausible mistakes: misread files, wrong pairing, wrong units, repeated poses."""

from . import sentences as sentences
