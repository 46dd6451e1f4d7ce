"""Arms whose accuracy over the workspace is known, base and tool aligned, and X in the aligned frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import uq_handeye as uq
from studies.common.scores import errors
from studies.kinematics import CAMERA, OF_ARM
from studies.kinematics.arms import Rig, drawn_rig, home, local_joints, workspace_joints
from uq_handeye.core.geometry.se3 import Array, inverse, perturb

PLACES = ("one region", "wide")
FACTOR = 2.0  # of the scales of the errors, from arm to arm
WIDE = np.radians(50.0)  # of each joint, about home
LEVER = 0.3  # m: what a rotation counts for where frames are aligned
ALIGNED_ON = 400


@dataclass(frozen=True, eq=False)
class Session:
    """Session to calibrate, and what is known about it."""

    poses: uq.PosePairs
    X: Array  # to the flange (base) of the aligned nominal arm
    accuracy: tuple[float, float]  # m, rad: RMS over the workspace


def session(name: str, setup: str, place: str, n: int, rng: np.random.Generator) -> Session:
    """One arm with errors of its own, and n poses of it."""
    scales, joint_sd, _ = OF_ARM[name]
    spread = FACTOR ** rng.standard_normal(len(scales))
    drawn = dict(zip(scales, spread * list(scales.values()), strict=True))
    rig = drawn_rig(name, setup, drawn, rng, joint_sd=joint_sd, camera_sd=np.repeat(CAMERA, 3))
    A, B, accuracy = aligned(rig, workspace_joints(rig.kinematics, ALIGNED_ON, rng))
    poses = rig.poses(joints(rig, name, place, n, rng), rng)
    # G = A N B: inv(X) inv(G) W = inv(B X) inv(N) inv(A) W, and inv(X) G W = inv(inv(A) X) N B W
    X = B @ rig.X if setup == "eye-in-hand" else inverse(A) @ rig.X
    return Session(uq.PosePairs(poses.robot, poses.camera, setup), X, accuracy)


def joints(rig: Rig, name: str, place: str, n: int, rng: np.random.Generator) -> Array:
    if place == "one region":
        return local_joints(rig, name, n, rng)
    low, high = rig.kinematics.limits.T
    found = np.empty((0, rig.kinematics.n_joints))
    while len(found) < n:
        q = home(name) + rng.uniform(-WIDE, WIDE, (2 * n, rig.kinematics.n_joints))
        inside = ((q > low) & (q < high)).all(axis=-1) & (rig.kinematics.poses(q)[:, 2, 3] > 0.0)
        found = np.concatenate([found, q[inside]])
    return found[:n]


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
