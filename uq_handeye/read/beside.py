"""Joint values and calibrated cameras beside files of poses, or in their place.

Joint values are poses of the robot, or stand beside the robot poses of another file.

Camera poses that come with their covariance: a calibrated camera, or poses from points in 3-D, or their folders.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.source import Source
from ..core.geometry.se3 import Array
from ..core.numbers.limits import MAX_TABLE_BYTES
from ..errors import InputError, InputWarning, require_type
from ..formats.contents import FRAMES, Side
from ..model.poses.pose_pairs import PosePairs, joint_values_at
from .matching import FEWEST, SYNCHRONOUS, check_tolerance, nearest

if TYPE_CHECKING:
    from ..model.camera.result import CameraCalibration
    from ..model.kinematics.chain import Kinematics
    from ..model.kinematics.joints_file import NamedJoints
    from ..model.points.result import PointPoses

# Joints are interpolated between rows of the file that are at most so many median intervals apart.
GAPS = 3.0


@dataclass(frozen=True, eq=False)
class Joints:
    """The rows of a joint file and the chain that they move."""

    values: Array  # (n, L) rad, m
    timestamps: Array | None  # (n,) s
    kinematics: Kinematics
    source: Source
    name: str  # of the file, for messages

    def __len__(self) -> int:
        return len(self.values)

    @property
    def side(self) -> Side:
        """Their poses by forward kinematics, as a file of robot poses would hold them."""
        T = self.kinematics.poses(self.values)
        return Side(self.name, T[:, :3, 3], T[:, :3, :3], self.timestamps, None, "row", frame=FRAMES["robot"][0])

    def beside(self, robot: Side, tolerance: float) -> Array:
        """Joint values (n, L) at the n poses of a file of robot poses; NaN at a pose that has none.

        Row k belongs to row k where there are as many and the timestamps, if both have them, agree; else rows are
        paired by time, the nearest within ``tolerance``.
        """
        check_tolerance(tolerance)
        r, q = robot.timestamps, self.timestamps
        if r is None or q is None:
            if len(robot) != len(self):
                raise InputError(
                    f"{robot.name} has {len(robot)} poses and {self.name} has {len(self)} rows: expected the joints of "
                    "each pose. Leave out rows that the other file lacks, or add timestamps to both."
                )
            return self.values
        half = 0.5 * float(np.median(np.abs(np.diff(r)))) if len(r) > 1 else tolerance  # the interval between rows
        if len(robot) == len(self) and (late := float(np.abs(r - q).max())) <= min(tolerance, half):
            if late > SYNCHRONOUS:
                warnings.warn(
                    f"Rows of {robot.name} and {self.name} are paired by their order although their timestamps differ "
                    f"by up to {late:.6g} s. That is right if the robot stood still.",
                    InputWarning,
                    stacklevel=4,
                )
            return self.values
        at = nearest(r, q)
        values = self.values[at]
        values[np.abs(r - q[at]) > tolerance] = np.nan
        return values

    def between(self, robot: Side) -> Array:
        """Joint values (n, L) at the times of a robot's stream, interpolated; NaN where that would be extrapolated."""
        if robot.timestamps is None or self.timestamps is None:
            without = robot.name if robot.timestamps is None else self.name
            raise InputError(f"{without} has no timestamps: joints and robot poses of streams are paired by time.")
        order = np.argsort(self.timestamps, kind="stable")
        times, wanted = self.timestamps[order], robot.timestamps
        values = joint_values_at(times, self.values[order], wanted)
        right = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
        step = np.diff(times, append=np.inf) if len(times) < 2 else np.diff(times)
        far = step[right - 1] > GAPS * float(np.median(step))
        on = np.abs(times[nearest(wanted, times)] - wanted) <= SYNCHRONOUS
        outside = (wanted < times[0] - SYNCHRONOUS) | (wanted > times[-1] + SYNCHRONOUS)
        values[(far & ~on) | outside] = np.nan
        return values


def joints_of(joints: Any, kinematics: Any, units: str | None) -> Joints | None:
    """The file of joints and its chain, or None if neither is given."""
    if joints is None and kinematics is None:
        return None
    if joints is None or kinematics is None:
        here, other = ("joints", "kinematics") if kinematics is None else ("kinematics", "joints")
        raise InputError(
            f"Expected `{other}` beside `{here}`: a file of joint values (--joints) and the chain that they move "
            "(--urdf, --dh)."
        )
    return read_joint_file(joints, kinematics, units)


def read_joint_file(path: StrPath | NamedJoints, kinematics: Kinematics, units: str | None = None) -> Joints:
    """Read joint values and say where they are from."""
    from ..model.kinematics.chain import Kinematics
    from ..model.kinematics.joints_file import NamedJoints, read_joints

    require_type("kinematics", kinematics, Kinematics, "Kinematics")
    if isinstance(path, NamedJoints):
        found, name, short, data = read_joints(path, kinematics, units), path.name, path.name, path.values.tobytes()
    else:
        location = as_path(path)
        found, name, short = read_joints(location, kinematics, units), shown(location), shown(as_path(location.name))
        with opened(location, MAX_TABLE_BYTES) as file:
            data = file.read()
    source = Source(short, "joints", len(data), sha256(data).hexdigest(), tuple(found.notes))
    return Joints(found.q, found.timestamps, kinematics, source, name)


