"""Plausible misreadings of the input."""

from . import sentences as sentences
