"""Poses in files that grow during a live session: the pairs that are complete so far."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core.files.source import Source
from ..core.geometry.frames import SETUPS
from ..core.geometry.se3 import Array
from ..errors import InputError
from ..formats.contents import FRAMES, finished
from ..formats.detect import read_contents
from ..model.camera.result import CameraCalibration
from ..model.poses.pose_pairs import PosePairs


def read_arrived(
    robot: Sequence[Path],
    camera: Sequence[Path] | CameraCalibration | Callable[[Array, str], PosePairs] | None,
    *,
    setup: str | None = None,
    units: tuple[str | None, str | None] = (None, None),
    format: tuple[str | None, str | None] = (None, None),
    rotation: tuple[str | None, str | None] = (None, None),
    robot_frame: str = "base_T_gripper",
    camera_frame: str = "camera_T_target",
) -> PosePairs | None:
    """Return pose k of the robot with pose k of the camera, as far as both have arrived; None: no pair yet.

    Parameters
    ----------
    robot, camera : paths
        In the order in which their poses are counted. ``camera=None``: the files of ``robot`` hold both sides.
        A calibrated camera: its pictures belong to the rows of the robot poses. A function: it pairs the robot poses
        (n, 4, 4), of a setup, with camera poses.
    setup, units, format, rotation, robot_frame, camera_frame
        As in `read_poses`, of both sides.

    Raises
    ------
    InputError
        A file that cannot be read, or holds the poses of one side where both are expected.
    """
    said = {setup} - {None}
    seen = camera if isinstance(camera, CameraCalibration) else None
    of_camera = () if isinstance(camera, CameraCalibration) or callable(camera) else camera
    sides: list[tuple[list[Array], list[Array | None]]] = []
    sources: list[Source] = []
    for role, paths, form, unit, numbers, frame in zip(
        FRAMES, (robot, of_camera), format, units, rotation, (robot_frame, camera_frame), strict=True
    ):
        poses, times = [], []
        for path in robot if paths is None else paths:
            contents, source = read_contents(path, form)
            said |= {contents.setup} - {None}
            side = getattr(contents, role) or (None if camera is None else contents.only)
            if side is None:
                raise InputError(f"{path.name} holds no {role} poses.")
            frame_of = frame
            if role == "robot" and contents.robot_enters and "eye-to-hand" in said:
                frame_of = FRAMES["robot"][1]
            poses.append(finished(side, role, unit, numbers, frame_of))
            times.append(side.timestamps)
            sources += [source] if paths is not None or role == "robot" else []
        sides.append((poses, times))
    if len(said) > 1:
        raise InputError(f"Expected one setup, got {' and '.join(sorted(map(str, said)))}.")
    chosen = next(iter(said), "eye-in-hand")
    if chosen not in SETUPS:
        raise InputError(f"Expected `setup` (--setup) to be one of {', '.join(SETUPS)}, got {chosen!r}.")
    G = _stacked(sides[0][0])
    if callable(camera):
        return replace(camera(G, chosen), sources=tuple(sources))
    if seen is not None:
        if seen.rows[-1] >= len(G):
            raise InputError(f"Picture {seen.rows[-1]} has no robot pose yet: there are {len(G)}.")
        return PosePairs(G[seen.rows], seen.poses, chosen, sources=tuple(sources), camera_calibration=seen)
    C = _stacked(sides[1][0])
    n = min(len(G), len(C))
    if n == 0:
        return None
    stamps = [part for part in sides[0][1] if part is not None]
    times_of = np.concatenate(stamps)[:n] if len(stamps) == len(sides[0][1]) else None
    if times_of is not None and len(np.unique(times_of)) < n:  # each file counts from 0
        times_of = None
    return PosePairs(G[:n], C[:n], chosen, times_of, sources=tuple(sources))


def count_arrived(files: Sequence[Path], format: str | None = None, role: str = "robot") -> int:
    """Return how many poses of one side have arrived."""
    every = (read_contents(path, format)[0] for path in files)
    return sum(len(getattr(contents, role) or contents.only or ()) for contents in every)


def _stacked(parts: list[Array]) -> Array:
    return np.concatenate(parts) if parts else np.zeros((0, 4, 4))
