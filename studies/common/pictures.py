"""Pictures of boards as a known camera of any model would take them, for tests and studies.

The grey of a pixel is the mean over its square of what the board shows where the rays of the camera meet it. Rays are
the inverse of the camera model (`uq_handeye.model.camera.models`), once per camera. The board is a drawing;
where all of it that a pixel sees has one colour, that is the pixel's. The others look at it at ``PLACES``, a Fibonacci
lattice, no two of which have the same u or v: a border along a row of pixels is met as exactly as any other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

from uq_handeye.core.geometry.se3 import Array
from uq_handeye.model.camera.adjustment.opencv import opencv
from uq_handeye.model.camera.description import CIRCLES, TAGS, Board
from uq_handeye.model.camera.dictionaries import bits_of, dictionary_of, drawn_upside_down
from uq_handeye.model.camera.models import MODELS
from uq_handeye.model.camera.rays import rays
from uq_handeye.model.camera.tags import layout_of

COUNT, TURN = 89, 55  # of a Fibonacci lattice
PLACES = ((np.arange(COUNT)[:, None] * [1, TURN] % COUNT + 0.5) / COUNT - 0.5).astype(np.float32)  # of (u, v)
STRIDE = 8  # pixels between exact rays; splines of degree 5 between them
FINE = 60  # dots of the drawing along a square
FINE_OF_DISCS = 250  # along the distance of two discs
DOTS = 8  # along a cell of a tag
AROUND = 200  # grey of what is around the white rim of the board, which is a square wide
BLACK, WHITE = 20.0, 224.0  # as the camera sees 0 and 255
Surface = Callable[[Array, Array], Array]  # z of a board at its x and y, all in metres


@dataclass(frozen=True, eq=False)
class Camera:
    """A model of `uq_handeye.model.camera.models`, its parameters, and (width, height) of its pictures."""

    model: str
    parameters: Array
    size: tuple[int, int]

    @cached_property
    def directions(self) -> Array:
        """(3, height, width): where each pixel's centre looks."""
        u, v = (np.arange(-STRIDE, length + 2 * STRIDE, STRIDE, dtype=float) for length in self.size)
        exact = rays(MODELS[self.model], self.parameters, np.stack(np.meshgrid(u, v), axis=-1))
        if not np.isfinite(exact).all():
            raise ValueError("Expected a camera that sees something at every pixel.")
        width, height = self.size
        between = [RectBivariateSpline(v, u, part, kx=5, ky=5) for part in np.moveaxis(exact, -1, 0)]
        return np.stack([spline(np.arange(height), np.arange(width)) for spline in between])

    def seen(self, points: Array, camera_T_board: Array) -> Array:
        """Pixels (..., m, 2) of points (m, 3) of a board at poses (..., 4, 4)."""
        there = points @ camera_T_board[..., :3, :3].mT + camera_T_board[..., None, :3, 3]
        return MODELS[self.model].project(self.parameters, there).pixels


def picture(
    camera: Camera,
    board: Board,
    camera_T_board: Array,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    blur: float = 0.0,
    surface: Surface | None = None,
) -> NDArray[np.uint8]:
    """(height, width) of ``board`` at ``camera_T_board``, with ``noise``, the standard deviation in grey levels.

    ``blur`` is the standard deviation in pixels of a Gaussian that the lens adds, ``surface`` that of a board which is
    not flat. Grey levels are whole numbers from 0 to 255.
    """
    cv2 = opencv()
    drawn, corner, fine = drawing(board)
    x, y, ahead = _met(camera.directions, camera_T_board, surface)
    at = (np.stack([x, y]) - corner).astype(np.float32) * np.float32(fine / board.side)
    by_v, by_u = np.gradient(at, axis=(1, 2))
    spot = _dots(at, drawn)
    grey = np.where(ahead, drawn.ravel()[spot], AROUND).astype(np.float32)
    # Within so many dots of the one at its centre lies all that a pixel of the board sees.
    on_board = ahead & (np.abs(by_u) + np.abs(by_v) < fine).all(axis=0) & (grey != AROUND)
    reach = 0.5 * (np.abs(by_u) + np.abs(by_v))[:, on_board].max(initial=0.5)
    around = np.ones((2 * int(np.ceil(reach)) + 1,) * 2, np.uint8)
    mixed = (cv2.dilate(drawn, around) != cv2.erode(drawn, around)).ravel()[spot] & ahead
    at, by_u, by_v = at[:, mixed], by_u[:, mixed], by_v[:, mixed]
    grey[mixed] = sum(drawn.ravel()[_dots(at + by_u * du + by_v * dv, drawn)].astype(np.float32) for du, dv in PLACES)
    grey[mixed] /= len(PLACES)
    if blur:
        grey = cv2.GaussianBlur(grey, (0, 0), blur)
    grey = BLACK + (WHITE - BLACK) / 255 * grey + noise * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _met(
    directions: Array, camera_T_board: Array, surface: Callable[[Array, Array], Array] | None
) -> tuple[Array, ...]:
    """x, y of the board where rays (3, ...) meet it, and which of them do."""
    start = -camera_T_board[:3, :3].T @ camera_T_board[:3, 3]
    forward = np.tensordot(camera_T_board[:3, :3].T, directions, axes=1)
    z = np.zeros(directions.shape[1:])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for _ in range(1 if surface is None else 3):
            far = (z - start[2]) / forward[2]
            x, y = start[0] + far * forward[0], start[1] + far * forward[1]
            z = z if surface is None else surface(x, y)
    return x, y, np.isfinite(far) & (far > 0)


