"""Stored results that a command takes, of which it may choose one camera and one target."""

import json
import re
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import InputError
from .messages import given_options
from .printing import emit

if TYPE_CHECKING:
    from ..calibration.load import Result
    from ..calibration.result import Calibration
    from ..core.files.json_values import Json

# Options that every command takes with a stored result.
EVERYWHERE = frozenset(
    {
        "RESULT",
        "ROBOT",
        "--camera",
        "--target",
        "--json",
        "--output",
        "--quiet",
        "--verbose",
        "--no-color",
        "--log-file",
    }
)


class OneOfRig(NamedTuple):
    """Options that choose one camera of a rig.

    Options (Result of a rig):
      of_camera = --camera NAME: Camera of a rig, with the result of one: the marginal of its joint posterior. Default:
        each camera in turn; plan: all together; verify: the only one, because touches are of what one camera saw.
      of_target = --target NAME: Target that the camera sees. Default: the one that it sees most often.
    """

    of_camera: str | None = None
    of_target: str | None = None

    def each(self, path: Path | None, option: str = "--camera") -> list[str]:
        """Return the cameras of a result, where it has several and none is chosen; else none."""
        if self.of_camera is not None or path is None or not is_result(path):
            return []
        from ..calibration.load import load

        cameras = list(load(path).camera_names)
        if len(cameras) > 1 and self.of_target is not None:
            raise InputError(f"--target {self.of_target} is of one camera. Add {option} {cameras[0]}.")
        return cameras if len(cameras) > 1 else []

    def read(self, path: Path) -> "Calibration":
        """Return the result of one camera, or one camera of that of several."""
        from ..calibration.load import load

        return self.of(load(path), path)

    def of(self, found: "Result", path: Path, option: str = "--camera") -> "Calibration":
        """Return a result as that of one camera; raises `InputError` for a camera that it does not have.

        ``option`` names the camera, where --camera asks for camera poses.
        """
        cameras = found.camera_names
        if self.of_camera is None and len(cameras) > 1:
            raise InputError(f"{path} has the cameras {', '.join(cameras)}. Choose one: {option} {cameras[0]}.")
        of_camera, of_target = (option, self.of_camera, cameras), ("--target", self.of_target, found.target_names)
        for called, name, known in (of_camera, of_target):
            if name not in (None, *known):
                raise InputError(f"{called} {name}: {path} has {', '.join(known)}. Correct the name.")
        return found.of_camera(self.of_camera, self.of_target)


def run_each(
    cameras: Sequence[str], as_json: bool, output: Path | None, command: Callable[[str, Path | None], int]
) -> int:
    """Run a command for each camera of a rig, with its name and folder, and return the largest exit status.

    Answers are below the names of the cameras; of JSON one object by their names.
    """
    from ..core.files.json_files import json_text

    statuses: list[int] = []
    found: dict[str, Json] = {}
    for name in cameras:
        folder = None if output is None else output / name
        if not as_json:
            emit(f"{name}:\n" if not statuses else f"\n{name}:\n")
            statuses.append(command(name, folder))
            continue
        with redirect_stdout(StringIO()) as said:
            statuses.append(command(name, folder))
        found[name] = json.loads(said.getvalue())
    if as_json:
        emit(json_text({"cameras": found}))
    return max(statuses)


def of_rig() -> bool:
    """Return whether the command is of several cameras: --camera NAME=FILE, or a rig file."""
    return "--camera" in given_options()


def is_result(path: Path | None) -> bool:
    """Return whether a file is the result of a calibration, by its format."""
    from ..core.files.json_files import result_file  # NumPy is slow to import

    path = None if path is None else result_file(path)
    if path is None or path.suffix.lower() != ".json" or not path.is_file():
        return False
    with path.open("rb") as file:
        start = file.read(200).decode("utf-8", "replace")
    return re.match(r'\s*{\s*"format"\s*:\s*"uq-handeye (?:calibration|rig) \d+"', start) is not None


def refuse(*taken: str, what: str = "the result of a rig") -> None:
    """Raise `InputError` for options that the command does not take for a stored result."""
    if wrong := [name for name in given_options() if name not in EVERYWHERE | set(taken)]:
        raise InputError(f"{', '.join(wrong)}: not for {what}. Remove it.")
