"""Camera poses that come with their covariance: a calibrated camera, or poses from points in 3-D, or their folders."""

from __future__ import annotations

from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files import lines as _lines
from ..core.files.open import as_path, opened, shown
from ..core.files.source import Source
from ..errors import InputError

if TYPE_CHECKING:
    from ..model.camera.result import CameraCalibration
    from ..model.points.result import PointPoses


class KnownCamera(NamedTuple):
    """Camera poses with their covariance, the rows of the robot that they belong to, and where they come from."""

    camera: CameraCalibration | None
    points: PointPoses | None
    name: str
    source: tuple[Source, ...]

    @property
    def poses(self) -> Any:
        """(n, 4, 4)."""
        found = self.points if self.camera is None else self.camera
        assert found is not None
        return found.poses

    @property
    def of_pairs(self) -> dict[str, Any]:
        """The fields of `PosePairs` that say how well the poses are known."""
        if self.points is not None:
            return {"camera_covariance": self.points.covariance}
        return {"camera_calibration": self.camera}

    def rows_of(self, n: int, name: str, what: str) -> tuple[NDArray[Any], list[str]]:
        """Rows of the n robot poses of file ``name``, and notes; raises `InputError` where they do not belong."""
        return self._rows_of_points(n, name, what) if self.camera is None else self._rows_of_pictures(n, name, what)

    def _rows_of_points(self, n: int, name: str, what: str) -> tuple[NDArray[Any], list[str]]:
        assert self.points is not None
        rows = np.asarray(self.points.rows)
        all_rows = np.union1d(rows, self.points.points.row)
        notes = []
        if all_rows[-1] == n and all_rows[0] >= 1:
            rows = rows - 1
            notes.append("poses of the points are numbered from 1")
        elif all_rows[-1] >= n:
            raise InputError(
                f"{name} has {n} {what} and {self.name} points of pose {all_rows[-1]}: pose k of the points, counted "
                "from 0, belongs to row k of the robot. Leave out what the other side lacks, or number the poses by "
                "the rows of the robot (docs/how-to/points.md)."
            )
        if len(left := np.setdiff1d(np.arange(n), rows)):
            notes.append(f"rows without a pose from points are left out: {_listed(left)}")
        return rows, notes

    def _rows_of_pictures(self, n: int, name: str, what: str) -> tuple[NDArray[Any], list[str]]:
        assert self.camera is not None
        rows, corners = self.camera.rows, self.camera.corners
        taken = corners.n + len(corners.missing)
        # Of pictures it is known how many there were; a table of corners may leave out some.
        counted = bool(corners.missing) or (corners.image_size is not None and not self.source)
        if (counted and taken != n) or rows[-1] >= n:
            count = (
                f"{taken} pictures, {len(corners.missing) or 'none'} of them without a board"
                if counted
                else (f"{corners.n} pictures, the last of row {rows[-1]}")
            )
            raise InputError(
                f"{name} has {n} {what} and {self.name} {count}: picture k, counted from 0 in the order of the names "
                "(the column row of corners), belongs to row k of the robot. Leave out what the other side lacks; a "
                "picture without a board stays."
            )
        left = np.setdiff1d(np.arange(n), rows)
        return rows, [f"rows without a picture of the board are left out: {_listed(left)}"] if len(left) else []


def _listed(rows: NDArray[Any]) -> str:
    return ", ".join(map(str, rows[:20])) + (", ..." if len(rows) > 20 else "")


def is_folder_of_poses(path: Path) -> bool:
    """Return whether a folder is one of ``uq-handeye camera`` or ``uq-handeye points``."""
    if not path.is_dir():
        return False
    from ..model.camera.files.folder import is_camera_folder
    from ..model.points.files.folder import is_points_folder

    return is_points_folder(path) or is_camera_folder(path)


def known_camera(camera: Any) -> KnownCamera | None:
    """The camera poses with their covariance that are meant, if some are."""
    if camera is None or (isinstance(camera, str | PathLike) and not as_path(camera).is_dir()):
        return None  # poses of a file, or none: what follows is slow to import
    from ..model.camera.files.folder import is_camera_folder, read_camera
    from ..model.camera.files.folder_writer import CORNERS
    from ..model.camera.result import CameraCalibration
    from ..model.points.files.folder import is_points_folder, read_point_poses
    from ..model.points.files.folder_writer import POINTS
    from ..model.points.result import PointPoses

    if isinstance(camera, CameraCalibration):
        return KnownCamera(camera, None, "the pictures", ())
    if isinstance(camera, PointPoses):
        return KnownCamera(None, camera, "the points", ())
    folder = as_path(camera)
    if is_points_folder(folder):
        found = read_point_poses(folder)
        note = f"{found.n} poses from {int(found.used.sum())} points with their joint covariance"
        return KnownCamera(None, found, shown(folder), (_source(folder, POINTS, "points", note),))
    if not is_camera_folder(folder):
        return None
    seen = read_camera(folder)
    note = f"{seen.corners.n} poses of the model {seen.model} with their joint covariance"
    return KnownCamera(seen, None, shown(folder), (_source(folder, CORNERS, "corners", note),))


def _source(folder: Path, file: str, format: str, note: str) -> Source:
    with opened(folder / file, _lines.MAX_BYTES) as opened_file:
        data = opened_file.read()
    return Source(shown(Path(folder.name) / file), format, len(data), sha256(data).hexdigest(), (note,))
