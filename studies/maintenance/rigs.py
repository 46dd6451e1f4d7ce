"""Simulated rigs: a calibration, and new poses of the same rig, changed or not."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.model.shared_errors.shared_error import SharedError

SETUPS = ("eye-in-hand", "eye-to-hand")
NOISES = ("given", "estimated")
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
CALIBRATED, CHECKED = 15, 5
CAUSES = ("X", "target", "focal length", "image centre")


@dataclass(frozen=True, eq=False)
class Rig:
    """One calibration and the truth, with robot poses to check at."""

    result: uq.Calibration
    X: Array
    W: Array
    robot: Array  # (k, CHECKED, 4, 4), exact
    setup: str

    def poses(self, k: int, rng: np.random.Generator, cause: str = "", size: Any = 0.0) -> uq.PosePairs:
        """New poses at the k-th set of robot poses; ``size`` of the cause: (6,) rad and m, relative, or rad."""
        G = self.robot[k]
        X = perturb(self.X, size) if cause == "X" else self.X
        W = perturb(self.W, size) if cause == "target" else self.W
        C = inverse(X) @ inverse(inverse(G) if self.setup == "eye-to-hand" else G) @ W
        if cause in ("focal length", "image centre"):
            error = SharedError.focal_length(1.0) if cause == "focal length" else SharedError.principal_point(1.0)
            C = perturb(C, error.at(uq.PosePairs(G, C, self.setup)) @ np.atleast_1d(size))
        return noisy(G, C, self.setup, rng)


def noisy(G: Array, C: Array, setup: str, rng: np.random.Generator) -> uq.PosePairs:
    """Add the noise to exact poses."""
    robot, camera = (
        perturb(T, rng.standard_normal((len(T), 6)) * np.sqrt(np.diag(np.asarray(S))))
        for T, S in ((G, NOISE.robot), (C, NOISE.camera))
    )
    return uq.PosePairs(robot, camera, setup)


def rig(setup: str, noise: str, rng: np.random.Generator, sets: int = 2, n: int = CALIBRATED) -> Rig:
    """Draw a rig, and calibrate it."""
    truth = uq.simulate(n_poses=n + sets * CHECKED, setup=setup, seed=rng).truth
    assert truth is not None
    poses = noisy(truth.robot[:n], truth.camera[:n], setup, rng)
    result = calibrated(poses, noise)
    return Rig(result, truth.X, truth.W, truth.robot[n:].reshape(sets, CHECKED, 4, 4), setup)


def calibrated(poses: uq.PosePairs, noise: str) -> uq.Calibration:
    """Calibrate poses that share nothing and have no outliers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(
            poses, noise=NOISE if noise == "given" else None, shared=[], correlation="none", robust=False
        )
