"""Display of results as text, in notebooks, and as JSON."""

from __future__ import annotations

from typing import ClassVar

from ..files.json_files import json_text
from ..files.json_values import JsonObject
from ..files.open import StrPath
from .document import WIDTH, document_of, to_text
from .html import html_of


class Shown:
    """Base of results with a document (`document_of`) and plain values (``to_dict``)."""

    title: ClassVar[str] = ""  # in notebooks; empty: the name of the class
    columns: ClassVar[int] = WIDTH  # of the text

    @property
    def unfolded(self) -> int:
        """Number of blocks that notebooks show unfolded."""
        return 1

    def summary(self) -> str:
        """Return the result as text."""
        return to_text(document_of(self), self.columns)

    def to_text(self) -> str:
        """Return the same as `summary`."""
        return self.summary()

    def _repr_html_(self) -> str:
        """Return the result for notebooks."""
        return html_of(self)

    def to_dict(self) -> JsonObject:
        """Return everything as plain numbers, lists and text."""
        raise NotImplementedError

    def to_json(self, path: StrPath | None = None) -> str:
        """Return `to_dict` as JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)
