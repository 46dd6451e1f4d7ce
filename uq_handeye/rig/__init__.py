"""Rigs: several cameras, targets and arms in one estimate, with their joint covariance (T18)."""

from . import sentences as sentences
