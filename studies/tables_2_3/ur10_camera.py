r"""The rig of section IV-A of the paper, simulated: a UR10 that carries a RealSense D435i over a chessboard.

Model: ``base_T_gripper(s) X camera_T_board(s) = W`` at every time s, ``X = gripper_T_camera``, ``W = base_T_board``;
m and rad. The chessboard has 12 x 9 squares of 30 mm, 11 x 8 inner corners. The camera has 640 x 480 pixels and the
focal length and centre that a calibration of the 224 published images gives. The arm moves smoothly and periodically
above the board, at 0.65 to 1.25 m (published images: 0.58 to 1.55 m), in steps of up to 5 degrees (half of the
published ones: below 2; a tenth: above 7). Time s is counted in measurements of the paper's first case, 40 of which are
one swing.

Noise: every corner is found with 0.21 pixels per axis, the residual of the same calibration. With pixels ``p(xi)`` of
the board at ``R = exp([theta]x) R_true``, ``t = t_true + tau`` and ``J = dp / d(theta, tau)``, the pose that least
squares find (PnP, (60)-(61)) has to first order the covariance ``0.21^2 (J^T J)^-1``. The arm has its stated
repeatability, 0.1 mm per axis, and 0.1 mrad.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.noises import diagonal
from uq_handeye.core.geometry.se3 import Array, inverse, skew
from uq_handeye.model.poses.pose_pairs import Truth

FOCAL, CENTRE, IMAGE = (621.0, 622.3), (322.3, 242.9), (640, 480)  # pixels
CORNER = 0.21  # pixels per axis
SWING = 40.0  # measurements of the first case
FIRST = 224  # motions of the first case
ARM = diagonal(0.1, 0.1)
SAMPLINGS = ("longer", "denser")

_grid = np.meshgrid(np.arange(11) - 5.0, np.arange(8) - 3.5, indexing="ij")
CORNERS = 0.03 * np.stack([*_grid, np.zeros((11, 8))], axis=-1).reshape(-1, 3)  # m, in the frame of the board


def _transform(rotation: Rotation, translation: Array) -> Array:
    T = np.zeros((*translation.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = rotation.as_matrix(), translation, 1.0
    return T


X = _transform(Rotation.from_euler("z", 90, degrees=True), np.array([0.03, -0.07, 0.05]))  # gripper_T_camera
W = _transform(Rotation.from_euler("z", 20, degrees=True), np.array([0.7, 0.1, 0.0]))  # base_T_board


def camera_path(s: Array) -> Array:
    """camera_T_board (n, 4, 4) at the times s (n,): the camera swings about the centre of the board."""
    swing = 2 * np.pi / SWING * s[:, None]
    # tilt about two axes of the board, roll; then where the line of sight meets the board
    angles = np.radians([20.0, 20.0, 15.0]) * np.sin(swing * [1.0, 1.3, 0.7] + [0.0, 1.0, 2.0])
    aim = 0.04 * np.sin(swing * [1.3, 0.7, 0.0] + [0.5, 1.5, 0.0])
    distance = 0.95 + 0.30 * np.sin(0.9 * swing + 0.7)
    looking = Rotation.from_euler("XYZ", angles) * Rotation.from_euler("x", np.pi)
    return inverse(_transform(looking, aim - distance * looking.as_matrix()[..., 2]))


def robot_path(s: Array) -> Array:
    """base_T_gripper (n, 4, 4) at the times s (n,)."""
    return W @ inverse(X @ camera_path(s))


def times(N: int, sampling: str) -> Array:
    """Return the times of N + 1 poses, which make N consecutive motions (6).

    "longer": the recording goes on, at the same steps; "denser": the recording of the first case in shorter steps.
    """
    return np.arange(N + 1.0) if sampling == "longer" else np.linspace(0.0, FIRST, N + 1)


def recording(N: int, sampling: str, late: float = 0.0) -> uq.PosePairs:
    """N + 1 exact poses with their truth; the robot's are those of ``late`` units of time before the image."""
    s = times(N, sampling)
    robot, camera = robot_path(s), camera_path(s)
    truth = Truth(X, W, robot, camera)
    return uq.PosePairs(robot if late == 0 else robot_path(s - late), camera, "eye-in-hand", s, truth)


def pixels(camera: Array) -> Array:
    """Image (..., 88, 2) of the corners, seen from camera_T_board (..., 4, 4)."""
    p = CORNERS @ camera[..., :3, :3].mT + camera[..., None, :3, 3]
    return np.asarray(p[..., :2] / p[..., 2:] * FOCAL + CENTRE)


def pnp_covariance(camera: Array) -> Array:
    """(n, 6, 6) of ``xi = (theta, tau)`` of camera_T_board (n, 4, 4), rad and m, to first order."""
    turned = CORNERS @ camera[:, :3, :3].mT
    p = turned + camera[:, None, :3, 3]
    zero = np.zeros(p.shape[:-1])
    by_point = np.stack(  # d pixel / d p
        [
            np.stack([FOCAL[0] / p[..., 2], zero, -FOCAL[0] * p[..., 0] / p[..., 2] ** 2], axis=-1),
            np.stack([zero, FOCAL[1] / p[..., 2], -FOCAL[1] * p[..., 1] / p[..., 2] ** 2], axis=-1),
        ],
        axis=-2,
    )
    by_error = np.concatenate([-skew(turned), np.broadcast_to(np.eye(3), (*turned.shape, 3))], axis=-1)
    J = (by_point @ by_error).reshape(len(camera), -1, 6)
    return np.asarray(CORNER**2 * np.linalg.inv(J.mT @ J))


def noise_of(poses: uq.PosePairs) -> uq.PoseNoise:
    """Return the noise of the arm and of PnP at every pose."""
    return uq.PoseNoise(ARM, pnp_covariance(poses.camera))
