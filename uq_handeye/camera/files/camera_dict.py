"""A camera calibration as plain numbers and text, and back without loss: what its folder holds, in one object."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...errors import InputError
from ...files.validate import plain
from ...geometry.se3 import Array
from ..calibrated import Calibrated
from ..corners import Corners
from ..result import CameraCalibration
from .folder import calibration_from_parts
from .folder_writer import bundle_arrays, to_dict


def camera_to_dict(cam: Calibrated) -> dict[str, Any]:
    """All but the poses, which stand beside it, and the windows that the corners were found in.

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
    arrays = {name: plain(np.asarray(value)) for name, value in bundle_arrays(cam).items()}
    return {**to_dict(cam), "seen": seen, "arrays": arrays}


def camera_from_dict(data: dict[str, Any], poses: Array) -> CameraCalibration:
    """The inverse of `camera_to_dict`, for the poses ``camera_T_target`` (n, 4, 4) beside it.

    Raises
    ------
    InputError
        Anything else.
    """
    try:
        seen = data["seen"]
        points = np.array(seen["points"], dtype=float)
        which = _numbers(seen["point"], len(points))
        row = _numbers(seen["row"], None)
        corners = Corners(row, points[which], np.array(seen["pixels"], dtype=float), seen["names"])
        used = np.ones(corners.m, dtype=bool)
        used[_numbers(seen["left_out"], corners.m)] = False
        if corners.n != len(poses) or (np.diff(row) < 0).any():
            raise InputError(f"{corners.n} pictures, and {len(poses)} poses")
        arrays = {name: np.array(value, dtype=float) for name, value in data["arrays"].items()} | {"poses": poses}
        if (sd := arrays.get("board_sd")) is not None:  # None in the file: nothing is known of the shape beforehand
            arrays["board_sd"] = np.where(np.isnan(sd), np.inf, sd)
        return calibration_from_parts(data, corners, used, arrays, "camera_calibration")
    except (InputError, KeyError, TypeError, ValueError, LookupError, ArithmeticError) as error:
        raise InputError(f"data.camera_calibration is damaged ({str(error).rstrip('.')})") from error


def _numbers(values: Any, below: int | None) -> Any:
    """Integers from 0 (and below a count); raises `InputError`."""
    found = np.array(values, dtype=float)
    if found.ndim != 1 or (found != np.floor(found)).any() or (found < 0).any():
        raise InputError("expected numbers from 0")
    if below is not None and (found >= below).any():
        raise InputError(f"expected numbers below {below}")
    return found.astype(np.intp)
