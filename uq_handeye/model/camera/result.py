"""Result of `calibrate_camera`, and the folder of files that it writes."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.atomic import json_text, write_files
from ...core.files.open import StrPath, as_path
from ...core.files.records import attributes
from ...core.geometry.conventions import TOOLKIT
from ...core.presentation.document import to_text
from ...core.presentation.html import to_html
from ...formats.csv_poses import pose_text
from .calibrated import Calibrated
from .corners import corners_text
from .files.board_file import board_text
from .files.intrinsics_file import FORMAT, opencv_text
from .report.text import camera_document

POSES, COVARIANCE, INTRINSICS, CORNERS = "camera.csv", "camera_covariance.npz", "intrinsics.json", "corners.csv"
BOARD = "board.csv"
# What a report may come with: `report.camera_figures`.
FURTHER = {
    "report.html",
    *(
        f"{stem}.{kind}"
        for stem in ("pattern", "residuals", "pictures", "certainty", "boards", "board", "board_residuals")
        for kind in ("png", "svg")
    ),
}
CONVENTION = (
    f"camera_T_target of row k; covariance of all errors = blkdiag(own) + F F^T with F = shared reshaped to (6n, q); "
    f"{TOOLKIT}; m and rad"
)


@dataclass(frozen=True, eq=False)
class CameraCalibration(Calibrated):
    """A calibrated camera, the poses it saw the board at, and how well all of that is known; see `calibrate_camera`."""

    def summary(self) -> str:
        """Model, intrinsics with their standard deviations, pixel noise, corners that were left out, warnings:
        as text.
        """
        return to_text(camera_document(self))

    def _repr_html_(self) -> str:
        """For notebooks."""
        return to_html("Camera calibration", camera_document(self))

    def figure(self, path: StrPath, name: str = "pattern") -> Path:
        """Write a figure as ``.png`` or ``.svg``; see `camera_figures` for the names."""
        from .report.figures import save_figure

        return save_figure(self, path, name)

    def write(self, folder: StrPath) -> Path:
        """Everything as files in a folder, all or none, which `read_camera` and `read_poses` take."""
        from .report.page import report_files

        files = {**camera_files(self), **report_files(self)}
        write_files(folder, files)
        path = as_path(folder)
        for name in FURTHER - set(files):  # those of an earlier run are not of this camera
            (path / name).unlink(missing_ok=True)
        return path


def bundle_arrays(cam: Calibrated) -> dict[str, Any]:
    """Parts of the joint covariance of the poses, by name."""
    bundle = cam.bundle
    return {
        "own": bundle.own,
        "by_parameters": bundle.by_parameters,
        "parameters": bundle.parameters,
        "covariance": bundle.covariance,
        "weights": bundle.weights,
        **{f"board_{name}": getattr(bundle.shape, name) for name in ("points", "offset", "fields", "sd")},
    }


def camera_files(cam: Calibrated) -> dict[str, str | bytes]:
    """The files of `write_camera` that are data, by name."""
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {
        "shared": cam.covariance.shared,
        "rows": cam.rows.astype(np.int64),
        "poses": cam.poses,
        "convention": CONVENTION,
        **bundle_arrays(cam),
    }
    np.savez(buffer, **arrays)
    return {
        POSES: pose_text(cam.poses, cam.rows),
        COVARIANCE: buffer.getvalue(),
        INTRINSICS: json_text(to_dict(cam)),
        "intrinsics.yaml": opencv_text(cam),
        CORNERS: corners_text(cam.corners, cam.bundle.used),
        BOARD: board_text(cam.board, cam.corners.board),
    }


def to_dict(cam: Calibrated) -> dict[str, Any]:
    """All but poses and corners as plain numbers and text."""
    return {
        "format": FORMAT,
        **attributes(
            cam,
            "model image_size parameters=intrinsics std estimated names=bundle.model.names "
            "covariance=bundle.intrinsics_covariance",
        ),
        "board": board_dict(cam),
        "prior": None if cam.bundle.prior is None else attributes(cam.bundle.prior, "mean covariance"),
        "units": "pixels; coefficients without unit",
        "convention": "centre of the first pixel at (0, 0); models and order of the coefficients as in OpenCV",
        **attributes(
            cam,
            "pixel_noise=bundle.pixel_noise pictures=corners.n pictures_without_board=corners.missing "
            "corners=corners.m",
        ),
        "outliers": [dict(zip(("picture", "corner", "distance"), one, strict=True)) for one in cam.outliers],
        "pattern": attributes(cam.pattern, "p_value share found"),
        "board_pattern": attributes(cam.board_pattern, "p_value share found"),
        "candidates": [attributes(one, "model coefficients board=shape bic rms") for one in cam.candidates],
        **attributes(cam, "converged=bundle.converged iterations=bundle.iterations findings warnings"),
    }


def board_dict(cam: Calibrated) -> dict[str, Any]:
    """The shape of the board in numbers; lengths in m."""
    shape, board = cam.bundle.shape, cam.board
    (bow, bow_std), (stretch, stretch_std) = board.bow, board.stretch
    return {
        "shape": shape.name,
        "names": list(shape.names),
        "coefficients": cam.bundle.bend.tolist(),
        "printed": cam.corners.board,
        "size": board.size,
        "bow": bow,
        "bow_std": bow_std,
        "in_plane_rms": board.in_plane,
        "stretch": stretch,
        "stretch_std": stretch_std,
    }
