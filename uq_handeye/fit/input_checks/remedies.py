"""Remedies for files that would fit in another reading: the options of the command that say so."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# Where the camera is, by the setup.
CAMERA = {"eye-in-hand": "if the camera is on the gripper", "eye-to-hand": "if the camera is fixed"}
OTHER_SETUP = {"eye-in-hand": "eye-to-hand", "eye-to-hand": "eye-in-hand"}


def of_lengths(values: Mapping[str, Any]) -> str:
    """Return what to do where another setup has lengths that are more likely."""
    frame = "without --robot-frame" if values["inverted"] else "--robot-frame gripper_T_base"
    return f"{CAMERA[values['setup']]}, run again with --setup {values['setup']} and {frame}"


def of_readings(values: Mapping[str, Any]) -> str:
    """Return what to do where the files fit in other readings, or in none that was tried."""
    readings = [values["reading"]] if "reading" in values else values["readings"]
    return _try(*readings[:2]) if readings else "check the frames, units and pairing of both files"


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
            here = CAMERA[OTHER_SETUP[reading["setup"]]]
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
        if reading["unit"] == "m":
            option += "; if it was read so, its lengths were divided once too often where it was written"
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
    return "" if setup is None else f"; or, {CAMERA[setup]}, with --setup {setup}"
