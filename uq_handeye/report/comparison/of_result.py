"""The published methods beside a calibration, compared on its data."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...methods.estimators import METHODS
from ...model.poses.motions import relative_motions, spread_pairs
from ...model.poses.pose_pairs import PosePairs
from .compare import Work, compare_rows, explained_motions
from .result import Comparison
from .row import Row

if TYPE_CHECKING:
    from ...calibration.result import Calibration

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
    data, noise, note = result.counted, result.noise, ""
    if data is None:
        return Compared(
            None,
            "Not compared: this result was read from a file that holds no poses. "
            "report(path, comparison=compare(poses, noise=noise)) shows the methods.",
            "",
        )
    if result.table is not None and result.table.rejected:
        kept = np.flatnonzero(result.table.weight[result.table.counted] > 0)
        data, noise = (data.rows(kept), None) if noise is None else result.used
        count = len(result.table.rejected)
        note = f" Without the {f'{count} {result.table.item}s' if count > 1 else result.table.item} rejected here."
    if isinstance(data, PosePairs):
        available = data.n * (data.n - 1) // 2
        motions = relative_motions(data, spread_pairs(data.n, COMPARED_PAIRS))
    else:
        motions, available = data, min(data.N, COMPARED_PAIRS)
        if data.N > COMPARED_PAIRS:
            some = np.linspace(0, data.N - 1, COMPARED_PAIRS).astype(np.intp)
            note += f" They are spread evenly over the {data.N:,} motions."
            motions, noise = data.rows(some), None if noise is None else noise.rows(some)
    base = Row(
        f"{result.method} (this result)",
        None,
        "",
        "",
        X=result.X,
        covariance=result.covariance,
        residuals=result.residuals if result.residuals.pairs == motions.N else None,
        warnings=result.warnings,
    )
    names, estimated = [base.method, *METHODS], result.noise_estimate is not None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those that matter are in the table
        work = Work(motions, noise, estimated, available, explained_motions(result, motions))
        found = compare_rows(names, work, {base.method: base}, base.method)
    return Compared(found, "", note)
