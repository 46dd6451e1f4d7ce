"""Sentences of the findings about the kinematics of an arm. Values are in rad and m; poses count from 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...core.presentation.numbers import digits
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...findings import INPUT, sentence

# What would explain poses that seem to be of another arm, and what to do about it.
READINGS = {
    "coupled": "They fit if {joints[0]} counts from the horizontal, as FANUC's pendant shows it: add pendant to the "
    "units (--joint-units deg,pendant).",
    "degrees": "They fit if the joints are in degrees: read the joints as degrees (--joint-units deg).",
    "radians": "They fit if the joints are in radians: read the joints as radians (--joint-units rad).",
    "columns": "They fit with the columns {named}: rename these joint_1, joint_2, ..., and the others otherwise.",
    "percent": "They fit if the joints are in -100 to 100 of their ranges, as LeRobot has them: give the calibration "
    "file of the arm (--joint-units my_arm.json), or record in degrees.",
    "arm": "They fit with the arm {named} of the table: give it (--robot-model {joints[0]}), or its URDF.",
    "inverted": "They fit if the robot poses are gripper_T_base: invert them (--robot-frame gripper_T_base).",
    "millimetres": "They fit if the robot poses are in millimetres (--units robot=mm).",
    "metres": "They fit if the robot poses are in metres (--units robot=m).",
    "rows later": "They fit with the joints of the next row: a row is missing in one of the two files.",
    "rows earlier": "They fit with the joints of the row before: a row is missing in one of the two files.",
    "sign": "They fit if joint {named} rotates the other way: correct its axis in the URDF, or the sign of its column.",
    "column in degrees": "They fit if joint {named} is in degrees and the others are not: write its column in the unit "
    "of the others.",
    "column in radians": "They fit if joint {named} is in radians and the others are not: write its column in the unit "
    "of the others.",
    "order": "They fit if the values of the joints belong, in their order, to {named}: correct the joint names.",
    "zero": "They fit if the zero of joint {named} is shifted by 90 or 180 degrees: correct its origin in the URDF, or "
    "its values.",
}


# What the joint values seem to be, in a few words.
_MEANT = {
    "coupled": "as FANUC's pendant shows them",
    "degrees": "in degrees",
    "radians": "in radians",
    "columns": "in the columns {first} to {last}",
    "percent": "from -100 to 100 of their ranges",
    "arm": "those of the arm {first}",
    "sign": "with another sign of {named}",
    "column in degrees": "with {named} in degrees",
    "column in radians": "with {named} in radians",
    "order": "in another order",
    "zero": "with another zero of {named}",
}


def _phrase(v: Mapping[str, Any]) -> str:
    joints = v["joints"] or [""]
    text = _MEANT.get(v["meant"], v["meant"])
    return f"the joints seem to be {text.format(first=joints[0], last=joints[-1], named=', '.join(joints))}"


def _reading(name: str | None, joints: Sequence[str]) -> str | None:
    """Return what another reading would explain and what confirms it; None for a reading that is not known."""
    return READINGS[name].format(joints=joints, named=", ".join(joints)) if name in READINGS else None


@sentence(
    "kinematics.another_reading",
    rank=3,
    explains=True,
    check=INPUT,
    phrase=_phrase,
    remedy=lambda v: (_reading(v["meant"], v["joints"]) or "").partition(": ")[2].rstrip("."),
)
def _(name: str, meant: str, joints: Sequence[str], rotation: float, translation: float) -> str:
    said = _reading(meant, joints) or ""
    apart = _both(rotation, translation)
    return f"{name}: the poses of these joints and those of the camera disagree by {apart} RMS. {said}"


@sentence(
    "kinematics.joint_3",
    check=INPUT,
    phrase=lambda v: (
        "joint 3 read as FANUC's pendant shows it" if v["coupled"] else "joint 3 read as the joint, not as J3"
    ),
)
def _(name: str, joint: str, coupled: bool, rotation: float, other: float) -> str:
    taken = (
        "as FANUC's pendant shows it, from the horizontal" if coupled else "as the angle between upper arm and forearm"
    )
    confirm = (
        "--joint-units deg,pendant confirms it, and `predict` and `plan` need it for such files"
        if coupled
        else "--joint-units deg,pendant would read it as FANUC's pendant shows it"
    )
    return (
        f"{name}: {joint} is read {taken}. The joints agree with the other poses to {_deg(rotation)}, read the other "
        f"way to {_deg(other)}. {confirm}."
    )


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
        f"a {name} of {frame_size(size)}"
        for name, size in (("tool frame", tool), ("base frame", base))
        if size is not None
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
    hint = _reading(explained_by, joints) or (
        "The URDF is of another arm, or joints and robot poses do not belong together row by row."
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


def _deg(rotation: float) -> str:
    return f"{digits(DEG_PER_RAD * rotation, 2)} deg"


def frame_size(size: Sequence[float]) -> str:
    """Return angle (rad) and length (m) of a frame as length and angle, without the one that is rounding."""
    angle, length = size[:2]
    parts = [
        (length > 1e-5, f"{digits(MM_PER_M * length, 3)} mm"),
        (angle > 2e-5, f"{digits(DEG_PER_RAD * angle, 3)} deg"),
    ]
    return ", ".join(text for shown, text in parts if shown) or parts[0][1]
