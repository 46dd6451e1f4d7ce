"""Names of columns: which of `COLUMNS` they mean, and the unit that they carry.

Beside our own names: short ones (`ALIASES`); ``position`` and ``orientation`` by their parts, as ROS and PlotJuggler
name the fields of a ``geometry_msgs/Pose``; ``p_RS_R_x`` and ``q_RS_w`` of the EuRoC MAV data sets. A unit may stand
behind a name, ``x_mm`` or ``x [mm]``; ``rostopic echo -p`` counts its ``%time`` in nanoseconds.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime

from ..core.files.table import name_and_unit
from ..core.formatting.units import LENGTH_UNITS
from .contents import COLUMNS

# Other names of the columns, in small letters, that mean one thing only.
ALIASES = {
    **dict.fromkeys(("t", "time", "stamp"), "timestamp"),
    **{f"{prefix}{axis}": axis for prefix in ("t", "t_", "p", "p_", "pos_") for axis in "xyz"},
    **{f"{prefix}{axis}": f"q{axis}" for prefix in ("q_", "quat_") for axis in "xyzw"},
}
# Longest name of a column.
LONGEST = 200
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNITS = {*LENGTH_UNITS, *SECONDS, "1"}

_CLOCK = re.compile(r"([01]?\d|2[0-3]):([0-5]\d):([0-5]?\d(?:[.,]\d+)?)")
_GERMAN = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})([ T].*)")
_COUNTING = re.compile(
    r"(?:nr|no|num|number|idx|index|punkt|point|pose|frame|image|img|picture|pic|bild|shot|sample|file|filename|name)"
    r"(?:[ _.]?(?:nr|no|num|number|idx|index|id|name|file|path))?\.?"
)
_PARTS = re.compile(r"(?:.*[./_])?(?:(position|translation)|orientation|rotation|quaternion)[./_]([xyzw])")
_EUROC = re.compile(r"(?:(p)|q)_(?:[a-z]+_)+([xyzw])")


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


def counts_poses(name: str) -> bool:
    """Return whether a column numbers the poses, or names their pictures: Nr, frame, image_name."""
    return bool(_COUNTING.fullmatch(name.strip().strip("\"'#").lower()))


def meaning(name: str) -> str:
    """The column of `COLUMNS` that a name means, or the name itself."""
    return meaning_and_unit(name)[0]


def meaning_and_unit(name: str) -> tuple[str, str | None]:
    """The column of `COLUMNS` that a name means, and the unit that it says; or the name itself.

    >>> meaning_and_unit("x [mm]"), meaning_and_unit("pose.orientation.w"), meaning_and_unit("time_ns")
    (('x', 'mm'), ('qw', None), ('timestamp', 'ns'))
    """
    if len(name) > LONGEST:
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
