"""Arms whose accuracy over the workspace is known, base and tool aligned, and X in the aligned frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import uq_handeye as uq
from studies.kinematics import CAMERA, OF_ARM
from studies.kinematics.aligned import X_aligned
from studies.kinematics.arms import Rig, drawn_rig, home, local_joints
from uq_handeye.core.geometry.se3 import Array

PLACES = ("one region", "wide")
FACTOR = 2.0  # of the scales of the errors, from arm to arm
WIDE = np.radians(50.0)  # of each joint, about home


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
    X, accuracy = X_aligned(rig, rng)
    poses = rig.poses(joints(rig, name, place, n, rng), rng)
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
