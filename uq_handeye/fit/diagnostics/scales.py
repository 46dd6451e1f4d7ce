r"""Test of the lengths that cameras measure: a target of another size than given, by all its views or by one camera's.

With whitened rows ``e = rho + A (x, z)`` of a fit, a relative error of the lengths of some views adds the column
``b = D_C (0, t)``, t (m) the translations of these views. It is tested as a step in time is (`graph.steps_in_time`),
with one number d in place of six: corrected views are (1 + d) times as long. ``d^2 M`` over the chi-square by degree of
freedom that is left has the distribution F, also where the noise that was given is too small or too large. Errors of
scale that the noise holds are among the unknowns z, so that only what they leave is found. X takes up most of an error
of scale: by ``(x, z) = -H^-1 A^T b d`` the pose of a camera moves by

    times^2 = x_X^T Cov(X)^-1 x_X

in units of its stated covariance. Tried are all views of each target, and those by each of its cameras. The one with
the largest chi-square is named: an error of one camera is also some error of all of them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from ...core.geometry.se3 import Array
from ...core.levels import IMPOSSIBLE
from ...core.rounding import SOLUTION_ROUNDING
from ...findings import GROSS_EXCESS, Finding
from ...model.errors.keys import CAMERA_SCALE
from ...model.errors.sizes import Size
from ...model.errors.term import ErrorTerm
from ..graph.fit import RigFit
from ..graph.graph import Index
from ..graph.noise import OPEN_SCALE_SD
from ..graph.steps_in_time import FALSE_FINDING, differences, sums_of
from .residuals import MAX_TARGET_RATIO


def wrong_size(found: RigFit) -> tuple[Finding, ErrorTerm] | None:
    """Return the finding of a target that has another size than given, and the error that its views share.

    It is a failure where it is no chance and a camera is off by more than `GROSS_EXCESS` of its standard deviations,
    else a caution.
    """
    graph = found.graph
    tried = [(w, x) for w in _each(graph.W) for x in (None, *_each(graph.X[w == graph.W]))]
    lengths = [_lengths(graph.C, (w == graph.W) & ((x is None) | np.asarray(x == graph.X))) for w, x in tried]
    sums, none = np.zeros((len(tried), 1, len(found.whole) + 2)), np.zeros((len(graph.robot), 6))
    for part in found.rows:
        rows = part.white
        for total, longer in zip(sums, lengths, strict=True):
            total += sums_of(part.half @ part.by_errors(none, longer)[..., None], rows).sum(axis=0)
    squares, _, d, S = differences(found.whole, sums)
    best = int(np.argmax(squares))
    free = max(found.dof - 1, 1)
    left = max((found.chi_square - float(squares[best])) / free, GROSS_EXCESS**-2)  # of exact data it is rounding
    p = float(fdtrc(1, free, squares[best] / left)) * len(tried)
    size = 1.0 + float(d[best, 0])
    if p > FALSE_FINDING or not 1.0 / MAX_TARGET_RATIO < size < MAX_TARGET_RATIO:  # a wrong file, not a size
        return None
    w, x = tried[best]
    moved = -found.whole @ sums[best, 0, 1:-1] * d[best, 0]
    times = max(_distance(moved[6 * k : 6 * k + 6], found.covariance[6 * k :, 6 * k :][:6, :6]) for k in _each(graph.X))
    values = {
        "target": graph.names[w], "camera": None if x is None else graph.names[x], "size": size,
        "sd": float(np.sqrt(left * S[best, 0, 0])), "times": times, "p": p,
    }  # fmt: skip
    wrong = times > GROSS_EXCESS and p < IMPOSSIBLE.probability
    finding = Finding("rig.wrong_size", "failure" if wrong else "caution", values)
    return finding, ErrorTerm(CAMERA_SCALE, "camera", Size(OPEN_SCALE_SD), columns=lengths[best][..., None])


def _each(numbers: Index) -> list[int]:
    return [int(one) for one in np.unique(numbers)]


def _lengths(C: Array, of: NDArray[np.bool_]) -> Array:
    """(E, 6) change of the views ``of`` (E,) by a relative error 1 of their lengths."""
    return np.pad(C[:, :3, 3] * of[:, None], [(0, 0), (3, 0)])


def _distance(move: Array, S: Array) -> float:
    """Return the size of a move (6,) in units of a covariance, which is 0 along open directions."""
    return float(np.sqrt(move @ np.linalg.pinv(S, SOLUTION_ROUNDING, hermitian=True) @ move))
