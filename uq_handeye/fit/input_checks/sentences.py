"""Sentences of the findings of the input checks: which thing looks wrong, and which argument or option to try.

Values are in rad and m; rows count from 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from ...core.formatting.numbers import digits, times_of_noise
from ...findings import INPUT, MOTION, NOISE, OUTLIERS, sentence
from .remedies import CAMERA, of_lengths, of_readings

_DEG, _MM = 180.0 / math.pi, 1e3


# ------------------------------------------------------------------------------------ what the columns look like


def _reading_in_short(v: Mapping[str, Any]) -> str:
    """One of `misread_files.other_readings`, in short."""
    kind, file = v["kind"], v.get("file")
    if kind == "scale":
        if file and v.get("unit"):
            return f"the {file} {'poses seem' if v.get('bag') else 'file seems'} to be in {v['unit']}"
        if v.get("bag"):
            return f"the tag seems to be {digits(float(v['factor']), 2)} times as large as given"
        if v.get("target"):
            return f"the target seems to be {digits(float(v['factor']), 3)} times as large as given"
        return "robot and camera seem to be in different units"
    if kind == "inverse robot" and v.get("likely") == "setup":
        return f"the setup seems to be {v['setup']}, or the camera file inverse"
    if kind == "inverse robot":
        return f"the robot file seems inverse, or the setup {v['setup']}"
    if kind == "inverse camera":
        setup = v.get("setup")
        return (
            "the camera file seems to hold inverse poses"
            if setup is None
            else (f"the camera file seems inverse, or the setup {setup}")
        )
    if kind == "mirrored":
        return "the camera's or the robot's frame seems to be left-handed"
    who = "both files seem" if file is None else f"the {file} file seems"
    if kind == "transposed":
        return f"{who} to have transposed rotations"
    return f"{who} to have the quaternion's scalar {'first' if v['order'] == 'wxyz' else 'last'}"


def _both_in_short(rotation: float, translation: float) -> str:
    return f"{digits(math.degrees(rotation), 2)} deg, {digits(1e3 * translation, 2)} mm"


def _readings_in_short(v: Mapping[str, Any]) -> str:
    readings: Sequence[Mapping[str, Any]] = v["readings"]
    if readings:
        return _reading_in_short(readings[0])
    return f"X does not explain the poses ({_both_in_short(v['rotation'], v['translation'])} RMS)"


def _far_remedy(v: Mapping[str, Any]) -> str:
    if rows := v.get("rows"):
        return f"correct these rows, or leave them out: --exclude {','.join(map(str, rows))}"
    return f"run again with --{v['file']}-units {v['unit']}"


def _far_in_short(v: Mapping[str, Any]) -> str:
    if rows := v.get("rows"):
        return f"{v['file']} row{'' if len(rows) == 1 else 's'} {', '.join(map(str, rows))} in {v['unit']}?"
    return f"{v['file']} translations look like {v['unit']}"


def _repeated_in_short(v: Mapping[str, Any]) -> str:
    count, again = v["count"], bool(v.get("runs"))
    rows = f"{count} {v.get('file', '')} row{'' if count == 1 else 's'}"
    return f"{rows} given again, counted once" if again else f"{rows} like the row before"


def _ratio(v: Mapping[str, Any]) -> float:
    return v["rms"] / v["expected"] if v["expected"] > 0 else math.inf


@sentence(
    "input_checks.far",
    first=True,
    check=INPUT,
    phrase=_far_in_short,
    effect=50,
    remedy=_far_remedy,
    rows=("rows",),
)
def _(file: str, reach: float, unit: str, from_corners: bool, rows: Sequence[int] = ()) -> str:
    if rows:
        which = f"Row{'' if len(rows) == 1 else 's'} {', '.join(map(str, rows))} of the {file} poses"
        return f"{which} reach {reach:.4g} m, unlike the others: in {unit}? Correct or exclude (--exclude)."
    looks = "millimetres" if unit == "mm" else "centimetres, or inches (in)"
    small = "" if unit == "mm" else "; or mm, if the rig is smaller than a hand"
    give = f"Give {_option(file, 'units', unit, 'm')}{small}"
    if from_corners:  # it is the board that gives their size
        give = f"Calibrate the camera again with the board in its unit (--units {unit}, or --square with one)"
    return f"The {file} translations reach {reach:.4g} m: they look like {looks}. {give}."


@sentence(
    "input_checks.tiny",
    rank=1,
    check=INPUT,
    phrase=lambda v: f"both files seem to be in a larger unit ({digits(1e3 * v['reach'], 2)} mm at most)",
    effect=50,
    remedy="give the unit that the lengths are in (--units), or write them in metres",
)
def _(reach: float) -> str:
    return (
        f"No translation of robot or camera exceeds {1e3 * reach:.3g} mm: both files seem to be in a larger unit than "
        "they were read in. Give that unit as `units` (--units), or write metres."
    )


@sentence(
    "input_checks.constant_column",
    check=INPUT,
    phrase="column {column} of the {file} poses is constant",
)
def _(file: str, column: str, value: float) -> str:
    return f"Column {column} of the {file} poses is constant ({value:.6g})."


@sentence(
    "input_checks.identical_columns",
    check=INPUT,
    phrase=lambda v: f"columns {' and '.join(v['columns'])} of the {v['file']} poses are equal",
    effect=20,
)
def _(file: str, columns: Sequence[str], n: int) -> str:
    return (
        f"Columns {columns[0]} and {columns[1]} of the {file} poses are identical in all {n} rows: one of them was "
        "lost when the file was written."
    )


@sentence(
    "input_checks.repeated_rows",
    check=INPUT,
    phrase=_repeated_in_short,
)
def _(file: str, count: int, n: int, runs: Sequence[Sequence[int]] = ()) -> str:
    if runs:
        named = [
            f"row {a} is row {c}" if a == b else f"rows {a} to {b} are rows {c} to {c + b - a}" for a, b, c in runs
        ]
        more = "" if sum(b - a + 1 for a, b, _ in runs) == count else ", ..."
        which = "1 of {n} poses is an earlier one" if count == 1 else "{count} of {n} poses are earlier ones"
        return (
            f"{which.format(count=count, n=n)} again, of robot and camera ({'; '.join(named)}{more}): no information "
            "is added. X counts each pose once."
        )
    return f"{count} of {n} {file} poses repeat the row before exactly: they add no information."


@sentence(
    "input_checks.same_file",
    rank=0,
    explains=True,
    check=INPUT,
    phrase="robot and camera file hold the same poses",
    remedy="give the file of the camera poses as the second one",
)
def _() -> str:
    return "Robot and camera poses are the same numbers: the same file was given twice."


# --------------------------------------------------------------------------------- what the rotations look like


@sentence(
    "input_checks.angles_disagree",
    rank=8,
    explained=True,
    check=INPUT,
    phrase=lambda v: (
        "a few pairs rotate by different angles" if v["few"] else "the rows of the two files do not belong together"
    ),
    effect=1.2,
    # of few the outliers say which
    remedy=lambda v: "" if v["few"] else "pair by timestamps: --pair time, or --pair async for unsynchronised clocks",
)
def _(rms: float, largest: float, where: str, few: bool) -> str:
    return (
        f"Robot and camera disagree on the rotation angles: they differ by {_DEG * rms:.1f} degrees RMS, "
        f"{_DEG * largest:.1f} at most ({where}). "
        + (
            "Only few pairs differ: look for wrong detections."
            if few
            else "The rows of the two files do not belong together (wrong pairing, a shift, a time offset). If both "
            'have timestamps, try pair="time" (--pair time) or --pair async.'
        )
    )


@sentence(
    "input_checks.half_turns",
    check=MOTION,
    phrase="many rotations above 150 deg, little weight in 4dpa",
)
def _(share: float) -> str:
    return (
        f"{100 * share:.0f} % of the motions rotate by more than 150 degrees. 4DPA weights a motion by sin^2(angle), "
        "so these count almost nothing. Choose pairs that rotate by 30 to 150 degrees."
    )


@sentence(
    "input_checks.small_rotations",
    check=MOTION,
    phrase=lambda v: f"rotations of {digits(math.degrees(v['largest']), 2)} deg at most: noise amplified",
    remedy="add poses that rotate by 30 deg and more, about different axes",
)
def _(largest: float) -> str:
    return (
        f"The robot rotates by at most {_DEG * largest:.2g} degrees, which amplifies the noise. Rotate it by 30 "
        "degrees or more, about different axes."
    )


@sentence(
    "input_checks.parallel_axes",
    check=MOTION,
    phrase="rotation axes are nearly parallel",
    effect=2,
    remedy="add poses that rotate about another axis: uq-handeye plan chooses them",
)
def _(axis: Sequence[float], within: float) -> str:
    return (
        f"The rotation axes of the robot are nearly parallel to ({', '.join(f'{x:.2f}' for x in axis)}) (within "
        f"{max(_DEG * within, 0.01):.2g} degrees): rotation about this axis and translation along it are hardly "
        "determined. Add motions that rotate about another axis."
    )


# ------------------------------------------------------------------------------------------ how well X fits them


@sentence(
    "input_checks.noise_too_small",
    check=NOISE,
    phrase=lambda v: times_of_noise(_ratio(v)),
    effect=_ratio,
    rejects=True,
    remedy="leave the noise out, it is then estimated; or correct it",
)
def _(what: str, part: str, rms: float, expected: float) -> str:
    ratio = f"{rms / expected:.3g} times what" if expected > 0 else "more than"
    return (
        f"The {part} residuals of the {what} ({_size(part, rms)} RMS) are {ratio} the noise given explains "
        f"({_size(part, expected)}). Either the noise is larger than given or the data are wrong. The standard "
        "deviations of X are too small."
    )


@sentence(
    "input_checks.noise_too_large",
    check=NOISE,
    phrase=lambda v: times_of_noise(_ratio(v)),
    effect=1.05,
    remedy="leave the noise out, it is then estimated; or correct it",
)
def _(what: str, part: str, rms: float, expected: float) -> str:
    return (
        f"The {part} residuals of the {what} ({_size(part, rms)} RMS) are {expected / rms:.3g} times smaller than the "
        f"noise given explains ({_size(part, expected)}). The noise, and with it the standard deviations of X, seem "
        "too large. Check the units."
    )


@sentence(
    "input_checks.outliers",
    explained=True,
    check=OUTLIERS,
    phrase="{count} of {n} {what}s fit much worse",
    effect=3,
    remedy="look at the residuals by pose in the report: --report report.html",
)
def _(what: str, count: int, n: int, rotation: float, translation: float, worst: Sequence[Mapping[str, Any]]) -> str:
    named = ", ".join(
        f"{what} {row['row']} ({_DEG * row['rotation']:.2g} degrees, {_MM * row['translation']:.3g} mm"
        + (f", {row['times']:.2g} times the usual ratio)" if "times" in row else ")")
        for row in worst
    )
    more = f" and {count - len(worst)} more" if count > len(worst) else ""
    beside = ", relative to the noise of each" if any("times" in row for row in worst) else ""
    return (
        f"{count} of {n} {what}s {'fits' if count == 1 else 'fit'} much worse than the others{beside} (median "
        f"{_DEG * rotation:.2g} degrees, {_MM * translation:.3g} mm): {named}{more}, counted from 0. Look for a wrong "
        "detection or a row that belongs to another moment, and leave it out of both files."
    )


@sentence(
    "input_checks.poses_unexplained",
    rank=5,
    explained=True,
    check=INPUT,
    phrase=_readings_in_short,
    remedy=of_readings,
)
def _(rotation: float, translation: float, readings: Sequence[Mapping[str, Any]]) -> str:
    start = (
        f"X does not explain the poses: the target seems to move by {_DEG * rotation:.2g} degrees and "
        f"{_MM * translation:.3g} mm RMS."
    )
    if not readings:
        return (
            f"{start} No inversion, quaternion order or unit that was tried fits. Either the rows do not belong "
            "together, or the poses have errors of this size."
        )
    return f"{start} It would fit if {'; or if '.join(reading_in_words(reading) for reading in readings)}."


@sentence(
    "input_checks.motions_unexplained",
    explained=True,
    check=INPUT,
    phrase=lambda v: f"X does not explain the motions ({_both_in_short(v['rotation'], v['translation'])} RMS)",
    remedy="check the frames, units and pairing of both files",
)
def _(rotation: float, translation: float) -> str:
    return (
        f"X does not explain the motions: residuals {_DEG * rotation:.2g} degrees and {_MM * translation:.3g} mm RMS. "
        "Check the directions and units of `A` and `B` and that they belong together."
    )


@sentence(
    "input_checks.wrong_scale",
    rank=7,
    explained=True,
    check=INPUT,
    phrase=lambda v: _reading_in_short(v["reading"]),
    remedy=of_readings,
)
def _(reading: Mapping[str, Any]) -> str:
    return f"The translations of robot and camera do not match. They would fit if {reading_in_words(reading)}."


@sentence(
    "input_checks.long_bracket",
    first=True,
    explained=True,
    check=INPUT,
    phrase=lambda v: f"the {v['what']} would sit {digits(v['length'], 2)} m from the gripper: wrong files?",
    effect=30,
    remedy="check which file is the robot's; it goes first",
)
def _(what: str, length: float, fixed: float) -> str:
    on_camera = what == "camera"  # on a gripper; else swapped files would show X inverse, of the same length
    cause = "the two files are swapped or both hold inverse poses" if on_camera else "both files hold inverse poses"
    first = "Give the robot's file first; or " if on_camera else "Give "
    return (
        f"The {what} would sit {length:.3g} m from the gripper, and the fixed part of the rig only {fixed:.3g} m from "
        f"the base. If this is wrong, {cause}: such data fit equally well, with another X. {first}"
        'robot_frame="gripper_T_base", camera_frame="target_T_camera" (--robot-frame gripper_T_base --camera-frame '
        "target_T_camera)."
    )


@sentence(
    "input_checks.setup_not_said",
    first=True,
    check=INPUT,
    phrase="the setup may be {setup}: say which",
    effect=30,
    remedy=lambda v: f"{CAMERA[v['setup']]}, run again with --setup {v['setup']} and without --camera-frame",
)
def _(setup: str, seen: float, as_given: float) -> str:
    return (
        f"Read as target_T_camera, the camera file shows the target in directions that vary by {_DEG * seen:.2g} "
        f"degrees RMS; as it stands, by {_DEG * as_given:.2g} degrees, as a camera sees its target. With another X "
        f'such data fit as well with setup="{setup}" (--setup {setup}) and no camera_frame (--camera-frame).'
    )


@sentence(
    "input_checks.setup_by_lengths",
    first=True,
    check=INPUT,
    phrase=lambda v: f"the {v['what']} would sit {digits(v['length'], 2)} m from the gripper: {v['setup']}?",
    effect=30,
    remedy=of_lengths,
)
def _(what: str, length: float, fixed: float, setup: str, inverted: bool) -> str:
    frame = (
        "no robot_frame (--robot-frame)" if inverted else 'robot_frame="gripper_T_base" (--robot-frame gripper_T_base)'
    )
    return (
        f"The {what} would sit {length:.3g} m from the gripper, and the fixed part of the rig only {fixed:.3g} m from "
        f'the base. Such data fit equally well with setup="{setup}" (--setup {setup}) and {frame}. Which is right, the '
        "poses cannot say."
    )


def _size(part: str, value: float) -> str:
    return f"{_DEG * value:.3g} degrees" if part == "rotation" else f"{_MM * value:.3g} mm"


def reading_in_words(reading: Mapping[str, Any]) -> str:
    """One of `misread_files.other_readings`, and how to ask for it."""
    names = ("kind", "setup", "file", "order", "length", "factor", "unit", "given")
    kind, setup, file, order, length, factor, unit, given = map(reading.get, names)
    if kind == "scale" and reading.get("bag"):
        cause = "the size of the tag is wrong, that of --tag or that given to its detector"
        if file is not None and unit is not None:
            cause = (
                f"the {file} poses are in {unit}. Write them with uq-handeye bag -o DIR and give --{file}-units {unit}"
            )
        return f"the camera translations are multiplied by {factor:.4g}: {cause}"
    if kind == "scale" and reading.get("target"):
        fitted = " (a printer that scaled to fit the page?)" if factor and 0.8 < factor < 1.25 else ""
        return (
            f"the camera translations are multiplied by {factor:.4g}: no unit is such a factor; the size of the target "
            f"is wrong{fitted}, or the focal length is that of other pictures"
        )
    if kind == "scale":
        cause = (
            f"the {file} file is in {unit}, {_option(file, 'units', unit, 'm')}"
            if file is not None and unit is not None
            else "one file is in another unit (--robot-units, --camera-units)"
        )
        if unit == "m":
            cause += ", or its lengths were divided once too often where it was written"
        return f"the camera translations are multiplied by {factor:.4g}: {cause}, or the size of the target is wrong"
    if kind == "inverse robot":
        text = f"the setup is {setup}, or the robot file holds inverse poses"
        option = f'setup="{setup}" (--setup {setup}), or robot_frame="gripper_T_base" (--robot-frame gripper_T_base)'
        if given:
            text = f"the setup is {setup}, or the robot file holds base_T_gripper"
            option = f'setup="{setup}" (--setup {setup}), or no robot_frame (--robot-frame)'
    elif kind == "inverse camera":
        text = f"the camera file holds {'camera_T_target' if given else 'inverse poses, target_T_camera'}"
        option = 'camera_frame="target_T_camera" (--camera-frame target_T_camera)'
        option = "no camera_frame (--camera-frame)" if given else option
    elif kind == "mirrored":
        text = "the frame of the camera, or that of the robot, is left-handed"
        option = "change the sign of one axis, of poses and points alike, where they are written"
    elif kind == "transposed":
        text = f"the rotations of {'both files' if file is None else f'the {file} file'} are transposed"
        option = (
            'rotation="transposed" (--rotation transposed)' if file is None else _option(file, "rotation", "transposed")
        )
    else:  # quaternion
        where = "first" if order == "wxyz" else "last"
        who = "both files have" if file is None else f"the {file} file has"
        text = f"{who} the scalar of the quaternion {where}"
        option = (
            f'quaternion="{order}" (--quaternion {order})' if file is None else _option(file, "quaternion", str(order))
        )
    return f"{text}: {option}" if length is None else f"{text} (X would be {length:.3g} m long): {option}"


def _option(file: str, argument: str, value: str, other: str | None = None) -> str:
    """Name the argument and the option for one file: ``units=("m", "mm") (--camera-units mm)``."""
    second = "None" if other is None else f'"{other}"'
    pair = f'"{value}", {second}' if file == "robot" else f'{second}, "{value}"'
    return f"{argument}=({pair}) (--{file}-{argument} {value})"


# ------------------------------------------------------------------------------------------------- shifted rows


@sentence(
    "input_checks.shifted_rows",
    rank=6,
    explained=True,
    check=INPUT,
    phrase="rows are missing in one file: the pairing is shifted",
    remedy="leave out the rows named above, or pair by timestamps: --pair time",
    rows=("robot_left_out", "camera_left_out"),
)
def _(
    stretches: Sequence[Sequence[int]],
    robot_left_out: Sequence[int],
    camera_left_out: Sequence[int],
    rotation: float,
    translation: float,
) -> str:
    """Say which file begins early, where a file lacks a row, which rows to leave out, and what it changes."""
    parts = []
    k = stretches[0][2]
    if k:
        early, late = ("camera", "robot") if k > 0 else ("robot", "camera")
        rows = f"{abs(k)} row" + ("" if abs(k) == 1 else "s")
        until = "" if len(stretches) == 1 else f", up to robot row {stretches[0][1] - 1}"
        parts.append(
            f"The {early} file begins {rows} before the {late} file: robot row i belongs to camera row "
            f"{_plus(k)}{until}."
        )
    for (_, edge, old), (_, _, new) in pairwise(stretches):
        missing = old - new
        if missing > 0:
            parts.append(
                f"The camera file has nothing for {_span(edge, missing, 'robot row')} (no detection?): "
                f"from robot row {edge + missing} on, robot row i belongs to camera row {_plus(new)}."
            )
        else:
            parts.append(
                f"The robot file has nothing for {_span(edge + old, -missing, 'camera row')}: from robot row {edge} "
                f"on, robot row i belongs to camera row {_plus(new)}."
            )
    leave = " and ".join(
        f"{name} {_rows(rows)}" for name, rows in (("robot", robot_left_out), ("camera", camera_left_out)) if rows
    )
    parts.append(
        f"To pair them, leave out {leave} (rows counted from 0). The residuals of the rows that move then fall to "
        f"{100 * rotation:.2g} % (rotation) and {100 * translation:.2g} % (translation) of their size as given."
    )
    return " ".join(parts)


@sentence(
    "input_checks.alphabetical_rows",
    rank=4,
    explains=True,
    check=INPUT,
    phrase=lambda v: f"the {v['file']} rows are in alphabetical order ({', '.join(map(str, v['order'][:3]))}, ...)",
    remedy="sort the rows of the {file} file by number",
)
def _(file: str, order: Sequence[int]) -> str:
    other = "camera" if file == "robot" else "robot"
    return (
        f"The rows of the {file} file are in the alphabetical order of numbered names ({', '.join(map(str, order))}, "
        f"...), and those of the {other} file are not. Sorted by number they fit. Sort the rows of the {file} file, or "
        "write the numbers with leading zeros where its names come from."
    )


@sentence(
    "input_checks.shifted_run",
    explained=True,
    check=INPUT,
    phrase="robot rows {first} to {last} are paired wrongly",
    effect=1.5,
    remedy="pair the rows again, or by timestamps: --pair time",
    rows=("first", "last", "near"),
)
def _(first: int, last: int, shift: int, lacks: str, near: int) -> str:
    return (
        f"Robot rows {first} to {last} fit the camera rows {first + shift} to {last + shift}, not their own: the "
        f"{lacks} file lacks a row near row {near}. Pair them again (rows counted from 0)."
    )


@sentence("input_checks.pose_ambiguity")
def _(count: int, n: int, changed: int, undecided: Sequence[str]) -> str:
    poses = f"{count} of {n} poses of the target" if count > 1 else f"1 of {n} poses of the target"
    text = f"{poses} had a second solution that fits its corners about as well: the other poses decided"
    if changed:
        text += f", {changed} of them for the solution that fits the corners less"
    if undecided:
        text += f". They do not decide {', '.join(undecided)}: leave {'it' if len(undecided) == 1 else 'them'} out"
    return text + "."


@sentence(
    "input_checks.flipped_poses",
    explained=True,
    check=OUTLIERS,
    phrase=lambda v: f"{len(v['rows'])} flipped: second solution of the target",
    rows=("rows",),
)
def _(rows: Sequence[int]) -> str:
    one = len(rows) == 1
    named = f"{'Pose' if one else 'Poses'} {', '.join(map(str, rows))}"
    return (
        f"{named} (counted from 0) {'fits' if one else 'fit'} if the target is flipped: a "
        "small flat target has two solutions, and the program that gave the poses took the other one. Exclude "
        f"{'it' if one else 'them'} (--exclude {','.join(map(str, rows))}), or take the other solution there."
    )


def _plus(k: int) -> str:
    return f"i {'+' if k > 0 else '-'} {abs(k)}" if k else "i"


def _span(first: int, count: int, what: str) -> str:
    return f"{what} {first}" if count == 1 else f"{what}s {first} to {first + count - 1}"


def _rows(rows: Sequence[int]) -> str:
    """rows 3, 7 to 9"""
    edges = [0, *(k for k in range(1, len(rows)) if rows[k] != rows[k - 1] + 1), len(rows)]
    runs = [(rows[first], rows[after - 1]) for first, after in pairwise(edges)]
    texts = [f"{first}" if first == last else f"{first} to {last}" for first, last in runs]
    return ("row " if len(rows) == 1 else "rows ") + ", ".join(texts)
