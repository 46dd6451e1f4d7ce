"""Corners: where the points of a board were seen, picture by picture; and their files.

In CSV: ``row,x,y,z,u,v`` with a header line, one corner per line. ``row`` is the number of the robot pose that the
picture was taken at, ``x, y, z`` the point on the board (m, or as the header says: ``x_mm``), ``u, v`` the pixel. A
column ``name`` has the picture's file, ``used`` (of our own files) 1 or 0; others are not used.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.lines import MAX_BYTES, csv_text, plain_text, short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.table import Places, Schema, Table, in_order, name_and_unit, read_table, rows_are_numbers
from ...core.formatting.units import LENGTH_UNITS
from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import InputError, InputWarning
from ...formats.contents import require_units

FEWEST = 4  # corners of a picture, for its pose
# Beyond these is no picture, board or pixel.
LARGEST = {"row": 1e9, "points": 1e5, "pixels": 1e6}
# Pixels that a picture is smoothed by before its corners are refined, and at most so much of the window's half width.
SMOOTH, SMOOTH_SHARE = 1.8, 0.25


@dataclass(frozen=True, eq=False)
class Corners:
    """Detected corners, one per line.

    ``row`` (m,) is the number of the picture and of the robot pose that it was taken at; ``points`` (m, 3) are on the
    board, in its frame and the unit of length of the poses; ``pixels`` (m, 2) where they were seen, the centre of the
    first pixel at (0, 0). ``names`` are those of the pictures, in ascending order of their rows. Kept sorted by row.
    ``window`` (m,) is half the width, in pixels, of the square in which ``cornerSubPix`` found each corner; of corners
    where lines through the edges of a tag meet, minus the length of these; 0, or None for all, where it is not known.
    What bent edges do to a corner `bent_edges` takes out.

    Raises `InputError`: shapes that do not fit, numbers that are not finite, fewer than 4 corners in a picture.
    """

    row: NDArray[np.intp]  # (m,) number of the picture and of the robot pose that it was taken at
    points: Array  # (m, 3) on the board, in its frame
    pixels: Array  # (m, 2) where they were seen
    names: Sequence[str] = field(default=())  # of the pictures
    image_size: tuple[int, int] | None = None  # (width, height), where it is known from the pictures
    missing: Sequence[str] = ()  # pictures without a board; their rows are left out
    board: str = ""  # that was looked for, where it is known: `Board.text`
    window: NDArray[np.intp] | None = None  # (m,) half the width of the square in which `cornerSubPix` looked

    def __post_init__(self) -> None:
        row, points, pixels = (as_numbers(getattr(self, name), name) for name in ("row", "points", "pixels"))
        m = row.size
        if row.ndim != 1 or points.shape != (m, 3) or pixels.shape != (m, 2) or m == 0:
            raise InputError(
                "Expected `row` (m,), `points` (m, 3) and `pixels` (m, 2) with m > 0, got "
                f"{row.shape}, {points.shape} and {pixels.shape}."
            )
        for name, values in (("row", row), ("points", points), ("pixels", pixels)):
            if not (np.abs(values) <= LARGEST[name]).all():  # nor NaN
                raise InputError(f"Expected `{name}` to be finite and at most {LARGEST[name]:g}, got others.")
        if (row != np.floor(row)).any() or row.min() < 0:
            raise InputError("Expected `row` to be the numbers of pictures, 0 and up, got others.")
        order = np.argsort(row, kind="stable")
        numbers, counts = np.unique(row, return_counts=True)
        if counts.min() < FEWEST:
            few = int(np.argmin(counts))
            raise InputError(
                f"Expected at least {FEWEST} corners in every picture, got {counts[few]} in row {numbers[few]:.0f}: "
                "leave that picture out."
            )
        names = tuple(str(name) for name in self.names) or tuple(f"row {number:.0f}" for number in numbers)
        if len(names) != len(numbers):
            raise InputError(f"Expected {len(numbers)} `names`, one for each picture, got {len(names)}.")
        kept: dict[str, NDArray[Any]] = {"row": row.astype(np.intp), "points": points, "pixels": pixels}
        if self.window is not None:
            window = as_numbers(self.window, "window")
            if window.shape != (m,) or not np.isfinite(window).all() or (window != np.floor(window)).any():
                raise InputError(
                    f"Expected `window` ({m},) to be half widths in whole pixels, 0 where not known, got others."
                )
            kept["window"] = window.astype(np.intp)
        for name, value in kept.items():
            value = np.array(value[order])
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "missing", tuple(str(name) for name in self.missing))

    def require_once(self, where: str) -> None:
        """Raise `InputError` where a picture, or a point of one, is there twice: it counts once."""
        before: dict[bytes, int] = {}
        for k in range(self.n):
            part = self.picture == k
            points, pixels = self.points[part], self.pixels[part]
            if len(np.unique(points, axis=0)) < len(points):
                raise InputError(f"{where}: a point of the board stands twice in {self.names[k]}. Leave one out.")
            order = np.lexsort(points.T)
            first = before.setdefault(np.concatenate([points[order], pixels[order]], axis=1).tobytes(), k)
            if first != k:
                raise InputError(
                    f"{where}: {self.names[first]} and {self.names[k]} hold the same corners, and a picture counts "
                    "once. Leave one of them out, with its robot pose."
                )

    @property
    def m(self) -> int:
        """Number of corners."""
        return len(self.row)

    @property
    def n(self) -> int:
        """Number of pictures."""
        return len(self.rows)

    @cached_property
    def rows(self) -> NDArray[np.intp]:
        """(n,) row numbers of the pictures, ascending."""
        return np.unique(self.row)

    @cached_property
    def picture(self) -> NDArray[np.intp]:
        """(m,) which of the n pictures each corner is in."""
        return np.searchsorted(self.rows, self.row)

    @cached_property
    def place(self) -> NDArray[np.intp]:
        """(m,) which corner of its picture each is, from 0."""
        return np.arange(self.m) - np.searchsorted(self.row, self.row)

    @cached_property
    def on_board(self) -> tuple[Array, NDArray[np.intp]]:
        """The points (u, 3) of the board, each once, and which of them each corner is (m,)."""
        points, which = np.unique(self.points, axis=0, return_inverse=True)
        return points, which.ravel()

    def by_picture(self, values: Any, empty: float = 0.0) -> Array:
        """Values (m, ...) of corners as (n, most, ...), pictures with fewer corners filled up with ``empty``."""
        values = np.asarray(values, dtype=float)
        padded = np.full((self.n, int(self.place.max()) + 1, *values.shape[1:]), empty)
        padded[self.picture, self.place] = values
        return padded


def picked(corners: Corners, kept: NDArray[np.bool_], names: tuple[str, ...] | None = None) -> Corners:
    """Return those corners (m,) that are kept; ``names`` are those of the pictures that have any, None: all have."""
    return replace(
        corners,
        row=corners.row[kept],
        points=corners.points[kept],
        pixels=corners.pixels[kept],
        names=corners.names if names is None else names,
        window=None if corners.window is None else corners.window[kept],
    )


def without_pictures(corners: Corners, out: NDArray[np.bool_]) -> Corners:
    """All but some of the n pictures."""
    return picked(corners, ~out[corners.picture], tuple(np.array(corners.names)[~out].tolist()))


def smoothing(window: NDArray[Any]) -> Array:
    """Standard deviation, in pixels, of the Gaussian that a picture is smoothed with before ``cornerSubPix`` looks for
    corners in a ``window`` of this half width.

    The pixels of a sharp picture are too far apart for its edges, and where a corner seems to be depends on where it
    lies between pixels: by 0.033 pixels RMS in rendered pictures, 0.013 with a Gaussian of 1 and 0.010 with 1.8.
    """
    return np.minimum(SMOOTH, SMOOTH_SHARE * np.asarray(window, dtype=float))


COLUMNS = ("row", "x", "y", "z", "u", "v")
HEADER = ",".join(COLUMNS)

# Points farther apart (m) are on no board.
LONGEST = 10.0

_log = logging.getLogger("uq_handeye")


def read_corners(path: StrPath, units: str = "m") -> Corners:
    """Corners of a CSV file with the header ``row,x,y,z,u,v``, in any order, and perhaps ``name``.

    Parameters
    ----------
    path : path of the file
    units : str
        Length unit of ``x, y, z``: m, mm, ..., where the header does not say it (``x_mm``, ``x [mm]``); those returned
        are in metres.

    Raises
    ------
    InputError
        One line that names the file and the line: a file that cannot be read or is no such table; see `Corners`.
    """
    corners, _ = corners_and_used(path, units)
    return corners


def corners_and_used(path: StrPath, units: str = "m") -> tuple[Corners, NDArray[np.bool_]]:
    """Read corners, and which of them, sorted by row, the column ``used`` marks as used; all where there is no such
    column.
    """
    factor = require_units(units)
    location = as_path(path)
    name = shown(location)
    with opened(location, MAX_BYTES) as file:
        table = read_table(file, name, SCHEMA)
    meant, said = zip(*(_name_and_unit(table.column(k)) for k in range(table.values.shape[1])), strict=True)
    if left := [one for one in table.names if _name_and_unit(one)[0] not in (*meant, "name")]:
        _log.info("%s: not used: the columns %s", name, short(", ".join(left)))
    if len(set(said[1:4])) > 1:
        raise InputError(f"{name}: expected one unit for x, y and z, got {short(', '.join(table.names))}.")
    if said[1] is not None:
        if units not in ("m", said[1]):
            raise InputError(f"{name} names its points in {said[1]}, and `units` says {units}. Leave `units` out.")
        factor = require_units(said[1])
    table.require_finite("; leave out corners that were not seen")
    value = dict(zip(meant, table.values.T, strict=True))
    points = np.stack([value[axis] for axis in "xyz"], axis=-1) * factor
    pixels = np.stack([value[axis] for axis in "uv"], axis=-1)
    used = np.ones(len(table.values), dtype=bool)
    if "used" in value:
        if not np.isin(value["used"], (0, 1)).all():
            raise InputError(f"{name}, column used: expected 1 or 0, got others.")
        used = value["used"] == 1
    try:
        corners = Corners(value["row"], points, pixels, _pictures(table, value["row"]))
    except InputError as error:
        raise InputError(f"{name}: {str(error)[0].lower()}{str(error)[1:]}") from error
    if (span := float(np.linalg.norm(np.ptp(points, axis=0)))) > LONGEST:
        warnings.warn(
            f"{name}: their points span {span:.3g} m, more than a board does: they look like millimetres. Read them "
            'with units="mm" (--units mm).',
            InputWarning,
            stacklevel=3,
        )
    corners.require_once(name)
    return corners, used[np.argsort(value["row"], kind="stable")]


def _name_and_unit(name: str) -> tuple[str, str | None]:
    """A name in small letters, of coordinates of the board without their unit, and that: ``x_mm``, ``x [mm]``."""
    bare, unit = name_and_unit(name.lower(), LENGTH_UNITS)
    return (bare, unit) if bare in ("x", "y", "z") else (name.lower(), None)


def _places(names: list[str], line: str, where: str) -> Places:
    small = [_name_and_unit(name)[0] for name in names]
    missing = [column for column in COLUMNS if column not in small]
    _, twice = in_order(small, (*COLUMNS, "name", "used"))
    if missing or twice:
        what = f"missing: {', '.join(missing)}" if missing else f"twice: {', '.join(sorted(twice))}"
        hint = "; the header line is missing" if rows_are_numbers(names) else ""
        raise InputError(f"{where}: expected the header {HEADER}, got {short(line)} ({what}){hint}.")
    wanted = [*COLUMNS, *(["used"] if "used" in small else [])]
    return Places([small.index(column) for column in wanted], [small.index("name")] if "name" in small else [])


SCHEMA = Schema(f"the header {HEADER}", "corner", _places, quotes=True)


def _pictures(table: Table, row: Array) -> tuple[str, ...]:
    """Return the names of the pictures, in ascending order of the rows; a row has one name."""
    named: dict[float, tuple[str, int]] = {}
    for k, (number, (text,)) in enumerate(zip(row.tolist(), table.texts, strict=bool(table.texts))):
        name = plain_text(text)
        before, first = named.setdefault(number, (name, k))
        if before != name:
            raise InputError(
                f"{table.at(k)}: row {number:g} is of {short(name)}, in {table.at(first)} of {short(before)}."
            )
    return tuple(named[number][0] or f"row {number:g}" for number in np.unique(row).tolist()) if named else ()


def corners_text(corners: Corners, used: NDArray[np.bool_]) -> str:
    """Format corners as `corners_and_used` reads them, bit by bit."""
    table = np.column_stack([corners.points, corners.pixels]).tolist()
    rows = zip(corners.row.tolist(), table, used.tolist(), corners.picture.tolist(), strict=True)
    lines = ([row, *numbers, int(use), corners.names[picture]] for row, numbers, use, picture in rows)
    return csv_text([[*COLUMNS, "used", "name"], *lines])
