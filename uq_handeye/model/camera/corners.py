"""`Corners`, the pixels at which the points of a board were seen, picture by picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...core.limits import MAX_ROWS
from ...errors import InputError

# The pose of a picture needs four corners.
MIN_CORNERS = 4
# No picture is as large: beyond is a reading error.
MAX_PIXELS = 1e6


@dataclass(frozen=True, eq=False)
class Corners:
    """Detected corners, one per line.

    ``row`` (m,) is the number of the picture and of the robot pose that it was taken at; ``points`` (m, 3) are on the
    board, in its frame and the unit of length of the poses; ``pixels`` (m, 2) where they were seen, the centre of the
    first pixel at (0, 0). ``names`` are those of the pictures, in ascending order of their rows. Kept sorted by row.
    ``window`` (m,) is half the width, in pixels, of the square in which ``cornerSubPix`` found each corner; of corners
    where lines through the edges of a tag meet, minus the length of these; 0, or None for all, where it is not known.
    What bent edges do to a corner `bent_edges` takes out. ``diameter`` (m,), in the unit of the points: these are the
    centres of discs, seen at the centroids of their images (`disc_centres`); None: points.

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
    diameter: Array | None = None  # (m,) of discs about the points

    def __post_init__(self) -> None:
        row, points, pixels = (as_numbers(getattr(self, name), name) for name in ("row", "points", "pixels"))
        m = row.size
        if row.ndim != 1 or points.shape != (m, 3) or pixels.shape != (m, 2) or m == 0:
            raise InputError(
                "Expected `row` (m,), `points` (m, 3) and `pixels` (m, 2) with m > 0, got "
                f"{row.shape}, {points.shape} and {pixels.shape}."
            )
        for name, values, most in (
            ("row", row, MAX_ROWS),
            ("points", points, MAX_PIXELS),
            ("pixels", pixels, MAX_PIXELS),
        ):
            if not (np.abs(values) <= most).all():  # nor NaN
                raise InputError(f"Expected `{name}` to be finite and at most {most:g}, got others.")
        if (row != np.floor(row)).any() or row.min() < 0:
            raise InputError("Expected `row` to be the numbers of pictures, 0 and up, got others.")
        order = np.argsort(row, kind="stable")
        numbers, counts = np.unique(row, return_counts=True)
        if counts.min() < MIN_CORNERS:
            few = int(np.argmin(counts))
            raise InputError(
                f"Expected at least {MIN_CORNERS} corners in every picture, got {counts[few]} in row "
                f"{numbers[few]:.0f}: leave that picture out."
            )
        names = tuple(str(name) for name in self.names) or tuple(f"row {number:.0f}" for number in numbers)
        if len(names) != len(numbers):
            raise InputError(f"Expected {len(numbers)} `names`, one for each picture, got {len(names)}.")
        kept: dict[str, Array | NDArray[np.intp]] = {"row": row.astype(np.intp), "points": points, "pixels": pixels}
        if self.window is not None:
            window = as_numbers(self.window, "window")
            if window.shape != (m,) or not np.isfinite(window).all() or (window != np.floor(window)).any():
                raise InputError(
                    f"Expected `window` ({m},) to be half widths in whole pixels, 0 where not known, got others."
                )
            kept["window"] = window.astype(np.intp)
        if self.diameter is not None:
            diameter = as_numbers(self.diameter, "diameter")
            if diameter.shape != (m,) or not ((diameter >= 0) & (diameter <= MAX_PIXELS)).all():
                raise InputError(f"Expected `diameter` ({m},) of discs to be finite and >= 0, got others.")
            kept["diameter"] = diameter
        for name, value in kept.items():
            ordered = value[order]
            ordered.flags.writeable = False
            object.__setattr__(self, name, ordered)
        object.__setattr__(self, "names", names)
        object.__setattr__(self, "missing", tuple(str(name) for name in self.missing))

    def require_once(self, where: str) -> None:
        """Raise `InputError` where a picture, or a point of one, is there twice: it counts once."""
        before: dict[bytes, int] = {}
        for k in range(self.n):
            part = self.picture == k
            points, pixels = self.points[part], self.pixels[part]
            if len(np.unique(points, axis=0)) < len(points):
                raise InputError(f"{where}: a point of the board is twice in {self.names[k]}. Leave one out.")
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

    def by_picture(self, values: ArrayLike) -> Array:
        """Values (m, ...) of corners as (n, most, ...), 0 where a picture has fewer corners."""
        values = np.asarray(values, dtype=float)
        padded = np.zeros((self.n, int(self.place.max()) + 1, *values.shape[1:]))
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
        diameter=None if corners.diameter is None else corners.diameter[kept],
    )


def without_pictures(corners: Corners, out: NDArray[np.bool_]) -> Corners:
    """All but some of the n pictures."""
    return picked(corners, ~out[corners.picture], tuple(np.array(corners.names)[~out].tolist()))


def smoothing(window: ArrayLike) -> Array:
    """Standard deviation, in pixels, of the Gaussian that a picture is smoothed with before ``cornerSubPix`` looks for
    corners in a ``window`` of this half width.

    The pixels of a sharp picture are too far apart for its edges, and where a corner seems to be depends on where it
    lies between pixels: by 0.033 pixels RMS in rendered pictures, 0.013 with a Gaussian of 1 and 0.010 with 1.8.
    """
    return np.minimum(1.8, 0.25 * np.asarray(window, dtype=float))
