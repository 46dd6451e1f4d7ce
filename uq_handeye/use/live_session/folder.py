"""Poses that arrive in a folder: detection of changed files, and the pairs that are complete so far."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_length
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs

POSE_FILES = (".csv", ".txt", ".tum", ".json", ".jsonl", ".yaml", ".yml", ".npz", ".npy", ".dat", ".mat")

if TYPE_CHECKING:
    from ...model.camera.corners import Corners
    from ...model.camera.description import Board
    from ...model.camera.result import CameraCalibration

State = tuple[tuple[str, int, int], ...]


class Seen(Protocol):
    """Pictures of a board: where they are, and the camera that saw its corners."""

    @property
    def images(self) -> str: ...

    def read_board(self) -> Board:
        """Return the board."""

    def calibrate(self, corners: Corners) -> CameraCalibration:
        """Return the calibrated camera."""


@runtime_checkable
class SeenScene(Protocol):
    """Pictures of a scene: where they are, and what makes poses of them."""

    @property
    def images(self) -> str: ...

    def paired(self, paths: list[Path], robot: Array, setup: str) -> PosePairs:
        """Return the poses of pictures with those of the robot (n, 4, 4)."""


@dataclass(frozen=True)
class SeenBoard:
    """Pictures of a board, which is as `camera.board.Board.text` says."""

    images: str
    board: str

    def read_board(self) -> Board:
        """Return the board."""
        from ...model.camera.description import board_of

        return board_of(self.board)

    def calibrate(self, corners: Corners) -> CameraCalibration:
        """Return the calibrated camera."""
        from ...model.camera.calibrate import calibrate_camera

        return calibrate_camera(corners)


def board_text(kind: str, numbers: str, side: str, second: str = "", dictionary: str = "") -> str:
    """Return ``Board.text`` of a board as people describe it; raises `InputError` for one that is none.

    ``numbers`` as 9x6 (of a single tag not used), ``side`` of a square or tag as 20mm; ``second`` the side of the
    markers of a ChArUco board, or the gap between the tags of a grid.
    """
    from ...model.camera.description import Board

    single = kind == "apriltag"
    found = re.fullmatch(r"\s*(\d{1,3})\s*x\s*(\d{1,3})\s*", "1x1" if single else numbers)
    if found is None:
        raise InputError(f"Expected the numbers of the board as COLUMNSxROWS, e.g. 9x6, got {numbers!a}.")
    more: dict[str, Any] = {"dictionary": dictionary.strip() or None} if kind != "chessboard" else {}
    if kind not in ("chessboard", "apriltag"):
        more["marker" if kind == "charuco" else "spacing"] = second.strip() or None
    return Board(int(found[1]), int(found[2]), parse_length(side, "square"), kind, **more).text


@dataclass(frozen=True)
class Folder:
    """Folder of pose files; ``how`` are arguments of `read_poses` that say how they are read."""

    path: Path
    how: Mapping[str, Any] = field(default_factory=dict)
    seen: Seen | SeenScene | None = None

    @property
    def of_scene(self) -> bool:
        """True if the pictures are of a scene without a board."""
        return isinstance(self.seen, SeenScene)

    def state(self) -> State:
        """Return names, sizes and times of change of the files."""
        found = []
        joints = [Path(self.how["joints"])] if "joints" in self.how else []
        for path in [*self.pose_files(), *self._pictures(), *joints]:
            with suppress(OSError):  # gone since
                status = path.stat()
                found.append((str(path), status.st_size, status.st_mtime_ns))
        return tuple(found)

    def read(self) -> tuple[int, PosePairs | None]:
        """Return how many poses are complete, and the poses; None: none yet, or too few pictures of the board.

        Two files that are equally long, or one of both sides, are read as `calibrate` reads them.
        """
        from ...read import read_poses
        from ...read.arrived import count_arrived, read_arrived

        robot, camera = self._sides()
        poses: PosePairs | None
        if isinstance(self.seen, SeenScene):
            return self._with_scene(self.seen, robot)
        if self.seen is not None:
            return self._with_pictures(self.seen, robot)
        formats = self.how.get("format", (None, None))
        if "joints" in self.how:  # the robot side
            files = robot if camera is None else camera
            poses = read_poses(None, files[0], **self.how) if len(files) == 1 and self._filled(files[0]) else None
            return (0, None) if poses is None else (poses.n, poses)
        if len(robot) == 1 and camera is None and count_arrived(robot, formats[0]) >= 3:
            poses = read_poses(robot[0], **self.how)
        elif len(robot) == 1 and camera is not None and len(camera) == 1:
            count, other = count_arrived(robot, formats[0]), count_arrived(camera, formats[1], "camera")
            same = count == other and count >= 3
            poses = read_poses(robot[0], camera[0], **self.how) if same else read_arrived(robot, camera, **self.how)
        else:
            poses = read_arrived(robot, camera, **self.how)
        return (0, None) if poses is None else (poses.n, poses)

    def _filled(self, path: Path) -> bool:
        """Return whether there are camera poses and joints, which a program that starts may not have written yet."""
        from ...read.arrived import count_arrived

        joints = Path(self.how["joints"])
        return joints.exists() and count_arrived([path], role="camera") > 0

    def _with_pictures(self, pictures: Seen, robot: list[Path]) -> tuple[int, PosePairs | None]:
        from ...fit.diagnostics.board_rotation import resolve_board_rotation
        from ...fit.diagnostics.pose_ambiguity import resolve_pose_ambiguity
        from ...model.camera.board import find_corners, source_of
        from ...read.arrived import count_arrived, read_arrived

        board, paths = pictures.read_board(), self._pictures()
        n = min(len(paths), count_arrived(robot, self.how.get("format", (None, None))[0]))
        if n < 3:
            return n, None
        seen = pictures.calibrate(find_corners(paths[:n], board, False))
        of_robot = {name: value for name, value in self.how.items() if name != "camera_frame"}
        poses = read_arrived(robot, seen, **of_robot)
        assert poses is not None
        poses = resolve_pose_ambiguity(resolve_board_rotation(poses, board))
        return n, replace(poses, sources=(*poses.sources, source_of(paths[:n], board)))

    def _with_scene(self, scene: SeenScene, robot: list[Path]) -> tuple[int, PosePairs | None]:
        from ...read.arrived import count_arrived, read_arrived
        from ...scene.estimate import MIN_PICTURES_OF_SCENE

        paths = self._pictures()
        n = min(len(paths), count_arrived(robot, self.how.get("format", (None, None))[0]))
        if n < MIN_PICTURES_OF_SCENE:
            return n, None
        of_robot = {name: value for name, value in self.how.items() if name != "camera_frame"}
        return n, read_arrived(robot, lambda G, setup: scene.paired(paths[:n], G[:n], setup), **of_robot)

    def pictures_of(self, poses: PosePairs) -> list[Path]:
        """Return the picture of each pose: those of the board, or as many as there are in the folder."""
        from ...model.camera.picture_files import SUFFIXES

        paths = self._pictures() or _in_order(path for path in self.path.iterdir() if path.suffix.lower() in SUFFIXES)
        seen = poses.camera_calibration
        rows = range(poses.n) if seen is None else seen.rows
        return [paths[k] for k in rows if k < len(paths)]

    def _sides(self) -> tuple[list[Path], list[Path] | None]:
        """Return the files of the robot and of the camera; None: the former hold both sides."""
        files = self.pose_files()
        robot, camera = ([path for path in files if path.name.lower().startswith(side)] for side in ("robot", "camera"))
        if self.seen is not None or robot or camera:
            return robot, camera
        return files, None

    @property
    def holds_camera(self) -> bool:
        """True if there are camera poses as files, or both sides in one."""
        robot, camera = self._sides()
        return bool(camera) or (camera is None and bool(robot))

    def pose_files(self) -> list[Path]:
        """Return the pose files, in the order in which their poses are counted."""
        return _in_order(path for path in self.path.iterdir() if path.suffix.lower() in POSE_FILES)

    def _pictures(self) -> list[Path]:
        if self.seen is None:
            return []
        from ...model.camera.picture_files import picture_paths

        with suppress(InputError):  # none yet
            return picture_paths(self.seen.images)
        return []


def _in_order(paths: Iterable[Path]) -> list[Path]:
    from ...core.files.folders import natural

    return sorted((path for path in paths if path.is_file() and path.name[0] != "."), key=natural)


def settled(
    look: Callable[[], State], pause: Callable[[float], bool | None], interval: float = 0.5, max_changes: int = 6
) -> Iterator[State]:
    """Yield each state of the files once it has not changed for one interval (s), and never the same twice.

    Files that change all the time are yielded after ``max_changes`` looks. Ends where ``pause``, which waits for a
    number of seconds, returns true.
    """
    before: State | None = None
    handled: State = ()
    changes = 0
    while True:
        now = look()
        changes = changes + 1 if now != before else 0
        if now != handled and (now == before or changes >= max_changes):
            handled, changes = now, 0
            yield now
        before = now
        if pause(interval):
            return
