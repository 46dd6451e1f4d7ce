"""Base and tool of an arm and its URDF aligned over the workspace, and X in the aligned frames."""

from __future__ import annotations

import numpy as np

from studies.common.scores import errors
from studies.kinematics.arms import Rig, workspace_joints
from uq_handeye.core.geometry.se3 import Array, inverse, perturb

LEVER = 0.3  # m: what a rotation counts for where frames are aligned
ALIGNED_ON = 400


def X_aligned(rig: Rig, rng: np.random.Generator) -> tuple[Array, tuple[float, float]]:
    """X to the flange (base, eye-to-hand) in which the arm moves over its workspace as nearly as can be as the URDF
    says, and what is left of its errors there (RMS, m and rad).
    """
    A, B, accuracy = aligned(rig, workspace_joints(rig.kinematics, ALIGNED_ON, rng))
    # G = A N B: inv(X) inv(G) W = inv(B X) inv(N) inv(A) W, and inv(X) G W = inv(inv(A) X) N B W
    return B @ rig.X if rig.setup == "eye-in-hand" else inverse(A) @ rig.X, accuracy


def aligned(rig: Rig, q: Array) -> tuple[Array, Array, tuple[float, float]]:
    """A, B with ``FK(q; e) = A FK(q; 0) B`` by least squares, and the RMS distance and angle that are left."""
    true, nominal = rig.true_robot(q), rig.kinematics.poses(q)
    A, B = np.eye(4), np.eye(4)
    weight = np.repeat([LEVER, 1.0], 3)
    for _ in range(3):
        now = A @ nominal @ B
        left, right = np.zeros((len(q), 6, 6)), np.zeros((len(q), 6, 6))
        left[:], right[:, :3, :3], right[:, 3:, 3:] = np.eye(6), now[:, :3, :3], now[:, :3, :3]
        left[:, 3:, :3] = -cross(now[:, :3, 3])
        F = np.concatenate([left, right], axis=-1) * weight[:, None]
        a = np.linalg.lstsq(F.reshape(-1, 12), (errors(true, now) * weight).ravel(), rcond=None)[0]
        # left turns about the base's origin, right ones about the flange's
        A, B = perturb(np.eye(4), a[:6]) @ A, B @ perturb(np.eye(4), a[6:])
    e = errors(true, A @ nominal @ B)
    move, turn = (float(np.sqrt(np.mean(np.sum(e[:, part] ** 2, axis=-1)))) for part in (slice(3, 6), slice(3)))
    return A, B, (move, turn)


def cross(v: Array) -> Array:
    """[v]x (n, 3, 3)."""
    return np.asarray(np.cross(np.eye(3), v[:, None, :])).mT * -1.0
