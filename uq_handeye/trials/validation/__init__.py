"""The claim of a covariance put to the test: simulated trials, the posterior, and everything side by side."""

from . import sentences as sentences
