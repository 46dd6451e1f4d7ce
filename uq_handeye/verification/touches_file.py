"""Files of touches: CSV, one row per touch, columns by name in any order.

    point,seen_x,seen_y,seen_z,touched_x,touched_y,touched_z

| columns | content |
|---|---|
| ``point`` | name of the point; optional |
| ``seen_x, seen_y, seen_z`` | the point in the camera frame |
| ``seen_sd``; or ``seen_sd_x, seen_sd_y, seen_sd_z`` | its standard deviation per axis; optional |
| ``board_x, board_y, board_z`` | in place of `seen`: the point on the board |
| ``board_pose`` | row (from 0) of its view in the file of board poses |
| ``touched_x, touched_y, touched_z`` | the point touched, in the base |
| ``touched_sd`` | its standard deviation per axis; optional |
| ``seen_at_x, ..., seen_at_qw`` | robot pose ``base_T_gripper`` at which the point was seen |
| ``touched_at_x, ..., touched_at_qw`` | robot pose at the touch |
| ``seen_at_NAME``, ``touched_at_NAME`` | the same by joints: NAME of the calibration's arm |

Lengths are in m unless the name of a column says otherwise (``seen_x [mm]``, ``touched_sd_mm``) or the caller does;
joints in rad (``[deg]``). Further columns are left alone.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import InputError
from ..evidence.touches import Touches
from ..files.csv_text import plain_text
from ..files.lines import decoded, short
from ..files.open import StrPath, as_path, opened, shown
from ..formatting.units import ANGLE_UNITS, LENGTH_UNITS
from ..geometry.se3 import Array
from ..kinematics.chain import Kinematics
from ..kinematics.joint import PRISMATIC

MAX_BYTES = 50_000_000
# A quaternion whose norm is further from 1 is none.
_NORM = 1e-2

_UNIT = re.compile(r"(.+?)(?:\s*[\[(]\s*([^\])]*?)\s*[\])]|_(mm|cm|um|in|deg|rad|mrad))")
_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_OTHER_NAMES = {
    **{f"camera_{axis}": f"seen_{axis}" for axis in "xyz"},
    **{f"cam_{axis}": f"seen_{axis}" for axis in "xyz"},
    **{f"base_{axis}": f"touched_{axis}" for axis in "xyz"},
    **{f"touch_{axis}": f"touched_{axis}" for axis in "xyz"},
    **{
        f"{side}_at_{part}": f"{to}_at_{part}" for side, to in (("touch", "touched"), ("see", "seen")) for part in _POSE
    },
    "name": "point",
    "id": "point",
    "touch_sd": "touched_sd",
    "view": "board_pose",
}


@dataclass
class _Table:
    """Columns of a file by their names: numbers, units and the lines that they stand in."""

    name: str
    lines: list[int]
    texts: dict[str, list[str]]
    units: dict[str, str | None]
    default: str

    def numbers(self, column: str, scale: float = 1.0) -> Array:
        values = []
        for line, text in zip(self.lines, self.texts[column], strict=True):
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not math.isfinite(value) or "_" in text:
                got = short(text) if text else "an empty field"
                raise InputError(f"{self.name}, line {line}, column {column}: expected a number, got {got}.")
            values.append(value * scale)
        return np.array(values)

    def lengths(self, columns: Sequence[str]) -> Array:
        return np.stack([self.numbers(c, LENGTH_UNITS[self.units[c] or self.default]) for c in columns], axis=-1)

    def group(self, prefix: str, parts: Sequence[str]) -> bool:
        """Return whether the columns of a group are there; raise where some of them are missing."""
        there = [part for part in parts if f"{prefix}{part}" in self.texts]
        if there and len(there) < len(parts):
            missing = ", ".join(f"{prefix}{part}" for part in parts if part not in there)
            raise InputError(f"{self.name}, line 1: expected the columns {missing} beside {prefix}{there[0]}.")
        return bool(there)


def read_touches(
    path: StrPath,
    arm: Kinematics | None = None,
    *,
    units: str = "m",
    touch_sd: float | None = None,
    point_sd: float | None = None,
    board: Any = None,
    **more: Any,
) -> Touches:
    """Read points that were seen and touched.

    Parameters
    ----------
    path : path of the CSV file
    arm : Kinematics or None
        Of the calibration, for columns of joints.
    units : str
        Length unit of columns that name none: m, mm, cm, um or in.
    touch_sd, point_sd : float or None
        Standard deviations per axis (m), of touching and of the seen point, where the file has no column of them.
    board : (k, 4, 4) or None
        Poses ``camera_T_target`` of the views that the column ``board_pose`` counts from 0.
    more : further parts of `Touches`, such as ``tool`` and ``tool_sd``

    Raises
    ------
    InputError
        One line that names the file, the line and the column.
    """
    if units not in LENGTH_UNITS:
        raise InputError(f"Expected `units` (--units) to be one of {', '.join(LENGTH_UNITS)}, got {units!r}.")
    table = _table(path, units, arm)
    parts: dict[str, Any] = dict(more)
    if "point" in table.texts:
        parts["names"] = tuple(plain_text(text) or str(k + 1) for k, text in enumerate(table.texts["point"]))
    parts |= _seen(table, board, point_sd)
    if table.group("touched_", "xyz"):
        parts["touched"] = table.lengths(["touched_x", "touched_y", "touched_z"])
    parts |= _robot(table, "seen_at_", arm, "robot", "joints")
    parts |= _robot(table, "touched_at_", arm, "touched_robot", "touched_joints")
    if not {"touched", "touched_robot", "touched_joints"} & set(parts):
        raise InputError(
            f"{table.name}, line 1: expected where the points were touched: touched_x, touched_y, touched_z (base "
            f"frame), or "
            "the robot pose touched_at_x ... touched_at_qw."
        )
    if "touched_sd" in table.texts:
        parts["touch_sd"] = table.lengths(["touched_sd"])[:, 0]
    elif touch_sd is not None:
        parts["touch_sd"] = touch_sd
    else:
        raise InputError(f"{table.name}: expected the noise of a touch: --tcp-sd 0.2mm, or a column touched_sd.")
    for column in ("touched_sd", "seen_sd", "seen_sd_x", "seen_sd_y", "seen_sd_z"):
        if column in table.texts and (values := table.numbers(column)).min() < 0:
            line = table.lines[int(values.argmin())]
            raise InputError(f"{table.name}, line {line}, column {column}: expected >= 0, got {values.min():g}.")
    return Touches(**parts)


def _seen(table: _Table, board: Any, point_sd: float | None) -> dict[str, Any]:
    seen, of_board = table.group("seen_", "xyz"), table.group("board_", "xyz")
    if seen == of_board:
        what = "both" if seen else "neither"
        raise InputError(
            f"{table.name}, line 1: expected either seen_x, seen_y, seen_z (camera frame) or board_x, board_y, "
            f"board_z (on the "
            f"board), got {what}."
        )
    prefix = "seen_" if seen else "board_"
    parts: dict[str, Any] = {"seen": table.lengths([f"{prefix}{axis}" for axis in "xyz"])}
    m = len(table.lines)
    if of_board:
        if board is None:
            raise InputError(
                f"{table.name}: points of a board need its poses: --board-poses FILE, one camera_T_target per view."
            )
        poses = np.asarray(board, dtype=float)
        if "board_pose" in table.texts:
            rows = table.numbers("board_pose")
            wrong = (rows != np.round(rows)) | (rows < 0) | (rows >= len(poses))
            if wrong.any():
                k = int(wrong.argmax())
                raise InputError(
                    f"{table.name}, line {table.lines[k]}, column board_pose: expected a row 0 to {len(poses) - 1} "
                    f"of the "
                    f"board poses, got {rows[k]:g}."
                )
            parts["board"] = poses[rows.astype(int)]
        elif len(poses) in (1, m):
            parts["board"] = np.broadcast_to(poses, (m, 4, 4))
        else:
            raise InputError(
                f"{table.name}: {m} rows and {len(poses)} board poses: expected a column board_pose (row from 0)."
            )
    if table.group("seen_sd_", "xyz"):
        sd = table.lengths([f"seen_sd_{axis}" for axis in "xyz"])
    elif "seen_sd" in table.texts:
        sd = np.repeat(table.lengths(["seen_sd"]), 3, axis=-1)
    elif point_sd is not None:
        sd = np.full((m, 3), point_sd)
    else:
        return parts
    parts["seen_covariance"] = sd[..., None] ** 2 * np.eye(3)
    return parts


def _robot(table: _Table, prefix: str, arm: Kinematics | None, poses: str, joints: str) -> dict[str, Any]:
    parts: dict[str, Any] = {}
    if table.group(prefix, _POSE):
        t = table.lengths([f"{prefix}{axis}" for axis in "xyz"])
        q = np.stack([table.numbers(f"{prefix}{part}") for part in _POSE[3:]], axis=-1)
        norm = np.linalg.norm(q, axis=-1)
        wrong = np.abs(norm - 1.0) > _NORM
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"{table.name}, line {table.lines[k]}, columns {prefix}qx ... {prefix}qw: expected a unit "
                f"quaternion, got one "
                f"of norm {norm[k]:.4g}."
            )
        T = np.zeros((len(t), 4, 4))
        T[:, :3, :3] = Rotation.from_quat(q).as_matrix()
        T[:, :3, 3], T[:, 3, 3] = t, 1.0
        parts[poses] = T
    if arm is not None and table.group(prefix, arm.names):
        columns = []
        for joint in arm.joints:
            name = f"{prefix}{joint.name}"
            unit = table.units[name]
            known: Mapping[str, float] = LENGTH_UNITS if joint.kind == PRISMATIC else ANGLE_UNITS
            if unit is not None and unit not in known:
                raise InputError(f"{table.name}, line 1, column {name}: unknown unit {unit!r} of a {joint.kind} joint.")
            columns.append(table.numbers(name, 1.0 if unit is None else known[unit]))
        parts[joints] = np.stack(columns, axis=-1)
    return parts


def _table(path: StrPath, units: str, arm: Kinematics | None) -> _Table:
    path = as_path(path)
    name = shown(path)
    with opened(path, MAX_BYTES) as file:
        text = decoded(file.read().removeprefix(b"\xef\xbb\xbf"), f"{name}: expected a CSV table of touches")
    lines = [(k, line) for k, line in enumerate(text.splitlines(), start=1) if line.strip() and line.strip()[0] != "#"]
    if not lines:
        raise InputError(f"{name}: the file is empty; expected a header such as seen_x,seen_y,seen_z,touched_x,...")
    first, header = lines[0]
    mark = next((mark for mark in ",;\t" if mark in header), ",")
    rows = list(csv.reader((line for _, line in lines), delimiter=mark, skipinitialspace=True))
    joints = () if arm is None else arm.names
    meant, found = zip(*(_meaning(column.strip(), joints) for column in rows[0]), strict=True)
    if twice := {column for column in meant if meant.count(column) > 1}:
        raise InputError(f"{name}, line {first}: two columns {sorted(twice)[0]}.")
    if not any(column.startswith(("seen_", "touched_", "board_")) for column in meant):
        raise InputError(
            f"{name}, line {first}: expected a header with seen_x,seen_y,seen_z,touched_x,touched_y,touched_z, got "
            f"{short(header)}."
        )
    for (number, _), fields in zip(lines[1:], rows[1:], strict=True):
        if len(fields) != len(meant):
            raise InputError(f"{name}, line {number}: expected {len(meant)} fields, got {len(fields)}.")
    if len(rows) < 2:
        raise InputError(f"{name}: no rows after the header; expected one line per touch.")
    texts = {column: [row[k].strip() for row in rows[1:]] for k, column in enumerate(meant)}
    for column, unit in zip(meant, found, strict=True):
        length = column.startswith(("seen_", "touched_", "board_")) and "_at_" not in column
        if unit is not None and length and unit not in LENGTH_UNITS:
            raise InputError(f"{name}, line {first}, column {column}: unknown unit {unit!r} of a length.")
    return _Table(name, [number for number, _ in lines[1:]], texts, dict(zip(meant, found, strict=True)), units)


def _meaning(column: str, joints: Sequence[str]) -> tuple[str, str | None]:
    """The name of a column in small letters (joints as they are), and its unit."""
    if any(column in (f"seen_at_{joint}", f"touched_at_{joint}") for joint in joints):
        return column, None
    split = _UNIT.fullmatch(column)
    if split is None:
        small = column.lower()
        return _OTHER_NAMES.get(small, small), None
    name, unit = split[1], split[2] if split[2] is not None else split[3]
    if not any(name in (f"seen_at_{joint}", f"touched_at_{joint}") for joint in joints):
        name = name.lower()
    return _OTHER_NAMES.get(name, name), unit
