"""Sentences of the findings of the input checks: the suspicious input, and the argument or option to try.

Values are in rad and m; rows count from 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from ...core.presentation.numbers import digits, times_of_noise
from ...core.presentation.units import DEG_PER_RAD as _DEG
from ...core.presentation.units import MM_PER_M as _MM
from ...findings import MOTION, NOISE, OUTLIERS, filled, sentence
from .readings import CAMERA, in_words, of_lengths, of_readings, option_of, view_in_words

# A robot whose poses differ by less than this does not rotate.
NO_ROTATION_RAD = 1e-3
_NOISE_REMEDY = "leave the noise out, it is then estimated; or correct it"
_LOOK = "look at the residuals by pose in the report: --report report.html"


# ------------------------------------------------------------------------------------ what the columns look like


def _far_remedy(v: Mapping[str, Any]) -> str:
    if rows := v.get("rows"):
        return f"correct these rows, or leave them out: --exclude {','.join(map(str, rows))}"
    if v.get("both"):
        return f"run again with --units {v['unit']}; with --units m if the poses are in metres"
    return f"run again with --units {v.get('name') or v['file']}={v['unit']}"


def _far_in_short(v: Mapping[str, Any]) -> str:
    if rows := v.get("rows"):
        return f"{v['file']} row{'' if len(rows) == 1 else 's'} {', '.join(map(str, rows))} in {v['unit']}?"
    return f"{'robot and camera' if v.get('both') else v['file']} translations look like {v['unit']}"


@sentence(
    "input_checks.far",
    first=True,
    phrase=_far_in_short,
    effect=50,
    remedy=_far_remedy,
    rows=("rows",),
)
def _(
    file: str,
    reach: float,
    unit: str,
    from_corners: bool,
    rows: Sequence[int] = (),
    name: str | None = None,
    both: bool = False,
) -> str:
    if rows:
        which = f"Row{'' if len(rows) == 1 else 's'} {', '.join(map(str, rows))} of the {file} poses"
        return f"{which} reach {reach:.4g} m, unlike the others: in {unit}? Correct or exclude (--exclude)."
    looks = "millimetres" if unit == "mm" else "centimetres, or inches (in)"
    small = "" if unit == "mm" else "; or mm, if the rig is smaller than a hand"
    give = f"Give {option_of(file, 'units', unit, 'm', name)}{small}"
    if both:
        give = f"Both files do: give units={unit!r} (--units {unit}), or say that they are in metres (--units m)"
    if from_corners:  # it is the board that gives their size
        give = f"Calibrate the camera again with the board in its unit (--units {unit}, or --square with one)"
    return f"The {file} translations reach {reach:.4g} m: they look like {looks}. {give}."


sentence(
    "input_checks.tiny",
    "No translation of robot or camera exceeds {reach:mm.3g} mm: both files seem to be in a larger unit than they were "
    "read in. Give that unit as `units` (--units), or write metres.",
    rank=1,
    phrase="both files seem to be in a larger unit ({reach:mm~2} mm at most)",
    effect=50,
    remedy="give the unit that the lengths are in (--units), or write them in metres",
)
sentence(
    "input_checks.constant_column",
    "Column {column} of the {file} poses is constant ({value:.6g}).",
    phrase="column {column} of the {file} poses is constant",
)
sentence(
    "input_checks.identical_columns",
    "Columns {columns[0]} and {columns[1]} of the {file} poses are identical in all {n} rows: one of them was lost "
    "when the file was written.",
    phrase="columns {columns[0]} and {columns[1]} of the {file} poses are equal",
    effect=20,
)
sentence(
    "input_checks.same_file",
    "Robot and camera poses are the same numbers: the same file was given twice.",
    rank=0,
    explains=True,
    phrase="robot and camera file hold the same poses",
    remedy="give the file of the camera poses as the second one",
)


sentence(
    "input_checks.still",
    "All {n} {file} poses are the same: the {file} did not move, or one pose was written again and again.",
    rank=2,
    explains=True,
    phrase="the {file} poses are all the same",
    remedy="move the robot between the poses, and check how the {file} file was written",
)


def _repeated_in_short(v: Mapping[str, Any]) -> str:
    rows = f"{v['count']} {v.get('file', '')} row{'' if v['count'] == 1 else 's'}"
    return f"{rows} given again, counted once" if v.get("runs") else f"{rows} like the row before"


@sentence("input_checks.repeated_rows", phrase=_repeated_in_short)
def _(file: str, count: int, n: int, runs: Sequence[Sequence[int]] = (), name: str | None = None) -> str:
    if not runs:
        return f"{count} of {n} {file} poses repeat the row before exactly: they add no information."
    named = [f"row {a} is row {c}" if a == b else f"rows {a} to {b} are rows {c} to {c + b - a}" for a, b, c in runs]
    more = "" if sum(b - a + 1 for a, b, _ in runs) == count else ", ..."
    which = f"1 of {n} poses is an earlier one" if count == 1 else f"{count} of {n} poses are earlier ones"
    return (
        f"{which} again, of robot and camera ({'; '.join(named)}{more}): no information is added. X counts each pose "
        "once."
    )


# --------------------------------------------------------------------------------- what the rotations look like

# Cause, phrase and remedy where robot and camera rotate by different angles: in few pairs (the outliers say which), by
# little beside the rotations, or altogether.
_ANGLES = {
    "few": (
        "Only few pairs differ: look for wrong detections.",
        "a few pairs rotate by different angles",
        "",
    ),
    "noisy": (
        "Noise of that size can be the cause (a small or distant target), or a time offset, as the rotations are much "
        "larger.",
        "rotations of robot and camera are {rms:deg~2} deg apart",
        "give the noise if it is that large; else see the target from nearer, or pair by timestamps (--pair time)",
    ),
    "": (
        "No shift of the rows and no other reading that was tried mends it. The rotations of one file may be in "
        "another convention, or its rows of other moments.",
        "robot and camera rotate by different angles ({rms:deg~2} deg)",
        "check the convention of the rotations (--rotation), and that row k of both files is one moment",
    ),
}


def _of_angles(v: Mapping[str, Any]) -> tuple[str, str, str]:
    return _ANGLES["few" if v["few"] else "noisy" if v.get("noisy") else ""]


@sentence(
    "input_checks.angles_disagree",
    rank=8,
    explained=True,
    phrase=lambda v: filled(_of_angles(v)[1], v),
    effect=1.2,
    remedy=lambda v: _of_angles(v)[2],
)
def _(rms: float, largest: float, where: str, few: bool, noisy: bool = False) -> str:
    return (
        f"Robot and camera disagree on the rotation angles: they differ by {_DEG * rms:.1f} degrees RMS, "
        f"{_DEG * largest:.1f} at most ({where}). {_of_angles({'few': few, 'noisy': noisy})[0]}"
    )


sentence(
    "input_checks.half_turns",
    "{share:pct.0f} % of the motions rotate by more than 150 degrees. 4DPA weights a motion by sin^2(angle), so these "
    "count almost nothing. Choose pairs that rotate by 30 to 150 degrees.",
    check=MOTION,
    phrase="many rotations above 150 deg, little weight in 4dpa",
)


@sentence(
    "input_checks.small_rotations",
    check=MOTION,
    phrase=lambda v: (
        "the robot does not rotate"
        if v["largest"] < NO_ROTATION_RAD
        else f"rotations of {digits(_DEG * v['largest'], 2)} deg at most: noise amplified"
    ),
    remedy=lambda v: (
        "measure the target or the camera and give it (--known), or rotate the robot"
        if v["largest"] < NO_ROTATION_RAD
        else "rotate more: add poses 30 deg and more apart, about different axes"
    ),
)
def _(largest: float) -> str:
    if largest < NO_ROTATION_RAD:
        return (
            "The robot does not rotate: the rotation of X comes from its translations alone, and the translation of X "
            "stays open but for what is known of target or camera (--known)."
        )
    return (
        f"The robot rotates by at most {digits(_DEG * largest, 2)} degrees, which amplifies the noise. Rotate it by 30 "
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


def _ratio(v: Mapping[str, Any]) -> float:
    return v["rms"] / v["expected"] if v["expected"] > 0 else math.inf


def _times(v: Mapping[str, Any]) -> str:
    return times_of_noise(_ratio(v))


@sentence("input_checks.noise_too_small", check=NOISE, phrase=_times, effect=_ratio, rejects=True, remedy=_NOISE_REMEDY)
def _(what: str, part: str, rms: float, expected: float) -> str:
    ratio = f"{rms / expected:.3g} times what" if expected > 0 else "more than"
    return (
        f"The {part} residuals of the {what} ({_size(part, rms)} RMS) are {ratio} the noise given explains "
        f"({_size(part, expected)}). Either the noise is larger than given or the data are wrong. The standard "
        "deviations of X are too small."
    )


@sentence("input_checks.noise_too_large", check=NOISE, phrase=_times, effect=1.05, remedy=_NOISE_REMEDY)
def _(what: str, part: str, rms: float, expected: float) -> str:
    return (
        f"The {part} residuals of the {what} ({_size(part, rms)} RMS) are {expected / rms:.3g} times smaller than the "
        f"noise given explains ({_size(part, expected)}). The noise, and with it the standard deviations of X, seem "
        "too large. Check the units."
    )


def _size(part: str, value: float) -> str:
    return f"{_DEG * value:.3g} degrees" if part == "rotation" else f"{_MM * value:.3g} mm"


@sentence(
    "input_checks.outliers",
    explained=True,
    check=OUTLIERS,
    phrase="{count} of {n} {what}s fit much worse",
    effect=3,
    remedy=_LOOK,
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


def _unexplained_in_short(v: Mapping[str, Any]) -> str:
    if v.get("readings"):
        return in_words(v["readings"][0]).short
    what = "poses" if "readings" in v else "motions"
    both = f"{digits(_DEG * v['rotation'], 2)} deg, {digits(_MM * v['translation'], 2)} mm"
    return f"X does not explain the {what} ({both} RMS)"


@sentence(
    "input_checks.poses_unexplained",
    rank=5,
    explains=lambda v: bool(v.get("readings")),
    explained=True,
    phrase=_unexplained_in_short,
    remedy=of_readings,
)
def _(rotation: float, translation: float, readings: Sequence[Mapping[str, Any]]) -> str:
    start = (
        f"X does not explain the poses: the target seems to move by {_DEG * rotation:.2g} degrees and "
        f"{_MM * translation:.3g} mm RMS."
    )
    if not readings:
        return (
            f"{start} No inversion, quaternion order, axes, unit or shift of the rows that was tried fits. Either the "
            "poses have errors of this size, or the rows of one file are of other moments."
        )
    return f"{start} It would fit if {'; or if '.join(in_words(reading).full for reading in readings)}."


sentence(
    "input_checks.motions_unexplained",
    "X does not explain the motions: residuals {rotation:deg.2g} degrees and {translation:mm.3g} mm RMS. Check the "
    "directions and units of `A` and `B` and that they belong together.",
    explained=True,
    phrase=_unexplained_in_short,
    remedy="check the frames, units and pairing of both files",
)


@sentence(
    "input_checks.wrong_scale",
    rank=7,
    explains=True,
    explained=True,
    phrase=lambda v: in_words(v["reading"]).short,
    remedy=of_readings,
)
def _(reading: Mapping[str, Any]) -> str:
    return f"The translations of robot and camera do not match. They would fit if {in_words(reading).full}."


@sentence(
    "input_checks.misread_axes",
    rank=6,
    explains=True,
    explained=True,
    phrase=lambda v: in_words(v["reading"]).short,
    effect=20,
    remedy=of_readings,
)
def _(reading: Mapping[str, Any]) -> str:
    return f"The translations of one file do not fit its rotations. They would if {in_words(reading).full}."


@sentence(
    "input_checks.long_bracket",
    first=True,
    explained=True,
    phrase="the {what} would sit {length:~2} m from the gripper: wrong files?",
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
    "input_checks.far_camera",
    first=True,
    explained=True,
    phrase="the camera would sit {length:~2} m from the gripper",
    effect=25,
    remedy="check the tool frame of the robot and the frames of both files; if it sits there, give its place (--known)",
)
def _(length: float) -> str:
    return (
        f"The camera would sit {length:.3g} m from the gripper. Check the tool frame of the robot poses, and whether "
        "both files hold inverse poses. If it does sit there, say so with its measured place: "
        f"--known 'camera z = {digits(length, 2)}m +- 5cm'."
    )


@sentence(
    "input_checks.identity",
    first=True,
    explained=True,
    phrase="X is the identity: are these poses of one frame?",
    effect=30,
    remedy="check that neither file was computed from the other; if X is the identity, say so (--known 'camera z = "
    "0mm +- 1mm')",
)
def _(setup: str, translation: float, rotation: float) -> str:
    frame = "gripper" if setup == "eye-in-hand" else "base"
    return (
        f"X is the identity within its uncertainty ({digits(_MM * translation, 2)} mm, {digits(_DEG * rotation, 2)} "
        f"deg): the camera would sit in the frame of the {frame}. Are the robot poses those of the camera, or were the "
        "camera poses computed from the robot's? If X is the identity, say so: --known 'camera z = 0mm +- 1mm'."
    )


sentence(
    "input_checks.setup_not_said",
    "Read as target_T_camera, the camera file shows the target in directions that vary by {seen:deg.2g} degrees RMS; "
    "as it stands, by {as_given:deg.2g} degrees, as a camera sees its target. With another X such data fit as well "
    "with "
    'setup="{setup}" (--setup {setup}) and no camera_frame (--camera-frame).',
    first=True,
    phrase="the setup may be {setup}: say which",
    effect=30,
    remedy=lambda v: f"{CAMERA[v['setup']]}, run again with --setup {v['setup']} and without --camera-frame",
)


@sentence(
    "input_checks.setup_by_lengths",
    first=True,
    phrase="the {what} would sit {length:~2} m from the gripper: {setup}?",
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


# ------------------------------------------------------------------------------------- what the camera can see

_CONFIRM = "--camera-convention optical"


def _view_remedy(v: Mapping[str, Any]) -> str:
    if not v["views"]:
        return f"check the frames of both files; {_CONFIRM} if they are right (a tracker, a fisheye)"
    return f"{view_in_words(v['views'][0])[1]}; {_CONFIRM} if the files are right"


def _views_listed(views: Sequence[Mapping[str, Any]]) -> str:
    said = (view_in_words(one) for one in views)
    return "; or if ".join(f"{words} ({option})" for words, option in said)


@sentence(
    "input_checks.target_unseen",
    first=True,
    explained=True,
    phrase=lambda v: (
        "the camera cannot see its target" + (f": {view_in_words(v['views'][0])[0]}?" if v["views"] else "")
    ),
    effect=40,
    remedy=_view_remedy,
)
def _(seen: int, n: int, views: Sequence[Mapping[str, Any]]) -> str:
    where = f"The target is ahead of the camera, within 60 deg of its axis (z), in {seen} of {n} poses only."
    confirm = f"If the poses are right (a tracker, a fisheye), say so with {_CONFIRM}."
    if not views:
        return f"{where} The frames of one file may be others. {confirm}"
    return f"{where} X fits as well, and is another, if {_views_listed(views)}. {confirm}"


@sentence(
    "input_checks.steadier_reading",
    first=True,
    explained=True,
    phrase=lambda v: f"{view_in_words(v['views'][0])[0]}?",
    effect=35,
    remedy=_view_remedy,
)
def _(spread: float, off: float, views: Sequence[Mapping[str, Any]]) -> str:
    best = views[0]
    return (
        f"The camera sees its target {_DEG * off:.2g} degrees off its axis, in directions that vary by "
        f"{_DEG * spread:.2g} degrees RMS. It would be {_DEG * best['off']:.2g} degrees off, with directions that vary "
        f"by {_DEG * best['spread']:.2g} degrees, if {_views_listed(views)}. If the files are right, say so with "
        f"{_CONFIRM}."
    )


# ------------------------------------------------------------------------------------------------- shifted rows


@sentence(
    "input_checks.shifted_rows",
    rank=3,
    explains=True,
    explained=True,
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
                f"The camera file has nothing for {_rows('robot row', edge, missing)} (no detection?): "
                f"from robot row {edge + missing} on, robot row i belongs to camera row {_plus(new)}."
            )
        else:
            parts.append(
                f"The robot file has nothing for {_rows('camera row', edge + old, -missing)}: from robot row {edge} "
                f"on, robot row i belongs to camera row {_plus(new)}."
            )
    left_out = (("robot", robot_left_out), ("camera", camera_left_out))
    leave = " and ".join(f"{name} row{'' if len(rows) == 1 else 's'} {_runs(rows)}" for name, rows in left_out if rows)
    parts.append(
        f"To pair them, leave out {leave} (rows counted from 0). The residuals of the rows that move then fall to "
        f"{100 * rotation:.2g} % (rotation) and {100 * translation:.2g} % (translation) of their size as given."
    )
    return " ".join(parts)


def _plus(k: int) -> str:
    return f"i {'+' if k > 0 else '-'} {abs(k)}" if k else "i"


def _rows(what: str, first: int, count: int) -> str:
    return f"{what} {first}" if count == 1 else f"{what}s {first} to {first + count - 1}"


def _runs(rows: Sequence[int]) -> str:
    """3, 7 to 9"""
    edges = [0, *(k for k in range(1, len(rows)) if rows[k] != rows[k - 1] + 1), len(rows)]
    runs = [(rows[first], rows[after - 1]) for first, after in pairwise(edges)]
    return ", ".join(f"{first}" if first == last else f"{first} to {last}" for first, last in runs)


@sentence(
    "input_checks.covariance_convention",
    first=True,
    rejects=True,
    rank=3,
    explains=True,
    effect=lambda v: max(1.2, v["off"]),
    phrase=lambda v: f"the covariances fit as {' or '.join(v['classes'])}",
    remedy="run again with --covariance-convention {next}",
)
def _(classes: Sequence[str], given: str, next: str, gain: float, off: float) -> str:
    as_given = "as given" if given == "toolkit" else f"as {given}"
    return (
        f"The covariances fit as {' or '.join(classes)}, not {as_given}: log likelihood +{digits(gain, 2)}. Next: "
        f"--covariance-convention {next} (Python: from_convention)."
    )


@sentence(
    "input_checks.alphabetical_rows",
    rank=4,
    explains=True,
    phrase=lambda v: f"the {v['file']} rows are in alphabetical order ({', '.join(map(str, v['order'][:3]))}, ...)",
    remedy="sort the rows of the {file} file by number",
)
def _(file: str, order: Sequence[int], name: str | None = None) -> str:
    other = "camera" if file == "robot" else "robot"
    return (
        f"The rows of the {file} file are in the alphabetical order of numbered names ({', '.join(map(str, order))}, "
        f"...), and those of the {other} file are not. Sorted by number they fit. Sort the rows of the {file} file, or "
        "write the numbers with leading zeros where its names come from."
    )


def _exchanged(pairs: Sequence[Sequence[int]]) -> str:
    return "; ".join(f"{i} and {j}" for i, j in pairs)


@sentence(
    "input_checks.exchanged_rows",
    explained=True,
    phrase=lambda v: f"rows {_exchanged(v['pairs'])} are exchanged",
    effect=1.5,
    remedy=lambda v: f"exchange rows {_exchanged(v['pairs'])} in one of the files",
    rows=("pairs",),
)
def _(pairs: Sequence[Sequence[int]]) -> str:
    return (
        f"Rows {_exchanged(pairs)} are exchanged in one of the files: each fits the camera pose of the other, and not "
        "its own (rows counted from 0). They are left out; exchange them, and they count."
    )


@sentence(
    "input_checks.shifted_run",
    explained=True,
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
    "input_checks.turned_pictures",
    explained=True,
    check=OUTLIERS,
    phrase=lambda v: f"{len(v['rows'])} pictures turned by {digits(math.degrees(v['angle']), 2)} deg",
    remedy="turn these pictures back, and run again",
    rows=("rows",),
)
def _(rows: Sequence[int], angle: float) -> str:
    one, numbers = len(rows) == 1, ", ".join(map(str, rows))
    how = "upside down" if angle > 3.0 else "turned by 90 deg"
    which = f"The picture of pose {numbers}" if one else f"The pictures of poses {numbers}"
    return (
        f"{which} (counted from 0) {'is' if one else 'are'} {how}: turned about the optical axis "
        f"{'it fits' if one else 'they fit'}. Turn back what is turned, or leave it out "
        f"(--exclude {','.join(map(str, rows))})."
    )


@sentence(
    "input_checks.board_order",
    rank=3,
    explains=lambda v: not v["rejected"],
    explained=True,
    phrase="the target is turned or mirrored in some views",
    remedy="give the corners of these views in the order of the others, or the pictures themselves (--images)",
    rows=("half", "mirrored", "quarter"),
)
def _(half: Sequence[int], mirrored: Sequence[int], quarter: Sequence[int], rejected: bool) -> str:
    def views(rows: Sequence[int]) -> str:
        return f"view{'s' * (len(rows) > 1)} {', '.join(map(str, rows))}"

    parts = [("turned by half a turn", half), ("mirrored", mirrored), ("turned by a quarter turn", quarter)]
    said = "; ".join(f"{words} in {views(rows)}" for words, rows in parts if rows)
    return (
        f"The board is {said} (counted from 0): its points were taken in another order than in the other views, with "
        "which all views agree with the robot. A grid without marks, such as a symmetric grid of circles, is read from "
        "any of its corners. Give the pictures (--images), use a target with marks, or exclude these views"
        f"{', as was done here' if rejected else ''}."
    )


sentence(
    "input_checks.flipped_poses",
    "{rows:?Pose|Poses} {rows} (counted from 0) {rows:?fits|fit} if the target is flipped: a small flat target has two "
    "solutions, and the program that gave the poses took the other one. Exclude {rows:?it|them} (--exclude {rows:,}), "
    "or take the other solution there.",
    explained=True,
    check=OUTLIERS,
    phrase=lambda v: f"{len(v['rows'])} flipped: second solution of the target",
    rows=("rows",),
)
