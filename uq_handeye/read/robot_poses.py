"""Reader of robot poses without camera poses, in any format: those to predict at, and the candidates of a plan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.files.open import StrPath, as_path, shown
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..formats.contents import FRAMES, finished
from ..formats.detect import read_contents


def read_robot_poses(
    path: StrPath,
    like: str | None = None,
    *,
    units: str | None = None,
    format: str | None = None,
    rotation: str | None = None,
) -> tuple[NDArray[np.float64] | None, Array]:
    """Return timestamps (n,), or None, and poses ``base_T_gripper`` (n, 4, 4) in metres.

    Parameters
    ----------
    path : any of `uq_handeye.read.FORMATS`
    like : format of the robot poses of the calibration, which decides where the numbers may be read in several ways
    units, format, rotation : as in `read_poses`, of one side

    Raises
    ------
    InputError
        A file that cannot be read, of the camera's side only, or whose rotations may be read in several ways.
    """
    path = as_path(path)
    contents, _ = read_contents(path, format)
    side = contents.robot or contents.only
    if side is None:
        raise InputError(f"{shown(path)} holds camera poses only; expected robot poses.")
    same = [reading for reading in side.readings if reading.format == like]
    if len(side.readings) > 1 and rotation is None and len(same) == 1:
        side = replace(side, readings=(same[0],))
    return side.timestamps, finished(side, "robot", units, rotation, FRAMES["robot"][0])