def _dots(at: NDArray[Any], drawn: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Numbers of the dots of the drawing that places (2, ...) lie in; its rim is everything around it."""
    rows, columns = drawn.shape
    u, v = (np.clip(part, 0, end - 1).astype(np.int32) for part, end in zip(at, (columns, rows), strict=True))
    return np.asarray(v * columns + u)


def drawing(board: Board) -> tuple[NDArray[np.uint8], float, int]:
    """The board and its white rim, x, y in metres of its first dot's outer corner, and dots along ``board.side``."""
    if board.kind in TAGS:
        return _tags(board)
    if board.kind in CIRCLES:
        return _discs(board)
    if board.kind == "chessboard":
        j, i = np.indices((board.rows + 1, board.columns + 1))
        squares = np.kron(((i + j) % 2 * 255).astype(np.uint8), np.ones((FINE, FINE), np.uint8))
        before = 2  # squares before the origin: the rim and the first square
    else:
        aruco = opencv().aruco
        words = aruco.getPredefinedDictionary(getattr(aruco, f"DICT_{board.dictionary}"))
        layout = aruco.CharucoBoard((board.columns, board.rows), board.side, float(board.marker or 0), words)
        squares = layout.generateImage((board.columns * FINE, board.rows * FINE))
        before = 1
    rim = np.pad(squares, FINE, constant_values=255)
    return np.pad(rim, 1, constant_values=AROUND), -board.side * (before + 1 / FINE), FINE


def _discs(board: Board) -> tuple[NDArray[np.uint8], float, int]:
    """Draw a grid of black discs."""
    first, last = board.points[:, :2].min() - board.side, board.points[:, :2].max(axis=0) + board.side
    step = board.side / FINE_OF_DISCS
    x, y = (np.arange(first + 0.5 * step, end, step) for end in last)
    drawn = np.full((len(y), len(x)), 255, np.uint8)
    for p in board.points[:, :2]:
        column, row = (
            slice(*np.searchsorted(of, [at - board.disc, at + board.disc])) for of, at in zip((x, y), p, strict=True)
        )
        inside = (x[column] - p[0]) ** 2 + (y[row, None] - p[1]) ** 2 < 0.25 * board.disc**2
        drawn[row, column][inside] = 0
    return np.pad(drawn, 1, constant_values=AROUND), float(first - step), FINE_OF_DISCS


def _tags(board: Board) -> tuple[NDArray[np.uint8], float, int]:
    """Draw tags upright as AprilTag has them; an AprilGrid as Kalibr prints it, with squares at its corners."""
    words = dictionary_of(board.dictionary)
    border = 2 if board.kind == "aprilgrid" else 1
    cells = words.markerSize + 2 * border
    fine = cells * DOTS
    gap = round(fine * board.gap / board.side)
    if abs(gap - fine * board.gap / board.side) > 1e-6:
        raise ValueError(f"Expected a gap of whole dots, {fine} along a side.")
    drawn = np.full((board.rows * (fine + gap) + gap, board.columns * (fine + gap) + gap), 255, np.uint8)
    layout = layout_of(board)
    for number, upper_left in zip(layout.ids.tolist(), layout.points[:, 0] - board.points[0, :2], strict=True):
        bits = np.pad(bits_of(words, number)[:: -1 if drawn_upside_down(board.dictionary) else 1], border)
        bits = bits[:, ::-1] if drawn_upside_down(board.dictionary) else bits
        x, y = np.rint(gap + upper_left * fine / board.side).astype(int)
        drawn[y : y + fine, x : x + fine] = 255 * np.kron(bits, np.ones((DOTS, DOTS)))
    if board.kind == "aprilgrid" and gap:
        j, i = np.indices(drawn.shape)
        drawn[(j % (fine + gap) < gap) & (i % (fine + gap) < gap)] = 0
    rim = fine // 2
    before = float(-board.points[0, 0]) + board.side * (gap + rim + 1) / fine
    return np.pad(np.pad(drawn, rim, constant_values=255), 1, constant_values=AROUND), -before, fine
