"""Choice of the touches to add to a verification: those after which the smallest bias would show.

Candidates are points of the region seen so far, or those given, from each robot pose at which points were seen. They
are chosen one after the other.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.estimated import Estimated
from ...calibration.evidence.touches import Touches, TouchEvidence, evidence_of_touches
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import InputError
from .power import bias_of
from .result import NextTouch


def next_touches(
    result: Estimated,
    touches: Touches,
    evidence: TouchEvidence,
    level: float,
    candidates: ArrayLike | None = None,
    *,
    max_views: int = 12,
    count: int = 3,
) -> tuple[NextTouch, ...]:
    """Choose touches one after the other, each the one after which the smallest bias would show.

    Candidates are points of the region seen so far (the corners of its box and its centre), or those given, from each
    robot pose at which points were seen. A touch has the orientation of the tool of its view's touch.
    """
    views = np.arange(touches.m)
    if result.setup == "eye-in-hand" or touches.board is not None:
        first = evidence.at * 0.0 if touches.robot is None else touches.robot[:, :3, 3]
        keys = first if touches.board is None else np.hstack([first, touches.board[:, :3, 3]])
        views = np.sort(np.unique(keys, axis=0, return_index=True)[1])
    else:
        views = views[:1]
    views = views[np.linspace(0, len(views) - 1, min(len(views), max_views)).round().astype(int)]
    points = _region(touches.seen) if candidates is None else _given(candidates)
    pairs = list(product(views.tolist(), points))
    rows = np.array([view for view, _ in pairs])
    more = replace(touches.rows(rows), seen=np.array([p for _, p in pairs]))
    at = evidence_of_touches(result, more).at
    more = replace(more, touched=None if more.touched is None else at)
    if more.touched_robot is not None:  # moved to the points, in the orientation of the touches they are made of
        poses = np.array(more.touched_robot)
        poses[:, :3, 3] += at - evidence.at[rows]
        more = replace(more, touched_robot=poses)
    new = evidence_of_touches(result, more)
    every = evidence_of_touches(result, touches.joined(more))
    m, chosen, found = touches.m, list(range(touches.m)), []
    for _ in range(count):
        sizes = [bias_of(every.rows(np.array([*chosen, m + j]))).detectable(level) for j in range(len(pairs))]
        best = int(np.argmin(sizes))
        chosen.append(m + best)
        found.append(NextTouch(more.seen[best], new.at[best], int(rows[best]), float(sizes[best])))
    return tuple(found)


def _region(seen: Array) -> Array:
    """Corners and centre of the box of the points, each once."""
    ends = np.stack([seen.min(axis=0), seen.max(axis=0)], axis=1)
    return np.unique([*product(*ends), ends.mean(axis=1)], axis=0)


def _given(candidates: ArrayLike) -> Array:
    points = np.atleast_2d(as_numbers(candidates, "candidates"))
    if points.ndim != 2 or points.shape[-1] != 3 or not len(points) or not np.isfinite(points).all():
        raise InputError(f"Expected `candidates` to be finite points (c, 3) in metres, got shape {points.shape}.")
    return points
