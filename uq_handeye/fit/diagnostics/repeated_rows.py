"""Removal of poses that occur more than once, in any rows (files joined twice, rows copied): they count once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.limits import MIN_POSES
from ...findings import Finding
from ...model.poses.pose_numbers import Selection
from ...model.poses.pose_pairs import PosePairs

# Numbers (rad, m) that differ by less are the same apart from rounding: no camera is so precise.
SAME_NUMBER = 1e-6


def repeated_rows(poses: PosePairs) -> tuple[tuple[int, ...], ...]:
    """Return groups of poses that are equal within rounding, of robot and camera together.

    Each group holds the numbers of two or more equal pairs, ascending: the first is the original, the others add no
    information and are to count once with it. Groups are in the order of their first pose; poses without an equal are
    in none. A robot that stood still while the camera measured again gives no group: its camera poses differ.

    >>> import uq_handeye as uq
    >>> poses = uq.simulate(4, noise=uq.PoseNoise.isotropic(camera=("0.1deg", "0.5mm")), seed=1)
    >>> rows = [0, 1, 2, 3, 1, 0]
    >>> repeated_rows(uq.PosePairs(poses.robot[rows], poses.camera[rows]))
    ((0, 5), (1, 4))
    """
    if poses.robot.ndim != 3:
        return ()
    numbers = np.concatenate([T[:, :3].reshape(poses.n, 12) for T in (poses.robot, poses.camera)], axis=1)
    if not len(some := _near_in_all(numbers)):
        return ()
    from scipy.sparse import coo_array  # slow to import
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    single, where = np.unique(numbers[some] + 0.0, axis=0, return_inverse=True)
    near = KDTree(single).query_pairs(SAME_NUMBER * np.sqrt(24), output_type="ndarray")
    near = near[np.abs(single[near[:, 0]] - single[near[:, 1]]).max(axis=1, initial=0.0) <= SAME_NUMBER]
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(single), len(single)))
    label = connected_components(links, directed=False)[1][where.reshape(-1)]
    order = np.argsort(label, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return tuple(sorted(tuple(some[group].tolist()) for group in groups if len(group) > 1))


def _near_in_all(numbers: Array) -> NDArray[np.intp]:
    """Return the rows (k,) of numbers (n, 24) that have others near them in each number, and in their sum.

    Rows that are equal within rounding are in one chain of each of these numbers, whose neighbours are near.
    """
    some, chain = np.arange(len(numbers)), np.zeros(len(numbers), dtype=np.intp)
    for along in (np.ones(24), *np.eye(24)):
        values = numbers[some] @ along
        order = np.lexsort((values, chain))
        some, chain, values = some[order], chain[order], values[order]
        begins = (np.diff(chain, prepend=-1) != 0) | (np.diff(values, prepend=-np.inf) > 24 * SAME_NUMBER)
        chain = np.cumsum(begins)
        several = np.bincount(chain)[chain] > 1
        if not several.any():
            return some[:0]
        some, chain = some[several], chain[several]
    return np.sort(some)


def rows_again(poses: PosePairs) -> list[tuple[int, int]]:
    """Return each row that repeats an earlier one, with the first that it repeats, ascending."""
    return sorted((row, group[0]) for group in repeated_rows(poses) for row in group[1:])


def repeated_rows_finding(again: list[tuple[int, int]], n: int) -> Finding:
    """Return the finding about rows of n poses that repeat earlier ones."""
    values = {"file": "pose", "count": len(again), "n": n, "runs": runs_of(again)[:4]}
    return Finding("input_checks.repeated_rows", "caution", values)


def counted_once(poses: PosePairs, selected: Selection | None) -> tuple[Selection | None, list[Finding]]:
    """Return which poses count where those that repeat an earlier one count once with it, and the findings.

    ``selected``: those that were selected before. Nothing is left out where fewer than `MIN_POSES` poses would remain.
    """
    kept = np.arange(poses.n) if selected is None else selected.kept
    again = rows_again(poses if selected is None else poses.rows(kept))
    if not again or len(kept) - len(again) < MIN_POSES:
        return selected, []
    again = [(int(kept[row]), int(kept[first])) for row, first in again]
    left = np.setdiff1d(kept, [row for row, _ in again])
    return Selection(left, np.setdiff1d(np.arange(poses.n), left)), [repeated_rows_finding(again, poses.n)]


def runs_of(again: list[tuple[int, int]]) -> list[list[int]]:
    """Return runs ``[first, last, first of the originals]`` of repeated rows and their originals, both ascending.

    >>> runs_of([(3, 0), (4, 1), (7, 1)])
    [[3, 4, 0], [7, 7, 1]]
    """
    runs: list[list[int]] = []
    for row, original in again:
        if runs and row == runs[-1][1] + 1 and original == runs[-1][2] + row - runs[-1][0]:
            runs[-1][1] = row
        else:
            runs.append([row, row, original])
    return runs
