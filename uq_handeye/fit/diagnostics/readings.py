"""Text on other readings of the two files: the meaning of each, short and in full, and the option that selects it.

A reading is a mapping as `misread_files.other_readings` returns it: its ``kind`` and the values that belong to it. With
``name``, its camera file is that of one camera of a rig, whose options and lines of the rig file are named.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

from ...core.presentation.numbers import digits

# A reading as plain values by name, as a finding holds it.
Reading: TypeAlias = dict[str, Any]
ReadingValues: TypeAlias = Mapping[str, Any]

# Where the camera is, by the setup.
CAMERA = {"eye-in-hand": "if the camera is on the gripper", "eye-to-hand": "if the camera is fixed"}
OTHER_SETUP = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}
# Frames that invert the poses of a side.
FRAMES = {"inverse robot": ("robot", "gripper_T_base"), "inverse camera": ("camera", "target_T_camera")}


class Words(NamedTuple):
    """A reading of the files in words."""

    short: str  # at most 55 characters
    full: str  # what would be true of the files, and how to ask for it
    remedy: str


def _line(key: str, value: str, name: str) -> str:
    """Name the line of a rig file for the views of one camera."""
    return f'{key} = "{value}" in the views of {name} in the rig file'


def option_of(file: str, argument: str, value: str, other: str | None = None, name: str | None = None) -> str:
    """Name the argument and the option for one file: ``units=("m", "mm") (--units camera=mm)``."""
    second = "None" if other is None else f'"{other}"'
    if name is not None and file == "camera":
        return f"{_line(argument, value, name)} (--{argument} {name}={value})"
    pair = f'"{value}", {second}' if file == "robot" else f'{second}, "{value}"'
    return f"{argument}=({pair}) (--{argument} {file}={value})"


def in_words(reading: ReadingValues) -> Words:
    """Return a reading in words."""
    kind = reading["kind"]
    if kind == "scale":
        short, cause, remedy = _of_scale(reading)
        return Words(short, f"the camera translations are multiplied by {reading['factor']:.4g}: {cause}", remedy)
    if kind == "axes":
        return _of_axes(reading)
    if kind in FRAMES:
        short, text, option, remedy = _of_frame(reading)
    elif kind == "mirrored" and reading.get("pictures"):
        short = "the pictures seem to be mirrored"
        text = "the pictures are mirror images, as of a preview or by a mirror in the path, or the robot is left-handed"
        option = "flip them left to right (cx becomes width - 1 - cx)"
        remedy = "flip the pictures left to right, and calibrate the camera again"
    elif kind == "mirrored":
        short = "the camera's or the robot's frame seems to be left-handed"
        text = "the frame of the camera, or that of the robot, is left-handed"
        option = "change the sign of one axis, of poses and points alike, where they are written"
        remedy = "write the poses or points of that side in a right-handed frame"
    else:
        short, text, option, remedy = _of_rotation(reading)
    if (scale := reading.get("scale")) is not None:  # both at once
        unit = in_words(scale)
        return Words(f"{short}, and its lengths", f"{text}: {option}; and {unit.full}", f"{remedy}; and {unit.remedy}")
    length = "" if reading.get("length") is None else f" (X would be {reading['length']:.3g} m long)"
    return Words(short, f"{text}{length}: {option}", remedy)


def _of_axes(v: ReadingValues) -> Words:
    """Axes of the translations of one file that are negated, exchanged, scaled or sheared."""
    side, said = v["file"], []
    if "exchanged" in v:
        said.append(f"{' and '.join(v['exchanged'])} exchanged")
    if "negated" in v:
        said.append(f"{' and '.join(v['negated'])} negated")
    if "scaled" in v:
        said.append(f"{v['scaled']} scaled by {digits(v['factor'], 3)}")
    if "sheared" in v:
        said.append(f"{v['sheared']} sheared by {digits(v['share'], 2)} of {v['along']}")
    what = ", ".join(said)
    misfit = f"{digits(1e3 * v['before'], 2)} mm RMS become {digits(1e3 * v['after'], 2)} mm"
    cause = " (pixels that are not square, a wrong focal length?)" if "scaled" in v and side == "camera" else ""
    return Words(
        f"the {side} translations have {what}",
        f"the {side} translations have {what}{cause}: {misfit}",
        f"correct the {side} translations where they are written: {what}",
    )


def _of_frame(v: ReadingValues) -> tuple[str, str, str, str]:
    setup, given, (side, frame) = v.get("setup"), v.get("given"), FRAMES[v["kind"]]
    if (name := v.get("name")) is not None:
        return _of_frame_in_rig(v, name)
    option = f"no {side}_frame (--{side}-frame)" if given else f'{side}_frame="{frame}" (--{side}-frame {frame})'
    remedy = f"run again {f'without --{side}-frame' if given else f'with --{side}-frame {frame}'}"
    short = f"the {side} file seems inverse, or the setup {setup}"
    if setup is None:
        short = f"the {side} file seems to hold inverse poses"
    else:
        remedy += f"; or, {CAMERA[setup]}, with --setup {setup}"
    if side == "camera":
        return (
            short,
            f"the camera file holds {'camera_T_target' if given else f'inverse poses, {frame}'}",
            option,
            remedy,
        )
    if v.get("likely") == "setup":
        short, remedy = f"the setup seems to be {setup}, or the camera file inverse", f"run again with --setup {setup}"
    text = f"the setup is {setup}, or the robot file holds {'base_T_gripper' if given else 'inverse poses'}"
    return short, text, f'setup="{setup}" (--setup {setup}), or {option}', remedy


def _of_frame_in_rig(v: ReadingValues, name: str) -> tuple[str, str, str, str]:
    """Return the same of one camera of a rig, whose robot file the other cameras use, too."""
    setup, given, (side, frame) = v.get("setup"), v.get("given"), FRAMES[v["kind"]]
    option = f"--camera-frame {name}={frame}"
    mount = f"{CAMERA[str(setup)]}, --setup {setup}, or `on` of camera and target in the rig file"
    if side == "camera":
        text = f"the file of {name} holds {'camera_T_target' if given else f'inverse poses, {frame}'}"
        line = f"no frame (--camera-frame) for {name}" if given else f"{_line('frame', frame, name)} ({option})"
        remedy = f"run again {f'without --camera-frame for {name}' if given else f'with {option}'}"
        return f"the file of {name} seems inverse", text, line, f"{remedy}; or, {mount}"
    text = f"the setup is {setup}, or the robot file holds {'base_T_gripper' if given else 'inverse poses'}"
    short = f"the setup seems to be {setup}, or the camera file inverse"
    return short, text, f"--setup {setup}, or `on` of camera and target in the rig file", f"{mount}; or with {option}"


def _of_rotation(v: ReadingValues) -> tuple[str, str, str, str]:
    file, order = v.get("file"), v.get("order")
    value = str(order or v["kind"])
    of, who, seem = ("both files", "both files have", "both files seem")
    if file is not None:
        whose = _whose(file, v.get("name"))
        of, who, seem = whose, f"{whose} has", f"{whose} seems"
    if v["kind"] == "transposed":
        argument, short, text = (
            "rotation",
            f"{seem} to have transposed rotations",
            f"the rotations of {of} are transposed",
        )
    else:
        place = "first" if order == "wxyz" else "last"
        argument, short = "quaternion", f"{seem} to have the quaternion's scalar {place}"
        text = f"{who} the scalar of the quaternion {place}"
    name = v.get("name")
    line = "rotation" if name is not None else argument  # of a rig file, which has one word for both
    option = f'{argument}="{value}" (--{argument} {value})'
    option = option if file is None else option_of(file, line, value, name=name)
    return short, text, option, f"run again with --{line} {'' if file is None else f'{_key(file, name)}='}{value}"


def _whose(file: str, name: str | None) -> str:
    return f"the file of {name}" if name is not None and file == "camera" else f"the {file} file"


def _key(file: str, name: str | None) -> str:
    """Name the file in the value of an option."""
    return name if name is not None and file == "camera" else file


def _of_scale(v: ReadingValues) -> tuple[str, str, str]:
    file, unit, factor, name = v.get("file"), v.get("unit"), float(v["factor"]), v.get("name")
    known = file is not None and unit is not None
    if v.get("bag") and known:
        write, give = "with uq-handeye bag -o DIR", f"give --units {file}={unit}"
        cause = f"the {file} poses are in {unit}. Write them {write} and {give}"
        return f"the {file} poses seem to be in {unit}", cause, f"write the poses {write} and {give}"
    if v.get("bag"):
        return (
            f"the tag seems to be {digits(factor, 2)} times as large as given",
            "the size of the tag is wrong, that of --tag or that given to its detector",
            "measure the black square of the tag, and correct --tag or the size that its detector has",
        )
    if v.get("target"):
        fitted = " (a printer that scaled to fit the page?)" if 0.8 < factor < 1.25 else ""
        cause = (
            f"no unit is such a factor; the size of the target is wrong{fitted}, or the focal length is that of other "
        )
        short = f"the target seems to be {digits(factor, 3)} times as large as given"
        return short, f"{cause}pictures", "measure the target and give its true size; else check the focal length"
    whose = _whose(str(file), name)
    short = f"{whose} seems to be in {unit}" if known else "robot and camera seem to be in different units"
    cause = "one file is in another unit (--units robot=..., --units camera=...)"
    remedy = "check the units of both files (--units robot=..., --units camera=...) and the size of the target"
    if known:
        cause = f"{whose} is in {unit}, {option_of(str(file), 'units', str(unit), 'm', name)}"
        remedy = f"run again with --units {_key(str(file), name)}={unit}"
    if unit == "m":
        cause += ", or its lengths were divided once too often where it was written"
        remedy += "; if it was read so, its lengths were divided once too often where it was written"
    return short, f"{cause}, or the size of the target is wrong", remedy


def of_lengths(values: ReadingValues) -> str:
    """Return what to do where another setup has lengths that are more likely."""
    frame = "without --robot-frame" if values["inverted"] else "--robot-frame gripper_T_base"
    return f"{CAMERA[values['setup']]}, run again with --setup {values['setup']} and {frame}"


def of_readings(values: ReadingValues) -> str:
    """Return what to do where the files fit in other readings, or in none that was tried.

    Where the setup is the likeliest, inverse camera poses that fit as well are the second way.
    """
    readings = [values["reading"]] if "reading" in values else values["readings"]
    if not readings:
        return "check the frames, units and pairing of both files"
    first, remedy = readings[0], in_words(readings[0]).remedy
    if first.get("likely") == "setup" and len(readings) > 1 and readings[1]["kind"] == "inverse camera":
        again = in_words({**readings[1], "setup": None}).remedy.removeprefix("run again ")
        remedy += f"; or, {CAMERA[OTHER_SETUP[first['setup']]]}, {again}"
    return remedy


# The meaning of a reading that fits as well, with X in another frame or place, and the options that select it.
_LOOKS = {"opengl": "looks along -z (OpenGL, Blender, MuJoCo)", "ros": "is a body with x ahead (ROS, WPILib)"}


def view_in_words(reading: ReadingValues) -> tuple[str, str]:
    """Return a reading of `camera_views` in words, and what to do if it is right."""
    kind = reading["kind"]
    if kind == "convention":
        name = reading["name"]
        return f"the camera {_LOOKS[name]}", f"run again with --camera-convention {name}"
    if kind == "both inverse":
        given = reading["on_request"]
        frames = [
            f"without --{side}-frame" if side in given else f"with --{side}-frame {frame}"
            for side, frame in FRAMES.values()
        ]
        other = f"{frames[1]} and --setup {OTHER_SETUP[reading['setup']]}"
        what = "both files hold inverse poses, or the camera file does and the setup is the other one"
        return what, f"run again {frames[0]} and {frames[1]}; or {other}"
    if kind == "exchanged":
        return "the two files are exchanged", "give the robot's file first, and the camera's second"
    return (
        "the two files are exchanged and hold inverse poses",
        "give the robot's file first, with --robot-frame gripper_T_base --camera-frame target_T_camera",
    )
