"""Other readings of the two files in words: what each says of them, in short and in full, and the option to ask for it.

A reading is what `misread_files.other_readings` returns: a mapping with its ``kind`` and what belongs to it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...core.formatting.numbers import digits

Reading = Mapping[str, Any]

# Where the camera is, by the setup.
CAMERA = {"eye-in-hand": "if the camera is on the gripper", "eye-to-hand": "if the camera is fixed"}
OTHER_SETUP = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}
# Frames that invert the poses of a side.
FRAMES = {"inverse robot": ("robot", "gripper_T_base"), "inverse camera": ("camera", "target_T_camera")}
# Arguments that read the rotations of a file in another way, and what they are called.
ROTATIONS = {
    "transposed": ("rotation", "have transposed rotations", "the rotations of {of} are transposed"),
    "quaternion": ("quaternion", "have the quaternion's scalar {place}", "{who} the scalar of the quaternion {place}"),
}


def option_of(file: str, argument: str, value: str, other: str | None = None) -> str:
    """Name the argument and the option for one file: ``units=("m", "mm") (--camera-units mm)``."""
    second = "None" if other is None else f'"{other}"'
    pair = f'"{value}", {second}' if file == "robot" else f'{second}, "{value}"'
    return f"{argument}=({pair}) (--{file}-{argument} {value})"


def in_short(v: Reading) -> str:
    """Return a reading in at most 55 characters."""
    kind, file, setup = v["kind"], v.get("file"), v.get("setup")
    if kind == "scale":
        if file and v.get("unit"):
            return f"the {file} {'poses seem' if v.get('bag') else 'file seems'} to be in {v['unit']}"
        if v.get("bag"):
            return f"the tag seems to be {digits(float(v['factor']), 2)} times as large as given"
        if v.get("target"):
            return f"the target seems to be {digits(float(v['factor']), 3)} times as large as given"
        return "robot and camera seem to be in different units"
    if kind == "inverse robot" and v.get("likely") == "setup":
        return f"the setup seems to be {setup}, or the camera file inverse"
    if kind == "inverse camera" and setup is None:
        return "the camera file seems to hold inverse poses"
    if kind in FRAMES:
        return f"the {FRAMES[kind][0]} file seems inverse, or the setup {setup}"
    if kind == "mirrored":
        return "the camera's or the robot's frame seems to be left-handed"
    who = "both files seem" if file is None else f"the {file} file seems"
    return f"{who} to {ROTATIONS[kind][1].format(place=_place(v))}"


def _place(reading: Reading) -> str:
    return "first" if reading.get("order") == "wxyz" else "last"


def in_words(reading: Reading) -> str:
    """Return what would be true of the files by a reading, and how to ask for it."""
    kind, setup, file, length, given = map(reading.get, ("kind", "setup", "file", "length", "given"))
    if kind == "scale":
        return f"the camera translations are multiplied by {reading['factor']:.4g}: {_cause_of_scale(reading)}"
    if kind == "inverse robot":
        text = f"the setup is {setup}, or the robot file holds {'base_T_gripper' if given else 'inverse poses'}"
        option = f'setup="{setup}" (--setup {setup}), or {_frame_option(reading)}'
    elif kind == "inverse camera":
        text = f"the camera file holds {'camera_T_target' if given else 'inverse poses, target_T_camera'}"
        option = _frame_option(reading)
    elif kind == "mirrored":
        text = "the frame of the camera, or that of the robot, is left-handed"
        option = "change the sign of one axis, of poses and points alike, where they are written"
    else:
        argument, _, text = ROTATIONS[str(kind)]
        of, who = ("both files", "both files have") if file is None else (f"the {file} file", f"the {file} file has")
        text = text.format(of=of, who=who, place=_place(reading))
        value = str(reading.get("order") or kind)
        option = f'{argument}="{value}" (--{argument} {value})' if file is None else option_of(file, argument, value)
    return f"{text}: {option}" if length is None else f"{text} (X would be {length:.3g} m long): {option}"


def _frame_option(reading: Reading) -> str:
    side, frame = FRAMES[reading["kind"]]
    given = reading.get("given")
    return f"no {side}_frame (--{side}-frame)" if given else f'{side}_frame="{frame}" (--{side}-frame {frame})'


def _cause_of_scale(reading: Reading) -> str:
    file, unit, factor = reading.get("file"), reading.get("unit"), reading["factor"]
    told = file is not None and unit is not None
    if reading.get("bag"):
        if told:
            return (
                f"the {file} poses are in {unit}. Write them with uq-handeye bag -o DIR and give --{file}-units {unit}"
            )
        return "the size of the tag is wrong, that of --tag or that given to its detector"
    if reading.get("target"):
        fitted = " (a printer that scaled to fit the page?)" if 0.8 < factor < 1.25 else ""
        return (
            f"no unit is such a factor; the size of the target is wrong{fitted}, or the focal length is that of other "
            "pictures"
        )
    cause = "one file is in another unit (--robot-units, --camera-units)"
    if told:
        cause = f"the {file} file is in {unit}, {option_of(str(file), 'units', str(unit), 'm')}"
    if unit == "m":
        cause += ", or its lengths were divided once too often where it was written"
    return f"{cause}, or the size of the target is wrong"


def of_lengths(values: Mapping[str, Any]) -> str:
    """Return what to do where another setup has lengths that are more likely."""
    frame = "without --robot-frame" if values["inverted"] else "--robot-frame gripper_T_base"
    return f"{CAMERA[values['setup']]}, run again with --setup {values['setup']} and {frame}"


def of_readings(values: Mapping[str, Any]) -> str:
    """Return what to do where the files fit in other readings, or in none that was tried."""
    readings = [values["reading"]] if "reading" in values else values["readings"]
    return _remedy(*readings[:2]) if readings else "check the frames, units and pairing of both files"


def _remedy(reading: Reading, second: Reading | None = None) -> str:
    """Return the option by which the files would fit, and the one of the setup that fits as well."""
    kind, file, setup, unit = map(reading.get, ("kind", "file", "setup", "unit"))
    side = "" if file is None else f"{file}-"
    if kind in FRAMES and reading.get("likely") == "setup":
        option = f"with --setup {setup}"
        if second is not None and second["kind"] == "inverse camera":
            option += f"; or, {CAMERA[OTHER_SETUP[str(setup)]]}, {_with_frame(second)}"
    elif kind in FRAMES:
        option = _with_frame(reading) + ("" if setup is None else f"; or, {CAMERA[setup]}, with --setup {setup}")
    elif kind == "scale":
        told = unit is not None and file is not None
        if reading.get("bag"):
            if told:
                return f"write the poses with uq-handeye bag -o DIR and give --{side}units {unit}"
            return "measure the black square of the tag, and correct --tag or the size that its detector has"
        if reading.get("target"):
            return "measure the target and give its true size; else check the focal length"
        if not told:
            return "check the units of both files (--robot-units, --camera-units) and the size of the target"
        option = f"with --{side}units {unit}"
        if unit == "m":
            option += "; if it was read so, its lengths were divided once too often where it was written"
    elif kind == "mirrored":
        return "write the poses or points of that side in a right-handed frame"
    else:
        option = f"with --{side}{ROTATIONS[str(kind)][0]} {reading.get('order') or kind}"
    return f"run again {option}"


def _with_frame(reading: Reading) -> str:
    side, frame = FRAMES[reading["kind"]]
    return f"without --{side}-frame" if reading.get("given") else f"with --{side}-frame {frame}"
