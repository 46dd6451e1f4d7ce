"""Ways in which joint values may be meant other than as they were read.

The likely ones come first: joint 3 as FANUC's pendant shows it, degrees and radians, other columns of a numbered
series, -100 to 100 of the range of each joint; then another arm of the table; then single joints with another sign or
unit, another order, and another zero.

*FANUC.* The pendant counts J3 from the horizontal: it stays when J2 moves and the forearm keeps its direction. The
joint between upper arm and forearm, which robot descriptions have, is J3 + J2. Files of the controller have the values
of the pendant; drivers of ROS publish the joint.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...core.rounding import CHAIN_ROUNDING
from .known_arms import arm_names, known_arm, maker_of
from .lerobot import MAX_SHARE

if TYPE_CHECKING:
    from .chain import Kinematics

COUPLED, PERCENT = "coupled", "percent"
# All orders of the joints are tried of arms up to this number of joints, the likely ones of others.
MAX_PERMUTED_JOINTS = 6
# Names of FANUC arms in robot descriptions, such as fanuc_m10ia, crx10ia_l, lrmate200id, r2000ic165f.
_FANUC = re.compile(r"fanuc|lr[\s_-]?mate|(?<![a-z0-9])(?:crx|m|r)[\s_-]?\d+i[a-d]", re.IGNORECASE)


class JointReading(NamedTuple):
    """One way to read joint values."""

    name: str  # key of `sentences.READINGS`
    joints: tuple[str, ...]  # names of joints or columns that it is about
    q: Array


class JointSeries(NamedTuple):
    """A numbered series of columns that is longer than the arm: its first columns were read."""

    names: tuple[str, ...]
    values: Array  # (n, K) rad


def may_be_coupled(kinematics: Kinematics) -> bool:
    """Return whether joint 3 may count from the horizontal: six axes, of which the second and third are opposite."""
    if kinematics.n_joints != 6 or not kinematics.revolute.all():
        return False
    second, third = kinematics.frames(np.zeros(6))[1:3, :3, 2]
    return bool(second @ third < -0.99)


def is_fanuc(kinematics: Kinematics) -> bool:
    """Return whether FANUC's pendant shows joint 3 of this arm from the horizontal, by its name and its axes."""
    return _FANUC.search(kinematics.name) is not None and may_be_coupled(kinematics)


def uncoupled(q: Array) -> Array:
    """Return joint values (n, 6) of those that FANUC's pendant shows."""
    joints = np.array(q, dtype=float)
    joints[..., 2] += joints[..., 1]
    return joints


def likely_readings(kinematics: Kinematics, q: Array, series: JointSeries | None = None) -> Iterator[JointReading]:
    """Yield readings of all joints together."""
    names, turns = kinematics.names, kinematics.revolute
    if may_be_coupled(kinematics):
        yield JointReading(COUPLED, (names[2], names[1]), uncoupled(q))
    yield JointReading("degrees", (), np.where(turns, np.radians(q), q))
    yield JointReading("radians", (), np.where(turns, np.degrees(q), q))
    if series is not None:
        for first in range(1, len(series.names) - len(names) + 1):
            window = slice(first, first + len(names))
            yield JointReading("columns", series.names[window], series.values[:, window])
    lower, upper = _ranges(kinematics).T
    if turns.all() and np.isfinite([lower, upper]).all():
        for percent in (q, np.degrees(q)):
            if 2 * np.pi < np.abs(percent).max() <= MAX_SHARE:
                yield JointReading(PERCENT, (), 0.005 * (upper - lower) * percent)


def _ranges(kinematics: Kinematics) -> Array:
    """Return the limits of the joints (L, 2); of an arm of the table the range in ordinary work."""
    if (maker := maker_of(kinematics.name)) is None:
        return kinematics.limits
    return known_arm(kinematics.name.removeprefix(f"{maker} ")).usual


def single_readings(kinematics: Kinematics, q: Array) -> Iterator[JointReading]:
    """Yield readings of single joints, and of joints in another order."""
    names, turns = kinematics.names, np.flatnonzero(kinematics.revolute).tolist()
    for k in turns:
        yield JointReading("sign", (names[k],), _changed(q, k, -q[:, k]))
    for k in turns:
        yield JointReading("column in degrees", (names[k],), _changed(q, k, np.radians(q[:, k])))
        yield JointReading("column in radians", (names[k],), _changed(q, k, np.degrees(q[:, k])))
    for i, j in combinations(turns, 2):
        yield JointReading("sign", (names[i], names[j]), _changed(_changed(q, i, -q[:, i]), j, -q[:, j]))
    for order in _orders(len(names)):
        yield JointReading("order", tuple(names[k] for k in np.argsort(order)), q[:, order])
    for k in turns:
        for quarter in (0.5 * np.pi, -0.5 * np.pi, np.pi):
            yield JointReading("zero", (names[k],), _changed(q, k, q[:, k] + quarter))


def other_arms(kinematics: Kinematics) -> Iterator[tuple[tuple[str, ...], Kinematics]]:
    """Yield the arms of the table with as many joints, each with the names of those that have its kinematics."""
    q = np.linspace(-1.0, 1.0, kinematics.n_joints)
    own = kinematics.poses(q)
    alike: list[tuple[list[str], Kinematics, Array]] = []
    for name in arm_names():
        if len(known_arm(name).usual) == kinematics.n_joints:
            arm = type(kinematics).from_name(name)
            T = arm.poses(q)
            names = next((names for names, _, other in alike if np.allclose(T, other, atol=CHAIN_ROUNDING)), None)
            if names is not None:
                names.append(name)
            elif not np.allclose(T, own, atol=CHAIN_ROUNDING):
                alike.append(([name], arm, T))
    for names, arm, _ in alike:
        yield tuple(names), arm


def _changed(q: Array, k: int, values: Array) -> Array:
    changed = q.copy()
    changed[:, k] = values
    return changed


def _orders(n: int) -> Iterator[list[int]]:
    """Yield orders of n joints, likely ones first, and all of them of up to `MAX_PERMUTED_JOINTS` joints.

    ``order[k]`` is the column that holds joint k.
    """
    seen = {tuple(range(n))}

    def likely() -> Iterator[Sequence[int]]:
        yield range(n)[::-1]
        for first in (1, n - 1):
            yield [(k + first) % n for k in range(n)]
        for i, j in combinations(range(n), 2):
            order = list(range(n))
            order[i], order[j] = j, i
            yield order
        if n <= MAX_PERMUTED_JOINTS:
            yield from permutations(range(n))

    for order in map(tuple, likely()):
        if order not in seen:
            seen.add(order)
            yield list(order)
