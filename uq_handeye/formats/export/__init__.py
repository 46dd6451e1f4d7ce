"""A calibration for other programs: as files (`write_export`) and as texts to copy (`texts`)."""

from ...core.formatting.snippets import Snippet
from .files import FORMATS, write_export
from .snippets import texts

__all__ = ["FORMATS", "Snippet", "texts", "write_export"]
