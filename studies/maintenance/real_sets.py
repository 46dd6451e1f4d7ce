"""Real recordings: one part calibrated, another part held against it."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse

VARIABLE = "UQ_HANDEYE_DATA"


class Part(NamedTuple):
    """Poses to calibrate with, and poses to check by."""

    folder: str
    setup: str
    words: str
    calibrated: slice | list[int]
    checked: slice | list[int]


PARTS = (
    Part("kuka_1", "eye-in-hand", "first 20, last 10", slice(20), slice(20, 30)),
    Part("kuka_1", "eye-in-hand", "last 20, first 10", slice(10, 30), slice(10)),
    Part("kuka_1", "eye-in-hand", "first 15, last 15", slice(15), slice(15, 30)),
    Part("kuka_1", "eye-in-hand", "first 15 but 12, last 15", [k for k in range(15) if k != 12], slice(15, 30)),
    Part("fr3_philnad", "eye-in-hand", "first 57, last 57", slice(57), slice(57, 114)),
    Part("nguyen_pham", "eye-to-hand", "first 40, last 10", slice(40), slice(490, 500)),
    Part("ethz_robot_arm_sync", "eye-in-hand", "every 20th of the first half, of the second", slice(0, 840, 20),
         slice(860, 1687, 40)),
    Part("industrial_grid_10x10", "eye-in-hand", "first 10, last 5", slice(10), slice(10, 15)),
)  # fmt: skip
# What is assumed of the rig.
WAYS: dict[str, dict[str, Any]] = {"default": {}, "nothing shared": {"shared": [], "correlation": "none"}}


def real_table() -> pd.DataFrame | None:
    """One row for each recording and way; None where the recordings are not there."""
    root = os.environ.get(VARIABLE)
    if root is None:
        return None
    rows = [_one(Path(root), part, way, options) for part in PARTS for way, options in WAYS.items()]
    return pd.DataFrame(rows)


def _one(root: Path, part: Part, way: str, options: dict[str, Any]) -> dict[str, Any]:
    folder = root / part.folder
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv", setup="eye-in-hand")
        camera = inverse(poses.camera) if part.setup == "eye-to-hand" else poses.camera
        poses = uq.PosePairs(poses.robot, camera, part.setup)
        index = np.arange(poses.n)
        result = uq.calibrate(poses.rows(index[part.calibrated]), **options)
        check = uq.check(result, poses.rows(index[part.checked]))
    moved = check.move("X")
    sd = np.sqrt(np.diag(moved.covariance))
    axis = 3 + int(np.argmax(np.abs(moved.estimate[3:]) / sd[3:]))
    return {
        "set": part.folder, "parts": part.words, "way": way, "status": check.status, "p": check.p_value,
        "d2_by_dof": check.d2 / check.dof, "cause": " or ".join(check.candidates),
        "detectable_mm": 1e3 * moved.least_shift,
        "detectable_deg": float(np.degrees(moved.least_angle)),
        "axis": "xyz"[axis - 3], "shift_mm": 1e3 * float(moved.estimate[axis]), "sd_mm": 1e3 * float(sd[axis]),
        "findings": "; ".join(finding.code for finding in check.findings),
    }  # fmt: skip
