"""Poses of a target from its points, measured in 3-D by a depth camera or a tracker, with their covariance."""

from . import sentences as sentences
