"""Poses from points read from the folder that `PointPoses.write` wrote; nothing is estimated again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ....core.files import trees as _trees
from ....core.files.lines import refused, short
from ....core.files.open import StrPath, as_path, opened, shown
from ....core.files.trees import parse_tree
from ....core.geometry.checks import as_transforms
from ....core.geometry.se3 import Array
from ....errors import InputError
from ....findings import Finding
from ....formats.csv_poses import read_pose_file
from ....formats.numpy_poses import MAX_BYTES, unpacked
from ...noise.joint_covariance import JointCovariance
from ..least_squares import NoiseModel
from ..result import COVARIANCE, FORMAT, POINTS, POSES, SUMMARY, TARGET, PointPoses, shape_names
from .point_file import read_points, read_target

# Poses of camera.csv, whose quaternions are rounded, and residuals are those of the archive within this.
ROUNDED = 1e-9
_OTHER_RUN = "not of the same run, or one was changed by hand; write the folder again with uq-handeye points -o"


def is_points_folder(path: Path) -> bool:
    """Return whether a folder is one of `PointPoses.write`."""
    return path.is_dir() and (path / COVARIANCE).exists()


def read_point_poses(folder: StrPath) -> PointPoses:
    """The poses that `PointPoses.write` wrote, exactly.

    Raises
    ------
    InputError
        A folder that is none, lacks a file, or whose files do not belong together.
    """
    path = as_path(folder)
    name = shown(path)
    if not path.is_dir():
        raise InputError(f"Cannot read {name}: expected the folder of uq-handeye points -o, got none.")
    if lacking := [file for file in (POSES, COVARIANCE, SUMMARY, POINTS, TARGET) if not (path / file).exists()]:
        raise InputError(
            f"{name} lacks {', '.join(lacking)}: expected the folder that uq-handeye points -o wrote; write it again."
        )
    with opened(path / SUMMARY, _trees.MAX_BYTES) as file:
        tree = parse_tree(file.read(), shown(path / SUMMARY))
    if not isinstance(tree, dict) or tree.get("format") != FORMAT:
        came = short(str(tree.get("format"))) if isinstance(tree, dict) else "no mapping"
        raise InputError(f"{shown(path / SUMMARY)}: expected the format {FORMAT!r}, got {came}.")
    with opened(path / COVARIANCE, MAX_BYTES) as file:
        arrays = unpacked(file.read(), shown(path / COVARIANCE))
    with refused(f"{name}: not what uq-handeye points writes", (KeyError, TypeError, ValueError, IndexError)):
        found = _point_poses(path, tree, arrays)
    rows, poses = read_pose_file(path / POSES)
    if (
        not np.array_equal(rows, found.rows)
        or np.abs(poses - found.poses).max() > ROUNDED * max(1.0, float(np.abs(poses).max()))
        or not _belong(found)
    ):
        raise InputError(f"{name}: {POSES}, {POINTS}, {TARGET} and {COVARIANCE} are {_OTHER_RUN}.")
    return found


def _point_poses(path: Path, tree: dict[str, Any], arrays: dict[str, Any]) -> PointPoses:
    target, points = read_target(path / TARGET), read_points(path / POINTS)
    k, m, n = len(points), len(target.names), len(arrays["rows"])
    noise = tree["noise"]
    own, shared = _numbers(arrays, "own", (n, 6, 6)), _numbers(arrays, "shared", (n, 6, None))
    if (own != own.mT).any() or np.linalg.eigvalsh(own).min() <= 0:
        raise InputError(f"{COVARIANCE}, own: expected covariances, got other matrices.")
    rows = _numbers(arrays, "rows", (n,)).astype(np.int64)
    residuals = np.asarray(arrays["residuals"], dtype=float)
    if residuals.shape != (k, 3) or (np.diff(rows) <= 0).any() or n == 0:
        raise InputError(f"{POINTS} and {COVARIANCE} are {_OTHER_RUN}.")
    if not np.array_equal(_numbers(arrays, "target", (m, 3)), target.xyz):
        raise InputError(f"{TARGET} and {COVARIANCE} are {_OTHER_RUN}.")
    sd = np.array([float(noise["lateral"]), float(noise["axial"])])
    dof = np.array(noise["degrees_of_freedom"], dtype=float)
    if not (np.isfinite(sd).all() and (sd > 0).all() and dof.shape == (2,)):
        raise InputError(f"{SUMMARY}, noise: expected standard deviations above 0.")
    return PointPoses(
        poses=as_transforms(_numbers(arrays, "poses", (n, 4, 4)), "poses"),
        rows=rows,
        covariance=JointCovariance(own, shared, shape_names(shared.shape[-1])),
        target=target,
        target_factor=_numbers(arrays, "target_factor", (m, 3, None)),
        target_known=bool(tree["target"]["known"]),
        model=NoiseModel(bool(noise["isotropic"]), bool(noise["growing"]), float(noise["distance"])),
        sd=sd,
        dof=dof,
        noise_given=bool(noise["given"]),
        points=points,
        residuals=residuals,
        used=_used(path, k),
        refused=tuple((int(one["pose"]), str(one["why"])) for one in tree["refused"]),
        findings=tuple(map(Finding.from_dict, tree["findings"])),
    )


def _used(path: Path, k: int) -> Any:
    """(k,) of the last column of the points, which are in order there."""
    with opened(path / POINTS, MAX_BYTES) as file:
        flags = [line.rstrip().rpartition(b",")[2] for line in file][1:]
    if len(flags) != k or not set(flags) <= {b"0", b"1"}:
        raise InputError(f"{POINTS}, column used: expected 1 or 0 for each of {k} points.")
    return np.array([flag == b"1" for flag in flags])


def _belong(found: PointPoses) -> bool:
    """Return whether the residuals are those of points, poses and target."""
    again = found.predicted_residuals
    both = np.isfinite(again) & np.isfinite(found.residuals)
    return bool(
        both[found.used].all()
        and np.abs(again[both] - found.residuals[both]).max(initial=0.0)
        < ROUNDED * max(1.0, float(np.abs(found.points.xyz).max()))
    )


def _numbers(arrays: dict[str, Any], key: str, shape: tuple[int | None, ...]) -> Array:
    value = arrays.get(key)
    fits = value is not None and value.ndim == len(shape) and value.dtype.kind in "fiu"
    if (
        value is None
        or not fits
        or any(want not in (None, have) for want, have in zip(shape, value.shape, strict=True))
    ):
        came = "none" if value is None else f"{value.dtype} {value.shape}"
        raise InputError(f"{COVARIANCE}, {key}: expected numbers {shape}, got {came}; the files are {_OTHER_RUN}.")
    if not np.isfinite(value).all():
        raise InputError(f"{COVARIANCE}, {key}: expected finite numbers; the files are {_OTHER_RUN}.")
    return np.asarray(value, dtype=float)
