"""Matrices of a text as the content of a pose file, with a note on their layout."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ..contents import Contents, matrices_side
from .layout import TableMatrices
from .stamps import times_of

HELP = "docs/formats.md, Matrices in text"


def contents_of(found: TableMatrices, name: str, rows: NDArray[np.int64] | None, counted: str, *more: str) -> Contents:
    """The poses that were found, with times where numbers in front of the matrices are some."""
    notes = [found.note, *(note for note in more if note)]
    times, said = times_of(found.others)
    try:
        side = matrices_side(name, found.T, rows=rows, counted=counted, timestamps=times, readings=found.readings)
    except InputError as error:
        R = found.T[:, :3, :3]
        decimals = next((k for k in range(4) if np.abs(np.round(R, k) - R).max() < CHAIN_ROUNDING), None)
        hint = "" if decimals is None else f"the rotations have {decimals} decimals, and need 6 or more; "
        raise InputError(f"{str(error).rstrip('.')} ({hint}{HELP}).") from error
    return Contents(only=side, notes=(*notes, *said))
