"""Camera poses that come with their covariance: of a calibrated camera, points in 3-D or a scene, or their folders."""

from __future__ import annotations

from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.source import Source
from ..core.geometry.se3 import Array
from ..core.limits import MAX_TABLE_BYTES
from ..errors import InputError
from .joints import listed_rows

if TYPE_CHECKING:
    from ..model.camera.result import CameraCalibration
    from ..model.points.result import PointPoses
    from ..scene.result import ScenePoses


class KnownCamera(NamedTuple):
    """Camera poses with their covariance, their file, and where they come from: of pictures or of points in 3-D."""

    name: str
    source: tuple[Source, ...]
    pictures: CameraCalibration | None = None
    points: PointPoses | None = None
    scene: ScenePoses | None = None

    @property
    def seen(self) -> CameraCalibration | PointPoses | ScenePoses:
        """The calibrated camera, or the poses from points or from a scene."""
        known = self.pictures or self.points or self.scene
        assert known is not None
        return known

    @property
    def poses(self) -> Array:
        """(n, 4, 4) ``camera_T_target``."""
        return self.seen.poses

    def rows_of(self, n: int, name: str, what: str) -> tuple[NDArray[np.intp], list[str]]:
        """Return rows of the n robot poses of a file ``name``, and notes; raises `InputError` where they do not fit."""
        has = f"{name} has {n} {what}"
        if self.points is not None:
            rows, notes = _rows_of_points(self.points, self.name, n, has)
            source = "pose from points"
        elif self.scene is not None:
            if len(self.scene.names) != n:
                raise InputError(
                    f"{has} and {self.name} {len(self.scene.names)} pictures: picture k, counted from 0 in the order "
                    "of the names, belongs to row k of the robot. Leave out what the other side lacks."
                )
            rows, notes = self.scene.rows, []
            source = "picture of the scene"
        else:
            assert self.pictures is not None
            rows, notes = _rows_of_pictures(self.pictures, self.name, bool(self.source), n, has), []
            source = "picture of the board"
        if len(left := np.setdiff1d(np.arange(n), rows)):
            notes.append(f"rows without a {source} are left out: {listed_rows(left)}")
        return rows, notes


def _rows_of_points(seen: PointPoses, file: str, n: int, has: str) -> tuple[NDArray[np.intp], list[str]]:
    rows = np.asarray(seen.rows)
    every = np.union1d(rows, seen.points.row)
    if every[-1] == n and every[0] >= 1:
        return rows - 1, ["poses of the points are numbered from 1"]
    if every[-1] >= n:
        raise InputError(
            f"{has} and {file} points of pose {every[-1]}: pose k of the points, counted from 0, belongs to row "
            "k of the robot. Leave out what the other side lacks, or number the poses by the rows of the robot "
            "(docs/how-to/points.md)."
        )
    return rows, []


def _rows_of_pictures(seen: CameraCalibration, file: str, stored: bool, n: int, has: str) -> NDArray[np.intp]:
    rows, corners = seen.rows, seen.corners
    taken, without = corners.n + len(corners.missing), len(corners.missing) or "none"
    # Of pictures it is known how many there were; a table of corners may leave out some.
    counted = bool(corners.missing) or (corners.image_size is not None and not stored)
    if (counted and taken != n) or rows[-1] >= n:
        count = f"{corners.n} pictures, the last of row {rows[-1]}"
        if counted:
            count = f"{taken} pictures, {without} of them without a board"
        raise InputError(
            f"{has} and {file} {count}: picture k, counted from 0 in the order of the names (the column row of "
            "corners), belongs to row k of the robot. Leave out what the other side lacks; a picture without a board "
            "stays."
        )
    return rows


def is_folder_of_poses(path: Path) -> bool:
    """Return whether a folder is one of ``uq-handeye camera``, ``points`` or ``scene``."""
    if not path.is_dir():
        return False
    from ..model.camera.calibration_files import is_camera_folder
    from ..model.points.result import is_points_folder
    from ..scene.result import is_scene_folder

    return is_points_folder(path) or is_camera_folder(path) or is_scene_folder(path)


def known_camera(camera: StrPath | CameraCalibration | PointPoses | ScenePoses | None) -> KnownCamera | None:
    """Return camera poses with their covariance, as given or of a folder; None: it is a file of poses or None."""
    if camera is None or (isinstance(camera, str | PathLike) and not as_path(camera).is_dir()):
        return None  # what follows is slow to import
    from ..model.camera.calibration_files import CORNERS, is_camera_folder
    from ..model.camera.result import CameraCalibration
    from ..model.camera.stored_calibration import read_camera
    from ..model.points.result import POINTS, PointPoses, is_points_folder, read_point_poses
    from ..scene.result import POSES, ScenePoses, is_scene_folder, read_scene

    if isinstance(camera, CameraCalibration):
        return KnownCamera("the pictures", (), camera)
    if isinstance(camera, PointPoses):
        return KnownCamera("the points", (), None, camera)
    if isinstance(camera, ScenePoses):
        return KnownCamera("the pictures", (), None, None, camera)
    folder = as_path(camera)
    if is_scene_folder(folder):
        scene = read_scene(folder)
        note = f"{scene.n} poses from {len(scene.points)} points of a scene with their joint covariance"
        return KnownCamera(shown(folder), (_source(folder, POSES, "scene", note),), None, None, scene)
    if is_points_folder(folder):
        found = read_point_poses(folder)
        note = f"{found.n} poses from {int(found.used.sum())} points with their joint covariance"
        return KnownCamera(shown(folder), (_source(folder, POINTS, "points", note),), None, found)
    if not is_camera_folder(folder):
        return None
    seen = read_camera(folder)
    note = f"{seen.corners.n} poses of the model {seen.model} with their joint covariance"
    return KnownCamera(shown(folder), (_source(folder, CORNERS, "corners", note),), seen)


def _source(folder: Path, file: str, format: str, note: str) -> Source:
    with opened(folder / file, MAX_TABLE_BYTES) as opened_file:
        data = opened_file.read()
    return Source(shown(Path(folder.name) / file), format, len(data), sha256(data).hexdigest(), (note,))
