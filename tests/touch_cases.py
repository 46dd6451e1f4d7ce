"""Points that a camera saw and a tool touched, with known truth."""

import numpy as np
from calibration_cases import quietly

import uq_handeye as uq
from uq_handeye.calibration.evidence.touches import Touches
from uq_handeye.core.geometry.se3 import perturb

ROBOT, CAMERA = ("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")
NOISE = uq.PoseNoise.isotropic(robot=ROBOT, camera=CAMERA)
TOUCH_SD, POINT_SD = 2e-4, 3e-4
TIP = np.array([0.01, 0.02, 0.15])
TRUTH = {setup: uq.simulate(12, setup=setup, seed=3) for setup in ("eye-in-hand", "eye-to-hand")}


def calibration(setup, rng, noise=NOISE):
    """Return a calibration of new measurements of the same poses."""
    truth = TRUTH[setup]
    poses = uq.PosePairs(with_noise(truth.robot, NOISE.robot, rng), with_noise(truth.camera, NOISE.camera, rng), setup)
    return quietly(poses, noise=noise, shared=[], robust=False)


def touches(setup, rng, m=8, *, bias=(0.0, 0.0, 0.0), tool=None, tool_sd=0.0, tool_error=(0.0, 0.0, 0.0)):
    """Return touches of m points in three views; ``tool``: by robot poses of all orientations."""
    truth = TRUTH[setup]
    X = truth.truth.X
    seen = rng.uniform([-0.1, -0.1, 0.4], [0.1, 0.1, 0.7], (m, 3))
    view = np.arange(m) % 3
    in_base = truth.robot[view] @ X if setup == "eye-in-hand" else np.broadcast_to(X, (m, 4, 4))
    b = (in_base[:, :3, :3] @ seen[..., None])[..., 0] + in_base[:, :3, 3]
    robot = with_noise(truth.robot, NOISE.robot, rng)[view] if setup == "eye-in-hand" else None
    hit = b + np.asarray(bias) + rng.normal(size=(m, 3)) * TOUCH_SD
    parts = {"touched": hit}
    if tool is not None:
        R = truth.robot[rng.integers(0, truth.n, m), :3, :3]
        poses = np.zeros((m, 4, 4))
        poses[:, :3, :3], poses[:, 3, 3] = R, 1.0
        poses[:, :3, 3] = hit - R @ (np.asarray(tool) + tool_error)
        parts = {"touched_robot": with_noise(poses, NOISE.robot, rng), "tool": tool, "tool_sd": tool_sd}
    noisy = seen + rng.normal(size=(m, 3)) * POINT_SD
    return Touches(noisy, robot=robot, touch_sd=TOUCH_SD, seen_covariance=POINT_SD**2 * np.eye(3), **parts)


def with_noise(poses, S, rng):
    """Poses with noise of the covariance (6, 6)."""
    return perturb(poses, rng.multivariate_normal(np.zeros(6), S, len(poses)))
