"""Options of the board that is seen in pictures or views."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.files.lines import floats
from ..errors import InputError
from .options import Options
from .values import metres, one_of

if TYPE_CHECKING:
    from ..model.camera.board_shape import BoardShape
    from ..model.camera.description import Board


# Names of camera.description.KINDS.
TAGS = ("aprilgrid", "aruco", "apriltag")
CIRCLES = ("circles", "circles-asymmetric")
KINDS = ("chessboard", "charuco", *CIRCLES, *TAGS)


@dataclass(frozen=True)
class BoardOptions(Options):
    """Options of the board.

    Options (Pictures of a board):
      * --board COLSxROWS: Inner corners of a chessboard, e.g. 9x6. Of a ChArUco board the squares, of a grid the tags
        or circles (asymmetric: 4x11 has 4 in a row).
        Or the board.csv of an earlier camera -o, the board as measured; or target.yaml of Kalibr; with --camera-matrix
        also a table of points x,y,z.
      * --square LENGTH: Measured side of a square or tag, e.g. 20mm. Of grids of circles their distance (of asymmetric
        ones, that of their rows). Without a unit: metres.
      --pattern NAME <KINDS>: Kind of board: {KINDS}. aprilgrid is that of Kalibr, aruco OpenCV's GridBoard; apriltag,
        or aruco without --board, is a single tag. Default: chessboard, with --marker charuco.
      --spacing GAP: Gap between the tags of a grid, e.g. 6mm; of aprilgrid also as a share of the side, e.g. 0.3.
      --marker LENGTH: Side of a marker, for a ChArUco board.
      --diameter LENGTH: Diameter of the discs of a grid of circles, e.g. 15mm.
      --dictionary NAME: Dictionary of the markers, e.g. 5X5_100 or tag25h9. Default: 4X4_50, of AprilTags 36h11.
      --first-id ID: Id of the first tag of a grid (default: 0), or of a single tag (default: any).
    """

    board: str | None = None
    square: str | None = None
    pattern: str | None = None
    spacing: str | None = None
    marker: str | None = None
    diameter: str | None = None
    dictionary: str | None = None
    first_id: int | None = None

    @property
    def file(self) -> str | None:
        """Table of points that ``--board`` names; raises `InputError` if further options describe the board."""
        if self.board is None or not Path(self.board).suffix:
            return None
        if further := self.given[1:]:
            raise InputError(
                f"{', '.join(further)}: not used with --board {self.board}, which holds all points. Remove the option."
            )
        return self.board

    def shape(self) -> "BoardShape | None":
        """Return the measured board if ``--board`` names a file of points."""
        if self.file is None or self.of_kalibr:
            return None
        from ..model.camera.board_file import read_board

        return read_board(self.file)

    def read(self) -> "Board":
        """Return the board that is searched in the pictures."""
        from ..model.camera.description import Board, board_of

        if self.of_kalibr:
            from ..model.camera.kalibr_target import read_target

            return read_target(str(self.file))
        if self.file is not None:
            from ..model.camera.board_file import read_board_table

            if not (text := read_board_table(self.file).board):
                raise InputError(
                    f"{self.file} does not name the kind of board to look for in pictures. Give a table of corners, or "
                    "add a line such as # board: kind=chessboard columns=9 rows=6 square=0.02 before its header."
                )
            return board_of(text)
        kind = None if self.pattern is None else one_of(self.pattern, "--pattern", KINDS)
        if kind in TAGS:
            return self._tags(str(kind))
        if self.board is None or self.square is None:
            raise InputError("Pictures need --board and --square, e.g. --board 9x6 --square 20mm.")
        for name, value in (("--spacing", self.spacing), ("--first-id", self.first_id)):
            if value is not None:
                raise InputError(f"{name} applies to tags. Add --pattern aprilgrid, aruco or apriltag.")
        columns, rows = read_two_numbers(self.board, "--board", "9x6")
        square = read_length(self.square, "--square")
        if kind in CIRCLES:
            return self._circles(str(kind), columns, rows, square)
        if self.diameter is not None:
            raise InputError("--diameter applies to circles. Add --pattern circles or circles-asymmetric.")
        if self.marker is None and kind != "charuco":
            if self.dictionary is not None:
                raise InputError("--dictionary applies to a ChArUco board. Add --marker LENGTH. Or to tags: --pattern.")
            return Board(columns, rows, square)
        if kind == "chessboard":
            raise InputError("--marker applies to a ChArUco board. Remove it, or say --pattern charuco.")
        if self.marker is None:
            raise InputError("--pattern charuco needs the side of its markers. Add --marker LENGTH.")
        return Board(columns, rows, square, "charuco", read_length(self.marker, "--marker"), self.dictionary)

    def _circles(self, kind: str, columns: int, rows: int, square: float) -> "Board":
        """Return a grid of circles."""
        from ..model.camera.description import Board

        for name, value in (("--marker", self.marker), ("--dictionary", self.dictionary)):
            if value is not None:
                raise InputError(f"{name} does not apply to circles. Remove it.")
        if self.diameter is None:
            raise InputError(f"--pattern {kind} needs the diameter of the circles. Add --diameter LENGTH.")
        return Board(columns, rows, square, kind, diameter=read_length(self.diameter, "--diameter"))

    @property
    def of_kalibr(self) -> bool:
        """True if ``--board`` names a YAML file."""
        return self.file is not None and Path(self.file).suffix.lower() in (".yaml", ".yml")

    def _tags(self, kind: str) -> "Board":
        """Return a board of tags."""
        from ..model.camera.description import Board

        single = kind == "apriltag" or (kind == "aruco" and self.board is None)
        if self.diameter is not None:
            raise InputError("--diameter applies to circles. Remove it.")
        if self.marker is not None:
            raise InputError(f"--marker applies to a ChArUco board. Of {kind} give the side of a tag as --square.")
        if self.square is None:
            raise InputError(f"--pattern {kind} needs the side of a tag with its black border. Add --square LENGTH.")
        if self.board is None and not single:
            raise InputError(f"--pattern {kind} needs the number of tags. Add --board COLSxROWS, e.g. --board 6x6.")
        columns, rows = (1, 1) if self.board is None else read_two_numbers(self.board, "--board", "6x6")
        if self.spacing is None and columns * rows > 1 and kind != "apriltag":
            shown = "0.3 (a share of the side) or 6mm" if kind == "aprilgrid" else "6mm"
            raise InputError(f"--pattern {kind} needs the gap between tags. Add --spacing, e.g. {shown}.")
        spacing: float | str | None = None
        if self.spacing is not None:
            share = floats([self.spacing])
            spacing = share[0] if share else self.spacing
            if kind == "aruco":
                spacing = read_length(self.spacing, "--spacing")
        square = read_length(self.square, "--square")
        return Board(columns, rows, square, kind, None, self.dictionary, spacing, self.first_id)


def read_two_numbers(text: str, name: str, example: str) -> tuple[int, int]:
    """Return the numbers of a text such as 9x6."""
    parts = text.lower().replace("\u00d7", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdecimal() and len(part) < 8 for part in parts):
        raise InputError(f"Expected {name} to be two numbers such as {example}, got {text!r}.")
    return int(parts[0]), int(parts[1])


def read_length(text: str, name: str) -> float:
    """Return the metres of a number, which may have a unit."""
    if (value := metres(text, name)) > 1.0:
        raise InputError(f"{name} {text} is {value:g} m, larger than any board. Write the unit, e.g. {name} {text}mm.")
    return value
