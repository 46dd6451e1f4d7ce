"""All methods on the same data."""

from . import text as text  # registers the words of a comparison
