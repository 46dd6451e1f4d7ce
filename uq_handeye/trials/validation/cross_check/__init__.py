"""Cross-check of the covariance: everything side by side, and the relations that must hold."""

from . import text as text  # registers the words of a cross-check
