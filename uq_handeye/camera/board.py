"""Boards, and their corners in pictures.

Frame of the board: x along a row of corners, y along a column, z away from the camera. A chessboard has its origin at
an inner corner, ChArUco at the outer corner of its first square, as OpenCV has them.

A chessboard looks the same after half a turn. Where one of its numbers of inner corners is even and the other odd, the
colours tell: the corners are ordered such that the square between the first four of them is dark, at whatever angle the
camera rolls. Where both are even or both odd, half a turn (of a square board also a quarter) cannot be seen.
"""

from __future__ import annotations

import glob
import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from ..errors import InputError, InputWarning, require_integer
from ..files.lines import short
from ..files.many import natural
from ..files.open import StrPath, as_path, opened, shown
from ..files.source import Source
from ..formatting.units import parse_length
from ..geometry.se3 import Array
from ..runtime.progress import progress_bar
from .adjustment.initial_guess import opencv
from .corners import Corners, smoothing

KINDS = ("chessboard", "charuco")
# Fewest corners of a ChArUco board that are worth a pose.
FEWEST_CHARUCO = 6
LARGEST = 200  # corners along a side
# Half the side of the window in which a corner is refined: a share of the distance to the nearest, and its bounds.
# Of ChArUco it is a share of the white around the markers, whose corners are no part of a corner of the board.
CHESSBOARD_SHARE, CHARUCO_SHARE = 0.4, 0.33
WINDOW = (2, 30)
RIM = 2  # pixels beyond the window that a corner moved a little, and the gradient, take
MAX_BYTES = 500_000_000  # of a picture's file
SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".webp")

Picture = NDArray[np.uint8]
# Numbers of the board's points, their pixels and half the widths of the windows in which these were refined.
Seen = tuple[NDArray[np.intp], Array, NDArray[np.intp]]
Found = Seen | None


@dataclass(frozen=True)
class Board:
    """A flat board of squares.

    Parameters
    ----------
    columns, rows : int
        Chessboard: inner corners along x and y. ChArUco: squares.
    square : float or str
        Side of a square in metres, or text with a unit such as "20mm". Measure it on the print.
    kind : "chessboard" or "charuco"
    marker : float, str or None
        Side of the markers of a ChArUco board.
    dictionary : str
        Of the markers: a name of OpenCV's predefined dictionaries such as "4X4_50".

    Raises `InputError` for numbers or names that make no sense.
    """

    columns: int
    rows: int
    square: float | str
    kind: str = "chessboard"
    marker: float | str | None = None
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise InputError(f"Expected `kind` to be {' or '.join(KINDS)}, got {self.kind!r}.")
        for name in ("columns", "rows"):
            require_integer(name, getattr(self, name), 3)
            if getattr(self, name) > LARGEST:
                raise InputError(f"Expected `{name}` of the board to be at most {LARGEST}, got {getattr(self, name)}.")
        object.__setattr__(self, "square", _positive(self.square, "square"))
        if self.kind == "chessboard":
            if self.marker is not None:
                raise InputError("A chessboard has no markers: leave `marker` out, or say kind='charuco'.")
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

    @property
    def text(self) -> str:
        """One line that `board_of` reads: ``kind=chessboard columns=9 rows=6 square=0.02``."""
        return " ".join(f"{name}={value}" for name, value in vars(self).items() if self._has(name))

    def _has(self, name: str) -> bool:
        return self.kind == "charuco" or name not in ("marker", "dictionary")

    @property
    def side(self) -> float:
        """Length of the side of a square, in metres."""
        return float(self.square)

    @property
    def symmetry_order(self) -> int:
        """Number of angles, 360 degrees over this apart, at which the board looks the same: 1, 2 or 4."""
        if self.kind == "charuco" or (self.columns + self.rows) % 2:
            return 1
        return 4 if self.columns == self.rows and self.columns % 2 == 0 else 2

    @property
    def turns(self) -> int:
        """Earlier name of `symmetry_order`; deprecated."""
        warnings.warn("Board.turns is now called symmetry_order.", DeprecationWarning, stacklevel=2)
        return self.symmetry_order

    @property
    def points(self) -> Array:
        """(m, 3) the corners in the frame of the board, row by row, in metres."""
        first = 0 if self.kind == "chessboard" else 1
        x = self.side * np.arange(first, self.columns)
        y = self.side * np.arange(first, self.rows)
        return np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)

    def __str__(self) -> str:
        what = "inner corners" if self.kind == "chessboard" else "squares"
        return f"{self.kind} of {self.columns} x {self.rows} {what}"


