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

``O_T_EE`` of Franka robots: the 16 numbers of base_T_end-effector, column by column, in m.

Read are tables with the columns ``O_T_EE_0`` to ``O_T_EE_15`` (also ``O_T_EE[0]``, ``field.O_T_EE0``), and the numbers
behind each ``O_T_EE`` in JSON, in robot states as libfranka prints them, and in messages that ROS prints; where the
format is asked for, also lines of 16 numbers without names. Source:
frankaemika/libfranka, ``include/franka/robot_state.h`` (``O_T_EE``: column-major) and ``src/robot_state.cpp``;
``franka_msgs/FrankaState``.

Transforms of Zivid: one matrix 4x4 per YAML file, in mm.

    __version__:                          %YAML:1.0
      serializer: 1                       ---
      data: 1                             PoseState: !!opencv-matrix
    FloatMatrix:                             rows: 4
      Data: [[1, 0, 0, 400], ...]            ...

Source: zivid/zivid-python-samples, ``source/sample_utils/save_load_matrix.py`` (today's form, also what
``zivid.Matrix4x4.save`` writes) and ``robotTransform.yaml`` of 2020 (the older one); translations in mm as
``zivid.calibration.Pose`` takes them.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...core.files.lines import floats
from ...core.files.one_line import short
from ...core.files.tree_values import fields_of, got, is_list, number
from ...core.files.trees import parse_tree
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..contents import Contents, Reading, matrices_side
from ..opencv_storage import stack
from .arrays import found_in
from .text import FRANKA, contents_of, names_matrices, number_lines, read_columns

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


_FRANKA = (Reading("franka", "matrix", "m"),)
HELP = "docs/formats.md, Franka"

_KEY = re.compile(r"(?<![A-Za-z0-9_])O_T_EE[\"']?\s*[:=]\s*")
_NUMBERS = re.compile(
    r"[\s\[\]{},-]*?([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)(?=[\s\[\]{},]|$)", re.IGNORECASE
)


def is_franka(head: str) -> bool:
    """Return whether a text names the numbers of O_T_EE."""
    if _KEY.search(head):
        return True
    return FRANKA in head.lower() and names_matrices(head)


def read_franka(text: str, name: str) -> Contents:
    """Return the poses of a table, of JSON or of printed states."""
    if not _KEY.search(text):
        return read_columns(text, name, _FRANKA) if names_matrices(text) else _unnamed(text, name)
    rows: list[list[float]] = []
    lines: list[int] = []
    begin, line = 0, 1
    for key in _KEY.finditer(text):
        line += text.count("\n", begin, key.end())
        begin = key.end()
        numbers: list[float] = []
        while (found := _NUMBERS.match(text, begin)) is not None:
            numbers.append(float(found[1]))
            begin = found.end()
        if not numbers or len(numbers) % 16:
            raise InputError(f"{name}, line {line}: expected the 16 numbers of O_T_EE, got {len(numbers)} ({HELP}).")
        rows += [numbers[k : k + 16] for k in range(0, len(numbers), 16)]
        lines += [line] * (len(numbers) // 16)
        line += text.count("\n", key.end(), begin)
    found_matrices = found_in(np.array(rows))
    if found_matrices is None:
        raise InputError(
            f"{name}, line {lines[0]}: expected 0, 0, 0, 1 as every fourth number of O_T_EE, got {rows[0]} ({HELP})."
        )
    side = matrices_side(name, found_matrices.T, rows=np.array(lines), counted="line", readings=_FRANKA)
    return Contents(only=side, notes=(f"O_T_EE, {found_matrices.note}",))


def _unnamed(text: str, name: str) -> Contents:
    """Return the poses of lines of 16 numbers, perhaps behind a time, without names."""
    lines = list(number_lines(text, name))
    table = (
        np.array([line.values for line in lines])
        if len({len(line.values) for line in lines}) == 1
        else np.empty((0, 0))
    )
    found = found_in(table) if table.shape[1] >= 16 else None
    if found is None:
        raise InputError(f"{name}: expected the 16 numbers of O_T_EE in each line, got none ({HELP}).")
    return contents_of(found, name, np.array([line.line for line in lines]), "line")


_ZIVID = (Reading("zivid", "matrix", "mm"),)
_KEYS = ("FloatMatrix", "PoseState")
_IS = re.compile(r"^\s*[\"']?(FloatMatrix|PoseState)[\"']?\s*:", re.MULTILINE)


def is_zivid(head: str) -> bool:
    """Return whether a text is a transform of Zivid."""
    return _IS.search(head) is not None


def read_zivid(text: str, name: str) -> Contents:
    """Return the pose of a file."""
    tree: Any = parse_tree(text.encode(), name)
    key = next((key for key in _KEYS if key in fields_of(tree)), None)
    if key is None:
        raise InputError(f"{name}: expected FloatMatrix or PoseState (docs/formats.md, Zivid), got {got(tree)}.")
    value, where = tree[key], f"{name}, {key}"
    if key == "FloatMatrix":
        if "Data" not in fields_of(value):
            raise InputError(f"{where}: expected Data with a matrix 4x4, got {got(value)}.")
        data, where = value["Data"], f"{where}, Data"
        flat = [entry for row in data for entry in (row if is_list(row) else [row])] if data else []
        numbers = np.array([number(entry, where) for entry in flat])
    else:
        numbers = stack(value, where).reshape(-1)
    if numbers.size != 16:
        raise InputError(f"{where}: expected a matrix 4x4, got {numbers.size} numbers.")
    found = found_in(numbers.reshape(1, 16))
    if found is None:
        raise InputError(f"{where}: expected the last row 0, 0, 0, 1, got {numbers[12:].tolist()}.")
    return Contents(
        only=matrices_side(where, found.T, readings=_ZIVID), notes=("translations in mm, as Zivid has them",)
    )
