"""Poses of HALCON: the text that ``write_pose`` writes, and lines of the seven numbers of a pose tuple.

    # Used representation type:
    f 0
    # Rotation angles [deg] or Rodriguez vector:
    r -17.8134 1.83816 0.288092
    # Translation vector (x y z [m]):
    t 0.280164 0.150644 1.7554

Source: HALCON Operator Reference, ``create_pose``, ``write_pose``, ``read_pose``. The type is a code: 0, 2, 4 for the
rotations gba (Rx Ry Rz), abg (Rz Ry Rx) and rodriguez (a vector along the axis whose length is the tangent of half the
angle); 8 more where the translation comes first, R (p - T) in place of R p + T; 1 more for the view of the coordinate
system, in which the angles count the other way. Angles are in degrees, translations in metres.
"""

from __future__ import annotations

import re

import numpy as np

from ...core.files.lines import floats
from ...core.files.one_line import short
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import Contents, Reading, matrices_side

CODES = {0: "gba", 2: "abg", 4: "rodriguez"}
ALL_CODES = tuple(sorted(order + first + view for order in CODES for first in (0, 8) for view in (0, 1)))
_HALCON = (Reading("halcon", "matrix", "m"),)
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TYPE = re.compile(r"^\s*f\s+(\d+)\s*$", re.MULTILINE)
_ROTATION = re.compile(rf"^\s*r\s+{_NUMBER}\s+{_NUMBER}\s+{_NUMBER}\s*$", re.MULTILINE)


def is_halcon(head: str) -> bool:
    """Return whether a text is a pose file of HALCON."""
    return _TYPE.search(head) is not None and _ROTATION.search(head) is not None


def pose_matrix(numbers: Array, code: int) -> Array:
    """The matrix (4, 4) of x, y, z and three numbers of the rotation, by the code of the representation."""
    order, first, back = CODES[code & 6], bool(code & 8), bool(code & 1)
    t, r = numbers[:3], numbers[3:] * (-1.0 if back else 1.0)
    if order == "rodriguez":
        rotation = Rotation.from_quat([*r, 1.0])
    else:
        x, y, z = r
        rotation = (
            Rotation.from_euler("XYZ", [x, y, z], degrees=True)
            if order == "gba"
            else Rotation.from_euler("ZYX", [z, y, x], degrees=True)
        )
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    T[:3, 3] = -T[:3, :3] @ t if first else t
    return T


def read_halcon(text: str, name: str) -> Contents:
    """Return the poses of a text, one per ``f``, ``r`` and ``t``, or one per line of seven numbers."""
    blocks: list[dict[str, tuple[float, ...]]] = []
    lines: list[int] = []
    for line, raw in enumerate(text.splitlines(), start=1):
        content = raw.partition("#")[0].strip()
        if not content:
            continue
        where = f"{name}, line {line}"
        key, *words = content.split()
        if key not in ("f", "r", "t"):
            blocks.append(_tuple(content, where))
            lines.append(line)
            continue
        numbers = _numbers(words, where, 1 if key == "f" else 3)
        if not blocks or key in blocks[-1]:
            blocks.append({})
            lines.append(line)
        blocks[-1][key] = numbers
    if not blocks:
        raise InputError(f"{name}: expected a pose of HALCON (lines f, r and t), got an empty file.")
    T = np.empty((len(blocks), 4, 4))
    codes = []
    for k, block in enumerate(blocks):
        where = f"{name}, line {lines[k]}"
        if lacks := [key for key in "frt" if key not in block]:
            raise InputError(f"{where}: expected the lines f, r and t of a pose, got none with {', '.join(lacks)}.")
        code = block["f"][0]
        if code not in ALL_CODES:
            raise InputError(
                f"{where}: expected a representation type of HALCON among {', '.join(map(str, ALL_CODES))}, got "
                f"{code:g} (docs/formats.md, HALCON)."
            )
        T[k] = pose_matrix(np.array([*block["t"], *block["r"]]), int(code))
        codes.append(int(code))
    side = matrices_side(name, T, rows=np.array(lines), counted="line", readings=_HALCON)
    return Contents(only=side, notes=(f"type {', '.join(map(_words, sorted(set(codes))))}; m and deg",))


def _words(code: int) -> str:
    view = ", coordinate_system" if code & 1 else ""
    return f"{code} ({'R(p-T)' if code & 8 else 'Rp+T'}, {CODES[code & 6]}{view})"


def _tuple(content: str, where: str) -> dict[str, tuple[float, ...]]:
    """The parts of a line of seven numbers."""
    words = [word for word in re.split(r"[\s,;]+", content.strip("[](){} ")) if word]
    numbers = _numbers(words, where, 7)
    return {"t": numbers[:3], "r": numbers[3:6], "f": numbers[6:]}


def _numbers(words: list[str], where: str, count: int) -> tuple[float, ...]:
    numbers = tuple(floats(words) or ())
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(
            f"{where}: expected {count} number{'s' * (count > 1)} of a pose of HALCON, got {short(' '.join(words))} "
            "(docs/formats.md, HALCON)."
        )
    return numbers
