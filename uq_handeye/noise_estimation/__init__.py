"""Restricted maximum likelihood of the noise, and what can be said of it."""

from . import sentences as sentences