def board_of(text: str) -> Board:
    """Return the board of `Board.text`; raises `InputError` for other text."""
    try:
        values = dict(part.split("=", 1) for part in text.split())
        columns, rows = int(values["columns"]), int(values["rows"])
        marker = float(values["marker"]) if "marker" in values else None
        more = {"dictionary": values["dictionary"]} if "dictionary" in values else {}
        return Board(columns, rows, float(values["square"]), values["kind"], marker, **more)
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
    nearest = np.asarray(KDTree(points).query(points, k=2)[0])[:, 1]
    return float(np.min(nearest)) if np.ptp(nearest) < 1e-3 * np.min(nearest) else None


def _positive(value: Any, name: str) -> float:
    length = parse_length(value, f"`{name}`")
    if not length > 0:
        raise InputError(f"Expected `{name}` to be a length above 0, got {value!r}.")
    return length


def detect_board(images: str | Iterable[StrPath], board: Board, *, progress: bool = False) -> Corners:
    """The corners of a board in pictures.

    Parameters
    ----------
    images : glob text, or paths
        Such as ``"img/*.png"``. They are always taken in the natural order of their names (img2 before img10), and the
        position there, from 0, is the row of the robot pose that the picture was taken at.
    board : Board
    progress : bool
        Show a bar on stderr, if that is a terminal.

    Returns
    -------
    Corners
        With ``image_size``, and the names of pictures in which there is no board in ``missing``.

    Raises
    ------
    InputError
        No pictures, files that are none, pictures of different sizes, a board in none of them.
    MissingExtraError
        OpenCV is not installed.

    Warns
    -----
    InputWarning
        Pictures without a board, by name. A chessboard that looks the same after half a turn.
    """
    corners = find_corners(images, board, progress)
    if board.symmetry_order > 1:
        warnings.warn(_ambiguous(board), InputWarning, stacklevel=2)
    return corners


def find_corners(images: str | Iterable[StrPath], board: Board, progress: bool) -> Corners:
    """Find corners as `detect_board` does, without a warning about half turns: for callers who resolve them."""
    if not isinstance(board, Board):
        raise InputError(f"Expected `board` to be a Board, got {type(board).__name__}.")
    paths = picture_paths(images)
    names = _names(paths)
    find = (_chessboard_finder if board.kind == "chessboard" else _charuco_finder)(board)
    found: dict[int, Seen] = {}
    sizes: dict[tuple[int, int], str] = {}
    with progress_bar("looking for the board", len(paths), "pictures", progress) as more:
        for row, path in enumerate(paths):
            picture = _picture(path)
            sizes.setdefault((picture.shape[1], picture.shape[0]), names[row])
            if len(sizes) > 1:
                (one, some), (other, odd) = sizes.items()
                raise InputError(
                    f"Expected pictures of one size: {some} has {one[0]} x {one[1]} pixels and {odd} {other[0]} x "
                    f"{other[1]}. They must come from one camera, uncropped and unscaled."
                )
            if (seen := find(picture)) is not None:
                found[row] = seen
            more(1)
    missing = tuple(name for row, name in enumerate(names) if row not in found)
    if not found:
        raise InputError(
            f"No {board} was found in any of {len(paths)} pictures, the first {names[0]}: is it that board? Counted "
            "are the inner corners of a chessboard, one less than squares, and the squares of ChArUco."
        )
    if missing:
        warnings.warn(
            f"The board was not found in {len(missing)} of {len(paths)} pictures, which are left out: "
            f"{listed(missing)}.",
            InputWarning,
            stacklevel=3,
        )
    (size,) = sizes
    numbers, pixels, window = (np.concatenate(part) for part in zip(*found.values(), strict=True))
    return Corners(
        np.repeat(list(found), [len(seen[0]) for seen in found.values()]),
        board.points[numbers],
        pixels,
        tuple(names[row] for row in found),
        image_size=size,
        missing=missing,
        board=board.text,
        window=window,
    )


def _ambiguous(board: Board) -> str:
    turn = "a half turn" if board.symmetry_order == 2 else "a quarter turn"
    return (
        f"A {board} looks the same after {turn}: its x axis is taken to point right in each picture, which is wrong "
        f"where the camera rolled by more than {90 if board.symmetry_order == 2 else 45} degrees. uq-handeye calibrate "
        "ROBOT --images resolves it by the robot poses. Better use ChArUco, or a board with an odd and an even number."
    )


