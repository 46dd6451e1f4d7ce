"""Meaning of the columns of a pose table: position, rotation and time by their names, with the units that these say."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from ...formatting.units import LENGTH_UNITS
from ..columns import LONGEST, SECONDS, meaning

# Units of angles, as columns name them.
ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad"}
_UNITS = "|".join(sorted({*LENGTH_UNITS, *ANGLES, *SECONDS, "-", "1"}, key=len, reverse=True))
_UNIT = re.compile(rf"(.+?)(?:\s*[\[(]\s*({_UNITS})?\s*[\])]|[\s_/]({_UNITS}))", re.IGNORECASE)
# What programs put before the names, in small letters.
_PREFIX = re.compile(
    r"(?:(?:actual|current|act|cart|cartesian|robot|tcp|tool|pose|position|pos|target|flange|ee|eef|tf|world|base|cam|"
    r"camera|board|marker|gripper|end_effector|r|msg)[\s._/]+)+(?=.)"
)

_MEASURED = re.compile(r"(?<![a-z])(?:actual|act|current|measured|meas)(?![a-z])", re.IGNORECASE)
_COMMANDED = re.compile(
    r"(?<![a-z])(?:target|command|commanded|cmd|desired|des|setpoint|goal|ref)(?![a-z])", re.IGNORECASE
)

# Three numbers of a rotation by their names in small letters, in the order of the form. The names of some are shared.
ROTATIONS: dict[str, tuple[str, ...]] = {
    "abc": ("a", "b", "c"),
    "wpr": ("w", "p", "r"),
    "oat": ("o", "a", "t"),
    "aer": ("a", "e", "r"),
    "uvw": ("u", "v", "w"),
    "rpy": ("roll", "pitch", "yaw"),
    "rotvec": ("rotvec_x", "rotvec_y", "rotvec_z"),
    "rxyz": ("rx", "ry", "rz"),
    "euler": ("alpha", "beta", "gamma"),
}
QUATERNIONS: dict[str, tuple[str, ...]] = {
    "named": ("qx", "qy", "qz", "qw"),
    "q1234": ("q1", "q2", "q3", "q4"),
    "q0123": ("q0", "q1", "q2", "q3"),
}
AXIS_ANGLE = ("ax", "ay", "az", "angle")

_ALIASES = {
    **{f"{part}{letter}": f"rotvec_{axis}"
       for part in ("rvec_", "rvec", "rotvec", "rot_vec_", "rv_", "rv", "axis_angle_", "axisangle_", "aa_")
       for letter, axis in zip("xyz012", "xyzxyz", strict=True)},
    **{f"{part}{axis}": f"r{axis}" for part in ("r_", "rot_", "rot", "rotation_", "ori_", "orientation_")
       for axis in "xyz"},
    **{f"{part}{axis}": f"r{axis}" for part in ("euler_", "euler", "e", "angle_", "ang_") for axis in "xyz"},
    **{f"{part}{number}": axis for part in ("tvec_", "tvec") for number, axis in zip("012", "xyz", strict=True)},
    **{f"tvec_{axis}": axis for axis in "xyz"},
    **{f"tcp_pose_{k}": axis for k, axis in enumerate(("x", "y", "z"))},
    **{f"tcp_pose_{k + 3}": f"rotvec_{axis}" for k, axis in enumerate("xyz")},
    **{f"{part}{axis}": f"q{axis}" for part in ("quat", "quaternion_", "o", "q.") for axis in "xyzw"},
    **{f"axis_{axis}": f"a{axis}" for axis in "xyz"},
    **{f"trans_{axis}": axis for axis in "xyz"}, **{f"translation_{axis}": axis for axis in "xyz"},
    **{f"{axis}_{part}": axis for axis in "xyz" for part in ("pos", "position", "coordinate")},
    "theta": "angle", "rw": "qw", "ori_w": "qw", "rot_w": "qw", "rotation_w": "qw", "phi": "alpha",
}  # fmt: skip


@dataclass(frozen=True)
class Columns:
    """Columns that are used: time, x, y, z, and those of the ``rotation``, in the order of its form."""

    kind: str
    time: int | None
    position: tuple[int, int, int]
    rotation: tuple[int, ...]
    length: str | None
    angle: str | None
    time_unit: str = "s"

    @property
    def used(self) -> set[int]:
        """The numbers of the columns that are used."""
        return {*self.position, *self.rotation, *(() if self.time is None else (self.time,))}


class ColumnError(Exception):
    """Names that do not make a pose, or in several ways."""


@lru_cache(maxsize=4096)
def name_and_unit(name: str) -> tuple[str, str | None]:
    """Return the meaning of a name in small letters, and the unit that it says.

    >>> name_and_unit("X [mm]"), name_and_unit("roll_deg"), name_and_unit("actual_TCP_pose_3")
    (('x', 'mm'), ('roll', 'deg'), ('rotvec_x', None))
    """
    if len(name) > LONGEST:
        return name, None
    small = name.strip().strip("\"'").lower()
    unit = None
    match = _UNIT.fullmatch(small)
    if match is not None and _known(match[1]) is not None:
        small, unit = match[1], match[2] or match[3]
    known = _known(small)
    return (small if known is None else known), unit


def _known(small: str) -> str | None:
    small = small.strip()
    for one in (small, _PREFIX.sub("", small)):
        one = one.replace(" ", "_")
        if one in _ALL:
            return one
        if one in _ALIASES:
            return _ALIASES[one]
        if (column := meaning(one)) in _ALL:
            return column
    if (match := re.fullmatch(r".*tcp_pose_([0-5])", small)) is not None:
        return _ALIASES[f"tcp_pose_{match[1]}"]
    return None


_ALL = {
    "timestamp", "x", "y", "z", *AXIS_ANGLE,
    *(name for names in (*ROTATIONS.values(), *QUATERNIONS.values()) for name in names),
}  # fmt: skip


def _rank(name: str) -> int:
    """Return which of several columns of one meaning comes first: what was measured, not what was commanded."""
    return 1 - bool(_MEASURED.search(name)) + bool(_COMMANDED.search(name))


def measured(word: str) -> bool:
    """Return whether a word before names says that they were measured, not commanded."""
    return bool(_MEASURED.fullmatch(word))


def is_pose_header(names: Sequence[str]) -> bool:
    """Return whether names of columns hold a position and a rotation."""
    try:
        _places(names)
    except ColumnError:
        return False
    return True


def _places(names: Sequence[str]) -> tuple[str, dict[str, int], list[tuple[str, str | None]]]:
    """Return the kind of the rotation, where each number stands, and what each name means."""
    found = [name_and_unit(name) for name in names]
    where: dict[str, int] = {}
    for k in sorted(range(len(names)), key=lambda k: _rank(names[k])):
        where.setdefault(found[k][0], k)
    if missing := [axis for axis in "xyz" if axis not in where]:
        raise ColumnError(f"no column {', '.join(missing)}")
    kinds = [kind for kind, parts in QUATERNIONS.items() if all(part in where for part in parts)]
    kinds = kinds or ["axis-angle"] * all(part in where for part in AXIS_ANGLE)
    kinds = kinds or [kind for kind, parts in ROTATIONS.items() if all(part in where for part in parts)]
    twice = [k for k, (meant, _) in enumerate(found) if meant == "y"]
    if not kinds and {"r", "p"} <= set(where) and len(twice) == 2:  # X, Y, Z, R, P, Y
        kinds, where = ["rpy"], {**where, "roll": where["r"], "pitch": where["p"], "yaw": twice[1]}
    if not kinds:
        raise ColumnError("no columns of a rotation")
    return kinds[0], where, found


def pose_columns(names: Sequence[str], units: Sequence[str]) -> Columns:
    """Return the columns of a pose; raises `ColumnError` in words for what is missing."""
    kind, where, found = _places(names)
    parts = {**ROTATIONS, **QUATERNIONS, "axis-angle": AXIS_ANGLE}[kind]
    position = (where["x"], where["y"], where["z"])
    rotation = tuple(where[part] for part in parts)
    unit_of = [found[k][1] or (units[k] if k < len(units) and units[k] else None) for k in range(len(names))]
    angles = rotation[-1:] if kind == "axis-angle" else rotation
    length = _one_unit([unit_of[k] for k in position], dict.fromkeys(LENGTH_UNITS), "x, y, z")
    angle = None if kind in QUATERNIONS else _one_unit([unit_of[k] for k in angles], ANGLES, "the rotation")
    status_and_turn = "s" in {name.strip().lower() for name in names}  # KUKA's S and T
    time = where.get("timestamp", None if kind == "oat" or status_and_turn else where.get("t"))
    time_unit = "s" if time is None else unit_of[time] or "s"
    return Columns(kind, time, position, rotation, length, angle, time_unit if time_unit in SECONDS else "s")


def _one_unit(units: Sequence[str | None], known: dict[str, str] | dict[str, None], what: str) -> str | None:
    names = {None if unit is None or unit in ("-", "1") else (known.get(unit) or unit) for unit in units}
    if len(names) > 1:
        raise ColumnError(f"different units of {what}: {', '.join(sorted(name or 'none' for name in names))}")
    (unit,) = names
    if unit is not None and unit not in known and unit not in ANGLES.values():
        raise ColumnError(f"{what} in {unit}")
    return unit
