"""Check of a covariance by the posterior."""

from . import sentences as sentences
from . import text as text  # registers the words of a posterior