def listed(names: Sequence[str], most: int = 20) -> str:
    """Names in a sentence, not all if they are too many."""
    rest = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + rest


# ---------------------------------------------------------------------------------------------------- pictures


def picture_paths(images: str | Iterable[StrPath]) -> list[Path]:
    """The pictures that are meant, in natural order; a folder means those within it."""
    if isinstance(images, str | os.PathLike):
        images = [images]
    paths: list[Path] = []
    for entry in images:
        path = as_path(entry)
        if path.is_dir():
            inside = [child for child in path.iterdir() if child.suffix.lower() in SUFFIXES]
            if not inside:
                raise InputError(f"Expected pictures ({', '.join(SUFFIXES)}) in {shown(path)}, got none.")
            paths += inside
        elif path.exists():
            paths.append(path)
        else:
            matched = [Path(name) for name in glob.glob(str(path), recursive=True) if not os.path.isdir(name)]
            if not matched:
                raise InputError(f"No pictures found for {shown(path)}: check the folder and the ending.")
            paths += matched
    if not paths:
        raise InputError("Expected `images` to name pictures, got none.")
    twice = [path for path, count in Counter(map(os.path.abspath, paths)).items() if count > 1]
    if twice:
        raise InputError(f"Expected every picture once, got {shown(Path(twice[0]))} twice.")
    return sorted(paths, key=natural)


def source_of(images: str | Iterable[StrPath], board: Board) -> Source:
    """The pictures as one source: the hash is that of their contents, one after the other in natural order."""
    paths = picture_paths(images)
    total, size = sha256(), 0
    for path in paths:
        with opened(path, MAX_BYTES) as file:
            data = file.read()
        total.update(data)
        size += len(data)
    names = _names(paths)
    note = f"{board}, squares of {1e3 * board.side:g} mm; the hash is of all pictures one after the other"
    return Source(f"{names[0]} to {names[-1]} ({len(paths)})", "pictures", size, total.hexdigest(), (note,))


def _names(paths: list[Path]) -> list[str]:
    """Without folders where that tells them apart."""
    bare = [path.name for path in paths]
    return [shown(Path(name)) for name in (bare if len(set(bare)) == len(bare) else map(str, paths))]


def _picture(path: Path) -> Picture:
    """Read the picture in grey, as the sensor has it: the orientation stated in a file is for viewers."""
    cv2 = opencv()
    with opened(path, MAX_BYTES) as file:
        data = np.frombuffer(file.read(), dtype=np.uint8)
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        picture = cv2.imdecode(data, flags) if data.size else None
    except cv2.error:  # too many pixels
        picture = None
    if picture is None:
        raise InputError(f"{shown(path)}: expected a picture (PNG, JPEG, TIFF, BMP, ...), got none that can be read.")
    if picture.dtype != np.uint8:
        picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return np.asarray(picture)


# --------------------------------------------------------------------------------------------------- detection


def _chessboard_finder(board: Board) -> Callable[[Picture], Found]:
    cv2 = opencv()
    size = (board.columns, board.rows)
    numbers = np.arange(board.columns * board.rows)

    def find(picture: Picture) -> Found:
        # The sector-based detector finds more boards, but its corners at the rim of the board are off by up to half a
        # pixel where squares are small; refined by their gradients, all are good to a few hundredths.
        for flags in (0, cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE):
            ok, corners = cv2.findChessboardCornersSB(picture, size, flags=flags)
            if ok:
                break
        else:
            ok, corners = cv2.findChessboardCorners(
                picture, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
            )
            if not ok:
                return None
        pixels, window = _refined(picture, corners, CHESSBOARD_SHARE)
        order = _ordered(pixels.reshape(board.rows, board.columns, 2), picture).ravel()
        return numbers, pixels[order], window[order]

    return find


def _refined(picture: Picture, corners: Array, share: float) -> tuple[Array, NDArray[np.intp]]:
    """Refine corners by the gradients around each of them (m, 2); also return half the width (m,) of the window: a
    share of the distance to the nearest neighbour, but within the picture, as beyond its rim edges would seem to run
    on along the rows.
    """
    cv2 = opencv()
    flat = np.asarray(corners, dtype=float).reshape(-1, 2)
    apart = np.linalg.norm(flat[:, None] - flat, axis=-1) + 1e9 * np.eye(len(flat))
    near = apart.min(axis=1)
    near = np.minimum(near, 1.2 * np.median(near))  # a neighbour may not have been found
    rim = np.minimum(flat, np.array(picture.shape[::-1]) - 1 - flat).min(axis=1) - RIM
    windows = np.clip(np.minimum(share * near, rim), *WINDOW).astype(np.intp)
    enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    grey, sigma = picture.astype(np.float32), smoothing(windows)
    smooth = {s: cv2.GaussianBlur(grey, (0, 0), s) for s in set(sigma.tolist())}
    found = [
        cv2.cornerSubPix(smooth[s], np.array(corner, dtype=np.float32).reshape(1, 1, 2), (w, w), (-1, -1), enough)
        for corner, w, s in zip(flat, windows.tolist(), sigma.tolist(), strict=True)
    ]
    return np.concatenate(found)[:, 0].astype(float), windows


