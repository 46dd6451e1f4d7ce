"""Poses that arrive in a folder one by one: when to look at the files, what they hold, the answer after each."""

import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, InputWarning, NotConvergedError
from .messages import LOG, quiet
from .options.common import emit
from .options.noise import Given
from .pictures import Pictures
from .pose_files import PoseFiles

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..poses.pose_pairs import PosePairs
    from ..statement.tolerance import Verdict
    from .outcome import Wanted
    from .views import Views

# Seconds between two looks; files that change from one to the next are waited for, but not for ever.
INTERVAL, MOST_CHANGES = 0.5, 6
POSE_FILES = (".csv", ".txt", ".tum", ".json", ".yaml", ".yml", ".npz", ".npy", ".dat")

State = tuple[tuple[str, int, int], ...]


@dataclass(frozen=True)
class Arrivals:
    """Folder that is watched, and how its files are read."""

    folder: Path
    files: PoseFiles
    seen: "Pictures | Views | None"

    def state(self) -> State:
        """Return names, sizes and times of change of the files."""
        found = []
        for path in [*self._pose_files(), *self._pictures()]:
            with suppress(OSError):  # gone since
                status = path.stat()
                found.append((str(path), status.st_size, status.st_mtime_ns))
        return tuple(found)

    def read(self) -> "tuple[int, PosePairs | None]":
        """Return how many poses are complete, and the poses; None: too few pictures of the board."""
        from ..io.arrived import read_arrived

        robot, camera = self._sides()
        if isinstance(self.seen, Pictures):
            return self._with_pictures(self.seen, robot)
        poses = read_arrived(robot, camera, camera_frame=self.files.camera_frame, **self._how())
        return (0, None) if poses is None else (poses.n, poses)

    def _with_pictures(self, pictures: Pictures, robot: list[Path]) -> "tuple[int, PosePairs | None]":
        from ..camera.board import find_corners, source_of
        from ..input_checks.pose_ambiguity import resolve_pose_ambiguity
        from ..io.arrived import count_arrived, read_arrived
        from ..poses.board_symmetry import resolve_board_rotation

        board, paths = pictures.board.read(), self._pictures()
        n = min(len(paths), count_arrived(robot, self.files.formats[0]))
        if n < 3:
            return n, None
        corners = find_corners(paths[:n], board, False)
        seen = pictures.calibrate(corners)
        poses = read_arrived(robot, seen, **self._how())
        assert poses is not None
        poses = resolve_pose_ambiguity(resolve_board_rotation(poses, board))
        return n, replace(poses, sources=(*poses.sources, source_of(paths[:n], board)))

    def _how(self) -> dict[str, Any]:
        files = self.files
        return {
            "setup": files.setup,
            "units": files.both_units,
            "format": files.formats,
            "rotation": files.rotations,
            "robot_frame": files.robot_frame,
        }

    def _sides(self) -> tuple[list[Path], list[Path] | None]:
        """Return the files of the robot and of the camera; None: the former hold both sides."""
        files = self._pose_files()
        robot, camera = ([path for path in files if path.name.lower().startswith(side)] for side in ("robot", "camera"))
        if isinstance(self.seen, Pictures) or robot or camera:
            return robot, camera
        return files, None

    def _pose_files(self) -> list[Path]:
        return self._in_order(path for path in self.folder.iterdir() if path.suffix.lower() in POSE_FILES)

    def _pictures(self) -> list[Path]:
        if not isinstance(self.seen, Pictures):
            return []
        from ..camera.board import picture_paths

        with suppress(InputError):  # none yet
            return picture_paths(self.seen.images)
        return []

    @staticmethod
    def _in_order(paths: Iterator[Path]) -> list[Path]:
        from ..files.many import natural

        return sorted((path for path in paths if path.is_file() and path.name[0] != "."), key=natural)


