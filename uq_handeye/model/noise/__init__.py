"""Noise models: covariances of poses and motions, also shared between poses, and their square roots."""

from . import text as text  # registers the words of noise models
