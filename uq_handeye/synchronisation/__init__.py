"""Two streams with unsynchronised clocks."""

from . import text as text  # registers the words of synchronised streams
