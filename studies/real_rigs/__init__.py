"""Rigs that are wrong by what all poses share, or that drift: what does the covariance of X say of them?

    python -m studies.real_rigs [--full] [-o results]

Simulated poses with Gaussian noise (robot 0.02 deg and 0.05 mm, camera 0.1 deg and 0.5 mm) and one error beside it: a
focal length or a principal point drawn from the defaults of `SharedError`, a target measured 1 % too large, a camera or
a target that walks by a third of the noise from pose to pose, or noise with the autocorrelation 0.9. Nothing is
declared; the noise is estimated. X is calibrated as of independent poses that share nothing, and as by default.

The second table is of finished camera poses: a camera is calibrated from the corners of a board, the corners are thrown
away, focal length and centre rounded to 10 pixels. X is calibrated with the noise that the views give
(`camera_noise`), by default, and as of independent poses. Robot without and with noise (0.02 deg, 0.1 mm), pixel noise
0.05 to 0.3 pixels, pictures calibrated with none, two or four coefficients.

Seed 2019. The truth is X, at the first pose where the camera walks. 40 sets per cell with ``--full``, 24 of 40 poses, 6
of 500, 30 calibrated cameras; few without. A set that is refused (`NotConvergedError`) counts as one without X.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
from scipy.signal import lfilter

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded
from studies.common.scores import errors
from studies.common.study import Study, Tables
from studies.real_rigs.figures import figures
from studies.real_rigs.findings import findings
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.core.progress import progress_bar
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.shared_errors.camera_noise import camera_noise
from uq_handeye.model.shared_errors.shared_error import SharedError

SEED = 2019
SETUPS = ("eye-in-hand", "eye-to-hand")
ROBOT, CAMERA = ("0.02deg", "0.05mm"), ("0.1deg", "0.5mm")
NOISE = uq.PoseNoise.isotropic(robot=ROBOT, camera=CAMERA)
DEVIATIONS = {side: np.sqrt(np.diag(getattr(NOISE, side))) for side in ("robot", "camera")}
STEP, COEFFICIENT, TOO_LARGE = 1 / 3, 0.9, 0.01
ALONE: dict[str, Any] = {"shared": [], "correlation": "none"}
WAYS: dict[str, dict[str, Any]] = {"alone": ALONE, "default": {}}
# Robot noise and numbers of distortion coefficients of the second table.
ROBOTS = (None, np.diag([3.5e-4] * 3 + [1e-4] * 3) ** 2)
COEFFICIENTS: tuple[list[str], ...] = ([], ["k1", "k2"], ["k1", "k2", "p1", "p2"])


def shared(error: SharedError, size: float | None = None) -> Callable[..., dict[str, Array]]:
    """Return the effect of the error on all poses of its side: drawn from its prior, or of the size given."""

    def made(true: uq.PosePairs, rng: np.random.Generator) -> dict[str, Array]:
        e = error.sd * rng.standard_normal(len(error.sd)) if size is None else np.full(1, size)
        return {error.side: error.at(true) @ e}

    return made


def walking(what: str) -> Callable[..., dict[str, Array]]:
    """The camera poses that are seen while camera or target walk, as errors of those of a rig that stands."""

    def made(true: uq.PosePairs, rng: np.random.Generator) -> dict[str, Array]:
        assert true.truth is not None
        size = np.sqrt(DEVIATIONS["robot"] ** 2 + DEVIATIONS["camera"] ** 2)
        walk = np.cumsum(STEP * size * rng.standard_normal((true.n, 6)), axis=0)
        walk -= walk[0]
        X, W = (
            perturb(np.broadcast_to(T, (true.n, 4, 4)), walk * (what == name))
            for name, T in (("camera", true.truth.X), ("target", true.truth.W))
        )
        seen = inverse(true.effective_robot @ X) @ W
        return {"camera": errors(seen, true.camera)}

    return made


CASES: dict[str, Callable[..., dict[str, Array]]] = {
    "nothing": lambda true, rng: {},
    "focal length": shared(SharedError.focal_length()),
    "principal point": shared(SharedError.principal_point()),
    "target 1 % too large": shared(SharedError.target_scale(), TOO_LARGE),
    "camera drifts": walking("camera"),
    "target drifts": walking("target"),
}


def poses_of(case: str, n: int, setup: str, seed: int) -> tuple[uq.PosePairs, Array]:
    """Poses with noise and the error of the case, and the true X."""
    rng = np.random.default_rng([SEED, n, list(CASES).index(case), SETUPS.index(setup), seed])
    truth = uq.simulate(n, setup=setup, seed=rng).truth
    assert truth is not None
    true = uq.PosePairs(truth.robot, truth.camera, setup, np.arange(float(n)), truth)
    return noisy(true, CASES[case](true, rng), rng), truth.X


def correlated(side: str, n: int, setup: str, seed: int) -> tuple[uq.PosePairs, Array]:
    """Poses of which one side's noise, the larger one, is an autoregressive process."""
    rng = np.random.default_rng([SEED, n, seed, SETUPS.index(setup), side == "robot"])
    truth = uq.simulate(n, setup=setup, seed=rng).truth
    assert truth is not None
    parts = []
    for name in DEVIATIONS:
        z = rng.standard_normal((n, 6))
        if name == side:
            z[1:] *= np.sqrt(1 - COEFFICIENT**2)
            z = lfilter([1.0], [1.0, -COEFFICIENT], z, axis=0)
        size = DEVIATIONS["camera" if name == side else "robot"]
        parts.append(perturb(getattr(truth, name), z * size))
    return uq.PosePairs(parts[0], parts[1], setup, np.arange(float(n))), truth.X


