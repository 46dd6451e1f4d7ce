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
joints in rad (``[deg]``). Further columns are ignored.
Millimetres that were taken for metres, and metres for millimetres, are refused (`require_metres`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...calibration.estimated import Estimated
from ...calibration.evidence.touches import Touches
from ...calibration.prediction.predict import poses_so_far
from ...core.files.csv_text import plain_text
from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, Table, name_and_unit, read_table
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, pose
from ...core.limits import MAX_TABLE_BYTES
from ...core.presentation.units import ANGLE_UNITS, LENGTH_UNITS
from ...errors import InputError, require_one_of
from ...formats.contents import NORM_TOLERANCE
from ...model.kinematics.chain import Kinematics
from ...model.kinematics.joint import PRISMATIC
from ..maintenance.joined_poses import ANOTHER_UNIT_RATIO

# Units behind the name of a column, and how names of numbers begin.
_UNITS = ("mm", "cm", "um", "in", "deg", "rad", "mrad")
_SIDES = ("seen_", "touched_", "board_")
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


class _Touches(NamedTuple):
    """Columns of a file by their names, and their units."""

    table: Table
    columns: dict[str, int]  # of numbers, by name
    units: dict[str, str | None]
    default: str

    def at(self, row: int, column: str) -> str:
        return f"{self.table.at(row)}, column {column}"

    def numbers(self, column: str, known: Mapping[str, float] | None = None) -> Array:
        """(m,) of a column, in the unit that it names; without one lengths have that of the caller."""
        values, unit = self.table.values[:, self.columns[column]], self.units[column]
        if not (finite := np.isfinite(values)).all():
            row = int(np.argmin(finite))
            raise InputError(f"{self.at(row, column)}: expected a number, got {values[row]}.")
        if unit is None:
            return np.asarray(values * (LENGTH_UNITS[self.default] if known is LENGTH_UNITS else 1.0))
        return np.asarray(values * (1.0 if known is None else known[unit]))

    def lengths(self, prefix: str, parts: Sequence[str] = "xyz") -> Array | None:
        """(m, k) of the columns of a group, None where there are none; raises where some of them are missing."""
        if not self.group(prefix, parts):
            return None
        return np.stack([self.numbers(f"{prefix}{part}", LENGTH_UNITS) for part in parts], axis=-1)

    def group(self, prefix: str, parts: Sequence[str]) -> bool:
        """Return whether the columns of a group are there; raise where some of them are missing."""
        there = [part for part in parts if f"{prefix}{part}" in self.columns]
        if there and len(there) < len(parts):
            missing = ", ".join(f"{prefix}{part}" for part in parts if part not in there)
            raise InputError(f"{self.table.name}, line 1: expected the columns {missing} beside {prefix}{there[0]}.")
        return bool(there)

    def deviations(self, column: str) -> Array | None:
        """(m,) standard deviations of a column, m; None where there is none."""
        if column not in self.columns:
            return None
        if (values := self.numbers(column, LENGTH_UNITS)).min() < 0:
            raise InputError(f"{self.at(int(values.argmin()), column)}: expected >= 0, got {values.min():g}.")
        return values


def read_touches(
    path: StrPath,
    arm: Kinematics | None = None,
    *,
    units: str = "m",
    touch_sd: float | None = None,
    point_sd: float | None = None,
    board: ArrayLike | None = None,
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
    require_one_of("units", units, LENGTH_UNITS, "--units")
    table = _table(path, units, arm)
    name, m = table.table.name, len(table.table.lines)
    parts: dict[str, Any] = dict(more)
    if table.table.texts:
        parts["names"] = tuple(plain_text(text) or str(k + 1) for k, (text,) in enumerate(table.table.texts))
    seen, on_board = table.lengths("seen_"), table.lengths("board_")
    if (seen is None) == (on_board is None):
        raise InputError(
            f"{name}, line 1: expected either seen_x, seen_y, seen_z (camera frame) or board_x, board_y, board_z (on "
            f"the board), got {'neither' if seen is None else 'both'}."
        )
    parts["seen"] = on_board if seen is None else seen
    if on_board is not None:
        parts["board"] = _board_poses(table, board, m)
    each = [table.deviations(f"seen_sd{axis}") for axis in ("", "_x", "_y", "_z")]
    sd = np.full((m, 3), point_sd) if each[0] is None else np.repeat(each[0][:, None], 3, axis=1)
    if table.group("seen_sd_", "xyz"):
        sd = np.stack([one for one in each[1:] if one is not None], axis=-1)
    if point_sd is not None or any(one is not None for one in each):
        parts["seen_covariance"] = sd[..., None].astype(float) ** 2 * np.eye(3)
    for prefix, poses, joints in (("seen_at_", "robot", "joints"), ("touched_at_", "touched_robot", "touched_joints")):
        parts |= {poses: _poses(table, prefix), joints: _joint_values(table, prefix, arm)}
    parts["touched"] = table.lengths("touched_")
    if all(parts[side] is None for side in ("touched", "touched_robot", "touched_joints")):
        raise InputError(
            f"{name}, line 1: expected where the points were touched: touched_x, touched_y, touched_z (base frame), or "
            "the robot pose touched_at_x ... touched_at_qw."
        )
    parts["touch_sd"] = touch_sd if (of_each := table.deviations("touched_sd")) is None else of_each
    if parts["touch_sd"] is None:
        raise InputError(f"{name}: expected the noise of a touch: --tcp-sd 0.2mm, or a column touched_sd.")
    return Touches(**parts)


def _board_poses(table: _Touches, board: ArrayLike | None, m: int) -> Array:
    """(m, 4, 4) of the view of each point."""
    name = table.table.name
    if board is None:
        raise InputError(f"{name}: points of a board need its poses: --board-poses FILE, one camera_T_target per view.")
    poses = np.asarray(board, dtype=float)
    if "board_pose" in table.columns:
        rows = table.numbers("board_pose")
        wrong = (rows != np.round(rows)) | (rows < 0) | (rows >= len(poses))
        if wrong.any():
            k = int(wrong.argmax())
            raise InputError(
                f"{table.at(k, 'board_pose')}: expected a row 0 to {len(poses) - 1} of the board poses, got "
                f"{rows[k]:g}."
            )
        return np.asarray(poses[rows.astype(int)])
    if len(poses) not in (1, m):
        raise InputError(f"{name}: {m} rows and {len(poses)} board poses: expected a column board_pose (row from 0).")
    return np.broadcast_to(poses, (m, 4, 4))


def _poses(table: _Touches, prefix: str) -> Array | None:
    """(m, 4, 4) of the robot; None where there are no columns of them.

    A quaternion whose norm is further from 1 than `NORM_TOLERANCE` is none.
    """
    if not table.group(prefix, _POSE):
        return None
    q = np.stack([table.numbers(f"{prefix}{part}") for part in _POSE[3:]], axis=-1)
    norm = np.linalg.norm(q, axis=-1)
    if (wrong := np.abs(norm - 1.0) > NORM_TOLERANCE).any():
        k = int(wrong.argmax())
        raise InputError(
            f"{table.table.at(k)}, columns {prefix}qx ... {prefix}qw: expected a unit quaternion, got one of norm "
            f"{norm[k]:.4g}."
        )
    t = table.lengths(prefix)
    assert t is not None
    return pose(Rotation.from_quat(q).as_matrix(), t)


def _joint_values(table: _Touches, prefix: str, arm: Kinematics | None) -> Array | None:
    """(m, L) of the robot, rad and m; None where there are no columns of them."""
    if arm is None or not table.group(prefix, arm.names):
        return None
    columns = []
    for joint in arm.joints:
        name, known = f"{prefix}{joint.name}", LENGTH_UNITS if joint.kind == PRISMATIC else ANGLE_UNITS
        unit = table.units[name]
        if unit is not None and unit not in known:
            raise InputError(
                f"{table.table.name}, line 1, column {name}: unknown unit {unit!r} of a {joint.kind} joint."
            )
        columns.append(table.numbers(name, None if unit is None else known))
    return np.stack(columns, axis=-1)


def _table(path: StrPath, units: str, arm: Kinematics | None) -> _Touches:
    path = as_path(path)
    joints = () if arm is None else arm.names
    known = {f"{side}{axis}" for side in (*_SIDES, "seen_sd_") for axis in "xyz"} | {
        "seen_sd",
        "touched_sd",
        "board_pose",
    }
    known |= {f"{side}_at_{part}" for side in ("seen", "touched") for part in (*_POSE, *joints)}
    found: dict[str, str | None] = {}

    def places(names: list[str], line: str, where: str) -> Places:
        meant = [_meaning(column, joints) for column in names]
        only = [name for name, _ in meant]
        if twice := sorted({name for name in only if only.count(name) > 1}):
            raise InputError(f"{where}: two columns {twice[0]}.")
        if not any(name.startswith(_SIDES) for name in only):
            raise InputError(
                f"{where}: expected a header with seen_x,seen_y,seen_z,touched_x,touched_y,touched_z, got "
                f"{short(line)}."
            )
        for name, unit in meant:
            length = name.startswith(_SIDES) and "_at_" not in name
            if unit is not None and length and unit not in LENGTH_UNITS:
                raise InputError(f"{where}, column {name}: unknown unit {unit!r} of a length.")
        numbers = [k for k, name in enumerate(only) if name in known]
        found.update(meant[k] for k in numbers)
        return Places(numbers, [k for k, name in enumerate(only) if name == "point"])

    schema = Schema("a header such as seen_x,seen_y,seen_z,touched_x,...", "touch", places, quotes=True)
    with opened(path, MAX_TABLE_BYTES) as file:
        table = read_table(file, shown(path), schema)
    return _Touches(table, {name: k for k, name in enumerate(found)}, found, units)


def _meaning(column: str, joints: Sequence[str]) -> tuple[str, str | None]:
    """The name of a column in small letters (joints as they are), and its unit."""
    of_joints = {f"{side}_at_{joint}" for side in ("seen", "touched") for joint in joints}
    name, unit = (column, None) if column in of_joints else name_and_unit(column, _UNITS)
    small = name if name in of_joints else name.lower()
    return _OTHER_NAMES.get(small, small), unit


def require_metres(result: Estimated, touches: Touches, usual_m: float = 0.75) -> None:
    """Raise `InputError` where lengths are some hundred times those of the calibration, or smaller by such a factor.

    ``usual_m``: distances of a camera and of a robot of which nothing is known.
    """
    data = poses_so_far(result)
    camera, robot = (usual_m, usual_m) if data is None else (_size(data.camera), _size(data.robot))
    distances = {
        "points that the camera saw": (touches.seen if touches.board is None else None, camera),
        "poses of the board": (touches.board, camera),
        "points touched": (touches.touched, robot),
        "robot poses at which the points were seen": (touches.robot, robot),
        "robot poses at the touch": (touches.touched_robot, robot),
    }
    for what, (values, usual) in distances.items():
        size = usual if values is None else _size(values)
        unit, do = "mm", "Give --units mm, or divide by 1000."
        if 0 < size * ANOTHER_UNIT_RATIO < usual:
            unit, do = "m, read as mm", "Give --units m."
        elif size <= ANOTHER_UNIT_RATIO * usual:
            continue
        raise InputError(
            f"The {what} lie {size:.3g} m away (median), those of the calibration {usual:.2g} m: they seem to be in "
            f"{unit}. {do}"
        )


def _size(values: Array) -> float:
    """Median distance of points (m, 3), or of the origins of poses (m, 4, 4)."""
    points = values if values.ndim == 2 else values[:, :3, 3]
    return float(np.median(np.linalg.norm(points, axis=-1)))
