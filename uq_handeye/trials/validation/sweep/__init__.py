"""Over which noise levels a covariance is consistent."""

from . import sentences as sentences
from . import text as text  # registers the words of a sweep
