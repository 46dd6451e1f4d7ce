"""Scale of camera poses by screws, without X.

A motion A of the robot and B of the camera, ``A X = X B``, rotate by the same angle and travel by the same distance
along their axes, whatever X is (Chen's screw congruence). With ``d = u . t`` along the axis u of each motion

    d_A = s d_B,     s = sum w d_A d_B / sum w d_B^2

over the motions of all pairs of poses, with Cauchy weights. It is right for one axis of rotation too, where the least
squares of (t_X, s) is singular.
"""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array, inverse, logarithm

# Angles (rad) of motions that are used; largest relative standard deviation of the scale that is an answer.
MIN_ANGLE, MAX_ANGLE = np.radians(5.0), np.radians(175.0)
MAX_SPREAD = 0.05
# Poses of which all motions are made at most.
MAX_POSES_OF_MOTIONS = 200


def scale_by_screws(G: Array, C: Array) -> tuple[float, float] | None:
    """Metres of the robot poses G (n, 4, 4) per unit of the camera poses C, and the relative standard deviation.

    ``G X C = W``; for eye-to-hand G are the inverse robot poses. None where the motions do not tell the scale.
    """
    n = len(G)
    rows = np.unique(np.linspace(0, n - 1, min(n, MAX_POSES_OF_MOTIONS)).round().astype(np.intp))
    i, j = (rows[one] for one in np.triu_indices(len(rows), 1))
    if not len(i):
        return None
    travel, angles = [], []
    for motions in (inverse(G[j]) @ G[i], C[j] @ inverse(C[i])):
        theta = logarithm(motions[:, :3, :3])
        angle = np.linalg.norm(theta, axis=-1)
        angles.append(angle)
        travel.append(np.sum(theta * motions[:, :3, 3], axis=-1) / np.maximum(angle, 1e-12))
    used = (angles[0] > MIN_ANGLE) & (angles[0] < MAX_ANGLE) & (angles[1] > MIN_ANGLE) & (angles[1] < MAX_ANGLE)
    a, b = travel[0][used], travel[1][used]
    if len(a) < 3 or not np.abs(b).max(initial=0.0) > 0:
        return None
    order = np.argsort(a / np.where(b == 0, np.inf, b))
    share = np.cumsum(np.abs(b)[order])
    s = float((a / np.where(b == 0, np.inf, b))[order][np.searchsorted(share, 0.5 * share[-1])])
    for _ in range(30):  # iterations of the weights
        off = a - s * b
        spread = max(float(np.median(np.abs(off))), 1e-12 * float(np.abs(a).max()))
        w = 1.0 / (1.0 + (off / (2.0 * spread)) ** 2)
        s = float(np.sum(w * a * b) / np.sum(w * b * b))
    # motions of n poses are no more than n - 1 measurements
    sd = float(np.sqrt(np.sum(w * off**2) / np.sum(w) / np.sum(w * b * b) * len(a) / (n - 1)))
    if s <= 0 or sd > MAX_SPREAD * s:
        return None
    return s, sd / s
