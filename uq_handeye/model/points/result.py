"""Result of `poses_from_points`, and the folder of files that it writes and reads without a new estimate."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.files.atomic import write_files
from ...core.files.csv_text import csv_text
from ...core.files.json_files import json_text
from ...core.files.json_values import JsonObject
from ...core.files.one_line import OF_DATA, refused
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.records import array_of
from ...core.files.tree_values import fields_of, items_of
from ...core.geometry.checks import as_transforms
from ...core.geometry.conventions import TOOLKIT
from ...core.geometry.se3 import Array
from ...core.limits import MAX_TABLE_BYTES
from ...core.presentation.document import to_text
from ...core.presentation.html import to_html
from ...core.rounding import CHAIN_ROUNDING
from ...errors import InputError
from ...findings import Finding
from ...formats.command_folder import arrays_in, description_in, folder_of_command
from ...formats.csv_poses import pose_text, read_pose_file
from ..errors.joint_covariance import JointCovariance
from ..errors.keys import INTRINSICS
from .point_file import read_points, read_target
from .posed import Posed
from .text import points_document

FORMAT = "uq-handeye points 2"
POSES, COVARIANCE, SUMMARY, POINTS, TARGET = (
    "camera.csv",
    "points_covariance.npz",
    "points.json",
    "points.csv",
    "target.csv",
)
FIGURE = "residuals.png"
CONVENTION = (
    "camera_T_target of row k and the covariance of its errors, independent of other rows; of intrinsics in addition "
    f"F F^T over all rows, F = shared reshaped to (6n, q); {TOOLKIT}; m and rad"
)
_OTHER_RUN = "not of the same run, or one was changed by hand; write the folder again with uq-handeye points -o"


@dataclass(frozen=True, eq=False)
class PointPoses(Posed):
    """Poses of a target that was measured in 3-D, and how well they are known; see `poses_from_points`."""

    def summary(self, details: bool = False) -> str:
        """Noise, poses, target, points that were left out, warnings: as text; ``details``: all points left out."""
        return to_text(points_document(self, details))

    def __repr__(self) -> str:
        return f"PointPoses({self.n} poses, {int(self.used.sum())} points)"

    def _repr_html_(self) -> str:
        """For notebooks."""
        return to_html("Poses from points", points_document(self))

    def write(self, folder: StrPath) -> Path:
        """Everything as files in a folder, all or none, which `read_point_poses` and `read_poses` take."""
        from ...core.presentation.figure_parts import render
        from .figure import residual_figure

        write_files(folder, {**point_pose_files(self), FIGURE: render(residual_figure(self), "png")})
        return as_path(folder)

    def figure(self, path: StrPath) -> Path:
        """Write the residuals along and across the line of sight as ``.png`` or ``.svg``."""
        from ...core.presentation.figure_parts import save_figure
        from .figure import residual_figure

        return save_figure(path, lambda: residual_figure(self))


def point_pose_files(found: Posed) -> dict[str, str | bytes]:
    """The files of `write_point_poses`, by name, without the figure."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        covariance=found.covariance.own,
        shared=found.covariance.shared,
        rows=found.rows,
        poses=found.poses,
        target=found.target.xyz,
        residuals=found.residuals,
        convention=np.array(CONVENTION),
    )
    return {
        POSES: pose_text(found.poses, found.rows),
        COVARIANCE: buffer.getvalue(),
        SUMMARY: json_text(to_dict(found)),
        POINTS: _rows(
            ["pose", "point", "x", "y", "z", "used"],
            found.points.row.tolist(),
            found.points.point.tolist(),
            *found.points.xyz.T.tolist(),
            found.used.astype(int).tolist(),
        ),
        TARGET: _rows(
            ["point", "x", "y", "z"],
            found.target.names.tolist(),
            *found.target.xyz.T.tolist(),
        ),
    }


