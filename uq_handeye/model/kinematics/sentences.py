"""Sentences of the findings about the kinematics of an arm. Values are in rad and m; poses count from 0."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.formatting.numbers import digits
from ...core.formatting.units import DEG_PER_RAD, MM_PER_M
from ...findings import INPUT, sentence

# What would explain poses that seem to be of another arm, and what to do about it.
READINGS = {
    "degrees": "They fit if the joints are in degrees: read the joints as degrees (--joint-units deg).",
    "radians": "They fit if the joints are in radians: read the joints as radians (--joint-units rad).",
    "inverted": "They fit if the robot poses are gripper_T_base: invert them (--robot-frame gripper_T_base).",
    "millimetres": "They fit if the robot poses are in millimetres (--units robot=mm).",
    "metres": "They fit if the robot poses are in metres (--units robot=m).",
    "rows later": "They fit with the joints of the next row: a row is missing in one of the two files.",
    "rows earlier": "They fit with the joints of the row before: a row is missing in one of the two files.",
    "sign": "They fit if joint {joints} rotates the other way: correct its axis in the URDF, or the sign of its "
    "values.",
    "order": "They fit if the values of the joints belong, in their order, to {joints}: correct the joint names.",
    "zero": "They fit if the zero of joint {joints} is shifted by 90 or 180 degrees: correct its origin in the "
    "URDF, or its values.",
}


@sentence("kinematics.against_controller")
def _(
    rotation: float,
    translation: float,
    largest_rotation: float,
    largest_translation: float,
    tool: Sequence[float] | None,
    base: Sequence[float] | None,
    n: int,
) -> str:
    frames = [
        f"a {name} of {_frame(size)}" for name, size in (("tool frame", tool), ("base frame", base)) if size is not None
    ]
    than = f"after {' and '.join(frames)}" if frames else "in the same frames"
    return (
        f"The controller's {n} poses differ from the URDF's by {_both(rotation, translation)} RMS, at most "
        f"{_both(largest_rotation, largest_translation)}, {than}."
    )


@sentence(
    "kinematics.another_arm",
    rank=2,
    check=INPUT,
    phrase="the robot poses are not those of the URDF",
    remedy="give the URDF of this robot, or leave --joints and --urdf out",
)
def _(rotation: float, translation: float, n: int, explained_by: str | None, joints: Sequence[str]) -> str:
    hint = (
        "The URDF is of another arm, or joints and robot poses do not belong together row by row."
        if explained_by not in READINGS
        else READINGS[explained_by].format(joints=", ".join(joints))
    )
    return (
        f"The {n} robot poses do not match the URDF: {_both(rotation, translation)} RMS remain after the best tool and "
        f"base frames, more than any tolerance of an arm. {hint}"
    )


@sentence(
    "kinematics.rows_apart",
    check=INPUT,
    phrase=lambda v: f"{len(v['rows'])} poses: joints and robot pose differ",
    effect=1.5,
    rows=("rows", "farthest"),
)
def _(rows: Sequence[int], farthest: int, rotation: float, translation: float) -> str:
    listed = ", ".join(map(str, rows[:10])) + (", ..." if len(rows) > 10 else "")
    which, of = ("Pose", "it") if len(rows) == 1 else ("Poses", "them")
    return (
        f"{which} {listed}: joints and robot pose are not of the same moment (pose {farthest} differs by "
        f"{_both(rotation, translation)} where the others agree). Leave {of} out, or correct the pairing of the rows."
    )


def _both(rotation: float, translation: float) -> str:
    return f"{digits(MM_PER_M * translation, 2)} mm and {digits(DEG_PER_RAD * rotation, 2)} deg"


def _frame(size: Sequence[float]) -> str:
    """Length and angle, without the one that is rounding."""
    angle, length = size[:2]
    parts = [
        (length > 1e-5, f"{digits(MM_PER_M * length, 3)} mm"),
        (angle > 2e-5, f"{digits(DEG_PER_RAD * angle, 3)} deg"),
    ]
    return ", ".join(text for shown, text in parts if shown) or parts[0][1]
