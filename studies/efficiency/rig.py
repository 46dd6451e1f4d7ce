"""The geometries and noises of the study of efficiency, and one cell of it: one method on one of them.

Two kinds of data (`SWEEPS`): poses ``G_i X C_i = W`` of which all pairs are made, and independent motions
``A_i X = X B_i``. Measured ones are ``R = exp([theta]x) R_true``, ``t = t_true + tau`` with ``xi = (theta, tau)``
Gaussian; mrad and mm below are standard deviations per axis.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import both, diagonal
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.model.errors.models import Noise
from uq_handeye.trials.simulation.experiment import Experiment
from uq_handeye.trials.simulation.run import run

SEED = 2019
POSES, MOTIONS = 15, 60
PUBLISHED = (*uq.METHODS, *uq.ROBOT_WORLD_METHODS)
METHODS = (*PUBLISHED, "efficient", "ml")
PREDICTED_ONLY = ("heller",)  # a convex program for every draw
COST = {"zhao": 20, "nguyen": 3, "ml": 3}  # of a pair in a trial, where it is far from that of the others
ROBOT = 0.2  # noise of the robot as a multiple of that of the camera


@dataclass(frozen=True)
class Setting:
    """Exact data with their X, and the noise upon them."""

    truth: uq.PosePairs | uq.Motions
    X: Array  # (4, 4)
    W: Array | None  # of poses
    noise: Noise

    def experiment(self, method: str, part: float = 1.0) -> Experiment:
        """The method on all pairs of the poses, or on the motions, with noise of ``part`` of the standard deviation."""
        return Experiment(self.truth, self.X, self.W, smaller(self.noise, part), method)

    def bound(self) -> Array:
        """(6,) least standard deviations of X; raises `DegenerateMotionError` where the motions leave a part of
        X open.
        """
        return np.sqrt(np.diag(self.experiment("efficient", 1.0).predicted()))


def smaller(noise: Noise, part: float) -> Noise:
    """The noise with ``part`` of its standard deviations."""
    if isinstance(noise, uq.PairNoise):
        return uq.PairNoise(*(None if S is None else part**2 * S for S in (noise.A, noise.B)))
    return uq.PoseNoise(*(None if S is None else part**2 * S for S in (noise.robot, noise.camera)))


def on_poses(rotation: float, translation: float) -> uq.PoseNoise:
    """mrad and mm of the camera; of the robot a fifth."""
    return uq.PoseNoise(diagonal(ROBOT * rotation, ROBOT * translation), diagonal(rotation, translation))


def poses(count: int = POSES, spread: float | None = None, ratio: float = 1.0) -> Setting:
    """Poses that look at a target. ``spread``: largest tilt and roll, degrees; ``ratio``: mrad per mm, product 0.09."""
    if spread is None:
        exact = uq.simulate(count, seed=SEED)
    else:
        exact = uq.simulate(count, seed=SEED, tilt=np.radians(spread), roll=np.radians(spread))
    assert exact.truth is not None
    return Setting(exact, exact.truth.X, exact.truth.W, on_poses(0.3 * np.sqrt(ratio), 0.3 / np.sqrt(ratio)))


def turned(T: Array, degrees: Array | float) -> Array:
    """Motions (n, 4, 4) about the same axes by other angles."""
    axis = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    result = T.copy()
    result[:, :3, :3] = Rotation.from_rotvec(axis * np.radians(np.broadcast_to(degrees, len(T)))[:, None]).as_matrix()
    return result


def motions(
    near: float = 0.0, distance: float = 1.0, star: float | None = None, rotation: float = 1.0, translation: float = 1.0
) -> Setting:
    """Independent motions, axes uniform. ``near``: share whose angle is 180 degrees less ``distance``; ``star``: mm.

    ``star`` is the standard deviation per axis of the translations of B about a common one of half a metre.
    """
    rng = np.random.default_rng([SEED, 1])
    X, B = random_transforms(rng, ()), random_transforms(rng, (MOTIONS,))
    count = round(near * MOTIONS)
    B[MOTIONS - count :] = turned(B[MOTIONS - count :], 180.0 - distance)
    if star is not None:
        B[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-3 * star * rng.normal(size=(MOTIONS, 3))
    return Setting(uq.Motions(X @ B @ inverse(X), B), X, None, both(rotation, translation))


@dataclass(frozen=True)
class Sweep:
    """One quantity that is varied."""

    name: str
    label: str  # with its unit
    data: str
    values: tuple[float, ...]
    quick: tuple[float, ...]
    setting: Callable[[float], Setting]


SWEEPS = (
    Sweep("poses", "number of poses", "poses", (5, 7, 10, 15, 20, 30, 50, 100, 200), (5, 10), lambda v: poses(int(v))),
    Sweep(
        "spread",
        "largest tilt and roll, degrees",
        "poses",
        (3, 6, 12, 25, 45, 90),
        (6,),
        lambda v: poses(spread=v),
    ),
    Sweep(
        "ratio",
        "rotation over translation noise, mrad/mm",
        "poses",
        (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100),
        (0.01, 100),
        lambda v: poses(ratio=v),
    ),
    Sweep(
        "distance",
        "distance of all motions from 180 degrees, degrees",
        "motions",
        (1, 3, 10, 30, 60, 90),
        (1,),
        lambda v: motions(near=1.0, distance=v),
    ),
    Sweep(
        "share",
        "share of motions 1 degree from 180 degrees",
        "motions",
        (0, 0.25, 0.5, 0.7, 0.8, 0.9, 0.95),
        (0.8,),
        lambda v: motions(near=v),
    ),
    Sweep(
        "star",
        "scatter about a common translation, mm",
        "motions",
        (1, 3, 10, 30, 100, 300, 1000),
        (1,),
        lambda v: motions(star=v),
    ),
)


@dataclass(frozen=True)
class Size:
    """Size of a run: trials by pairs per cell aimed at, and the most that a cell may cost."""

    budget: int
    most: int
    fewest: int = 100
    trials: int = 1000

    def of(self, experiment: Experiment) -> int:
        """Trials of a cell; 0 where it would cost too much."""
        if experiment.method in PREDICTED_ONLY:
            return 0
        price = experiment.size * COST.get(experiment.method, 1)
        trials = int(np.clip(self.budget // price, self.fewest, self.trials))
        return trials if trials * price <= self.most else 0


def cell(setting: Setting, method: str, size: Size, part: float = 1.0) -> dict[str, Any]:
    """Standard deviations over the bound, predicted and of the drawn errors about the truth; smallest and largest of
    six.

    ``answer`` is yes, or why there is none. ``bias_over_sd``: largest mean error of the six, in standard deviations.
    """
    if method in uq.ROBOT_WORLD_METHODS and isinstance(setting.truth, uq.Motions):
        return {"answer": "solves for poses, not for motions", "trials": 0, "failed": 0}
    experiment = setting.experiment(method, part)
    limit = part * setting.bound()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        try:
            S = experiment.predicted()
        except (uq.InputError, uq.NotConvergedError) as error:
            return {"answer": type(error).__name__, "trials": 0, "failed": 0}
        deviations = np.sqrt(np.diag(S))
        row: dict[str, Any] = {
            "answer": "yes",
            "predicted_over_bound_low": (deviations / limit).min(),
            "predicted_over_bound_high": (deviations / limit).max(),
            "trials": size.of(experiment),
            "failed": 0,
        }
        if row["trials"] == 0:
            return row
        drawn = run(experiment, np.random.default_rng([SEED, 2]), row["trials"])
    row["failed"] = int((~drawn.ok).sum())
    row["trials"] -= row["failed"]
    if row["trials"] < 2:
        return row
    e = drawn.errors[drawn.ok]
    found = np.sqrt(np.mean(e**2, axis=0))
    for name, ratio in (("bound", found / limit), ("predicted", found / deviations)):
        row |= {f"drawn_over_{name}_low": ratio.min(), f"drawn_over_{name}_high": ratio.max()}
    row["nees"] = np.einsum("ti,ti->", e, np.linalg.solve(S, e.T).T) / len(e)
    row["bias_over_sd"] = np.abs(e.mean(axis=0) / e.std(axis=0)).max()
    return row
