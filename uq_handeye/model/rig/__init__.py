"""Observations of rigs with several cameras, targets and arms: who carries what, and who sees what."""

from . import sentences as sentences
