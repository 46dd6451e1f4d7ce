"""Selection of poses by their numbers, as sequences or as text such as ``12,14-16``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.limits import MIN_POSES
from ...errors import InputError

_RANGE = re.compile(r"(\d+)(?:\s*-\s*(\d+))?")


class Selection(NamedTuple):
    """Numbers of the poses that count and of those that are left out, ascending."""

    kept: NDArray[np.intp]
    excluded: NDArray[np.intp]


def select_poses(
    n: int,
    exclude: str | ArrayLike | None = None,
    only: str | ArrayLike | None = None,
    names: Sequence[str] = ("`exclude`", "`only`"),
    fewest: int = MIN_POSES,
) -> Selection | None:
    """Return which of n poses count; None where all do.

    Parameters
    ----------
    n : int
    exclude, only : sequence of int, text such as ``"12,14-16"``, or None
        Numbers of the poses to leave out, or of those to keep; at most one of the two.
    names : two str
        What messages call them.
    fewest : int
        Poses that are needed.

    Raises
    ------
    InputError
        Both given, a range that counts downwards, fewer poses left than are needed.
    """
    if exclude is None and only is None:
        return None
    if exclude is not None and only is not None:
        raise InputError(f"{names[0]} and {names[1]} are both given. Give one of them.")
    name, given = (names[0], exclude) if only is None else (names[1], only)
    assert given is not None
    listed = numbers_of(given, name)
    if (wrong := [k for k in listed if not 0 <= k < n]) != []:
        raise InputError(f"Expected {name} to name poses between 0 and {n - 1}, counted from 0, got {wrong[0]}.")
    chosen = np.zeros(n, dtype=bool)
    chosen[listed] = True
    kept = chosen if only is not None else ~chosen
    if kept.sum() < fewest:
        needed = "1 is needed" if fewest == 1 else f"{fewest} are needed (2 motions)"
        raise InputError(f"{name} leaves {int(kept.sum())} of {n} poses. At least {needed}.")
    if kept.all():
        return None
    return Selection(np.flatnonzero(kept), np.flatnonzero(~kept))


def numbers_of(given: str | ArrayLike, name: str) -> list[int]:
    """Return pose numbers of a sequence of integers, or of text such as ``"12,14-16"``, where ranges include their end.

    Raises `InputError` for anything else.
    """
    if isinstance(given, str):
        return [number for part in given.split(",") for number in _range(part.strip(), given, name)]
    try:
        array = np.asarray(given)
    except ValueError:
        array = np.empty(0, dtype=object)
    if array.ndim > 1 or (array.size and not np.issubdtype(array.dtype, np.integer)) or array.dtype == object:
        raise InputError(f"Expected {name} to be pose numbers such as [12, 14] or '12,14-16', got {given!r:.60}.")
    return [int(number) for number in np.atleast_1d(array)]


def _range(part: str, text: str, name: str) -> range:
    """Return the numbers of ``12`` or ``14-16``."""
    found = _RANGE.fullmatch(part)
    if found is None or any(len(digits or "") > 9 for digits in found.groups()):
        raise InputError(f"Expected {name} to be pose numbers such as 12,14-16, got {text!r:.60}.")
    first = int(found[1])
    last = first if found[2] is None else int(found[2])
    if last < first:
        raise InputError(f"Expected the ranges of {name} to count upwards, got {part}. Write {last}-{first}.")
    return range(first, last + 1)


def ranges(numbers: Sequence[int]) -> str:
    """Return ascending pose numbers as text that `numbers_of` reads: ``12, 14-16``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(f"{run[0]}" if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
