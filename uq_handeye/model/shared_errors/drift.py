r"""Drift: a camera mount or a target that creeps while the poses are taken.

Model: a random walk of six components (theta, tau) over the poses in the order of their time, each with one standard
deviation a step (rad, m). Its slow part is in the first `MODES` terms of the Karhunen-Loeve expansion over n steps,

    b(i) = sum_k z_k sqrt(2 n) sin((k - 1/2) pi i / n) / ((k - 1/2) pi)

so that drift is so many columns times six. What moves is the *camera*, about its own origin (a left error of
``camera_T_target``), or the *target*, about its own (a right one). There is no drift where there are no timestamps: the
order of the rows of a file means nothing.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array

DRIFT = "drift of the"
MODES = 6
# Poses below which a drift is not told from anything.
FEWEST = 6


def drift_columns(camera: Array, timestamps: Array, target: bool) -> Array:
    """(n, 6, 6 m) columns at poses (n, 4, 4) camera_T_target, per step of 1 rad and 1 m."""
    n = len(camera)
    place = np.empty(n)
    place[np.argsort(timestamps, kind="stable")] = np.arange(1, n + 1)
    rate = (np.arange(1, min(MODES, n) + 1) - 0.5) * np.pi
    walk = np.sqrt(2.0 * n) * np.sin(np.outer(place / n, rate)) / rate
    walk = walk - walk.mean(axis=0)  # the mean is in X or W
    E = np.zeros((n, 6, 6))
    if target:
        E[:, :3, :3] = E[:, 3:, 3:] = camera[:, :3, :3]
    else:
        E[:] = np.eye(6)
    return np.asarray(np.einsum("nm,nik->nimk", walk, E).reshape(n, 6, -1))
