"""Planning of the poses to add next."""

from . import text as text  # registers the words of a plan
