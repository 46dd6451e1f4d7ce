r"""Detection of rows of two pose files that were paired with a shift, by rotation angles, confirmed by a fit.

Model: robot row i was taken at the moment of camera row ``i + k(i)``, k constant over long stretches of the file. A
detection that failed and was left out moves all later camera rows up by one (k falls by 1), a camera row without a
robot row moves them down (k grows by 1), and a file cut at the wrong place shifts them all.

For rows i, j that belong to camera rows i', j', the motions A and B of ``A X = X B`` are similar matrices, so that
whatever X is, both rotate by the same angle:

    angle(R_i^T R_j) = angle(R'_i' R'_j'^T)                                                    (both setups, rad)

The cost of "robot row i belongs to camera row i + k" is the mean over several lags l of the bounded difference of the
angles of (i, i + l) and (i + k, i + k + l), or of the lags backwards, whichever is smaller: next to a row where k
changes, one of the two sides has the same k. The path k(i) with the smallest sum of costs, a price for each change
included, is found by dynamic programming (Viterbi) in O(n K).

A shift that the angles suggest is reported only if a fit confirms it. X and W are fitted robustly (`robust.consensus`)
to the rows as paired again; their residuals take the place of the angles as the cost, which gives the rows of the
changes. Over the rows that moved, the median residuals of rotation and of translation must both fall below
`CONFIRMED_RATIO` of what they are in a robust fit to the rows as given, and must be like those of the rows that did not
move.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import DegenerateMotionError, InputError
from ...findings import Finding
from ...model.poses.pose_pairs import PosePairs
from ...model.poses.residuals import rotation_angles
from ..graph.consensus import consensus, misfit
from ..graph.constraint import OnPoses, Unknowns
from .repeated_rows import SAME_NUMBER

# Motions are compared over this many lags: 1, 2, 3, ... times the smallest one over which the robot rotates enough.
LAGS = 6
# The robot rotates enough over a lag if the median of its angles is above this.
LAG_ROTATION_RAD = np.radians(8.0)
# Price of a change of the shift, in rows that do not fit at all.
CHANGE_COST = 3.0
# The cost of a row without a partner: as much as one that half fits.
UNPAIRED_COST = 0.5
# Differences of angles count in full from this multiple of their typical size on.
MAX_DIFFERENCE_RATIO = 6.0
# Wrong rows among which exchanged ones are looked for, at most.
MAX_EXCHANGED = 40
# Rows below which a stretch, or a whole file, proves nothing. Once there is a fit, half of them do.
MIN_STRETCH_ROWS = 6
# The median residuals of the rows that moved must fall to this share of what they were.
CONFIRMED_RATIO = 0.3
# They may be this many times as large as those of the rows that did not move.
SIMILAR_RESIDUAL_RATIO = 3.0


@dataclass(frozen=True, eq=False)
class Shift(ReadOnlyArrays):
    """A pairing other than row by row."""

    robot_rows: NDArray[np.intp]  # (m,) rows that have a partner, and
    camera_rows: NDArray[np.intp]  # (m,) the partners
    stretches: tuple[tuple[int, int, int], ...]  # (first robot row, first one after it, k): row i belongs to i + k
    ratio: tuple[float, float]  # median residual (rotation, translation) of the rows that moved, new : as given
    n: int  # rows as given

    @property
    def finding(self) -> Finding:
        """Finding that says which rows belong together, which to leave out, and what it changes."""
        robot, camera = (np.setdiff1d(np.arange(self.n), rows) for rows in (self.robot_rows, self.camera_rows))
        rotation, translation = self.ratio
        values = {
            "stretches": self.stretches,
            "robot_left_out": robot,
            "camera_left_out": camera,
            "rotation": rotation,
            "translation": translation,
        }
        return Finding("input_checks.shifted_rows", "failure", values)

    def apply(self, poses: PosePairs) -> PosePairs:
        """Return the poses paired again; timestamps are those of the robot rows."""
        return poses.rows(self.robot_rows, self.camera_rows)


def find_shift(poses: PosePairs, max_shift: int = 50) -> Shift | None:
    """Return the shift of the camera rows against the robot rows, whole or from some row on, or None if there is none.

    Parameters
    ----------
    poses : PosePairs
        n pairs as given, in the order in which they were taken; no leading axes.
    max_shift : int
        The largest shift that is tried, in rows; a third of the rows at most.

    Returns
    -------
    Shift or None
        None where the rows fit as they are; where no shift makes the residuals of the rows that
        it moves fall below 0.3 of theirs; and where rows hardly move from one to the next, so that a shift does not
        show.

    Raises
    ------
    InputError
        ``poses`` that are not PosePairs, or have leading axes.
    """
    if not isinstance(poses, PosePairs) or poses.robot.ndim != 3:
        raise InputError("Expected `poses` to be PosePairs of one data set, without leading axes.")
    n = poses.n
    if n < 2 * MIN_STRETCH_ROWS:
        return None
    most = min(n // 3, max_shift)
    shifts = np.arange(-most, most + 1)
    stretches = _stretches(shifts[_viterbi(_angle_cost(poses, shifts))], MIN_STRETCH_ROWS)
    if stretches == [(0, n, 0)]:
        return None
    as_given = OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")
    robot_rows, camera_rows = _rows(stretches, n)
    anew = OnPoses(poses.robot[robot_rows], poses.camera[camera_rows], as_given.inverted)
    if len(robot_rows) < max(MIN_STRETCH_ROWS, n // 2):
        return None
    rng = np.random.default_rng(0)
    try:
        found = consensus(anew, None, rng).unknowns
        given = consensus(as_given, None, rng).unknowns
    except DegenerateMotionError:
        return None  # no fit, nothing to confirm it with
    squares = np.median(misfit(anew, found), axis=0)
    cost = _residual_cost(as_given, found, squares, shifts)
    stretches = _refined(_stretches(shifts[_viterbi(cost)], MIN_STRETCH_ROWS // 2), cost, shifts)
    robot_rows, camera_rows = _rows(stretches, n)
    moved = robot_rows != camera_rows
    if moved.sum() < MIN_STRETCH_ROWS:
        return None
    now = np.sqrt(misfit(OnPoses(poses.robot[robot_rows], poses.camera[camera_rows], as_given.inverted), found))
    before = np.sqrt(misfit(as_given, given))[robot_rows[moved]]
    fits, others = np.median(now[moved], axis=0), now[~moved]
    ratio = fits / np.maximum(np.median(before, axis=0), 1e-12)
    if max(abs(k) for _, _, k in stretches) == most:
        return None  # the edge of what was looked at: the true shift may lie beyond
    unlike = len(others) >= MIN_STRETCH_ROWS and bool(
        (fits > SIMILAR_RESIDUAL_RATIO * np.median(others, axis=0) + SAME_NUMBER).any()
    )
    if unlike or not (ratio < CONFIRMED_RATIO).all():
        return None
    return Shift(robot_rows, camera_rows, tuple(stretches), (float(ratio[0]), float(ratio[1])), n)


def shifted_run(poses: PosePairs, at: Unknowns, wrong: NDArray[np.bool_], ratio: float = 4.0) -> Finding | None:
    """Return a finding if wrong rows in a run, too few for `find_shift`, fit their neighbours in the run.

    ``at`` is what the other poses agree on. Rows fit if their residuals stay below ``ratio`` times the median. Where a
    row is lost near an end of the file, all rows from there to the end are wrong, and fit once they are moved by one.
    """
    inverted = poses.setup == "eye-to-hand"
    typical = np.median(misfit(OnPoses(poses.robot[~wrong], poses.camera[~wrong], inverted), at), axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(int))).reshape(-1, 2)
    for first, after in edges.tolist():
        for shift in (-1, 1, -2, 2):
            rows = np.arange(max(first, first - shift), min(after, after - shift))
            if len(rows) < 2:
                continue
            moved = misfit(OnPoses(poses.robot[rows], poses.camera[rows + shift], inverted), at)
            if (moved < ratio**2 * typical + SAME_NUMBER**2).all():
                values = {
                    "first": int(rows[0]),
                    "last": int(rows[-1]),
                    "shift": shift,
                    "lacks": "camera" if shift < 0 else "robot",
                    "near": first,
                }
                return Finding("input_checks.shifted_run", "caution", values)
    return None


def exchanged_rows(poses: PosePairs, at: Unknowns, wrong: NDArray[np.bool_], ratio: float = 4.0) -> Finding | None:
    """Return a finding if wrong rows fit, two by two, with the camera poses of each other.

    ``at`` is what the other poses agree on. Rows fit if their residuals stay below ``ratio`` times the median.
    """
    rows = np.flatnonzero(wrong)
    if not 2 <= len(rows) <= MAX_EXCHANGED or wrong.all():
        return None
    inverted = poses.setup == "eye-to-hand"
    typical = np.median(misfit(OnPoses(poses.robot[~wrong], poses.camera[~wrong], inverted), at), axis=0)
    limit = ratio**2 * typical + SAME_NUMBER**2
    i, j = np.triu_indices(len(rows), 1)
    fits = [
        (misfit(OnPoses(poses.robot[rows[a]], poses.camera[rows[b]], inverted), at) < limit).all(axis=-1)
        for a, b in ((i, j), (j, i))
    ]
    pairs = [(int(rows[a]), int(rows[b])) for a, b in zip(i[fits[0] & fits[1]], j[fits[0] & fits[1]], strict=True)]
    if not pairs or len({row for pair in pairs for row in pair}) < 2 * len(pairs):
        return None
    return Finding("input_checks.exchanged_rows", "caution", {"pairs": [list(pair) for pair in pairs]})


def _angle_cost(poses: PosePairs, shifts: NDArray[np.intp]) -> Array:
    """Return the cost (n, K) in [0, 1] of each partner by the angles of the motions from and to it."""
    n = poses.n
    base = _base_lag(poses.robot[:, :3, :3])
    # difference[i, k, l] of the angles over lag l from robot row i and from camera row i + k; NaN outside
    forward = np.full((n, len(shifts), LAGS), np.nan)
    backward = np.full_like(forward, np.nan)
    partner = np.arange(n)[:, None] + shifts
    for column in range(LAGS):
        lag = base * (column + 1)
        if lag >= n:
            break
        robot, camera = (_angles(T[:, :3, :3], lag, inner) for T, inner in ((poses.robot, True), (poses.camera, False)))
        inside = (partner[: n - lag] >= 0) & (partner[: n - lag] < n - lag)
        difference = np.abs(robot[:, None] - camera[np.where(inside, partner[: n - lag], 0)])
        difference[~inside] = np.nan
        forward[: n - lag, :, column] = difference
        backward[lag:, :, column] = difference
    size = min(_typical(forward), _typical(backward))
    cost = np.minimum(_cost(forward, size), _cost(backward, size))
    # A row without a partner costs the same whatever k.
    cost[(partner < 0) | (partner >= n)] = UNPAIRED_COST
    return cost


def _base_lag(R: Array) -> int:
    """Return the smallest lag over which the robot mostly rotates enough, at most a twelfth of the rows."""
    n = len(R)
    lag, largest = 1, max(1, n // (2 * LAGS))
    while lag < largest and np.median(_angles(R, lag, True)) < LAG_ROTATION_RAD:
        lag = min(largest, lag + max(1, lag // 2))
    return lag


def _angles(R: Array, lag: int, inner: bool) -> Array:
    """Angle (n - lag,) of ``R_i^T R_(i + lag)`` (``inner``) or of ``R_i R_(i + lag)^T``."""
    first, second = R[:-lag], R[lag:]
    return np.asarray(rotation_angles(first.mT @ second if inner else first @ second.mT))


def _typical(difference: Array) -> float:
    """Return the usual size of angle differences where rows belong together: the median over rows of the best shift."""
    known = np.isfinite(difference).sum(axis=-1)
    mean = np.where(known >= 3, np.nansum(difference, axis=-1) / np.maximum(known, 1), np.inf)
    best = mean.min(axis=1)
    best = best[np.isfinite(best)]
    return max(float(np.median(best)), SAME_NUMBER) if best.size else np.inf


def _cost(difference: Array, size: float) -> Array:
    """Mean over the lags of the bounded squared difference; 1 where fewer than two lags lie inside."""
    known = np.isfinite(difference)
    bounded = np.minimum(np.where(known, difference, 0.0) / (MAX_DIFFERENCE_RATIO * size), 1.0) ** 2
    count = known.sum(axis=-1)
    return np.where(count >= 2, (bounded * known).sum(axis=-1) / np.maximum(count, 1), 1.0)


def _viterbi(cost: Array) -> NDArray[np.intp]:
    """Return the column (n,) of each row with the smallest sum of ``cost`` (n, K) and CHANGE_COST for each change."""
    n, K = cost.shape
    total, came = cost[0], np.empty((n, K), dtype=np.intp)
    stay = np.arange(K)
    for i in range(1, n):  # each row needs the one before it
        best = int(np.argmin(total))
        change = total > total[best] + CHANGE_COST
        came[i] = np.where(change, best, stay)
        total = cost[i] + np.where(change, total[best] + CHANGE_COST, total)
    path = np.empty(n, dtype=np.intp)
    path[-1] = int(np.argmin(total))
    for i in range(n - 1, 0, -1):
        path[i - 1] = came[i, path[i]]
    return path


def _stretches(path: NDArray[np.intp], fewest: int) -> list[tuple[int, int, int]]:
    """(first row, row after the last, k); those shorter than ``fewest`` are joined to the one before them."""
    edges = [0, *(np.flatnonzero(np.diff(path)) + 1).tolist(), len(path)]
    found: list[tuple[int, int, int]] = []
    start = 0
    for first, after in pairwise(edges):
        k = int(path[first])
        if after - first < fewest:
            if found:
                found[-1] = (found[-1][0], after, found[-1][2])
                start = after
            continue  # else the next one begins at `start`
        if found and found[-1][2] == k:
            found[-1] = (found[-1][0], after, k)
        else:
            found.append((start, after, k))
        start = after
    return found or [(0, len(path), 0)]


def _rows(stretches: list[tuple[int, int, int]], n: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Robot rows and their camera rows, without those that have no partner or would share one."""
    robot, camera = [], []
    for s, (first, after, k) in enumerate(stretches):
        dropped = max(0, stretches[s - 1][2] - k) if s else 0
        rows = np.arange(first + dropped, after)
        rows = rows[(rows + k >= 0) & (rows + k < n)]
        robot.append(rows)
        camera.append(rows + k)
    return np.concatenate(robot), np.concatenate(camera)


