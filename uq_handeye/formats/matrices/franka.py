"""``O_T_EE`` of Franka robots: the 16 numbers of base_T_end-effector, column by column, in m.

The reader accepts tables with the columns ``O_T_EE_0`` to ``O_T_EE_15`` (also ``O_T_EE[0]``, ``field.O_T_EE0``), and
the numbers behind each ``O_T_EE`` in JSON, in robot states as libfranka prints them, and in messages that ROS prints;
where the format is asked for, also lines of 16 numbers without names. Source:
frankaemika/libfranka, ``include/franka/robot_state.h`` (``O_T_EE``: column-major) and ``src/robot_state.cpp``;
``franka_msgs/FrankaState``.
"""

from __future__ import annotations

import re

import numpy as np

from ...errors import InputError
from ..contents import Contents, Reading, matrices_side
from .layout import matrices_in
from .matrix_contents import contents_of
from .named_columns import FRANKA, names_matrices, read_columns
from .number_lines import number_lines

_FRANKA = (Reading("franka", "matrix", "m"),)
HELP = "docs/formats.md, Franka"
_KEY = re.compile(r"(?<![A-Za-z0-9_])O_T_EE[\"']?\s*[:=]\s*")
# Entries of JSON that hold the pose of a target beside that of the robot.
_SEEN = re.compile(r"\"[\w.]*(?:target|board|marker|tag|pattern|aruco|rvec|object)[\w.]*\"\s*:\s*\[", re.IGNORECASE)
_NUMBERS = re.compile(
    r"[\s\[\]{},-]*?([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)(?=[\s\[\]{},]|$)", re.IGNORECASE
)


def is_franka(head: str) -> bool:
    """Return whether a text names the numbers of O_T_EE."""
    if _KEY.search(head):
        return not (head.lstrip().startswith("{") and _SEEN.search(head))
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
    found_matrices = matrices_in(np.array(rows))
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
    found = matrices_in(table) if table.shape[1] >= 16 else None
    if found is None:
        raise InputError(f"{name}: expected the 16 numbers of O_T_EE in each line, got none ({HELP}).")
    return contents_of(found, name, np.array([line.line for line in lines]), "line")