def to_dict(found: Posed) -> JsonObject:
    """Return all but the points and poses as plain numbers and text."""
    return {
        "format": FORMAT,
        "poses": found.n,
        "points": int(found.used.sum()),
        "noise": {
            "lateral": float(found.sd[0]),
            "axial": float(found.sd[1]),
            "unit": "m",
            "degrees_of_freedom": found.dof.tolist(),
            "given": found.noise_given,
        },
        "target": {"points": len(found.target.names)},
        "covariance": found.covariance.blocks.tolist(),
        "convention": CONVENTION,
        "outliers": [{"pose": pose, "point": point, "distance": distance} for pose, point, distance in found.outliers],
        "refused": [{"pose": pose, "why": why} for pose, why in found.refused],
        "findings": [finding.to_dict() for finding in found.findings],
        "warnings": list(found.warnings),
    }


def _rows(header: list[str], *columns: list[str] | list[int] | list[float]) -> str:
    return csv_text([header, *zip(*columns, strict=True)])


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
    path = folder_of_command(folder, "points", (POSES, COVARIANCE, SUMMARY, POINTS, TARGET))
    name, tree, arrays = shown(path), description_in(path / SUMMARY, FORMAT), arrays_in(path / COVARIANCE)
    with refused(f"{name}: not what uq-handeye points writes", OF_DATA):
        found = _point_poses(path, tree, arrays)
    rows, poses = read_pose_file(path / POSES)
    if (
        not np.array_equal(rows, found.rows)
        or np.abs(poses - found.poses).max() > CHAIN_ROUNDING * max(1.0, float(np.abs(poses).max()))
        or not _belong(found)
    ):
        raise InputError(f"{name}: {POSES}, {POINTS}, {TARGET} and {COVARIANCE} are {_OTHER_RUN}.")
    return found


def _point_poses(path: Path, tree: JsonObject, arrays: Mapping[str, Array]) -> PointPoses:
    target, points = read_target(path / TARGET), read_points(path / POINTS)
    k, m, n = len(points), len(target.names), len(arrays["rows"])
    shapes = {"covariance": (n, 6, 6), "rows": (n,), "target": (m, 3), "poses": (n, 4, 4)}
    covariance, rows, xyz, T = (array_of(arrays[key], shape, f"{key} of {COVARIANCE}") for key, shape in shapes.items())
    if (covariance != covariance.mT).any() or np.linalg.eigvalsh(covariance).min() <= 0:
        raise InputError(f"{COVARIANCE}, covariance: expected covariances, got other matrices.")
    residuals = np.asarray(arrays["residuals"], dtype=float)
    shared = np.asarray(arrays.get("shared", np.zeros((n, 6, 0))), dtype=float)
    if shared.ndim != 3 or shared.shape[:2] != (n, 6):
        raise InputError(f"{COVARIANCE}, shared: expected ({n}, 6, q) numbers, got {shared.shape}.")
    if residuals.shape != (k, 3) or (np.diff(rows) <= 0).any() or n == 0:
        raise InputError(f"{POINTS} and {COVARIANCE} are {_OTHER_RUN}.")
    if not np.array_equal(xyz, target.xyz):
        raise InputError(f"{TARGET} and {COVARIANCE} are {_OTHER_RUN}.")
    noise = fields_of(tree["noise"])
    sd = np.array([float(noise["lateral"]), float(noise["axial"])])
    dof = np.array(noise["degrees_of_freedom"], dtype=float)
    if not (np.isfinite(sd).all() and (sd > 0).all() and dof.shape == (2,)):
        raise InputError(f"{SUMMARY}, noise: expected standard deviations above 0.")
    return PointPoses(
        poses=as_transforms(T, "poses"),
        rows=rows.astype(np.int64),
        covariance=JointCovariance(covariance, shared, (INTRINSICS,) * shared.shape[-1]),
        target=target,
        sd=sd,
        dof=dof,
        noise_given=bool(noise["given"]),
        points=points,
        residuals=residuals,
        used=_used(path, k),
        refused=tuple((int(one["pose"]), str(one["why"])) for one in map(fields_of, items_of(tree["refused"]))),
        findings=tuple(map(Finding.from_dict, items_of(tree["findings"]))),
    )


def _used(path: Path, k: int) -> NDArray[np.bool_]:
    """(k,) of the last column of the points, which are in order there."""
    with opened(path / POINTS, MAX_TABLE_BYTES) as file:
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
        < CHAIN_ROUNDING * max(1.0, float(np.abs(found.points.xyz).max()))
    )
