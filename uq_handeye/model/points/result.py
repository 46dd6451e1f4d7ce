"""Result of `poses_from_points`, and the folder of files that it writes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.atomic import json_text, write_files
from ...core.files.lines import csv_text
from ...core.files.open import StrPath, as_path
from ...core.geometry.conventions import TOOLKIT
from ...core.presentation.document import to_text
from ...core.presentation.html import to_html
from ...formats.csv_poses import pose_text
from ..noise.models import TARGET_SHAPE
from .posed import Posed
from .text import points_document

FORMAT = "uq-handeye points 1"
POSES, COVARIANCE, SUMMARY, POINTS, TARGET = (
    "camera.csv",
    "points_covariance.npz",
    "points.json",
    "points.csv",
    "target.csv",
)
FIGURE = "residuals.png"
CONVENTION = (
    "camera_T_target of row k; covariance of all errors = blkdiag(own) + F F^T with F = shared reshaped to (6n, q); "
    f"{TOOLKIT}; m and rad"
)


def shape_names(q: int) -> tuple[str, ...]:
    """Names of the q shared columns of the covariance."""
    return tuple(f"{TARGET_SHAPE}: {k + 1}" for k in range(q))


@dataclass(frozen=True, eq=False)
class PointPoses(Posed):
    """Poses of a target that was measured in 3-D, and how well they are known; see `poses_from_points`."""

    def summary(self) -> str:
        """Noise, poses, target, points that were left out, warnings: as text."""
        return to_text(points_document(self))

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
        from .figure import save_figure

        return save_figure(self, path)


def point_pose_files(found: Posed) -> dict[str, str | bytes]:
    """The files of `write_point_poses`, by name, without the figure."""
    buffer = io.BytesIO()
    np.savez(
        buffer,
        own=found.covariance.own,
        shared=found.covariance.shared,
        rows=found.rows,
        poses=found.poses,
        target=found.target.xyz,
        target_factor=found.target_factor,
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
            ["point", "x", "y", "z", *(() if found.target_known else ("sd_x", "sd_y", "sd_z"))],
            found.target.names.tolist(),
            *found.target.xyz.T.tolist(),
            *([] if found.target_known else np.sqrt((found.target_factor**2).sum(axis=-1)).T.tolist()),
        ),
    }


def to_dict(found: Posed) -> dict[str, Any]:
    """All but the points and poses as plain numbers and text."""
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
            "isotropic": found.model.isotropic,
            "growing": found.model.growing,
            "distance": found.model.distance,
        },
        "target": {"known": found.target_known, "points": len(found.target.names)},
        "covariance": np.asarray(found.covariance.blocks).tolist(),
        "convention": CONVENTION,
        "outliers": [{"pose": pose, "point": point, "distance": distance} for pose, point, distance in found.outliers],
        "refused": [{"pose": pose, "why": why} for pose, why in found.refused],
        "findings": [finding.to_dict() for finding in found.findings],
        "warnings": list(found.warnings),
    }


def _rows(header: list[str], *columns: list[Any]) -> str:
    return csv_text([header, *zip(*columns, strict=True)])
