"""The published methods beside a calibration, compared on its data."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, NotConvergedError
from ..poses.motions import spread_pairs
from ..poses.pose_pairs import PosePairs
from .compare import compare
from .result import Comparison
from .row import Row, against

if TYPE_CHECKING:
    from ..calibration.result import Calibration

# Methods are compared on all pairs of the poses, or on about so many of them.
COMPARED_PAIRS = 4000


class Compared(NamedTuple):
    """A comparison, or why there is none."""

    comparison: Comparison | None
    reason: str  # why there is none
    note: str  # on the data that were compared


def compare_beside(result: Calibration) -> Compared:
    """All published methods on the data of the result, without the poses that it rejected; its X is the reference.

    The noise is that of the result, given or estimated there. No time is measured.
    """
    data, noise, note = result.data, result.noise, ""
    if data is None:
        return Compared(
            None,
            "Not compared: this result was read from a file, which holds no poses. "
            "report(path, comparison=compare(poses, noise=noise)) shows the methods.",
            "",
        )
    if result.table is not None and result.table.rejected:
        kept = np.flatnonzero(result.table.weight > 0)
        data, noise = data.rows(kept), None if noise is None else noise.rows(kept)
        count = len(result.table.rejected)
        note = f" Without the {f'{count} {result.table.item}s' if count > 1 else result.table.item} rejected here."
    pairs: NDArray[np.intp] | str = "all"
    if isinstance(data, PosePairs):
        pairs = spread_pairs(data.n, COMPARED_PAIRS)
    elif data.N > COMPARED_PAIRS:
        some = np.linspace(0, data.N - 1, COMPARED_PAIRS).astype(np.intp)
        note += f" They are spread evenly over the {data.N:,} motions."
        data, noise = data.rows(some), None if noise is None else noise.rows(some)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # those that matter are in the table
            found = compare(data, noise=noise, pairs=pairs, timed=False)
    except (InputError, NotConvergedError) as error:
        return Compared(None, f"Not compared: {error}", "")
    available = data.n * (data.n - 1) // 2 if isinstance(data, PosePairs) else found.n_pairs
    base = Row(
        f"{result.method} (this result)",
        0,
        "",
        "",
        X=result.X,
        covariance=result.covariance,
        residuals=result.residuals,
    )
    rows = [against(row, base) for row in (base, *found.rows)]
    found = replace(found, rows=tuple(rows), reference=base.method, n_pairs_available=available)
    return Compared(found, "", note)
