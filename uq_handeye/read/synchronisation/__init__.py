"""Two streams with unsynchronised clocks."""

from . import document as document  # registers the words of synchronised streams
from . import sentences as sentences  # registers the words of findings
