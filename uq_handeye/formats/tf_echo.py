"""Output of ``ros2 run tf2_ros tf2_echo PARENT CHILD`` (ROS 2) and ``rosrun tf tf_echo PARENT CHILD`` (ROS 1).

    At time 1700000000.250000000
    - Translation: [0.400, -0.100, 0.500]
    - Rotation: in Quaternion (xyzw) [0.000, 0.000, 0.707, 0.707]
    - Rotation: in RPY (radian) [0.000, -0.000, 1.571]
    - Rotation: in RPY (degree) [0.000, -0.000, 90.000]

Sources: ``tf2_ros/src/tf2_echo.cpp`` in ros2/geometry2 and ``tf/src/tf_echo.cpp`` in ros/geometry. What is printed is
``parent_T_child``, in metres, the scalar of the quaternion last; RPY are angles about fixed axes. The numbers have
three decimals unless tf2_echo was given a precision. With few decimals the angles in degrees are more precise than the
quaternion, and must agree with it. tf2_echo prints the nanoseconds of a stamp without leading zeros.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ..core.files.lines import floats
from ..core.files.one_line import short
from ..core.geometry.rotations import Rotation
from ..core.geometry.se3 import Array
from ..errors import InputError
from .contents import Contents
from .ros_sides import one_side, unit_quaternions

_TIME = re.compile(r"At time\s+(-?\d+)(?:\.(\d+))?\s*$")
_NUMBERS = r"\[?\s*([^\]]*?)\s*\]?\s*$"
_TRANSLATION = re.compile(r"-?\s*Translation:\s*" + _NUMBERS)
_QUATERNION = re.compile(r"-?\s*(?:Rotation:)?\s*in Quaternion\s*(?:\(xyzw\))?\s*" + _NUMBERS)
_DEGREES = re.compile(r"-?\s*(?:Rotation:)?\s*in RPY \(degrees?\)\s*" + _NUMBERS)
# Decimals up to which the degrees are used in place of the quaternion, and a rotation is named coarse.
FEW_DECIMALS, COARSE_DECIMALS = 6, 4


def is_tf_echo(head: str) -> bool:
    """Return whether a text is what tf_echo prints."""
    if "in Quaternion" not in head:
        return False
    lines = (line.lstrip(" \t-") for line in head.splitlines())
    return any(line.startswith("Translation:") and "[" in line for line in lines)


def read_tf_echo(text: str, name: str) -> Contents:
    """Return the poses of a text, one per block."""
    blocks = _blocks(text, name)
    if not blocks:
        raise InputError(
            f"{name}: expected blocks of tf_echo (At time, Translation, Rotation: in Quaternion), got none."
        )
    notes: list[str] = []
    if len(blocks) > 1 and blocks[-1].quaternion is None:
        notes.append("the last block is incomplete, and left out")
        blocks.pop()
    for block in blocks:
        if block.translation is None or block.quaternion is None:
            lacks = "Translation" if block.translation is None else "Rotation: in Quaternion"
            raise InputError(f"{name}, line {block.line}: expected the line {lacks} after it, got none.")
    rows = [(*block.translation, *block.quaternion) for block in blocks]  # type: ignore[misc]
    numbers = np.array(rows, dtype=float)
    decimals = max(block.decimals for block in blocks)
    numbers[:, 3:] = unit_quaternions(numbers[:, 3:], decimals)
    if decimals <= FEW_DECIMALS and all(block.degrees is not None for block in blocks):
        degrees = np.array([block.degrees for block in blocks])
        numbers[:, 3:], by_angles = _by_degrees(numbers[:, 3:], degrees, decimals)
        if by_angles:
            notes.append("rotations from the lines in degrees, which have more digits than the quaternions")
    if decimals <= COARSE_DECIMALS:
        notes.append(
            f"{decimals} decimals: translations are rounded to {10.0 ** (3 - decimals):g} mm; ros2 topic echo has all "
            "digits, tf2_echo more with -p 9"
        )
    lines = np.array([block.line for block in blocks])
    return one_side(name, numbers, _stamps(blocks), lines, notes)


class _Block:
    """Lines of one pose, after ``At time``."""

    def __init__(self, line: int, stamp: tuple[str, str] | None) -> None:
        self.line, self.stamp = line, stamp
        self.translation: list[float] | None = None
        self.quaternion: list[float] | None = None
        self.degrees: list[float] | None = None
        self.decimals = 0


def _blocks(text: str, name: str) -> list[_Block]:
    blocks: list[_Block] = []
    for line, raw in enumerate(text.split("\n"), start=1):
        body = raw.strip()
        if time := _TIME.match(body):
            blocks.append(_Block(line, (time.group(1), time.group(2) or "0")))
            continue
        for part, pattern, count in (
            ("translation", _TRANSLATION, 3),
            ("quaternion", _QUATERNION, 4),
            ("degrees", _DEGREES, 3),
        ):
            if (found := pattern.match(body)) is None:
                continue
            if not blocks or (part == "translation" and blocks[-1].translation is not None):
                blocks.append(_Block(line, None))  # without the line of the time
            values = _values(found.group(1), count, f"{name}, line {line}")
            if values is None and part == "degrees":
                continue
            if values is None:
                if part == "quaternion":  # cut off; it is an error unless it is the last block
                    continue
                raise InputError(
                    f"{name}, line {line}: expected {count} numbers in brackets, got {short(found.group(1))}."
                )
            setattr(blocks[-1], part, values)
            if part == "quaternion":
                blocks[-1].decimals = max(len(word.partition(".")[2]) for word in re.split(r"[,\s]+", found.group(1)))
    return blocks


def _values(text: str, count: int, where: str) -> list[float] | None:
    """Return numbers separated by commas or blanks, or None if they are not as many."""
    words = [word for word in re.split(r"[,\s]+", text) if word]
    if len(words) != count:
        return None
    if (numbers := floats(words)) is None:
        raise InputError(f"{where}: expected numbers, got {short(text)}.")
    return numbers


def _by_degrees(q: Array, degrees: Array, decimals: int) -> tuple[Array, bool]:
    """Return the rotations of RPY in degrees as quaternions (n, 4), if they agree with those within the rounding."""
    norm = np.linalg.norm(q, axis=1)
    if not np.isfinite(degrees).all() or not (norm > 0).all():
        return q, False
    by_angles = Rotation.from_euler("xyz", degrees, degrees=True)
    apart = (by_angles.inv() * Rotation.from_quat(q)).magnitude()
    if (apart > 3.0 * 10.0**-decimals).any():
        return q, False
    return by_angles.as_quat(), True


def _stamps(blocks: list[_Block]) -> NDArray[np.float64] | None:
    """Return the times; None where a block has none, or all are 0 as of static transforms."""
    if any(block.stamp is None for block in blocks):
        return None
    stamps = [block.stamp for block in blocks if block.stamp is not None]
    longest = max(len(rest) for _, rest in stamps)
    if longest == 9:  # nanoseconds as a whole number
        return np.array([float(whole) + 1e-9 * float(rest) for whole, rest in stamps])
    times = np.array([float(f"{whole}.{rest}") for whole, rest in stamps])
    return None if len(times) > 1 and not times.any() else times
