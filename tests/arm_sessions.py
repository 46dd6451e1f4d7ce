"""Calibration sessions of a simulated arm whose kinematics are wrong: poses with joints, and the truth."""

from typing import NamedTuple

import numpy as np
from arm_cases import SIX_AXES, motion
from calibration_cases import quietly
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.model.kinematics.arms.newton import postures_at
from uq_handeye.model.kinematics.chain import Kinematics

DEGREE = np.pi / 180
# Of the arm, as they are declared.
ERRORS = {"offset_sd": 2e-3, "tilt_sd": 0.6e-3, "length_sd": 0.2e-3, "transmission_sd": 0.3e-3, "sag_sd": 1e-3}
JOINT_SD = 1e-4
CAMERA = (0.3e-3, 0.2e-3)  # rad, m
X = motion((0.1, -0.2, 0.4), (0.03, -0.05, 0.06))
W = motion((0.02, 0.03, 0.5), (0.5, 0.05, 0.0))


class Session(NamedTuple):
    """An arm, its true errors, and what was measured."""

    chain: Kinematics
    e: np.ndarray
    poses: uq.PosePairs
    q: np.ndarray


def chain():
    return Kinematics.from_urdf(SIX_AXES, tip="tool0")


def declared(how="declared"):
    return uq.KinematicErrors(how, **ERRORS, joint_sd=JOINT_SD)


def drawn_errors(arm, rng):
    """Errors of the groups with the declared standard deviations, none of them of the gauge."""
    sd = declared().standard_deviations
    return np.array([0.0 if error.gauge else rng.normal() * sd[error.group] for error in arm.errors])


def looking(arm, rng, n, spread):
    """Joints (n, L) from which the camera (eye-in-hand) sees the target from above, tilted by up to ``spread``."""
    size = 10 * n
    tilt = Rotation.from_rotvec(rng.uniform(-spread, spread, (size, 3)) * [1, 1, 2])
    C = np.zeros((size, 4, 4))  # camera_T_target
    C[:, :3, :3] = (Rotation.from_euler("x", np.pi) * tilt).as_matrix()
    C[:, :2, 3] = rng.uniform(-0.03, 0.03, (size, 2))
    C[:, 2, 3], C[:, 3, 3] = rng.uniform(0.25, 0.25 + 0.3 * spread, size), 1.0
    poses = W @ np.linalg.inv(C) @ np.linalg.inv(X)
    start = np.array([0.0, 0.5, 0.1, -0.5, -0.8, 2.9])
    found = postures_at(arm, poses, np.tile(start, (size, 1)))
    near = found.reached & (np.abs(found.q - start) < 1.2).all(axis=-1)  # the same branch of the wrist
    assert near.sum() >= n, "the target is out of reach"
    return found.q[near][:n]


def measured(arm, e, q, rng, setup="eye-in-hand", noise=1.0):
    """Poses with joints, of an arm with errors e that are not known."""
    true = arm.poses(q + noise * JOINT_SD * rng.normal(size=q.shape), e)
    G = true if setup == "eye-in-hand" else np.linalg.inv(true)
    C = np.linalg.inv(X) @ np.linalg.inv(G) @ W
    turn = Rotation.from_rotvec(noise * CAMERA[0] * rng.normal(size=(len(q), 3))).as_matrix()
    C[:, :3, :3] = turn @ C[:, :3, :3]
    C[:, :3, 3] += noise * CAMERA[1] * rng.normal(size=(len(q), 3))
    return uq.PosePairs(arm.poses(q), C, setup, joints=q)


def session(seed=0, n=20, spread=0.2):
    """Eye-in-hand, poses from one region."""
    rng = np.random.default_rng(seed)
    arm = chain()
    e = drawn_errors(arm, rng)
    q = looking(arm, rng, n, spread)
    return Session(arm, e, measured(arm, e, q, rng), q)


def camera_noise():
    turn, shift = CAMERA
    return uq.PoseNoise.isotropic(camera=(turn, shift))


def calibrated(case, how="declared"):
    """Its calibration with joints; residuals of the nominal arm may look like outliers."""
    return quietly(case.poses, kinematics=case.chain, kinematic_errors=declared(how))
