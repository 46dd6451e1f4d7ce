"""Names of the columns of poses: the meaning of each name, and the unit that it carries.

A new name is added here only. Columns of pose files (`meaning_and_unit`) have unambiguous names: our own, short ones
(`ALIASES`); ``position`` and ``orientation`` by their parts, as ROS and PlotJuggler name the fields of a
``geometry_msgs/Pose``; ``p_RS_R_x`` and ``q_RS_w`` of the EuRoC MAV data sets. A unit may follow a name, ``x_mm``
or ``x [mm]``; ``rostopic echo -p`` counts its ``%time`` in nanoseconds.

Columns of tables as controllers and people write them (`name_in_table`) have rotations of any kind, words before the
names, and capitals within them. `pose_columns` finds the position, the rotation and the time among them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..core.files.table import name_and_unit
from ..core.geometry.se3 import Array
from ..core.limits import MAX_NAME_CHARACTERS
from ..core.presentation.units import LENGTH_UNITS
from .contents import COLUMNS

# Other names of the columns, in small letters, that mean one thing only.
ALIASES = {
    **dict.fromkeys(("t", "time", "stamp"), "timestamp"),
    **{f"{prefix}{axis}": axis for prefix in ("t", "t_", "p", "p_", "pos_") for axis in "xyz"},
    **{f"{prefix}{axis}": f"q{axis}" for prefix in ("q_", "quat_") for axis in "xyzw"},
}
# Length in seconds of each unit of time in the name of a column.
SECONDS = {"s": 1.0, "sec": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Units of angles, as columns name them.
ANGLES = {"deg": "deg", "degree": "deg", "degrees": "deg", "°": "deg", "rad": "rad", "radian": "rad", "radians": "rad"}
_UNITS = {*LENGTH_UNITS, *SECONDS, "1"}
_UNITS_IN_TABLES = {*_UNITS, *ANGLES, "-", ""}

_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]?\d(?:[.,]\d+)?)")
_GERMAN = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})([ T].*)")
_COUNTING = re.compile(
    r"(?:nr|no|num|number|idx|index|punkt|point|pose|frame|image|img|picture|pic|bild|shot|sample|file|filename|name)"
    r"(?:[ _.]?(?:nr|no|num|number|idx|index|id|name|file|path))?\.?"
)
_PARTS = re.compile(r"(?:.*[./_])?(?:(position|translation)|orientation|rotation|quaternion)[./_]([xyzw])")
_EUROC = re.compile(r"(?:(p)|q)_(?:[a-z]+_)+([xyzw])")
# Numbers of a covariance; of two components; and what ROS's tools put before them.
_COVARIANCE = re.compile(r"(?:.*[./_])?cov(?:ariance)?[._\[]?(\d{1,2})\]?")
_COVARIANCE_OF = re.compile(r"(?:.*[./])?cov(?:ariance)?_([a-z]+)_([a-z]+)")
_COMPONENT = {name: k for k, names in enumerate(("x", "y", "z", "roll rx", "pitch ry", "yaw rz"))
              for name in names.split()}  # fmt: skip
_OF_ROS = ("pose.", "pose/", "field.", "/", "msg.")
# What programs put before the names, in small letters.
_PREFIX = re.compile(
    r"(?:(?:actual|current|act|cart|cartesian|robot|tcp|tool|pose|position|pos|target|flange|ee|eef|tf|world|base|cam|"
    r"camera|board|marker|gripper|end_effector|r|msg|meas|measured|gt|truth|groundtruth|ground_truth)[\s._/]+)+(?=.)"
)

_MEASURED = re.compile(r"(?<![a-z])(?:actual|act|current|measured|meas)(?![a-z])", re.IGNORECASE)
_COMMANDED = re.compile(
    r"(?<![a-z])(?:target|command|commanded|cmd|desired|des|setpoint|goal|ref)(?![a-z])", re.IGNORECASE
)
# Ground truth of a simulated data set, which stands beside what was measured.
_TRUTH = re.compile(r"(?<![a-z])(?:gt|truth|groundtruth)(?![a-z])", re.IGNORECASE)

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

# Names of the columns of poses as programs write them, in small letters: what each means.
_NAMES = {
    **{name: name for name in ("timestamp", "x", "y", "z", *AXIS_ANGLE)},
    **{name: name for names in (*ROTATIONS.values(), *QUATERNIONS.values()) for name in names},
    **{f"{part}{letter}": f"rotvec_{axis}"
       for part in ("rvec_", "rvec", "rotvec", "rot_vec_", "rv_", "rv", "axis_angle_", "axisangle_", "aa_")
       for letter, axis in zip("xyz012", "xyzxyz", strict=True)},
    **{f"{part}{axis}": f"r{axis}" for part in ("r_", "rot_", "rot", "rotation_", "ori_", "orientation_")
       for axis in "xyz"},
    **{f"{part}{axis}": f"r{axis}" for part in ("euler_", "euler", "e", "angle_", "ang_", "theta_") for axis in "xyz"},
    **{f"{part}{number}": axis for part in ("tvec_", "tvec") for number, axis in zip("012", "xyz", strict=True)},
    **{f"tvec_{axis}": axis for axis in "xyz"},
    **{f"tcp_pose_{k}": axis for k, axis in enumerate(("x", "y", "z"))},
    **{f"tcp_pose_{k + 3}": f"rotvec_{axis}" for k, axis in enumerate("xyz")},
    **{f"{part}{axis}": f"q{axis}" for part in ("quat", "quaternion_", "o", "q.") for axis in "xyzw"},
    **{f"axis_{axis}": f"a{axis}" for axis in "xyz"},
    **{f"trans_{axis}": axis for axis in "xyz"}, **{f"translation_{axis}": axis for axis in "xyz"},
    **{f"{axis}_{part}": axis for axis in "xyz" for part in ("pos", "position", "coordinate")},
    **{f"{axis}1": axis for axis in "xyz"},  # of figaroh, with the number of the marker
    **{f"phi{axis}{number}": angle for number in ("", "1")
       for axis, angle in zip("xyz", ("roll", "pitch", "yaw"), strict=True)},
    "theta": "angle", "rw": "qw", "ori_w": "qw", "rot_w": "qw", "rotation_w": "qw", "phi": "alpha",
}  # fmt: skip


def seconds_of(text: str) -> float | None:
    """Return a date with its time (UTC unless it names a zone), or a time of day, in seconds; None for another text.

    >>> seconds_of("2024-03-01T10:00:11.5Z"), seconds_of("01.03.2024 10:00:11"), seconds_of("10:00:11.25")
    (1709287211.5, 1709287211.0, 36011.25)
    """
    text = text.strip().strip("\"'[]")
    if (time := _CLOCK.fullmatch(text)) is not None:
        return 3600.0 * int(time[1]) + 60.0 * int(time[2]) + float(time[3].replace(",", "."))
    if not 12 <= len(text) <= 40:
        return None
    if (german := _GERMAN.fullmatch(text)) is not None:
        text = f"{german[3]}-{german[2]:>02}-{german[1]:>02}{german[4]}"
    try:
        found = datetime.fromisoformat(text.replace("/", "-").replace(",", "."))
    except ValueError:
        return None
    return (found if found.tzinfo is not None else found.replace(tzinfo=UTC)).timestamp()


def in_seconds(times: Array, unit: str) -> tuple[Array, str]:
    """Return times of a column in seconds, and what is to be said of their unit: as it is named, or by their size."""
    if SECONDS[unit] != 1.0:
        return times * SECONDS[unit], f"timestamps in {unit}, as the column is named"
    largest = float(np.nanmax(np.abs(times))) if len(times) else 0.0
    for limit, finer in ((1e17, "ns"), (1e14, "us"), (1e11, "ms")):  # seconds since 1970 are 1.7e9
        if largest > limit:
            return times * SECONDS[finer], f"timestamps in {finer}, as their size shows"
    return times, ""


def covariance_columns(names: Sequence[str]) -> tuple[list[int], str] | None:
    """Return the columns of the 36 numbers of a covariance, row by row, and the convention that their names say.

    All 36, or the 21 of the upper triangle: numbered (``pose.covariance[0]``, ``cov_35``), by row and column
    (``cov_00``, ``cov_16``), or by the names of two components (``cov_x_yaw``, of ROS). None where there are others.
    """
    upper = [(i, j) for i in range(6) for j in range(i, 6)]
    square = [(i, j) for i in range(6) for j in range(6)]
    found: dict[tuple[int, int], int] = {}
    numbered = [(k, one) for k, name in enumerate(names) if (one := _COVARIANCE.fullmatch(name.lower()))]
    named = [(k, one) for k, name in enumerate(names) if (one := _COVARIANCE_OF.fullmatch(name.lower()))]
    convention = "ros"
    if named and all(part in _COMPONENT for _, one in named for part in one.groups()):
        found = {(_COMPONENT[one[1]], _COMPONENT[one[2]]): k for k, one in named}
    elif len(numbered) in (21, 36):
        texts = [one[1] for _, one in numbered]
        places = square if len(texts) == 36 else upper
        for first in (0, 1):
            if sorted(map(int, texts)) == list(range(first, first + len(texts))):
                found = {places[int(text) - first]: k for text, (k, _) in zip(texts, numbered, strict=True)}
            elif set(texts) == {f"{i + first}{j + first}" for i, j in places}:
                found = {(int(text[0]) - first, int(text[1]) - first): k
                         for text, (k, _) in zip(texts, numbered, strict=True)}  # fmt: skip
        if not all(one[0].startswith(_OF_ROS) for _, one in numbered):
            convention = "toolkit"
    columns = [found.get((i, j), found.get((j, i), -1)) for i, j in square]
    return None if -1 in columns else (columns, convention)


def counts_poses(name: str) -> bool:
    """Return whether a column numbers the poses, or names their pictures: Nr, frame, image_name."""
    return bool(_COUNTING.fullmatch(name.strip().strip("\"'#").lower()))


def meaning_and_unit(name: str) -> tuple[str, str | None]:
    """The column of `COLUMNS` that a name means, and the unit that it says; or the name itself.

    >>> meaning_and_unit("x [mm]"), meaning_and_unit("pose.orientation.w"), meaning_and_unit("time_ns")
    (('x', 'mm'), ('qw', None), ('timestamp', 'ns'))
    """
    if len(name) > MAX_NAME_CHARACTERS:
        return name, None
    small = name.lower()
    if small == "%time":
        return "timestamp", "ns"
    if (column := _plain(small)) is not None:
        return column, None
    bare, unit = name_and_unit(small, _UNITS)
    if unit is None or (column := _plain(bare)) is None:
        return name, None
    if column.startswith("q"):
        return (column, None) if unit in ("", "-", "1") else (name, None)
    known = SECONDS if column == "timestamp" else LENGTH_UNITS
    return (column, unit) if unit in known else (name, None)


def _plain(small: str) -> str | None:
    """The column that a name in small letters, without a unit, means."""
    small = small.lstrip("_")
    if small in COLUMNS:
        return small
    if small in ALIASES:
        return ALIASES[small]
    found = _PARTS.fullmatch(small) or _EUROC.fullmatch(small)
    column = None if found is None else f"{'' if found[1] else 'q'}{found[2]}"
    return column if column in COLUMNS else None


@lru_cache(maxsize=4096)
def name_in_table(name: str) -> tuple[str, str | None]:
    """Return the meaning of a name in small letters, and the unit that it says.

    >>> name_in_table("X [mm]"), name_in_table("roll_deg"), name_in_table("actual_TCP_pose_3")
    (('x', 'mm'), ('roll', 'deg'), ('rotvec_x', None))
    """
    if len(name) > MAX_NAME_CHARACTERS:
        return name, None
    name = name.strip().strip("\"'")
    for small in (name.lower(), re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()):  # toolPoseX
        bare, unit = name_and_unit(small, _UNITS_IN_TABLES, r"\s_/")
        if unit in _UNITS_IN_TABLES and (known := _known(bare)) is not None:
            return known, unit or None
        if (known := _known(small)) is not None:
            return known, None
    return name.lower(), None


def _known(small: str) -> str | None:
    small = small.strip()
    for one in (small, _PREFIX.sub("", small)):
        one = one.replace(" ", "_")
        column = _NAMES.get(one) or meaning_and_unit(one)[0]
        if column in _NAMES:
            return column
    match = re.fullmatch(r".*(tcp_pose_[0-5])", small)
    return None if match is None else _NAMES[match[1]]


class Columns(NamedTuple):
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


def _rank(name: str) -> int:
    """Return which of several columns of one meaning comes first: what was measured, not commanded or ground truth."""
    return 1 - bool(_MEASURED.search(name)) + bool(_COMMANDED.search(name)) + 2 * is_truth(name)


def is_truth(name: str) -> bool:
    """Return whether a name says that its numbers are the ground truth."""
    return bool(_TRUTH.search(name))


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
    found = [name_in_table(name) for name in names]
    where: dict[str, int] = {}
    for k in sorted(range(len(names)), key=lambda k: _rank(names[k])):
        where.setdefault(found[k][0], k)
    if missing := [axis for axis in "xyz" if axis not in where]:
        raise ColumnError(f"no column {', '.join(missing)}")
    if "qx" not in where and {"rx", "ry", "rz", "qw"} <= set(where):  # ori_x, ori_y, ori_z, ori_w
        where |= {f"q{axis}": where[f"r{axis}"] for axis in "xyz"}
    if "qw" not in where and {"q0", "qx", "qy", "qz"} <= set(where):
        where["qw"] = where["q0"]
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
