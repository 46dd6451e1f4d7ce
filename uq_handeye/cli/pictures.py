"""Pictures of a board on the command line: board, lens, and the camera poses that come of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from ..runtime.progress import working
from .messages import LOG, progress_wanted, timed
from .options import one_of, option

if TYPE_CHECKING:
    from ..camera.board import Board
    from ..camera.board_shape import BoardShape
    from ..camera.corners import Corners
    from ..camera.result import CameraCalibration
    from ..poses.pose_pairs import PosePairs


# camera.models.MODELS and "auto", written down once more to be quick.
MODEL_NAMES = ("auto", "pinhole", "brown", "fisheye")


COEFFICIENT_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


# Panels of the help.
BOARD, LENS = "Board in pictures", "Camera model"


@dataclass(frozen=True)
class BoardOptions:
    """The board, as the command line says."""

    board: Annotated[
        str | None,
        option(
            "--board",
            metavar="COLUMNSxROWS|FILE",
            panel=BOARD,
            help="Inner corners of a chessboard, e.g. 9x6, one less than squares; squares of a ChArUco board. Or the "
            "board.csv of an earlier uq-handeye camera -o: the board as measured. Beside --camera-matrix also a "
            "file of points, x,y,z.",
        ),
    ] = None
    square: Annotated[
        str | None,
        option("--square", metavar="LENGTH", panel=BOARD, help="Side of a square as measured: metres, or e.g. 20mm."),
    ] = None
    marker: Annotated[
        str | None,
        option("--marker", metavar="LENGTH", panel=BOARD, help="Side of the markers: makes it a ChArUco board."),
    ] = None
    dictionary: Annotated[
        str | None,
        option("--dictionary", metavar="NAME", panel=BOARD, help="Of the markers, e.g. 5X5_100. Left out: 4X4_50."),
    ] = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [f"--{name}" for name, value in vars(self).items() if value is not None]

    @property
    def file(self) -> str | None:
        """The file of points that ``--board`` names; raises `InputError` where further options say what it says."""
        if self.board is None or not Path(self.board).suffix:
            return None
        if further := self.given[1:]:
            raise InputError(f"{', '.join(further)}: --board {self.board} says all points; leave it out.")
        return self.board

    def shape(self) -> "BoardShape | None":
        """The board as measured before, where ``--board`` names a file."""
        if self.file is None:
            return None
        from ..camera.files.board_file import read_board

        return read_board(self.file)

    def read(self) -> "Board":
        """The board that is meant."""
        from ..camera.board import Board, board_of

        if self.file is not None:
            from ..camera.files.board_file import read_board_table

            if not (text := read_board_table(self.file).board):
                raise InputError(
                    f"{self.file} does not say which board to look for in pictures, as it was measured from a table of "
                    "corners: give a table of corners again, or add a line such as # board: kind=chessboard columns=9 "
                    "rows=6 square=0.02 before its header."
                )
            return board_of(text)
        if self.board is None or self.square is None:
            raise InputError("Pictures need --board and --square, e.g. --board 9x6 --square 20mm.")
        columns, rows = read_two_numbers(self.board, "--board", "9x6")
        square = read_length(self.square, "--square")
        if self.marker is None:
            if self.dictionary is not None:
                raise InputError("--dictionary is that of a ChArUco board: give --marker, too.")
            return Board(columns, rows, square)
        more = {} if self.dictionary is None else {"dictionary": self.dictionary}
        return Board(columns, rows, square, "charuco", read_length(self.marker, "--marker"), **more)


@dataclass(frozen=True)
class LensOptions:
    """What is estimated of the camera and what is known, as the command line says."""

    model: Annotated[
        str | None,
        option(
            "--model",
            of=MODEL_NAMES,
            metavar="NAME",
            panel=LENS,
            help=f"{', '.join(MODEL_NAMES)}. Left out: auto, the best of several by BIC.",
        ),
    ] = None
    coefficients: Annotated[
        str | None,
        option(
            "--coefficients",
            of=COEFFICIENT_NAMES,
            metavar="NAME,NAME,...",
            panel=LENS,
            help="Those of the model that are estimated, e.g. k1,k2; the others are 0.",
        ),
    ] = None
    intrinsics: Annotated[
        str | None,
        option(
            "--intrinsics",
            metavar="FILE",
            panel=LENS,
            help='What is known beforehand: JSON such as {"fx": [1080.0, 2.0], "k1": 0.0}, a value exact, two a value '
            "and its standard deviation; or YAML of OpenCV or ROS, exact. Beside --camera-matrix: estimated, pinhole "
            "or exact.",
        ),
    ] = None
    board_shape: Annotated[
        str | None,
        option(
            "--board-shape",
            metavar="NAME",
            panel=LENS,
            help="Of the board: auto, flat, bow2, bow3, bow4 (degree of its height), plane1, plane2 (aspect and shear; "
            "and degree 2), or both, such as bow2+plane1. Left out: auto, the best by BIC.",
        ),
    ] = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [f"--{name.replace('_', '-')}" for name, value in vars(self).items() if value is not None]

    def calibrate(
        self, corners: "Corners", image_size: tuple[int, int] | None, measured: "BoardShape | None" = None
    ) -> "CameraCalibration":
        """The camera that saw these corners, of a board that was ``measured`` before."""
        from ..camera.calibrate import calibrate_camera

        if measured is not None and self.board_shape is not None:
            raise InputError("--board-shape: the file of --board says the shape of the board; leave one of them out.")
        model = None if self.model is None else one_of(self.model, "--model", MODEL_NAMES)
        values: Any = None
        if self.intrinsics is not None:
            from ..camera.files.intrinsics_file import read_intrinsics

            known = read_intrinsics(self.intrinsics, model)
            values, model = known.values, known.model if model in (None, "auto") else model
            size = image_size or corners.image_size
            if size is None:
                image_size = known.image_size
            elif known.image_size not in (None, size):
                other = "{} x {}".format(*known.image_size)
                raise InputError(
                    f"{self.intrinsics} is of pictures of {other} pixels, these have {size[0]} x {size[1]}: scale fx, "
                    "fy, cx, cy and their deviations first."
                )
        if image_size is None and corners.image_size is None:
            raise InputError("Corners do not say how large the pictures are: give --image-size, e.g. 1920x1080.")
        names = None if self.coefficients is None else [part.strip() for part in self.coefficients.split(",") if part]
        with timed("calibrating the camera"), working("calibrating the camera", progress_wanted()):
            return calibrate_camera(
                corners, image_size, model or "auto", coefficients=names, intrinsics=values,
                shape=measured or self.board_shape or "auto",
            )  # fmt: skip


@dataclass(frozen=True)
class Pictures:
    """Pictures in place of a file of camera poses."""

    images: str
    board: BoardOptions
    lens: LensOptions

    def poses(self, robot: Path | None, **how: Any) -> "PosePairs":
        """Robot poses with the poses of the pictures; ``how`` are further options of `read_poses`."""
        from dataclasses import replace

        from ..camera.board import find_corners, source_of
        from ..camera.report.text import model_name
        from ..io import read_poses
        from ..poses.board_symmetry import resolve_turns

        board = self.board.read()
        with timed(f"looking for the board in {self.images}"):
            corners = find_corners(self.images, board, progress_wanted())
        seen = self.lens.calibrate(corners, None, self.board.shape())
        LOG.info("the camera: %s, pixel noise %.3g pixels", model_name(seen), seen.pixel_noise)
        poses = resolve_turns(read_poses(robot, seen, **how), board)
        return replace(poses, sources=(*poses.sources, source_of(self.images, board)))


def read_two_numbers(text: str, name: str, example: str) -> tuple[int, int]:
    parts = text.lower().replace("\u00d7", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdecimal() and len(part) < 8 for part in parts):
        raise InputError(f"Expected {name} to be two numbers such as {example}, got {text!r}.")
    return int(parts[0]), int(parts[1])


def read_length(text: str, name: str) -> float:
    """Metres of a number, or of one with a unit."""
    from ..formatting.units import parse_length

    try:
        value = float(text)
    except ValueError:
        value = parse_length(text, name)
    if value > 1.0:
        raise InputError(f"{name} {text} is {value:g} m, larger than any board: write the unit, e.g. {name} {text}mm.")
    return value
