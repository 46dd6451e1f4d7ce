"""Tests of a covariance: by simulated trials, by the posterior, and by a comparison of all covariances."""

from . import sentences as sentences