def give_joints(poses: PosePairs, values: Array, name: str) -> PosePairs:
    """Return the pairs with their joint values (n, L); pairs without (NaN) are left out, and noted."""
    have = np.isfinite(values).all(axis=1)
    if have.all():
        return replace(poses, joints=values)
    if have.sum() < FEWEST:
        raise InputError(
            f"{int(have.sum())} of {poses.n} poses have joints in {name}, and at least {FEWEST} are needed: are the "
            "timestamps of both files of one clock, in seconds? Rows that belong together may have row numbers."
        )
    rows = np.flatnonzero(~have)
    first, *others = poses.sources
    note = f"{len(rows)} pairs without joints in {name} are left out: {_listed(rows)}"
    left = replace(poses.rows(np.flatnonzero(have)), joints=values[have])
    return replace(left, sources=(replace(first, notes=(*first.notes, note)), *others))


class KnownCamera(NamedTuple):
    """Camera poses with their covariance, of pictures or of points; their file; where they come from."""

    seen: CameraCalibration | PointPoses
    name: str
    source: tuple[Source, ...]
    of_points: bool

    @property
    def poses(self) -> Any:
        """(n, 4, 4)."""
        return self.seen.poses

    @property
    def of_pairs(self) -> dict[str, Any]:
        """The fields of `PosePairs` that say how well the poses are known."""
        return {"camera_covariance": self.seen.covariance} if self.of_points else {"camera_calibration": self.seen}

    def rows_of(self, n: int, name: str, what: str) -> tuple[NDArray[Any], list[str]]:
        """Rows of the n robot poses of file ``name``, and notes; raises `InputError` where they do not belong."""
        rows, notes = (_rows_of_points if self.of_points else _rows_of_pictures)(self, n, f"{name} has {n} {what}")
        if len(left := np.setdiff1d(np.arange(n), rows)):
            source = "pose from points" if self.of_points else "picture of the board"
            notes.append(f"rows without a {source} are left out: {_listed(left)}")
        return rows, notes


def _rows_of_points(known: KnownCamera, n: int, has: str) -> tuple[NDArray[Any], list[str]]:
    seen: Any = known.seen
    rows = np.asarray(seen.rows)
    every = np.union1d(rows, seen.points.row)
    if every[-1] == n and every[0] >= 1:
        return rows - 1, ["poses of the points are numbered from 1"]
    if every[-1] >= n:
        raise InputError(
            f"{has} and {known.name} points of pose {every[-1]}: pose k of the points, counted from 0, belongs to row "
            "k of the robot. Leave out what the other side lacks, or number the poses by the rows of the robot "
            "(docs/how-to/points.md)."
        )
    return rows, []


def _rows_of_pictures(known: KnownCamera, n: int, has: str) -> tuple[NDArray[Any], list[str]]:
    seen: Any = known.seen
    rows, corners = seen.rows, seen.corners
    taken, without = corners.n + len(corners.missing), len(corners.missing) or "none"
    # Of pictures it is known how many there were; a table of corners may leave out some.
    counted = bool(corners.missing) or (corners.image_size is not None and not known.source)
    if (counted and taken != n) or rows[-1] >= n:
        count = f"{corners.n} pictures, the last of row {rows[-1]}"
        if counted:
            count = f"{taken} pictures, {without} of them without a board"
        raise InputError(
            f"{has} and {known.name} {count}: picture k, counted from 0 in the order of the names (the column row of "
            "corners), belongs to row k of the robot. Leave out what the other side lacks; a picture without a board "
            "stays."
        )
    return rows, []


def _listed(rows: NDArray[Any]) -> str:
    return ", ".join(map(str, rows[:20])) + (", ..." if len(rows) > 20 else "")


def is_folder_of_poses(path: Path) -> bool:
    """Return whether a folder is one of ``uq-handeye camera`` or ``uq-handeye points``."""
    if not path.is_dir():
        return False
    from ..model.camera.calibration_files import is_camera_folder
    from ..model.points.result import is_points_folder

    return is_points_folder(path) or is_camera_folder(path)


def known_camera(camera: Any) -> KnownCamera | None:
    """The camera poses with their covariance that are meant, if some are."""
    if camera is None or (isinstance(camera, str | PathLike) and not as_path(camera).is_dir()):
        return None  # poses of a file, or none: what follows is slow to import
    from ..model.camera.calibration_files import CORNERS, is_camera_folder
    from ..model.camera.result import CameraCalibration
    from ..model.camera.stored_calibration import read_camera
    from ..model.points.result import POINTS, PointPoses, is_points_folder, read_point_poses

    kinds = {CameraCalibration: ("the pictures", (), False), PointPoses: ("the points", (), True)}
    if (of := kinds.get(type(camera))) is not None:
        return KnownCamera(camera, *of)
    folder = as_path(camera)
    if is_points_folder(folder):
        found = read_point_poses(folder)
        note = f"{found.n} poses from {int(found.used.sum())} points with their joint covariance"
        return KnownCamera(found, shown(folder), (_source(folder, POINTS, "points", note),), True)
    if not is_camera_folder(folder):
        return None
    seen = read_camera(folder)
    note = f"{seen.corners.n} poses of the model {seen.model} with their joint covariance"
    return KnownCamera(seen, shown(folder), (_source(folder, CORNERS, "corners", note),), False)


def _source(folder: Path, file: str, format: str, note: str) -> Source:
    with opened(folder / file, MAX_TABLE_BYTES) as opened_file:
        data = opened_file.read()
    return Source(shown(Path(folder.name) / file), format, len(data), sha256(data).hexdigest(), (note,))
