"""Is the covariance consistent: by simulation."""

from . import sentences as sentences
