"""The most useful next step after a calibration, in one line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...core.formatting.numbers import digits
from ...findings import Finding, record_of
from ...fit.input_checks.misread_files import OTHER_SETUP
from ..result import Calibration
from ..statement.accuracy import Accuracy

# Poses below which more of them are the first thing to try where noise limits X.
FEW = 25

# Findings that explain others of more effect.
_FIRST = (
    "input_checks.far",
    "input_checks.long_bracket",
    "input_checks.setup_not_said",
    "input_checks.setup_by_lengths",
)
# Options that declare an error, and a value that takes a measurement: better than what is assumed.
_DECLARE = {
    "focal length": ("--focal-sd", "0.03%"),
    "principal point": ("--principal-point-sd", "0.0003"),
    "target scale": ("--target-scale-sd", "0.01%"),
    "robot scale": ("--robot-scale-sd", "0.005%"),
    "robot accuracy": ("--robot-accuracy", "0.2mm,0.02deg"),
    "clock offset": ("--offset-sd", "0.1ms"),
}
_CAMERA = {"eye-in-hand": "if the camera is on the gripper", "eye-to-hand": "if the camera is fixed"}


def next_step(result: Calibration, report: str | None = None) -> str:
    """Return the next step: about the finding of most effect that asks for one, else about the largest part.

    ``report`` is the name of the report that was written.
    """
    first = [finding for finding in result.cautions if finding.code in _FIRST]  # explain the others
    if found := step_after([*first, *result.cautions]):
        return found.replace("--report report.html", report) if report else found
    accuracy = result.accuracy
    if accuracy is None:
        return "give the noise: --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm"
    if report is not None:
        return f"open {report}"
    return (
        _about_largest(accuracy, result.n_poses or result.n_pairs) or "add --report report.html for two pages to file"
    )


def step_after(findings: Sequence[Finding]) -> str | None:
    """Return what to do about the first of some findings that asks for something."""
    return next(filter(None, (_about(finding) for finding in findings)), None)


def _about(finding: Finding) -> str | None:
    """Return what to do about a finding; by its record where that does not depend on more than one value."""
    code, values = finding.code, finding.values
    if code in ("input_checks.poses_unexplained", "input_checks.wrong_scale"):
        readings = [values["reading"]] if "reading" in values else values.get("readings")
        return _try(*readings[:2]) if readings else "check the frames, units and pairing of both files"
    if code in ("input_checks.setup_not_said", "input_checks.setup_by_lengths"):
        setup = values.get("setup", "eye-to-hand")
        if code.endswith("not_said"):
            return f"{_CAMERA[setup]}, run again with --setup {setup} and without --camera-frame"
        frame = "without --robot-frame" if values.get("inverted") else "--robot-frame gripper_T_base"
        return f"{_CAMERA[setup]}, run again with --setup {setup} and {frame}"
    if code == "diagnostics.undeclared" and values.get("errors"):
        name, found = values["errors"][0]["name"], abs(float(values["errors"][0]["estimate"]))
        option = f"{_DECLARE[name][0]} {digits(100 * found, 1)}%" if name in _DECLARE else "--shared defaults"
        return f"measure the {name}, or declare an uncertainty that holds what was found: {option}"
    return record_of(finding).remedy_of(finding) or None


def _try(reading: Mapping[str, Any], second: Mapping[str, Any] | None = None) -> str:
    """Return the option by which the files would fit, and the one of the setup that fits as well."""
    kind, file = reading["kind"], reading.get("file")
    side = "" if file is None else f"{file}-"
    setup = reading.get("setup")
    if kind == "inverse camera":
        option = f"{_frame(reading, '--camera-frame target_T_camera')}{_or_setup(setup)}"
    elif kind == "inverse robot" and reading.get("likely") == "setup":
        option = f"with --setup {setup}"
        if second is not None and second["kind"] == "inverse camera":
            here = _CAMERA[OTHER_SETUP[reading["setup"]]]
            option += f"; or, {here}, {_frame(second, '--camera-frame target_T_camera')}"
    elif kind == "inverse robot":
        option = f"{_frame(reading, '--robot-frame gripper_T_base')}{_or_setup(setup)}"
    elif kind == "scale":
        if reading.get("bag") and (reading.get("unit") is None or file is None):
            return "measure the black square of the tag, and correct --tag or the size that its detector has"
        if reading.get("bag"):
            return f"write the poses with uq-handeye bag -o DIR and give --{side}units {reading['unit']}"
        if reading.get("target"):
            return "measure the target and give its true size; else check the focal length"
        if reading.get("unit") is None or file is None:
            return "check the units of both files (--robot-units, --camera-units) and the size of the target"
        option = f"with --{side}units {reading['unit']}"
    elif kind == "mirrored":
        return "write the poses or points of that side in a right-handed frame"
    elif kind == "transposed":
        option = f"with --{side}rotation transposed"
    else:
        option = f"with --{side}quaternion {reading['order']}"
    return f"run again {option}"


def _frame(reading: Mapping[str, Any], option: str) -> str:
    return f"without {option.partition(' ')[0]}" if reading.get("given") else f"with {option}"


def _or_setup(setup: str | None) -> str:
    """Return the setup that fits as well, and where the camera is in it."""
    return "" if setup is None else f"; or, {_CAMERA[setup]}, with --setup {setup}"


def _about_largest(accuracy: Accuracy, count: int) -> str | None:
    """Return what to do about the largest part of the accuracy."""
    if not accuracy.parts:
        return None
    name = accuracy.parts[0].name
    if name.startswith("noise of") and count < FEW:
        return "take more poses to reduce the noise: uq-handeye plan chooses them"
    assumed = any(text.startswith(name) and text.endswith("assumed)") for text in accuracy.included)
    if assumed and name in _DECLARE:
        return f"measure the {name}, which limits X, and declare how well: such as {' '.join(_DECLARE[name])}"
    return None
