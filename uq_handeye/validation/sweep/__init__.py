"""Over which noise levels a covariance is consistent."""

from . import text as text  # registers the words of a sweep
