"""Sentences of the findings about pose data: remarks on their reading, and poses that are left out."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...findings import INPUT, SHARED, sentence


@sentence("poses.offset_taken_as_exact", check=SHARED, phrase="the clock offset counts as exact", effect=1.5)
def _(function: str, std: float) -> str:
    return (
        f"The time offset of these poses is known to {1e3 * std:.2g} ms, but {function} takes it as exact. Use "
        "calibrate() with method 'efficient' or 'ml' to include its uncertainty."
    )


@sentence(
    "poses.another_rotation",
    rank=3,
    explains=True,
    check=INPUT,
    phrase="the {side} rotations seem to be {form}, not {used}",
    remedy="run again with --rotation {side}={form}",
)
def _(name: str, side: str, used: str, form: str, rotation: float | None, translation: float | None) -> str:
    amount = ""
    if rotation is not None and translation is not None:
        amount = f" by {math.degrees(rotation):.2g} degrees and {1e3 * translation:.3g} mm RMS"
    both = f'"{form}", None' if side == "robot" else f'None, "{form}"'
    return (
        f"{name}: with rotations read as {used} robot and camera disagree{amount}; as {form} they agree. Give "
        f"--rotation {side}={form} (rotation=({both})) if that is what the file holds."
    )


@sentence("poses.units", check=INPUT, phrase="units as given")
def _(sides: Sequence[str]) -> str:
    return f"The length unit of the {' and the '.join(sides)} poses is as given (--units)."


@sentence("poses.camera_convention", check=INPUT, phrase="camera poses of the convention {name}")
def _(name: str) -> str:
    if name == "optical":
        return "The camera poses are those of the optical frame (z ahead), as stated (--camera-convention optical)."
    return f"The camera poses were converted to the optical frame (z ahead) from the convention {name!r}."


@sentence("poses.pixel_origin", check=INPUT, phrase="camera poses of pixels counted from the corner of the first one")
def _(shift: float) -> str:
    return (
        f"The camera poses were fitted again to pixels that are {shift:g} px smaller, as theirs were counted from the "
        "corner of the first pixel (--pixel-origin corner)."
    )


@sentence("poses.inverted", check=INPUT, phrase=lambda v: f"{' and '.join(v['sides'])} poses inverted on request")
def _(sides: Sequence[str], said: bool) -> str:
    frames = {"robot": "--robot-frame gripper_T_base", "camera": "--camera-frame target_T_camera"}
    options = " and ".join(frames.get(side, side) for side in sides)
    return f"The poses of the {' and the '.join(sides)} were inverted on request ({options})."
