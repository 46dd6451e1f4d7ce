"""A camera calibration as plain numbers and text: the files of its folder, and one object for other results.

``camera_covariance.npz`` has the parts of the joint covariance of the poses (`JointCovariance`), their derivatives by
the intrinsics, and poses and intrinsics themselves; ``intrinsics.json`` the parameters with their covariance and prior;
``corners.csv`` every corner, and whether it was used. The other files are for people and other programs. Everything is
written without loss; `stored_calibration` reads it.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.json_files import json_text
from ...core.files.json_values import JsonObject
from ...core.files.records import attributes, plain
from ...core.geometry.conventions import TOOLKIT
from ...core.geometry.se3 import Array
from ...formats.csv_poses import pose_text
from .board_file import board_text
from .calibrated import Calibrated
from .corners_file import corners_text
from .intrinsics_file import FORMAT, opencv_text

POSES, COVARIANCE, INTRINSICS, CORNERS = "camera.csv", "camera_covariance.npz", "intrinsics.json", "corners.csv"
BOARD = "board.csv"
CONVENTION = (
    f"camera_T_target of row k; covariance of all errors = blkdiag(own) + F F^T with F = shared reshaped to (6n, q); "
    f"{TOOLKIT}; m and rad"
)


def bundle_arrays(cam: Calibrated) -> dict[str, Array]:
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


def to_dict(cam: Calibrated) -> JsonObject:
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
        "given": None if cam.given is None else attributes(cam.given, "values exact"),
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


def board_dict(cam: Calibrated) -> JsonObject:
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


def is_camera_folder(path: Path) -> bool:
    """Return whether a path is a folder with a file that `CameraCalibration.write` writes, or an empty one."""
    if not path.is_dir():
        return False
    names = {child.name for child in path.iterdir()}
    return not names or bool(names & {CORNERS, COVARIANCE, INTRINSICS})


def camera_to_dict(cam: Calibrated) -> JsonObject:
    """Return all but the poses, which the other object has, and the windows of the corners.

    The points of the board are listed once; corners name them by number.
    """
    corners = cam.corners
    points, which = corners.on_board
    seen = {
        "row": corners.row.tolist(),
        "point": which.tolist(),
        "pixels": corners.pixels.tolist(),
        "points": points.tolist(),
        "names": list(corners.names),
        "left_out": np.flatnonzero(~cam.bundle.used).tolist(),
    }
    arrays: JsonObject = {name: plain(np.asarray(value)) for name, value in bundle_arrays(cam).items()}
    return {**to_dict(cam), "seen": seen, "arrays": arrays}
