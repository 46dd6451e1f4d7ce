"""Poses of one file with their times or pose numbers, by which rows of two files are matched.

A row of a camera belongs to the robot pose of its time, or of its pose number (a column such as ``name`` or ``image``,
the number in the name of a file). Rows by order only where neither file names its poses and both have as many.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.open import shown
from ...core.files.source import Source
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...formats.contents import FRAMES, Side, finished
from ...formats.detect import read_contents
from ...model.errors.joint_covariance import JointCovariance
from ...model.rig.description import WORLD, ArmPoses, Rig, View
from ..known_camera import known_camera
from ..pairing_by_time import nearest
from ..poses import side_of


@dataclass(frozen=True, eq=False)
class PoseRows:
    """n poses of one file, ``base_T_gripper`` or ``camera_T_target``, m."""

    poses: Array  # (n, 4, 4)
    name: str  # the file, for messages
    source: Source
    times: NDArray[np.float64] | None = None
    numbers: tuple[int, ...] = ()
    rows: tuple[int, ...] = ()  # of a calibrated camera: rows of the robot, counted from 0
    covariance: Array | None = None  # (n, 6, 6) of poses that come with it
    intrinsics: Array | None = None  # (n, 6, q) what errors of the camera's calibration do to them
    calibration: bytes = b""  # of which calibration these errors are
    joints: Array | None = None  # (n, L) of an arm
    by_joints: bool = False  # the poses are those of the joints
    stream: bool = False  # of a bag: interpolated at the times of the views

    @property
    def names(self) -> tuple[Hashable, ...]:
        """Times (whole ones as integers), else numbers, else 0, 1, 2, ..."""
        if self.times is not None:
            return tuple(int(time) if time.is_integer() else time for time in self.times.tolist())
        return self.numbers or tuple(range(len(self.poses)))

    @property
    def named(self) -> bool:
        """True if the file names its poses."""
        return self.times is not None or bool(self.numbers)

    @property
    def count(self) -> int:
        """Number of errors of the camera's calibration."""
        return 0 if self.intrinsics is None else int(self.intrinsics.shape[-1])

    @property
    def side(self) -> Side:
        """These poses as those of a file."""
        return Side(self.name, self.poses[:, :3, 3], self.poses[:, :3, :3], self.times, None, "row")

    def later(self, offset: float) -> PoseRows:
        """Return the rows with times on a clock that is ahead by the offset (s)."""
        return self if self.times is None or offset == 0 else replace(self, times=self.times + offset)

    def some(self, kept: NDArray[np.bool_]) -> PoseRows:
        """Return some of the rows."""

        def of(values: Any) -> Any:
            return None if values is None else values[kept]

        picked = np.flatnonzero(kept).tolist()
        return replace(
            self, poses=self.poses[kept], times=of(self.times), covariance=of(self.covariance),
            intrinsics=of(self.intrinsics), joints=of(self.joints),
            numbers=tuple(self.numbers[k] for k in picked) if self.numbers else (),
            rows=tuple(self.rows[k] for k in picked) if self.rows else (),
        )  # fmt: skip

    def joined(self, other: PoseRows) -> PoseRows:
        """Return these rows with those of another file that have other names."""
        here = set(self.names)
        new = [k for k, name in enumerate(other.names) if name not in here]
        times = None
        if self.times is not None and other.times is not None:
            times = np.concatenate([self.times, other.times[new]])
        numbers: tuple[int, ...] = ()
        if self.numbers and other.numbers:
            numbers = (*self.numbers, *(other.numbers[k] for k in new))
        poses, joints = np.concatenate([self.poses, other.poses[new]]), None
        if self.joints is not None and other.joints is not None:
            joints = np.concatenate([self.joints, other.joints[new]])
        return replace(self, poses=poses, times=times, numbers=numbers, joints=joints)

    def names_among(self, robot: PoseRows, names: tuple[Hashable, ...], tolerance: float) -> tuple[Hashable, ...]:
        """Names of the robot poses (as ``names`` has them) that the rows belong to.

        A row without a partner keeps its own name. Raises `InputError` where neither file has names by which rows
        match.
        """
        if self.rows:
            if self.rows[-1] >= len(robot.poses):
                raise InputError(
                    f"{self.name} has pictures of row {self.rows[-1]} and {robot.name} {len(robot.poses)} poses, "
                    "counted from 0: picture k belongs to row k of the robot. Add the robot poses that are missing."
                )
            return tuple(names[k] for k in self.rows)
        if self.times is not None and robot.times is not None:
            near = nearest(self.times, robot.times)
            apart = np.abs(robot.times[near] - self.times) <= tolerance
            return tuple(
                names[k] if close else self.names[i] for i, (k, close) in enumerate(zip(near, apart, strict=True))
            )
        if self.numbers and robot.numbers:
            at = {number: names[k] for k, number in enumerate(robot.numbers)}
            return tuple(at.get(number, f"number {number}") for number in self.numbers)
        if not (self.named or robot.named) and len(self.poses) == len(robot.poses):
            return names
        raise InputError(
            f"{self.name} ({_said(self)}) and {robot.name} ({_said(robot)}) do not say which rows belong together. "
            "Give both timestamps, or a column `name` with the number of the robot pose: rows of files that differ "
            "are never matched by their order."
        )


