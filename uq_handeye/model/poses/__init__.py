"""The data: pose pairs, motions, streams, their timing; residuals."""

from . import sentences as sentences
