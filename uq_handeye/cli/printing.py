"""Printing on stdout: text, and documents wrapped to the terminal."""

import os
import sys
from typing import TYPE_CHECKING

from ..core.files.one_line import printable
from ..errors import InputError
from .messages import quiet, styled, terminal_width

if TYPE_CHECKING:
    from ..core.presentation.document import Document


def shown(document: "Document") -> "Document":
    """Return a document; with --quiet its first block, which is its answer."""
    from ..core.presentation.document import groups_of

    return [list(next(iter(groups_of(document)))[:1])] if quiet() else document


def emit_document(document: "Document") -> None:
    """Print a document, wrapped to the terminal and with its colours."""
    from ..core.presentation.document import to_text

    emit(to_text(document, terminal_width(), styled))


def emit(output: str) -> None:
    """Print text; a reader that closes the pipe early (`| head`) is no failure."""
    if sys.stdout is None:  # closed by the caller
        raise InputError("Cannot write the output: the standard output is closed.")
    try:
        sys.stdout.write(printable(output))
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