def _ordered(grid: Array, picture: Picture) -> NDArray[np.intp]:
    """Numbers (rows, columns) of corners (rows, columns, 2) such that z points away and the colours, or else the
    picture, tell where x points."""
    number = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
    along = (grid[:, 1:] - grid[:, :-1]).mean(axis=(0, 1))
    down = (grid[1:] - grid[:-1]).mean(axis=(0, 1))
    if along[0] * down[1] - along[1] * down[0] < 0:  # seen from the front no board is a mirror image
        number = number[:, ::-1]
    turned = [np.rot90(number, k) for k in (range(4) if grid.shape[0] == grid.shape[1] else (0, 2))]
    flat = grid.reshape(-1, 2)
    dark = np.array([_first_is_dark(flat[one], picture) for one in turned])
    if dark.any() and not dark.all():
        turned = [one for one, is_dark in zip(turned, dark, strict=True) if is_dark]
    right = [(flat[one[:, -1]] - flat[one[:, 0]]).mean(axis=0) for one in turned]
    best = int(np.argmax([d[0] / np.hypot(*d) for d in right]))
    return turned[best]


def _first_is_dark(grid: Array, picture: Picture) -> bool:
    """Return whether the square between the first four corners is of the darker colour, judged by all squares."""
    centres = 0.25 * (grid[1:, 1:] + grid[1:, :-1] + grid[:-1, 1:] + grid[:-1, :-1])
    x = 0.15 * (grid[:-1, 1:] - grid[:-1, :-1])
    y = 0.15 * (grid[1:, :-1] - grid[:-1, :-1])
    height, width = picture.shape
    value = np.zeros(centres.shape[:2])
    for shift in (0 * x, x, -x, y, -y):
        u, v = np.moveaxis(np.rint(centres + shift).astype(int), -1, 0)
        value += picture[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
    j, i = np.indices(value.shape)
    even = (i + j) % 2 == 0
    return bool(value[even].mean() < value[~even].mean())


def _charuco_finder(board: Board) -> Callable[[Picture], Found]:
    cv2 = opencv()
    words = cv2.aruco.getPredefinedDictionary(_dictionary(board.dictionary))

    share = CHARUCO_SHARE * (1.0 - float(board.marker or 0.0) / board.side)

    def detector(legacy: bool) -> Any:
        layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.side, float(board.marker or 0.0), words)
        layout.setLegacyPattern(legacy)
        return cv2.aruco.CharucoDetector(layout)

    try:
        # Boards with an even number of rows began with a white square before OpenCV 4.6; prints of both are about.
        detectors = [detector(legacy) for legacy in ((False, True) if board.rows % 2 == 0 else (False,))]
    except cv2.error as error:
        raise InputError(f"OpenCV takes no {board} with the dictionary {board.dictionary}: too few markers?") from error

    def find(picture: Picture) -> Found:
        for k, one in enumerate(detectors):
            corners, ids, _, _ = one.detectBoard(picture)
            if ids is None or len(ids) < FEWEST_CHARUCO:
                continue
            numbers = np.asarray(ids, dtype=np.intp).ravel()
            if np.linalg.matrix_rank(board.points[numbers, :2] - board.points[numbers[0], :2]) < 2:
                continue  # corners of one line
            if k:
                detectors.reverse()  # it will be this one in all pictures
            # Releases of OpenCV differ by half a pixel here; refined once more, all give the same.
            return numbers, *_refined(picture, corners, share)
        return None

    return find


def _dictionary(name: Any) -> int:
    aruco = opencv().aruco
    known = [key.removeprefix("DICT_") for key in dir(aruco) if key.startswith("DICT_")]
    text = str(name).upper().removeprefix("DICT_")
    if text not in known:
        raise InputError(f"Expected `dictionary` to be one of {', '.join(known)}, got {short(str(name))}.")
    return int(getattr(aruco, f"DICT_{text}"))