def _said(of: PoseRows) -> str:
    what = "timestamps" if of.times is not None else "pose numbers" if of.numbers else "no names"
    return f"{len(of.poses)} poses, {what}"


def read_rows(
    path: Path,
    role: str,
    *,
    units: str | None = None,
    format: str | None = None,
    rotation: str | None = None,
    frame: str | None = None,
) -> PoseRows:
    """Read the poses of one side, "robot" or "camera": a pose file, or the folder of ``camera -o`` or ``points -o``.

    Raises `InputError` for a file that cannot be read, holds the other side only, or leaves several readings.
    """
    if role == "camera" and (seen := known_camera(path)) is not None:
        if seen.scene is not None:
            raise InputError(
                f"{seen.name} holds poses in the unit of a scene, which several cameras cannot share. Calibrate each "
                "camera alone (uq-handeye calibrate ROBOT FOLDER), or all of them by boards."
            )
        found = seen.seen
        rows, S = tuple(np.asarray(found.rows).tolist()), found.covariance
        own, shared = (S.own, S.shared) if isinstance(S, JointCovariance) else (S.blocks, None)
        root = b"" if seen.pictures is None else seen.pictures.bundle.parameters.tobytes()
        return PoseRows(
            np.asarray(seen.poses), seen.name, seen.source[0], rows=rows, covariance=own, intrinsics=shared,
            calibration=root,
        )  # fmt: skip
    contents, source = read_contents(path, format)
    side = side_of(contents, role, shown(path))
    poses = finished(side, role, units, rotation, FRAMES[role][0] if frame is None else frame)
    return PoseRows(poses, side.name, source, side.timestamps, side.numbers)


def on_one_clock(rows: PoseRows, first: PoseRows, tolerance: float) -> PoseRows:
    """Return the poses of another arm with the times of the first one, where they are within the tolerance."""
    if rows.times is None or first.times is None:
        return rows
    return replace(rows, times=np.array(rows.names_among(first, first.names, tolerance), dtype=float))


def view_of(camera: str, target: str, rows: PoseRows, arms: list[PoseRows], tolerance: float) -> View:
    """Return the view of a file; ``arms`` are those that carry camera or target."""
    at = rows.names_among(arms[0], arms[0].names, tolerance) if arms else rows.names if rows.named else None
    return View(camera, target, rows.poses, at, rows.covariance, rows.name, rows.intrinsics)


def rig_of_files(
    robot: PoseRows,
    cameras: Mapping[str, Path],
    *,
    setup: str = "eye-in-hand",
    tolerance: float = 0.0,
    reading: Mapping[str, Mapping[str, str | None]] | None = None,
) -> Rig:
    """Return the rig of one arm, ``arm``, whose cameras all see one target, ``target``, in a file each.

    Parameters
    ----------
    robot : rows of the robot
    cameras : mapping of names to files of camera poses
    setup : "eye-in-hand" (cameras on the arm, target in the world) or "eye-to-hand" (the other way round)
    tolerance : s by which the time of a view may differ from that of its robot pose
    reading : arguments of `read_rows` by "robot" and the names of cameras, or None
    """
    how = reading or {}
    on, to = ("arm", WORLD) if setup == "eye-in-hand" else (WORLD, "arm")
    files = {(name, "target"): file for name, file in cameras.items()}
    return views_of_files(robot, "arm", files, dict.fromkeys(cameras, on), {"target": to}, tolerance, how)


def views_of_files(
    robot: PoseRows,
    arm: str,
    files: Mapping[tuple[str, str], Path],
    cameras: Mapping[str, str],
    targets: Mapping[str, str],
    tolerance: float,
    reading: Mapping[str, Any],
) -> Rig:
    """Return a rig of one arm with a file for each pair of camera and target.

    ``reading``: arguments of `read_rows` by the names of cameras.
    """
    views = []
    for (camera, target), file in files.items():
        moving = [robot] if arm in (cameras[camera], targets[target]) else []
        views.append(view_of(camera, target, read_rows(file, "camera", **reading.get(camera, {})), moving, tolerance))
    poses = ArmPoses(robot.poses, robot.names if robot.named else (), robot.name, timed=robot.times is not None)
    used = {target: targets[target] for _, target in files}
    return Rig({arm: poses}, {camera: cameras[camera] for camera, _ in files}, used, tuple(views))
