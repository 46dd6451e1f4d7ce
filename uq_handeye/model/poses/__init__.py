"""Pose data: pairs of poses, motions, streams with their timing, and their residuals."""

from . import sentences as sentences
