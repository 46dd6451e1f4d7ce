"""Calibration of a rig on the command line: what is given, what is refused, what is printed and written."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ..messages import given_options, quiet, timed, withheld
from ..options.common import AT_THE_BOUND, PAIRINGS, SETUP_NAMES, emit, one_of
from ..outcome import NOT_PASSED, Wanted

if TYPE_CHECKING:
    from ...calibration.statement.tolerance import Verdict
    from ...rig.description import Rig
    from ...rig.result import RigCalibration
    from ..delivery import Outputs, ReportOptions
    from ..new_poses import Data, Estimation
    from ..options.noise import Given
    from ..pose_files import PoseFiles

# Options that a rig takes beside the rig file, and beside a file for each camera.
_ALWAYS = {"ROBOT", "--method", "--no-robust", "--robust", "--seed", "--shared", "--tolerance", "--at", "--report",
           "--json", "--output", "--about", "--full-report", "--paper", "--quiet", "--verbose", "--no-color",
           "--log-file"}  # fmt: skip
_OF_FILES = {"--camera", "--setup", "--pair", "--time-tolerance", "--robot-noise", "--camera-noise", "--noise",
             "--robot-frame", "--camera-frame",
             *(f"--{side}{what}" for side in ("", "robot-", "camera-") for what in
               ("format", "units", "rotation", "quaternion"))}  # fmt: skip


def is_rig(robot: Path | None, cameras: tuple[str, ...]) -> bool:
    """Return whether a calibration is that of a rig: a TOML file, or cameras by their names."""
    return bool(cameras) or (robot is not None and robot.suffix.lower() == ".toml")


def calibrate_rig_files(
    data: "Data", asked: "Estimation", wishes: "ReportOptions", wanted: Wanted, outputs: "Outputs"
) -> int:
    """Calibrate a rig, print it and write its files; return the exit status."""
    from ...rig.calibrate import calibrate_rig

    cameras, given = data.robot.cameras, data.given
    _refuse_others(bool(cameras))
    outputs.require_possible()
    if given.shared.shared is not None and given.shared.shared not in ("defaults", "none"):
        raise InputError(f"Expected --shared to be defaults or none, got {given.shared.shared!r}.")
    with withheld() as shown, timed("reading"):
        rig, noise = _of_cameras(data.files, cameras, given) if cameras else _of_file(data.files.robot)
        with timed("calibrating"):
            result = calibrate_rig(
                rig,
                noise,
                method=AT_THE_BOUND[0] if asked.method is None else one_of(asked.method, "--method", AT_THE_BOUND),
                robust=asked.robust is not False,
                shared=given.shared.shared != "none",
                seed=asked.seed,
            )
        shown += [] if outputs.as_json else result.warnings
    return deliver_rig(result, wishes, wanted, outputs)


def _refuse_others(of_files: bool) -> None:
    takes = _ALWAYS | (_OF_FILES if of_files else set())
    if wrong := [name for name in given_options() if name not in takes]:
        what = "several cameras (--camera NAME=FILE)" if of_files else "a rig file"
        raise InputError(f"{', '.join(wrong)}: not for {what}. Remove it.")


def _of_file(path: Path | None) -> "tuple[Rig, Any]":
    from ...rig.files.rig_file import read_rig

    assert path is not None
    return read_rig(path)


def _of_cameras(files: "PoseFiles", cameras: tuple[str, ...], given: "Given") -> "tuple[Rig, Any]":
    from ...rig.files.pose_rows import rig_of_files

    if files.robot is None:
        raise InputError("--camera NAME=FILE needs the file of robot poses. Add it, e.g. robot.csv.")
    if given.prior is not None:
        raise InputError("Several cameras need the noise of robot and camera, or of neither. Give both options.")
    how = None if files.pair is None else one_of(files.pair, "--pair", PAIRINGS)
    if how == "async":
        raise InputError(
            "--pair async: not for several cameras. Put each on the clock of the robot with uq-handeye sync."
        )
    if how == "rows":
        raise InputError("--pair rows: several cameras are matched by time or pose name. Remove it.")
    if files.time_tolerance is not None and how != "time":
        raise InputError("--time-tolerance needs --pair time. Add it.")
    tolerance = 0.0 if how is None else 0.02 if files.time_tolerance is None else files.time_tolerance
    named: dict[str, Path] = {}
    for text in cameras:
        name, _, file = (part.strip() for part in text.partition("="))
        if not name or not file:
            raise InputError(f"Expected --camera to be NAME=FILE such as left=left.csv, got {text!r}.")
        if name in named:
            raise InputError(f"The camera {name!r} is given twice, {named[name]} and {file}. Rename one of them.")
        named[name] = Path(file)
    frames = (files.robot_frame, files.camera_frame)
    reading = {
        role: {"units": units, "format": format, "rotation": rotation, "frame": frame}
        for role, units, format, rotation, frame in zip(
            ("robot", "camera"), files.both_units, files.formats, files.rotations, frames, strict=True
        )
    }
    setup = SETUP_NAMES[0] if files.setup is None else one_of(files.setup, "--setup", SETUP_NAMES)
    return rig_of_files(files.robot, named, setup=setup, tolerance=tolerance, reading=reading), given.noise


def verdicts_of(result: "RigCalibration", wanted: Wanted) -> "dict[str, Verdict]":
    """Return whether the pose of each camera meets the tolerance."""
    from ...calibration.statement.tolerance import FAIL, MET, MISSED, NOT_SHOWN, PASS, Verdict, probability_within

    found = {}
    for name, camera in result.cameras.items():
        assert wanted.tolerance is not None
        if len(camera.open):
            found[name] = Verdict(NOT_SHOWN, None, wanted.tolerance, (f"{name} is not determined in all directions",))
            continue
        p = probability_within(camera.covariance, result.reference, wanted.tolerance, camera.pose[:3, :3])
        found[name] = Verdict(PASS if p >= MET else FAIL if p <= MISSED else NOT_SHOWN, p, wanted.tolerance)
    return found


def deliver_rig(result: "RigCalibration", wishes: "ReportOptions", wanted: Wanted, outputs: "Outputs") -> int:
    """Print the result of a rig, write its files, and return the exit status."""
    from ...read import json_text
    from ..delivery import deliver

    verdicts = {} if wanted.tolerance is None else verdicts_of(result, wanted)
    said = [f"{name}: {verdict}" for name, verdict in verdicts.items()]
    text = "\n".join([result.text(), *said]) + "\n"
    written = ""
    page = {"about": wishes.about, "verdicts": verdicts, **wishes.of_report}
    if (output := outputs.output) is not None:
        from ...rig.output.page import rig_html

        html = rig_html(result, **{name: value for name, value in page.items() if name != "paper"})
        files: dict[str, str | bytes] = {"rig.json": json_text(result.to_dict()), "rig.txt": text, "report.html": html}
        with timed(f"writing {output}"):
            written = deliver(output, files)
    if outputs.report is not None:
        with timed(f"writing {outputs.report}"):
            written += f"\nWrote {result.report(outputs.report, **page)}\n"
    if outputs.as_json:
        more_of = {"verdicts": {name: one.to_dict() for name, one in verdicts.items()}} if verdicts else {}
        emit(json_text(result.to_dict() | more_of))
    elif quiet():
        rows = ((name, " ".join(map(repr, one.pose.ravel().tolist()))) for name, one in result.cameras.items())
        emit("".join(f"{name} {row}\n" for name, row in rows))
    else:
        emit(text + written)
    return NOT_PASSED if any(not verdict.passed for verdict in verdicts.values()) else 0
