"""Times behind or before the matrices of a text: seconds, or counted in ns, us or ms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array

# Times since 1970 by their size.
_STAMPS = ((1e17, ("ns", 1e-9)), (1e14, ("us", 1e-6)), (1e11, ("ms", 1e-3)))


def times_of(others: Array) -> tuple[NDArray[np.float64] | None, list[str]]:
    """Times (s) among the numbers beside the matrices (n, k), and what is to be said of them."""
    said: list[str] = []
    for column in others.T:
        if np.isfinite(column).all() and (column == np.round(column)).all() and (np.diff(column) == 1).all():
            said.append("a number in each row counts the poses")
            continue
        if not np.isfinite(column).all() or (np.diff(column) <= 0).any():
            said.append("the numbers beside the matrices are not used")
            continue
        unit = next((unit for limit, unit in _STAMPS if abs(column[0]) > limit), None)
        said.append("timestamps beside the matrices" + ("" if unit is None else f", in {unit[0]}"))
        return column * (1.0 if unit is None else unit[1]), said
    return None, said
