"""Sets of poses of simulated arms: X and predictions of one calibration against the truth."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

import uq_handeye as uq
from studies.common.scores import errors, nees
from studies.kinematics.aligned import X_aligned
from studies.kinematics.arms import Rig, drawn_rig, local_joints, workspace_joints
from uq_handeye.core.geometry.se3 import Array

INSIDE = {freedom: float(chi2.ppf(0.95, freedom)) for freedom in (3, 6)}
HELD_OUT = 20  # joints of each set that are predicted, near and far


class Case(NamedTuple):
    """Definition of a set of poses: rad, m."""

    arm: str
    setup: str
    scales: Mapping[str, float]
    joint_sd: float
    camera: tuple[float, float]
    poses: int = 30
    where: str = "local"
    unmodelled: float = 0.0


class Drawn(NamedTuple):
    """One arm with its errors: what is calibrated, and what is predicted."""

    rig: Rig
    poses: uq.PosePairs
    held_out: dict[str, tuple[Array, Array, Array]]  # by place: joints, camera poses measured there, and the true ones


def drawn(case: Case, rng: np.random.Generator) -> Drawn:
    rig = drawn_rig(
        case.arm,
        case.setup,
        case.scales,
        rng,
        joint_sd=case.joint_sd,
        camera_sd=np.repeat(case.camera, 3),
        unmodelled=case.unmodelled,
    )

    def joints(where: str, n: int) -> Array:
        return local_joints(rig, case.arm, n, rng) if where == "local" else workspace_joints(rig.kinematics, n, rng)

    poses = rig.poses(joints(case.where, case.poses), rng)
    held_out = {}
    for place, where in (("near", "local"), ("far", "anywhere")):
        q = joints(where, HELD_OUT)
        held_out[place] = (q, rig.seen(q, rng), rig.true_camera(rig.true_robot(q)))
    return Drawn(rig, poses, held_out)


def calibrated(poses: uq.PosePairs, **options: Any) -> uq.Calibration | None:
    """None where it is refused as not converged."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        try:
            return uq.calibrate(poses, **options)
        except uq.NotConvergedError:
            return None


# Of the postures over which frames are aligned, the same for all sets.
ALIGNED_SEED = 400


def scored(of: Drawn, options: dict[str, Any], flanges: Mapping[str, Array] | None = None) -> dict[str, float]:
    """Score one set: d^2 of X, share of predictions inside, d^2 over its freedom, RMS (mm) against the true camera
    poses.

    Without ``kinematics`` among the options the robot's poses are by the URDF, and count as they stand.
    """
    result = calibrated(of.poses, **options)
    if result is None or result.covariance is None or result.posterior is None:
        return {"refused": 1.0}
    line = {"refused": 0.0}
    for name, X in (flanges or {"X": X_aligned(of.rig, np.random.default_rng(ALIGNED_SEED))[0]}).items():
        e = errors(result.X, X)
        d2 = float(e @ np.linalg.solve(result.covariance, e))
        line |= {f"{name}: d2": d2, f"{name}: inside": float(d2 <= result.quantile(0.95))}
        line[f"{name}: mm"] = 1e3 * float(np.linalg.norm(e[3:]))
    for place, (q, seen, true) in of.held_out.items():
        line |= predicted(place, result, of.rig.kinematics, q, seen, true)
    return line


def predicted(
    place: str, result: uq.Calibration, kinematics: uq.Kinematics, q: Array, seen: Array, true: Array | None = None
) -> dict[str, float]:
    """Camera poses predicted at joints q against those measured there; the RMS is of the true ones, where known."""
    at: dict[str, Any] = {"robot": kinematics.poses(q)} if result.kinematics is None else {"joints": q}
    ahead = result.predict_camera(**at)
    d2 = nees(errors(seen, ahead.poses), ahead.covariance)
    off = errors(seen if true is None else true, ahead.poses)
    line = {}
    if true is not None:
        mean = result.predict_camera(**at, new_measurement=False)
        line[f"{place}: mean inside"] = float(np.mean(nees(off, mean.covariance) <= INSIDE[6]))
    return line | {
        f"{place}: inside": float(np.mean(d2 <= INSIDE[6])),
        f"{place}: d2/6": float(np.mean(d2)) / 6,
        f"{place}: mm": rms(1e3 * off[:, 3:]),
        f"{place}: deg": rms(np.degrees(off[:, :3])),
    }


def rms(vectors: Array) -> float:
    """Return the RMS of the lengths of vectors (n, 3)."""
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))
