r"""Random walk of camera poses that come from odometry: each step adds an error of its own to all later poses.

Model: ``T_k = T_{k-1} dT_k exp(n_k)`` for the poses T = target_T_camera of visual odometry, n_k drawn at each step,
rotation and translation with a size each (rad, m a step). To first order the pose k has, in the target's frame, the
twist

    g_k = sum_{j <= k} Ad(T_j) n_j

The n_j of one axis over the steps are a sum of the first `MODES` cosines, each with a number of its own: columns that
all poses share. The rest is faster than 2 n / `MODES` steps, and counts as noise of each pose.

*Scale*: where the scale of the camera poses is not known, its logarithm may walk as well.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, inverse, skew
from ..errors.key import ErrorKey, Kind
from ..errors.keys import WALKS
from ..errors.sizes import SIZES
from ..poses.pose_pairs import PosePairs
from .shared_error import SharedError, the_same

# Cosines of each axis.
MODES = 40


def assumed_walk(poses: PosePairs, scale: bool = False) -> tuple[SharedError, ...]:
    """Return the random walk over the order of the timestamps, or of the rows where there are none.

    ``scale``: with that of the scale.
    """
    n = poses.n
    modes = min(n, MODES)
    order = np.arange(n) if poses.timestamps is None else np.argsort(poses.timestamps, kind="stable")
    back = np.argsort(order, kind="stable")
    step = np.ones(n)
    if poses.timestamps is not None:
        between = np.diff(poses.timestamps[order])
        step[1:] = np.sqrt(between / np.median(between))
    steps = np.sqrt(2.0 / n) * np.cos(np.pi * np.outer(np.arange(n) + 0.5, np.arange(modes)) / n)
    steps[:, 0] = np.sqrt(1.0 / n)
    steps *= step[:, None]
    rest = n / (np.pi**2 * modes) if modes < n else 0.0
    C = poses.camera[order]
    T = inverse(C)
    turned = np.concatenate([T[:, :3, :3], skew(T[:, :3, 3]) @ T[:, :3, :3]], axis=1)
    moved = np.concatenate([np.zeros((n, 3, 3)), T[:, :3, :3]], axis=1)
    found = []
    of_steps = ((Kind.WALK_IN_ROTATION, turned, slice(0, 3)), (Kind.WALK_IN_TRANSLATION, moved, slice(3, 6)))
    for kind, Ad, rows in of_steps:
        g = np.cumsum(Ad[..., None] * steps[:, None, None, :], axis=0)
        g = (g - g.mean(axis=0)).reshape(n, 2, 3, -1)
        F = (C[:, None, :3, :3] @ g).reshape(n, 6, -1)[back]
        left = np.zeros((n, 6, 6))
        left[:, range(rows.start, rows.stop), range(rows.start, rows.stop)] = rest
        found.append(_walk(WALKS[kind], F, left))
    if scale:
        path = np.cumsum(steps, axis=0)
        tau = C[:, :3, 3:] * (path - path.mean(axis=0))[:, None, :]
        along = np.pad(C[:, :3, 3:], [(0, 0), (3, 0), (0, 0)])
        F = np.concatenate([np.zeros_like(tau), tau], axis=1)[back]
        found.append(_walk(WALKS[Kind.WALK_IN_SCALE], F, (rest * along @ along.mT)[back]))
    return tuple(found)


def _walk(key: ErrorKey, F: Array, left: Array) -> SharedError:
    size = SIZES[key]
    keys = tuple(key.number(k + 1) for k in range(F.shape[-1]))
    sd = np.full(len(keys), size.median)
    return SharedError(
        key, "", "camera", sd, keys, the_same(F), factor=size.factor, default=True, left=left if left.any() else None
    )
