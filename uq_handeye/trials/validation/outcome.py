"""Words, figure and file of the results of validations, made in one way."""

from __future__ import annotations

from functools import singledispatch
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ...core.files.atomic import json_text, write_atomically
from ...core.files.open import StrPath, as_path
from ...core.presentation.document import COLUMNS, WIDTH, Document, document_of, to_text
from ...core.presentation.html import to_html
from ...errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@singledispatch
def figure_of(result: Any) -> Figure:
    """Return the figure of a result. Each topic registers the function that draws its own result."""
    raise TypeError(f"Expected a result with a figure, got {type(result).__name__}.")


class Outcome:
    """A result with a document (`document_of`), a figure and a file."""

    title: ClassVar[str]  # in notebooks

    def document(self, verbose: bool = False) -> Document:
        """Return the verdict with its limits and the first table; ``verbose``: everything that is known."""
        with np.errstate(over="ignore"):  # the ratio to a direction without any error is infinite
            return document_of(self, verbose=verbose)

    @property
    def unfolded(self) -> int:
        """Number of blocks that notebooks show unfolded."""
        return 1

    def _repr_html_(self) -> str:
        """Return the verdict, with everything else folded, for notebooks."""
        return to_html(self.title, self.document(True), seen=self.unfolded)

    def summary(self, verbose: bool = False) -> str:
        """Return the verdict and the first table as text of 80 columns; ``verbose``: everything that is known."""
        return to_text(self.document(verbose), WIDTH if verbose else COLUMNS)

    def __str__(self) -> str:
        return self.summary()

    def drawn(self) -> Figure:
        """Return the figure as Matplotlib has it: by the module ``figure`` beside that of the result."""
        import_module(".figure", type(self).__module__.rpartition(".")[0])  # Matplotlib is slow to import
        return figure_of(self)

    def figure(self, path: StrPath) -> Path:
        """Write the figure, ``.png`` or ``.svg`` by its name, whole or not at all; returns the path.

        Raises `InputError` for another kind of file, or one that cannot be written.
        """
        path = as_path(path)
        kind = path.suffix.lower().removeprefix(".")
        if kind not in ("png", "svg"):
            raise InputError(f"Expected a figure to be named .png or .svg, got {str(path)!r}.")
        from ...core.presentation.ellipses import render

        with np.errstate(over="ignore"):
            image = render(self.drawn(), kind)
        write_atomically(path, image)
        return path

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain numbers, lists and text, with units and convention."""
        raise NotImplementedError

    def to_json(self, path: StrPath | None = None) -> str:
        """Return JSON text, also written to ``path`` (whole or not at all)."""
        return json_text(self.to_dict(), path)
