"""Two streams with unsynchronised clocks."""

from . import result as result  # registers the words of synchronised streams
from . import sentences as sentences
