"""Rigs that cannot turn about two axes, with the directions of X and W that they leave open; an own simulator."""

import numpy as np
from support import difference, draw, moved, random_transforms, rotations, transforms

import uq_handeye as uq

KINDS = ("scara", "vehicle", "gantry", "turntable", "oblique")
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
# Columns of xi_X that the motions determine, by the kind.
CLOSED = {"scara": [0, 1, 2, 3, 4], "vehicle": [0, 1, 2, 3, 4], "gantry": [0, 1, 2]}
COUNT = {"scara": 1, "vehicle": 1, "gantry": 3, "turntable": 2, "oblique": 1}


def robot_poses(kind, rng, n):
    """``base_T_gripper`` (n, 4, 4): base z is the axis, gripper z too but for ``oblique``."""
    angle = rng.uniform(-1.5, 1.5, n) * (kind != "gantry")
    t = np.column_stack([rng.uniform(-0.3, 0.3, n), rng.uniform(-0.3, 0.3, n), rng.uniform(0.2, 0.5, n)])
    if kind == "vehicle":
        t[:, 2] = 0.1
    if kind == "turntable":
        t[:] = 0.0
    G = transforms(rotations(angle[:, None] * [0.0, 0.0, 1.0]), t)
    return G @ transforms(rotations(np.array([0.3, 0.5, -0.2])), np.zeros(3)) if kind == "oblique" else G


def rig(kind, n, rng, setup="eye-in-hand", noise=NOISE):
    """Poses with noise drawn on them, and their truth."""
    X, W = random_transforms(rng, length=0.3), random_transforms(rng, length=0.3)
    robot = robot_poses(kind, rng, n)
    G = robot if setup == "eye-in-hand" else np.linalg.inv(robot)
    camera = np.linalg.inv(G @ X) @ W
    truth = uq.model.poses.pose_pairs.Truth(X, W, robot, camera)
    if noise is not None:
        robot, camera = moved(robot, draw(rng, noise.robot, (n,))), moved(camera, draw(rng, noise.camera, (n,)))
    return uq.PosePairs(robot, camera, setup, truth=truth)


def squared(found, truth, columns):
    """``xi^T S^-1 xi`` of X on the columns that are determined."""
    xi = difference(found.X, truth.X)[columns]
    S = (found.covariance_X if hasattr(found, "covariance_X") else found.covariance)[np.ix_(columns, columns)]
    return xi @ np.linalg.solve(S, xi)
