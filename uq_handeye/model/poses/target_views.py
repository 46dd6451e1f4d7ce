"""Views of a target over the poses: the point of the target that moves least, and the spread of viewing directions."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array

# Largest spread of the directions in which a camera sees its target, over that of any other reading of the poses.
STEADY_VIEW = 0.5


def pivot_of(camera: Array) -> Array:
    """The point of the target (3,), in its frame, that moves least in the camera frame (least sum of distances).

    ``R_i s + t_i`` is the point s in view i; the sum is over its distances to their mean. Directions in which no
    rotation tells s are left at the mean position of the camera.
    """
    R, t = camera[:, :3, :3], camera[:, :3, 3]
    begin = -(R.mT @ t[..., None])[..., 0].mean(axis=0)
    t = t + R @ begin
    s, weights = np.zeros(3), np.full(len(t), 1.0 / len(t))
    for _ in range(5):  # steps, each with weights 1 / distance
        mean_R, mean_t = np.tensordot(weights, R, 1), weights @ t
        M = np.eye(3) - mean_R.T @ mean_R
        s = -np.linalg.pinv(M, rcond=1e-6, hermitian=True) @ (
            np.einsum("n,nij,ni->j", weights, R, t) - mean_R.T @ mean_t
        )
        away = R @ s + t
        distance = np.sqrt(((away - weights @ away) ** 2).sum(axis=1))
        weights = 1.0 / np.maximum(distance, 1e-3 * float(distance.max()) + 1e-300)
        weights /= weights.sum()
    return np.asarray(begin + s)


def direction_spread(T: Array) -> float:
    """RMS angle (rad) of the directions of the translations of poses (n, 4, 4) about their mean direction."""
    t = T[:, :3, 3]
    directions = t / np.maximum(np.linalg.norm(t, axis=1, keepdims=True), 1e-12)
    mean = np.mean(directions, axis=0)
    across = np.linalg.norm(np.cross(directions, mean), axis=1)
    return float(np.sqrt(np.mean(np.arctan2(across, directions @ mean) ** 2)))
