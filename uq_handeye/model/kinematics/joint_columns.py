"""Columns of joint values found by their names.

A column belongs to a joint if its name is that of the joint, or has it as a part: ``/joint_states/elbow/position``,
``elbow.pos``, ``elbow [deg]``. Where no column names a joint of the arm, the columns are

- one series of numbers, counted from the base: ``J1`` to ``J6``, ``fr3_joint1``, ``joint_1_s``, ``actual_q_0``,
  ``q[0]``. A series with the number 0 begins there, so that ``q_0`` is joint 1. Where joints have names of their own,
  the series must be that of a vector: ``q_0``, ``position[0]``;
- the names of a maker's driver: ``shoulder_pan_joint`` of Universal Robots, S L U R B T of Yaskawa. They are taken for
  arms without names of their own, `joint_1` and so on, those of the table of arms and of Denavit-Hartenberg parameters.

Velocities, currents and targets are no joint values. Two series that could both be the joints are refused.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ...core.files.one_line import short
from ...core.files.table import name_and_unit
from ...core.limits import MAX_NAME_CHARACTERS
from ...core.presentation.units import ANGLE_UNITS, LENGTH_UNITS
from ...errors import InputError
from .descriptions.urdf import nearest
from .joint import REVOLUTE
from .known_arms import maker_of

Column = tuple[int, str | None]  # number and the unit that its name says


class _Driver(NamedTuple):
    """Names that drivers of one maker give the joints, from the base on."""

    maker: str
    names: tuple[str, ...]


_DRIVERS = (
    _Driver("Universal Robots", ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")),
    _Driver("Universal Robots", ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")),
    _Driver("Yaskawa", ("s", "l", "u", "r", "b", "t")),
    _Driver("Yaskawa", ("s", "l", "e", "u", "r", "b", "t")),
    _Driver("TheRobotStudio", ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")),
)
# Words in names of columns that are no joint values; those of targets are passed over only where others are measured.
_NO_POSITIONS = {
    "velocity", "velocities", "vel", "speed", "speeds", "qd", "dq", "qdd", "ddq", "effort", "efforts", "eff",
    "torque", "torques", "tau", "moment", "current", "currents", "acceleration", "accelerations", "acc",
    "temperature", "temperatures", "temp", "voltage", "voltages", "force", "forces", "mode", "name", "tcp", "pose",
    "control", "output",
}  # fmt: skip
_TARGETS = {
    "target", "targets", "command", "commands", "commanded", "cmd", "desired", "goal", "reference", "setpoint",
    "action",
}  # fmt: skip
# Words of a series that says that it holds joint values.
_POSITIONS = {
    "q", "qpos", "j", "jt", "joint", "joints", "a", "ax", "axis", "axes", "rax", "theta", "angle", "angles",
    "position", "positions", "pos",
}  # fmt: skip
# Those of a vector of all joints, which has no names of the joints, whatever they are.
_VECTORS = {"q", "qpos", "position", "positions"}
# A number in a name, with brackets and what joins it to what precedes.
_NUMBER = re.compile(r"[\s_.\[(-]*(\d{1,3})[\])]?")
# The letter of Yaskawa's axes behind the number, as in joint_1_s.
_AXIS_LETTER = re.compile(r"_[slurbte]$")


class Joints(NamedTuple):
    """Names and kinds of the joints of an arm, from base to tip."""

    arm: str  # its name, with that of its maker where it is of the table
    names: tuple[str, ...]
    kinds: tuple[str, ...]

    @property
    def counted(self) -> bool:
        """True if the joints are only counted: names of arms of the table and of Denavit-Hartenberg parameters."""
        return self.names == tuple(f"joint_{k + 1}" for k in range(len(self.names)))


@dataclass
class JointColumns:
    """Columns of the joints.

    Parameters
    ----------
    columns : (L) columns of each joint, with the units that their names say; none or several where it is wrong
    note : how they were found, in words; empty where the names are those of the joints
    series : the columns of the series, in the order of their numbers, where it has more than the arm has joints
    """

    columns: list[list[Column]]
    note: str = ""
    series: list[Column] = field(default_factory=list)


def joint_columns(names: Sequence[str], arm: Joints, where: str) -> JointColumns:
    """Return the columns ``names`` of the joints of an arm, each once.

    Raises `InputError` for joints without a column, several columns of one joint, two series that may be the joints,
    and names of another maker's driver.
    """
    found = _of_joints(names, arm)
    if not any(found.columns):
        found = _of_series(names, arm, where)
    if not any(found.columns) and arm.counted:
        found = _of_driver(names, arm, where)
    if not any(found.columns):
        found = JointColumns([[] for _ in arm.names])
    for joint, columns in zip(arm.names, found.columns, strict=True):
        if len(columns) > 1:
            which = short(", ".join(names[k] for k, _ in columns))
            raise InputError(f"{where}: expected one column of joint {joint}, got {which}.")
    require_all([joint for joint, of in zip(arm.names, found.columns, strict=True) if not of], names, where)
    taken = [of[0][0] for of in found.columns]
    if twice := [k for k in taken if taken.count(k) > 1]:
        raise InputError(f"{where}: the column {short(names[twice[0]])} fits several joints.")
    return found


def require_all(missing: Sequence[str], names: Sequence[str], where: str) -> None:
    """Raise `InputError` if joints have no column, with the nearest names."""
    if missing:
        some = ", ".join(missing[:8]) + (f" and {len(missing) - 8} more" if len(missing) > 8 else "")
        raise InputError(f"{where}: no column of joint {some}{nearest(missing[0], [name for name in names if name])}.")


def _of_joints(names: Sequence[str], arm: Joints) -> JointColumns:
    """Columns by the names of the joints; where these are ours, a series that counts from 0 goes before them."""
    if arm.counted and maker_of(arm.arm) is not None and any(_counts_from_zero(name) for name in names):
        return JointColumns([])
    return JointColumns([_matches(joint, kind, names) for joint, kind in zip(arm.names, arm.kinds, strict=True)])


def _counts_from_zero(name: str) -> bool:
    return len(name) <= MAX_NAME_CHARACTERS and re.search(r"(?<![0-9])0[\])]?$", _bare(name)[0]) is not None


def _matches(joint: str, kind: str, names: Sequence[str]) -> list[Column]:
    """Columns that are values of a joint; those of exactly its name before all others."""
    exact: list[Column] = [(k, None) for k, name in enumerate(names) if name == joint]
    if exact:
        return exact
    found = []
    for k, name in enumerate(names):
        bare, unit = _bare(name, kind)
        if joint in _parts(bare) and not _NO_POSITIONS & {part.lower() for part in _parts(bare)}:
            found.append((k, unit))
    return found


def _bare(name: str, kind: str = REVOLUTE) -> tuple[str, str | None]:
    """Return a name without its unit, and the unit."""
    known = ANGLE_UNITS if kind == REVOLUTE else LENGTH_UNITS
    bare, unit = name_and_unit(name, known)
    return (bare, unit) if unit in known else (name, None)


def _parts(bare: str) -> list[str]:
    parts = re.split(r"[/\\]", bare)
    for ending in (".position", ".positions", ".pos"):
        parts = [part.removesuffix(ending) for part in parts]
    return parts


class _Series(NamedTuple):
    """Columns whose names differ in a number only."""

    words: frozenset[str]
    columns: dict[int, list[Column]]

    def start(self, n_joints: int) -> int | None:
        """Return the number of the first joint, None if the numbers are not those of the joints."""
        first = 0 if 0 in self.columns else 1
        return first if set(range(first, first + n_joints)) <= set(self.columns) else None


def _of_series(names: Sequence[str], arm: Joints, where: str) -> JointColumns:
    """Columns by the number in each name, where one series may be the joints.

    Joints with names of their own take only a vector of joint values: ``q_0`` or ``position[0]``, not ``joint_1``.
    """
    n_joints, series = len(arm.names), dict[tuple[str, str], _Series]()
    for k, name in enumerate(names):
        if len(name) > MAX_NAME_CHARACTERS:
            continue
        bare, unit = _bare(name)
        for match in _NUMBER.finditer(bare):
            before, after = bare[: match.start()].lower(), _AXIS_LETTER.sub("", bare[match.end() :].lower(), count=1)
            words = frozenset(re.findall(r"[a-z]+", f"{before} {after}"))
            of = series.setdefault((before, after), _Series(words, {}))
            of.columns.setdefault(int(match[1]), []).append((k, unit))
    whole = [of for of in series.values() if of.start(n_joints) is not None and not of.words & _NO_POSITIONS]
    whole = [of for of in whole if not of.words & _TARGETS] or whole
    whole = [of for of in whole if of.words & _POSITIONS] or whole
    if not arm.counted:
        whole = [of for of in whole if of.words & _VECTORS and not of.words & _TARGETS]
    if len(whole) > 1:
        firsts = " and ".join(short(names[min(of.columns[of.start(n_joints) or 0])[0]]) for of in whole[:2])
        raise InputError(
            f"{where}: the columns from {firsts} on may both be the joints. Keep one of them, or name the columns "
            "joint_1, joint_2, ..."
        )
    if not whole:
        return JointColumns([])
    of = whole[0]
    first = of.start(n_joints)
    assert first is not None
    columns = [of.columns[first + k] for k in range(n_joints)]
    note = "columns by the numbers of the joints"
    if first == 0:
        note += f", counted from 0: {names[columns[0][0][0]]} is joint 1"
    numbers = sorted(of.columns)
    more = len(numbers) > n_joints and numbers == list(range(first, first + len(numbers)))
    return JointColumns(columns, note, [of.columns[number][0] for number in numbers] if more else [])


def _of_driver(names: Sequence[str], arm: Joints, where: str) -> JointColumns:
    """Columns by the names that drivers give the joints."""
    bare: dict[str, list[Column]] = {}
    for k, name in enumerate(names):
        plain, unit = _bare(name)
        parts = {part.lower() for part in _parts(plain)}
        if not _NO_POSITIONS & parts:
            for part in parts:
                bare.setdefault(part.removesuffix("_joint"), []).append((k, unit))
    maker = maker_of(arm.arm)
    for driver in _DRIVERS:
        columns = [[found for name in bare if _names(name, joint) for found in bare[name]] for joint in driver.names]
        if not all(columns):
            continue
        if len(columns) != len(arm.names) or maker not in (None, driver.maker):
            listed = short(", ".join(names[of[0][0]] for of in columns))
            raise InputError(
                f"{where}: the columns {listed} are those of the {len(columns)} joints of {driver.maker}, and the arm "
                f"{arm.arm} is another one. Give the robot model of these joints (--robot-model, --urdf)."
            )
        return JointColumns(columns, f"columns by the names of the joints of {driver.maker}")
    return JointColumns([])


def _names(name: str, joint: str) -> bool:
    """Return whether a name is that of a joint, with or without that of the arm before it."""
    return name == joint or name.endswith(f"_{joint}")