def _residual_cost(
    as_given: OnPoses, unknowns: Unknowns, squares: Array, shifts: NDArray[np.intp], limit: float = 50.0
) -> Array:
    """Return the cost (n, K) in [0, 1] of each partner by its squared residuals.

    They are in units of the medians ``squares`` (2,), and count up to ``limit`` of these.
    """
    n = len(as_given.first)
    cost = np.full((n, len(shifts)), UNPAIRED_COST)
    for column, k in enumerate(shifts):
        rows = np.arange(max(0, -k), min(n, n - k))
        pairs = OnPoses(as_given.first[rows], as_given.second[rows + k], as_given.inverted)
        cost[rows, column] = np.minimum(
            (misfit(pairs, unknowns) / np.maximum(squares, 1e-24)).sum(axis=-1) / limit, 1.0
        )
    return cost


def _refined(
    stretches: list[tuple[int, int, int]], cost: Array, shifts: NDArray[np.intp]
) -> list[tuple[int, int, int]]:
    """Return the stretches with each change moved to its best place.

    The path of smallest cost cannot choose which of the rows at a change have no partner.
    """
    found = list(stretches)
    for s in range(len(found) - 1):
        (first, edge, old), (_, after, new) = found[s], found[s + 1]
        if (dropped := old - new) <= 0 or dropped > after - first:  # or there is no room for a better place
            continue
        by_old, by_new = (np.concatenate([[0.0], np.cumsum(cost[first:after, k - shifts[0]])]) for k in (old, new))
        begins = np.arange(after - first - dropped + 1)  # rows of the stretch before; then come those without a partner
        total = by_old[begins] - by_new[begins + dropped]
        edge = first + int(begins[np.argmin(total)])
        found[s], found[s + 1] = (first, edge, old), (edge, after, new)
    return found
