"""``check``, ``update``, ``predict`` and ``plan`` of the result of a rig."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ..delivery import deliver
from ..messages import given_options, quiet, timed
from ..options.common import emit
from ..options.touches import coordinates

if TYPE_CHECKING:
    from ...rig.description import Rig
    from ...rig.result import RigCalibration

_EVERYWHERE = {"RESULT", "--json", "--output", "--quiet", "--verbose", "--no-color", "--log-file"}


def stored_rig(path: Path | None) -> "RigCalibration | None":
    """Return the result of a rig, None for another file."""
    if path is None or path.suffix.lower() != ".json" or not path.is_file():
        return None
    from ...calibration.result import load
    from ...rig.result import RigCalibration

    with path.open("rb") as file:  # those of one camera are read by their own command
        if b"uq-handeye rig " not in file.read(200):
            return None
    found = load(path)
    return found if isinstance(found, RigCalibration) else None


def refuse(*taken: str) -> None:
    """Raise `InputError` for options that the command does not take for a rig."""
    if wrong := [name for name in given_options() if name not in _EVERYWHERE | set(taken)]:
        raise InputError(f"{', '.join(wrong)}: not for the result of a rig. Remove it.")


def new_views(stored: "RigCalibration", file: Path | None) -> "Rig":
    """Return new views of a rig file."""
    from ...rig.files.rig_file import read_rig

    if file is None or file.suffix.lower() != ".toml":
        raise InputError(
            "New views of a rig come as a rig file, e.g. today.toml, with the names of the calibrated one (rig.md)."
        )
    return read_rig(file)[0]


def check_stored_rig(
    stored: "RigCalibration", file: Path | None, level: float, as_json: bool, output: Path | None
) -> int:
    """Check the result of a rig by new views; exit status 4 if something changed."""
    refuse("ROBOT", "--level")
    found = stored.check(new_views(stored, file), level=level)
    written = "" if output is None else deliver(output, {"check.json": found.to_json(), "check.txt": found.text()})
    emit(found.to_json() if as_json else f"{found.sentence}\n" if quiet() else found.text() + written)
    return 4 if found.changed else 0


def update_stored_rig(
    stored: "RigCalibration", file: Path | None, although_changed: bool, wishes: Any, wanted: Any, outputs: Any
) -> int:
    """Update the result of a rig by new views."""
    from ...rig.in_use.update import update_rig
    from .calibrate import deliver_rig

    refuse("ROBOT", "--although-changed", "--report", "--about", "--full-report", "--paper", "--tolerance", "--at")
    with timed("updating"):
        found = update_rig(stored, new_views(stored, file), although_changed=although_changed)
    return deliver_rig(found, wishes, wanted, outputs)


def predict_stored_rig(
    stored: "RigCalibration",
    camera: str | None,
    into: str | None,
    point: list[str] | None,
    robot: Path | None,
    as_json: bool,
    output: Path | None,
) -> None:
    """Predict points of a camera of a rig at robot poses of its arm, or where it stands still."""
    import numpy as np

    from ...read import json_text
    from ...rig.files.pose_rows import read_rows

    refuse("--of", "--into", "--point", "--robot", "--robot-units", "--robot-format")
    if camera is None or not point:
        raise InputError("A rig needs --of CAMERA and --point X,Y,Z in the frame of that camera. Add them.")
    arms = list(stored.rig.arms)
    if robot is not None and len(arms) > 1:
        raise InputError("--robot: the rig has several arms; predict in Python with the poses of each.")
    at = None if robot is None else {arms[0]: read_rows(robot, "robot").poses}
    points = np.array([coordinates(text, "--point") for text in point])
    found = stored.predict(camera, points, at, into or "world")
    data = json_text(found.to_dict())
    head = " ".join([*(f"{name:>11}" for name in "xyz"), *(f"{f'sd {name}':>8}" for name in "xyz")])
    lines = [f"Points of {camera} in the frame {found.frame}", f"{'row':>4} {'point':>5} {head}  (mm)"]
    for i in range(len(found.points)):
        for j, (x, sd) in enumerate(zip(1e3 * found.points[i], 1e3 * found.std[i], strict=True)):
            numbers = " ".join([*(f"{value:>11.3f}" for value in x), *(f"{value:>8.3f}" for value in sd)])
            lines.append(f"{i:>4} {j:>5} {numbers}")
    written = "" if output is None else deliver(output, {"predictions.json": data})
    emit(data if as_json else "\n".join(lines) + "\n" + written)


def plan_stored_rig(
    stored: "RigCalibration",
    k: int,
    candidates: Path | None,
    sample: int,
    seed: int,
    as_json: bool,
    output: Path | None,
) -> None:
    """Choose the views of a rig to take next."""
    from ...read import pose_text
    from ...rig.files.pose_rows import read_rows

    refuse("ROBOT", "--count", "--candidates", "--sample", "--seed")
    arms = list(stored.rig.arms)
    if candidates is not None and len(arms) > 1:
        raise InputError("--candidates: the rig has several arms; plan in Python with the candidates of each.")
    rows = None if candidates is None else {arms[0]: read_rows(candidates, "robot").poses}
    found = stored.plan(rows, k, sample=sample, seed=seed)
    written = ""
    if output is not None:
        import numpy as np

        chosen = list(dict.fromkeys(step.candidate for step in found.steps))
        files: dict[str, str | bytes] = {"plan.json": found.to_json()}
        for name, T in found.robot.items():
            stem = "next.csv" if len(arms) == 1 else f"next_{name}.csv"
            files[stem] = pose_text(np.asarray(T, dtype=float)[chosen], [float(number) for number in chosen])
        written = deliver(output, files)
    emit(found.to_json() if as_json else found.text() + written)
