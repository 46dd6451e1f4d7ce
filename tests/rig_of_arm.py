"""Rigs carried by a six-axis arm with kinematic errors: joints, camera poses, and the truth at other joints."""

from typing import NamedTuple

import numpy as np
from arm_cases import SIX_AXES, random_transform

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse, logarithm, perturb

ARM = uq.Kinematics.from_urdf(SIX_AXES)
# Deviations of an arm, and of the camera: rad and m.
GEOMETRY = {"joint offsets": 5e-4, "joint tilts": 5e-4, "link lengths": 3e-4}
CAMERA = (3e-4, 1e-4)
JOINT_NOISE = 1e-4
CENTRE = np.array([0.2, 0.3, -0.4, 0.3, 0.9, 0.2])


class Rig(NamedTuple):
    poses: uq.PosePairs  # as measured, with the joints that the encoders read
    e: np.ndarray
    X: np.ndarray
    W: np.ndarray
    near: np.ndarray  # (m, 6) joints
    far: np.ndarray

    def seen(self, joints):
        """The true camera poses."""
        G = ARM.poses(joints, self.e)
        G = inverse(G) if self.poses.setup == "eye-to-hand" else G
        return inverse(self.X) @ inverse(G) @ self.W

    def base_points(self, joints, points):
        """Return the places in the base of points that the camera sees at these joints."""
        p = points @ self.X[:3, :3].T + self.X[:3, 3]
        if self.poses.setup == "eye-to-hand":
            return p
        G = ARM.poses(joints, self.e)
        return (G[..., :3, :3] @ p[..., None])[..., 0] + G[..., :3, 3]


def rig(rng, setup="eye-in-hand", n=20, spread=0.3, sd=GEOMETRY, joint_noise=JOINT_NOISE, camera=CAMERA, others=8):
    """A rig with errors of the arm drawn from their deviations, those of base and flange too."""
    e = np.array([rng.normal() * sd.get(error.group, 0.0) for error in ARM.errors])
    draw = lambda m, s: np.clip(CENTRE + rng.uniform(-s, s, (m, 6)), *ARM.limits.T)  # noqa: E731
    read, near, far = draw(n, spread), draw(others, spread), draw(others, 1.5)
    view = np.eye(4)
    view[:3, 3] = [0.02, -0.03, 0.5]
    mount, G = random_transform(rng), ARM.poses(CENTRE, e)
    mount[:3, 3] *= 0.2
    X = mount if setup == "eye-in-hand" else G @ random_transform(rng)
    W = (G if setup == "eye-in-hand" else inverse(G)) @ X @ view
    found = Rig(uq.PosePairs(np.eye(4)[None], np.eye(4)[None], setup), e, X, W, near, far)
    true = read + joint_noise * rng.normal(size=read.shape)
    C = perturb(found.seen(true), rng.normal(size=(n, 6)) * np.repeat(camera, 3))
    return found._replace(poses=uq.PosePairs(ARM.poses(read), C, setup, joints=read))


def squares(prediction, truth):
    """d^2 of predicted poses (m, 4, 4) against the true ones."""
    off = np.concatenate(
        [
            logarithm(prediction.poses[..., :3, :3] @ truth[..., :3, :3].mT),
            prediction.poses[..., :3, 3] - truth[..., :3, 3],
        ],
        axis=-1,
    )
    return np.einsum("...i,...ij,...j->...", off, np.linalg.inv(prediction.covariance), off)
