"""Check of a covariance by simulation."""

from . import sentences as sentences
