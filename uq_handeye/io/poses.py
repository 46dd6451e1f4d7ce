"""Two pose files, paired by row."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import InputError, InputWarning
from ..poses import PosePairs
from ._files import StrPath, as_path, shown
from .csv_poses import read_pose_file

# Rows are synchronous within this (s): rounding of printed times; an arm at 1 m/s moves a micrometre in it.
SYNCHRONOUS = 1e-6


def read_poses(
    robot: StrPath, camera: StrPath, *, setup: str = "eye-in-hand", units: str | tuple[str, str] = "m"
) -> PosePairs:
    """Robot and camera poses from two pose files whose rows belong together.

    Parameters
    ----------
    robot : path
        ``base_T_gripper``; format: `uq_handeye.io.read_pose_file`.
    camera : path
        ``camera_T_target``, row k taken at the same moment as row k of ``robot``.
    setup : "eye-in-hand" or "eye-to-hand"
    units : str or (str, str)
        Length unit of both files, or of the robot's and the camera's: m, mm, ...; the poses returned are in metres.

    Raises
    ------
    InputError
        What `read_pose_file` refuses; different numbers of rows; timestamps of a row that differ by half the
        interval between rows or more. Two row numberings are such timestamps too: if they differ, a row was
        lost in one file.

    Warns
    -----
    InputWarning
        Timestamps of a row that differ by more than 1e-6 s but less than that.
    """
    robot, camera = as_path(robot), as_path(camera)
    robot_units, camera_units = (units, units) if isinstance(units, str) else units
    robot_times, robot_poses = read_pose_file(robot, robot_units)
    camera_times, camera_poses = read_pose_file(camera, camera_units)
    if len(robot_times) != len(camera_times):
        raise InputError(
            f"{shown(robot)} has {len(robot_times)} poses and {shown(camera)} has {len(camera_times)}: "
            "expected one row in each file per moment. Leave out poses that the other file lacks; for "
            "streams with clocks of their own, resample one of them at the times of the other."
        )
    difference = np.abs(robot_times - camera_times)
    row = int(np.argmax(difference))
    if difference[row] > SYNCHRONOUS:
        where = (
            f"the timestamps of {shown(robot)} and {shown(camera)} differ by up to {difference[row]:.6g} s, in pose "
            f"{row} ({robot_times[row].item()!r} and {camera_times[row].item()!r})"
        )
        interval = float(np.median(np.abs(np.diff(robot_times)))) if len(robot_times) > 1 else 0.0
        if difference[row] >= 0.5 * interval:
            raise InputError(
                f"The rows do not belong to the same moments: {where}. Resample one stream at the times of the other; "
                "or, if the rows do belong together, give both files the same timestamps (row numbers will do)."
            )
        warnings.warn(
            f"Rows are paired by their order although {where}. That is right if the robot stood still.",
            InputWarning,
            stacklevel=2,
        )
    return PosePairs(robot_poses, camera_poses, setup=setup, timestamps=robot_times)