def arrivals_of(folder: Path, files: PoseFiles, seen: "Pictures | Views | None", output: Path | None) -> Arrivals:
    """Return what is watched; raises `InputError` for options that do not go with it."""
    if not folder.is_dir():
        raise InputError(f"Expected --watch to name a folder, got {folder}.")
    if files.robot is not None or files.camera is not None:
        given = files.robot or files.camera
        raise InputError(f"--watch {folder} finds the pose files in the folder. Remove {given}.")
    if files.pair not in (None, "rows"):
        raise InputError(f"--watch pairs pose k of the robot with pose k of the camera. Remove --pair {files.pair}.")
    if files.exclude is not None or files.only is not None:
        raise InputError("--exclude and --only number poses that are there. Use them without --watch, afterwards.")
    if output is not None and output.resolve() == folder.resolve():
        raise InputError("-o names the folder that is watched. Name another one.")
    return Arrivals(folder, files, seen)


def settled(look: Callable[[], State], pause: Callable[[float], None]) -> Iterator[State]:
    """Yield each state of the files once it has not changed for one interval, and never the same twice.

    Files that change all the time are yielded after `MOST_CHANGES` looks.
    """
    before: State | None = None
    handled: State = ()
    changes = 0
    while True:
        now = look()
        changes = changes + 1 if now != before else 0
        if now != handled and (now == before or changes >= MOST_CHANGES):
            handled, changes = now, 0
            yield now
        before = now
        pause(INTERVAL)


@dataclass(frozen=True)
class Session:
    """Request that is answered after each pose, and where the result goes."""

    arrivals: Arrivals
    given: Given
    options: dict[str, Any]  # of `calibrate`
    wanted: "Wanted"
    output: Path | None
    as_json: bool

    def run(self, pause: Callable[[float], None] = time.sleep) -> "Calibration | None":
        """Answer after each pose until the tolerance is met or Ctrl-C; return the last result."""
        last: Calibration | None = None
        count, problem = 0, ""
        try:
            self._say([f"Watching {self.arrivals.folder}. Ctrl-C ends the session."])
            for _ in settled(self.arrivals.state, pause):
                try:
                    n, poses = self.arrivals.read()
                except InputError as error:  # half written, or wrong
                    if str(error) != problem:
                        problem = str(error)
                        self._say([f"Waiting: {problem}"])
                    continue
                if n == count:
                    continue
                count, problem = n, ""
                result, verdict = self._after(n, poses)
                last = result or last
                if verdict is not None and verdict.passed:
                    break
        except KeyboardInterrupt:
            self._say([f"Stopped after {count} pose{'' if count == 1 else 's'}."])
        return last

    def _after(self, n: int, poses: "PosePairs | None") -> "tuple[Calibration | None, Verdict | None]":
        from ..calibration.calibrate import calibrate
        from ..planning.after_each import next_pose, words_after, words_without
        from .views import Views

        if poses is None or n < 3:
            self._say(words_without(n, InputError("")))
            return None, None
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)  # the last result has them
                noise: Any = self.given.noise
                if isinstance(self.arrivals.seen, Views):
                    noise = self.arrivals.seen.beside(poses, noise, self.options["prior"])
                    shared = self.given.shared.errors(poses, None, self.given.file, self.arrivals.seen)
                else:
                    shared = self.given.shared.errors(poses, noise, self.given.file)
                result = calibrate(poses, noise=noise, shared=shared, **self.options)
        except (InputError, NotConvergedError) as error:
            self._say(words_without(n, error))
            return None, None
        verdict = self.wanted.verdict(result)
        if self.output is not None:
            self._write(result, verdict)
        ended = verdict is not None and verdict.passed
        self._say(words_after(result, verdict, None if ended else next_pose(result, noise, shared)))
        return result, verdict

    def _write(self, result: "Calibration", verdict: "Verdict | None") -> None:
        from ..io import write_files
        from .outcome import json_of

        assert self.output is not None
        write_files(self.output, {"result.json": json_of(result, verdict)})

    def _say(self, lines: list[str]) -> None:
        if quiet():
            return
        for line in lines:
            if self.as_json:
                LOG.info("%s", line)
            else:
                emit(line + "\n")
