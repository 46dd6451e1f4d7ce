"""Two streams with unsynchronised clocks."""

from . import sentences as sentences
from . import text as text  # registers the words of synchronised streams