def noisy(true: uq.PosePairs, wrong: dict[str, Array], rng: np.random.Generator) -> uq.PosePairs:
    """Add errors of the poses, and then noise."""
    moved = []
    for side, sd in DEVIATIONS.items():
        T = perturb(getattr(true, side), np.broadcast_to(wrong.get(side, 0.0), (true.n, 6)))
        moved.append(perturb(T, sd * rng.standard_normal((true.n, 6))))
    return uq.PosePairs(moved[0], moved[1], true.setup, true.timestamps)


def score(poses: uq.PosePairs, X: Array, **options: Any) -> dict[str, float]:
    """d^2 of the truth, whether the 95 % ellipsoid holds it, the error (mm), the motion stated (mm)."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        try:
            result = uq.calibrate(poses, **options)
        except uq.NotConvergedError:
            return {"refused": 1.0}
    assert result.covariance is not None and result.noise_estimate is not None
    e = errors(result.X, X)
    d2 = float(e @ np.linalg.solve(result.covariance, e))
    return {
        "refused": 0.0,
        "d2": d2,
        "inside": float(d2 <= result.quantile(0.95)),
        "mm": 1e3 * float(np.linalg.norm(e[3:])),
        "motion": 1e3 * _motion(result),
    }


def _motion(result: uq.Calibration) -> float:
    """Standard uncertainty of X (m, all directions) by its motion during the session, 0 where none is assumed."""
    parts = dict(zip(result.budget.sources, result.budget.covariances, strict=True))
    return float(np.sqrt(np.trace(parts.get("motion in the session", np.zeros((6, 6)))[3:6, 3:6])))


def summary(found: list[dict[str, float]], way: str) -> dict[str, float]:
    """Means over the sets that have an X."""
    of = pd.DataFrame(found)
    return {
        f"mean d2, {way}": of["d2"].mean(),
        f"inside 95 %, {way}": of["inside"].mean(),
        f"median mm, {way}": of["mm"].median(),
        f"refused, {way}": of["refused"].sum(),
    }


def cells(full: bool) -> Iterator[tuple[str, int, str, int]]:
    """Case, poses, setup, sets."""
    for case in CASES:
        for n in (8, 15, 40) if full else (15,):
            for setup in SETUPS:
                yield case, n, setup, (40 if n < 40 else 24) if full else 2
    for side, setup in (("robot", SETUPS[0]), ("camera", SETUPS[1])):
        yield f"{side} noise correlated", 500 if full else 60, setup, 6 if full else 2


def of_poses(full: bool) -> Iterator[dict[str, object]]:
    every = list(cells(full))
    with progress_bar("sets", len(every), "cells") as done:
        for cell in every:
            yield one_cell(*cell)
            done(1)


def one_cell(case: str, n: int, setup: str, sets: int) -> dict[str, object]:
    make = poses_of if case in CASES else correlated
    made = [make(case if case in CASES else case.split()[0], n, setup, seed) for seed in range(sets)]
    line: dict[str, object] = {"error": case, "poses": n, "setup": setup, "sets": sets}
    for way, options in WAYS.items():
        found = [score(poses, X, **options) for poses, X in made]
        line |= summary(found, way)
    return line | {"motion mm": pd.DataFrame(found)["motion"].median()}


def finished(n: int, setup: str, seed: int) -> tuple[uq.PosePairs, uq.CameraNoise, Array] | None:
    """Poses of a camera that was calibrated with them, their noise by the views, and the true X.

    None: a corner is not in its picture.
    """
    rng = np.random.default_rng([SEED, n, SETUPS.index(setup), seed])
    pixel = float(np.exp(rng.uniform(np.log(0.05), np.log(0.3))))
    coefficients = COEFFICIENTS[seed % 3]
    model = "brown" if coefficients else "pinhole"
    corners, robot, X = recorded(rng, n, model=model, setup=setup, pixel=pixel, robot=ROBOTS[seed % 2])
    if corners.m < n * len(board()):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        seen = calibrate_camera(corners, SIZE, model, coefficients=coefficients or None)
    if len(seen.rows) < n:
        return None
    poses = uq.PosePairs(robot, seen.poses, setup)
    matrix = np.round([seen.intrinsics[name] for name in ("fx", "fy", "cx", "cy")], -1)
    return poses, camera_noise(poses, board(), matrix, image_size=SIZE), X


def of_views(full: bool) -> Iterator[dict[str, object]]:
    every = [(n, setup) for n in ((15, 19, 30) if full else (15,)) for setup in SETUPS]
    with progress_bar("finished poses", len(every), "cells") as done:
        for n, setup in every:
            drawn = (finished(n, setup, seed) for seed in range(30 if full else 3))
            made = [one for one in drawn if one is not None]
            line: dict[str, object] = {"poses": n, "setup": setup, "sets": len(made)}
            for way in ("views", *WAYS):
                given, options = way == "views", WAYS.get(way, {})
                found = [score(poses, X, **options, **({"noise": views} if given else {})) for poses, views, X in made]
                line |= summary(found, way)
            yield line
            done(1)


def measure(full: bool) -> Tables:
    return {"poses": pd.DataFrame(of_poses(full)), "views": pd.DataFrame(of_views(full))}


STUDY = Study("real_rigs", measure, findings, figures)
