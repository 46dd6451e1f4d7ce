"""Choice of further touches: the candidates that make a bias known best."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from ...calibration.evidence.state import Calibrated
from ...calibration.evidence.touches import Touches, TouchEvidence, evidence_of_touches
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import InputError
from .power import detectable
from .result import NextTouch

# Views that are considered, and touches that are proposed.
MOST_VIEWS = 12
PROPOSED = 3


def next_touches(
    result: Calibrated,
    touches: Touches,
    evidence: TouchEvidence,
    level: float,
    candidates: Any = None,
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
    views = views[np.linspace(0, len(views) - 1, min(len(views), MOST_VIEWS)).round().astype(int)]
    points = _region(touches.seen) if candidates is None else _given(candidates)
    pairs = list(product(views.tolist(), points))
    rows = np.array([view for view, _ in pairs])
    more = replace(touches.rows(rows), seen=np.array([p for _, p in pairs]))
    at = evidence_of_touches(result, _touching(more, evidence, rows)).at
    more = _touching(replace(more, touched=None if more.touched is None else at), evidence, rows, at)
    new = evidence_of_touches(result, more)
    every = evidence_of_touches(result, _both(touches, more))
    m, chosen, found = touches.m, list(range(touches.m)), []
    for _ in range(PROPOSED):
        sizes = [detectable(every.rows([*chosen, m + j]), True, level) for j in range(len(pairs))]
        best = int(np.argmin(sizes))
        chosen.append(m + best)
        found.append(NextTouch(more.seen[best], new.at[best], int(rows[best]), float(sizes[best])))
    return tuple(found)


def _touching(more: Touches, evidence: TouchEvidence, rows: Array, at: Array | None = None) -> Touches:
    """The touches with the robot moved to the points, in the orientation of the touches that they are made of."""
    if more.touched_robot is None or at is None:
        return more
    poses = np.array(more.touched_robot)
    poses[:, :3, 3] += at - evidence.at[rows]
    return replace(more, touched_robot=poses)


def _both(one: Touches, other: Touches) -> Touches:
    parts: dict[str, Any] = {
        name: None if getattr(one, name) is None else np.concatenate([getattr(one, name), getattr(other, name)])
        for name in ("seen", "touched", "robot", "joints", "touched_robot", "touched_joints", "seen_covariance",
                     "touch_sd", "board", "board_covariance")
    }  # fmt: skip
    return replace(one, **parts, names=(*one.names, *other.names))


def _region(seen: Array) -> Array:
    """Corners and centre of the box of the points, each once."""
    low, high = seen.min(axis=0), seen.max(axis=0)
    corners = np.array([[(low, high)[bit][k] for k, bit in enumerate(bits)] for bits in product((0, 1), repeat=3)])
    return np.unique(np.vstack([corners, 0.5 * (low + high)]), axis=0)


def _given(candidates: Any) -> Array:
    points = np.atleast_2d(as_numbers(candidates, "candidates"))
    if points.ndim != 2 or points.shape[-1] != 3 or not len(points) or not np.isfinite(points).all():
        raise InputError(f"Expected `candidates` to be finite points (c, 3) in metres, got shape {points.shape}.")
    return points
