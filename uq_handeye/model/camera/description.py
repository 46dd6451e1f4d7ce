"""Description of boards of squares or tags: their dimensions, frames, and the places of their corners.

Frame of a board: x along a row of corners to the right, y along a column downwards, z away from the camera.

============  =========================================================================================================
chessboard    origin at an inner corner
charuco       origin at the outer corner of the first square, as OpenCV has it
aruco         a grid of markers (OpenCV's GridBoard): origin at the outer corner of the first marker, upper left, as
              OpenCV has it; ids row by row from there
aprilgrid     Kalibr's grid of AprilTags: origin at the outer corner of the upper left tag. Ids run row by row from the
              lower left one, upwards. Kalibr's own frame has its origin at the outer corner of the lower left tag, y up
              and z towards the camera: x' = x, y' = height - y, z' = -z
circles       a symmetric grid of discs: origin in the middle of the first one
circles-      an asymmetric grid, whose odd rows are moved by half of the distance of discs in a row, as OpenCV has it:
asymmetric    ``square`` is the distance of rows, and half of that in a row; origin in the middle of the first disc
one tag       ``apriltag``, or ``aruco`` of 1 x 1: origin in the middle, as in AprilTag; OpenCV's frame (of
              `tag_points`, and of its ArUco samples) is rotated by 180 deg about x from it
============  =========================================================================================================

Corners are numbered row by row. A tag has four, the outer corners of its black border: upper left, upper right, lower
left, lower right of the upright tag.

A chessboard looks the same after half a turn. Where one of its numbers of inner corners is even and the other odd, the
colours decide: the corners are ordered such that the square between the first four of them is dark, at whatever angle
the camera rolls. Where both are even or both odd, half a turn (of a square board also a quarter) cannot be seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.files.one_line import short
from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_length
from ...errors import InputError, require_integer
from .dictionaries import dictionary_name

SQUARES, TAGS = ("chessboard", "charuco"), ("aprilgrid", "aruco", "apriltag")
CIRCLES = ("circles", "circles-asymmetric")
KINDS = (*SQUARES, *CIRCLES, *TAGS)
# Dictionary of the markers where none is named.
DICTIONARIES = {"charuco": "4X4_50", "aruco": "4X4_50", "aprilgrid": "APRILTAG_36H11", "apriltag": "APRILTAG_36H11"}
# Corners or tags along a side of a board.
MAX_COLUMNS = 200
# Gap between tags, in sides of a tag.
MAX_GAP_SIDES = 3.0


@dataclass(frozen=True)
class Board:
    """A flat board of squares or of tags, or a single tag; see `camera.description` for the frames.

    Parameters
    ----------
    columns, rows : int
        Chessboard: inner corners along x and y. ChArUco: squares. Grids: tags, or discs; of an asymmetric one, discs
        in a row and rows. A single tag: 1 and 1.
    square : float or str
        Side of a square, or of a tag with its black border, in metres, or text with a unit such as "20mm". Measure it
        on the print.
    kind : "chessboard", "charuco", "circles", "circles-asymmetric", "aprilgrid", "aruco" or "apriltag"
        ``aprilgrid``: Kalibr's grid of AprilTags. ``aruco``: OpenCV's GridBoard, or with 1 and 1 a single marker.
        ``apriltag``: a single tag.
    marker : float, str or None
        Side of the markers of a ChArUco board.
    dictionary : str or None
        Of the markers: a name of OpenCV's predefined dictionaries such as "4X4_50", or a family such as "tag36h11".
        None: 4X4_50, and of AprilTags 36h11.
    spacing : float, str or None
        Gap between the tags of a grid: of ``aprilgrid`` a share of the side (Kalibr's ``tagSpacing``), of ``aruco`` a
        length in metres; text with a unit is a length for both.
    first_id : int or None
        Id of the first tag of a grid, or of the single tag. None: 0 in a grid; a single tag may have any id.
    diameter : float, str or None
        Of the discs of a grid of circles: the centroid of the image of a disc is not the image of its centre.

    Raises `InputError` for numbers or names that make no sense.
    """

    columns: int
    rows: int
    square: float | str
    kind: str = "chessboard"
    marker: float | str | None = None
    dictionary: str | None = None
    spacing: float | str | None = None
    first_id: int | None = None
    diameter: float | str | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"Expected `kind` to be {', '.join(KINDS[:-1])} or {KINDS[-1]}, got {self.kind!r}.")
        tags = self.kind in TAGS
        for name in ("columns", "rows"):
            require_integer(name, getattr(self, name), 1 if tags else 3)
            if getattr(self, name) > MAX_COLUMNS:
                raise InputError(
                    f"Expected `{name}` of the board to be at most {MAX_COLUMNS}, got {getattr(self, name)}."
                )
        object.__setattr__(self, "square", _positive(self.square, "square"))
        if self.dictionary is None:
            object.__setattr__(self, "dictionary", DICTIONARIES.get(self.kind, "4X4_50"))
        if tags:
            self._check_tags()
            return
        if (self.diameter is None) == (self.kind in CIRCLES):
            raise InputError(
                f"Expected `diameter`, that of the discs of a {self.kind} grid, got none."
                if self.kind in CIRCLES
                else f"A {self.kind} board has no `diameter`: it is of grids of circles."
            )
        if self.spacing is not None or self.first_id is not None:
            raise InputError(f"A {self.kind} board has no `spacing` and no `first_id`: these are of grids of tags.")
        if self.kind != "charuco":
            if self.marker is not None:
                raise InputError(f"A {self.kind} board has no markers: leave `marker` out, or say kind='charuco'.")
            if self.kind in CIRCLES:
                self._check_discs()
            return
        if self.marker is None:
            raise InputError("Expected `marker`, the side of the markers of the ChArUco board, got none.")
        marker = _positive(self.marker, "marker")
        if marker >= self.side:
            raise InputError(
                f"Expected `marker` to be smaller than `square`, {self.side:g} m, got {marker:g} m: the markers lie "
                "within the white squares."
            )
        object.__setattr__(self, "marker", marker)

    def _check_discs(self) -> None:
        assert self.diameter is not None
        diameter = _positive(self.diameter, "diameter")
        apart = self.side * (2.0**0.5 if self.kind == "circles-asymmetric" else 1.0)
        if diameter >= apart:
            raise InputError(
                f"Expected `diameter` to be smaller than the distance of neighbouring discs, {apart:g} m, got "
                f"{diameter:g} m. Of an asymmetric grid `square` is the distance of its rows."
            )
        object.__setattr__(self, "diameter", diameter)

    def _check_tags(self) -> None:
        """Set dictionary and spacing of tags; raises `InputError` for what does not go with them."""
        if self.marker is not None or self.diameter is not None:
            what = "marker" if self.diameter is None else "diameter"
            raise InputError(f"Of {self.kind} the side of a tag is `square`: leave `{what}` out.")
        object.__setattr__(self, "dictionary", dictionary_name(self.dictionary))
        if self.kind in ("aprilgrid", "apriltag") and not str(self.dictionary).startswith("APRILTAG"):
            raise InputError(f"Expected `dictionary` of {self.kind} to be of AprilTags, got {self.dictionary}.")
        if self.first_id is not None:
            require_integer("first_id", self.first_id, 0)
        if self.single:
            if self.spacing is not None:
                raise InputError("A single tag has no `spacing`: leave it out.")
            return
        if self.kind == "apriltag":
            raise InputError(
                f"Expected `columns` and `rows` of a single apriltag to be 1, got {self.columns} and {self.rows}: a "
                "grid of them is 'aprilgrid', or 'aruco' with the dictionary APRILTAG_36h11."
            )
        if self.spacing is None:
            raise InputError(f"Expected `spacing`, the gap between the tags of the {self.kind} board, got none.")
        share = self.kind == "aprilgrid" and not isinstance(self.spacing, str)
        gap = self.side * _positive(self.spacing, "spacing") if share else _positive(self.spacing, "spacing")
        if gap > MAX_GAP_SIDES * self.side:
            raise InputError(
                f"Expected the `spacing` of tags of {self.side:g} m to be smaller than {MAX_GAP_SIDES:g} sides, got a "
                f"gap of {gap:g} m. Of aprilgrid a number is the gap as a share of the side, of aruco it is in metres."
            )
        object.__setattr__(self, "spacing", gap / self.side if self.kind == "aprilgrid" else gap)

    @property
    def text(self) -> str:
        """One line that `board_of` reads: ``kind=chessboard columns=9 rows=6 square=0.02``."""
        of_markers = "" if self.kind in (*TAGS, "charuco") else "dictionary"  # which others have not
        return " ".join(f"{k}={value}" for k, value in vars(self).items() if value is not None and k != of_markers)

    @property
    def side(self) -> float:
        """Length of the side of a square or a tag, in metres."""
        return float(self.square)

    @property
    def disc(self) -> float:
        """Diameter of the discs, in metres; 0 of other boards."""
        return 0.0 if self.diameter is None else float(self.diameter)

    @property
    def single(self) -> bool:
        """True for one tag."""
        return self.kind in TAGS and self.columns == self.rows == 1

    @property
    def gap(self) -> float:
        """Length of the gap between the tags of a grid, in metres; 0 of other boards."""
        if self.spacing is None:
            return 0.0
        return float(self.spacing) * (self.side if self.kind == "aprilgrid" else 1.0)

    @property
    def symmetry_order(self) -> int:
        """Number of angles, 360 degrees over this apart, at which the board looks the same: 1, 2 or 4."""
        if self.kind == "circles":
            return 4 if self.columns == self.rows else 2
        if self.kind == "circles-asymmetric":
            return 1 if self.rows % 2 else 2
        if self.kind != "chessboard" or (self.columns + self.rows) % 2:
            return 1
        return 4 if self.columns == self.rows and self.columns % 2 == 0 else 2

    @property
    def points(self) -> Array:
        """(m, 3) the corners in the frame of the board, row by row, in metres."""
        if self.kind in TAGS:
            middle = 0.5 * self.side if self.single else 0.0
            x, y = (_ends(count, self.side, self.gap) - middle for count in (self.columns, self.rows))
        elif self.kind == "circles-asymmetric":
            row, column = np.mgrid[: self.rows, : self.columns]
            of_rows = self.side * np.stack([2.0 * column + row % 2, 1.0 * row, 0.0 * row], axis=-1)
            return np.asarray(of_rows.reshape(-1, 3))
        else:
            first = 1 if self.kind == "charuco" else 0
            x, y = (np.asarray(self.side * np.arange(first, count)) for count in (self.columns, self.rows))
        return np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)

    def __str__(self) -> str:
        if self.single:
            which = "" if self.first_id is None else f" {self.first_id}"
            return f"tag{which} of {self.dictionary}"
        what = {"chessboard": "inner corners", "charuco": "squares"}.get(self.kind, "tags")
        if self.kind in CIRCLES:
            return f"{self.kind.partition('-')[2] or 'symmetric'} grid of {self.columns} x {self.rows} circles"
        return f"{self.kind} of {self.columns} x {self.rows} {what}"


def _ends(count: int, side: float, gap: float) -> Array:
    """Both ends (2 count,) of ``count`` sides, one after the other with a gap between."""
    return np.asarray((np.arange(count)[:, None] * (side + gap) + [0.0, side]).ravel())


def board_of(text: str) -> Board:
    """Return the board of `Board.text`; raises `InputError` for other text."""
    try:
        values = dict(part.split("=", 1) for part in text.split())
        lengths = ("marker", "spacing", "diameter")
        marker, spacing, diameter = (float(values[name]) if name in values else None for name in lengths)
        first_id = int(values["first_id"]) if "first_id" in values else None
        numbers = int(values["columns"]), int(values["rows"]), float(values["square"])
        return Board(*numbers, values["kind"], marker, values.get("dictionary"), spacing, first_id, diameter)
    except (KeyError, ValueError) as error:
        raise InputError(
            f"Expected a board such as kind=chessboard columns=9 rows=6 square=0.02, got {short(text)}."
        ) from error


def tag_points(side: float | str) -> Array:
    """(4, 3) the corners of a single tag of this side (m, or text such as "40mm"), whose frame is in its middle."""
    half = 0.5 * _positive(side, "side")
    return half * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])


def spacing_of(points: Array) -> float | None:
    """The distance from each point (m, 3) to its nearest, such as the side of a square; None where it is not one."""
    points = np.unique(points, axis=0)
    if len(points) < 4:
        return None
    from scipy.spatial import KDTree  # slow to import

    nearest = np.asarray(KDTree(points).query(points, k=2)[0])[:, 1]
    return float(np.min(nearest)) if np.ptp(nearest) < 1e-3 * np.min(nearest) else None


def _positive(value: float | str, name: str) -> float:
    length = parse_length(value, f"`{name}`")
    if not length > 0:
        raise InputError(f"Expected `{name}` to be a length above 0, got {value!r}.")
    return length
