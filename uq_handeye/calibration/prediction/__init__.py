"""Predictions of what the rig will see and where points lie, from X, W and the errors that all poses share."""

from . import sentences as sentences
