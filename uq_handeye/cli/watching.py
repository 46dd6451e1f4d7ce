"""Estimation of X after each pose that arrives in a folder, for ``calibrate --watch`` and ``live``."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .messages import LOG, quiet
from .noise import Given
from .pictures import Pictures, Scene
from .pose_files import PoseFiles, StreamFiles
from .printing import emit

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..calibration.tolerance import Tolerance
    from ..model.poses.pose_pairs import PosePairs
    from ..use.live_session.folder import Folder
    from ..use.live_session.question import Answer, Question
    from .views import Views


def folder_of(path: Path, files: StreamFiles, seen: "Pictures | Views | None") -> "Folder":
    """Return the folder, with the options by which its files are read; a scene needs pictures."""
    from ..use.live_session.folder import Folder

    if isinstance(seen, Scene) and not seen.images:
        raise InputError("--scene needs pictures. Add --images 'PATTERN'.")
    return Folder(path, files.reading, seen if isinstance(seen, Pictures) else None)


def watched(path: Path, files: PoseFiles, seen: "Pictures | Views | None", output: Path | None) -> "Folder":
    """Return the folder to watch; raises `InputError` for options that do not apply to it."""
    if not path.is_dir():
        raise InputError(f"Expected --watch to name a folder, got {path}.")
    if files.robot is not None or files.camera is not None:
        given = files.robot or files.camera
        raise InputError(f"--watch {path} finds the pose files in the folder. Remove {given}.")
    if files.pair not in (None, "rows"):
        raise InputError(f"--watch pairs pose k of the robot with pose k of the camera. Remove --pair {files.pair}.")
    if files.exclude is not None or files.only is not None:
        raise InputError("--exclude and --only number poses that are there. Use them without --watch, afterwards.")
    if output is not None and output.resolve() == path.resolve():
        raise InputError("-o names the folder that is watched. Name another one.")
    return folder_of(path, files, seen)


def question_of(
    given: Given, seen: "Pictures | Views | None", options: dict[str, Any], tolerance: "Tolerance | None"
) -> "Question":
    """Return the computation that is repeated after each pose, with the noise and the shared errors as given."""
    from ..use.live_session.question import Question
    from .views import Views

    def noise_and_shared(poses: "PosePairs") -> tuple[Any, Any]:
        noise = given.noise_at(poses)
        if isinstance(seen, Views):
            of_views = seen.noise_with(poses, noise, given.prior)
            return of_views, given.shared.errors(poses, None, given.file, seen)
        return noise, given.shared.errors(poses, noise, given.file)

    return Question({**options, "prior": given.prior}, noise_and_shared, tolerance)


class Watch(NamedTuple):
    """Folder and question, and where the result goes."""

    folder: "Folder"
    question: "Question"
    output: Path | None
    as_json: bool

    def run(self, pause: Callable[[float], None] = time.sleep) -> "Calibration | None":
        """Answer after each pose until the tolerance is met or Ctrl-C; return the last result."""
        from ..use.live_session.folder import settled

        last: Calibration | None = None
        count, problem = 0, ""
        try:
            self._say([f"Watching {self.folder.path}. Ctrl-C ends the session."])
            for _ in settled(self.folder.state, pause):
                try:
                    n, poses = self.folder.read()
                except InputError as error:  # half written, or wrong
                    if str(error) != problem:
                        problem = str(error)
                        self._say([f"Waiting: {problem}"])
                    continue
                if n == count:
                    continue
                count, problem = n, ""
                answer = self.question.ask(n, poses)
                if answer.result is not None:
                    last = answer.result
                    self._write(answer)
                self._say(list(answer.lines))
                if answer.passed:
                    break
        except KeyboardInterrupt:
            self._say([f"Stopped after {count} pose{'' if count == 1 else 's'}."])
        return last

    def _write(self, answer: "Answer") -> None:
        from ..read import write_files
        from .delivery import json_of

        if self.output is not None and answer.result is not None:
            write_files(self.output, {"result.json": json_of(answer.result, answer.verdicts)})

    def _say(self, lines: list[str]) -> None:
        if quiet():
            return
        for line in lines:
            if self.as_json:
                LOG.info("%s", line)
            else:
                emit(line + "\n")
