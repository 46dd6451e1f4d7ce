"""Detection of chessboards in a picture, and of the first of their corners."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .corner_refinement import Detection, Picture, refined
from .description import Board

# Neighbouring squares differ by this share of the usual contrast at least, in this share of the pairs.
MIN_CONTRAST_SHARE, MIN_ALTERNATING_SHARE = 0.2, 0.9
# The outer squares are as long as their neighbours let expect, within this factor.
MAX_SPACING_RATIO = 1.35
# Longest side of a picture in which another board is looked for.
PROBE_SIDE_PX = 1000


def chessboard_finder(board: Board) -> Callable[[Picture], Detection]:
    cv2 = opencv()
    size = (board.columns, board.rows)
    numbers = np.arange(board.columns * board.rows)

    def find(picture: Picture) -> Detection:
        # The sector-based detector finds more boards, but its corners at the rim of the board are off by up to half a
        # pixel where squares are small; refined by their gradients, all are good to a few hundredths.
        for flags in (0, cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE):
            ok, corners = cv2.findChessboardCornersSB(picture, size, flags=flags)
            if ok and is_grid(corners.reshape(board.rows, board.columns, 2), picture):
                break
        else:
            ok, corners = cv2.findChessboardCorners(
                picture, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
            )
            if not ok or not is_grid(corners.reshape(board.rows, board.columns, 2), picture):
                return None
        pixels, window = refined(picture, corners, share=0.4)
        order = _ordered(pixels.reshape(board.rows, board.columns, 2), picture).ravel()
        return numbers, pixels[order], window[order]

    return find


def is_grid(grid: Array, picture: Picture) -> bool:
    """Return whether corners (rows, columns, 2) are those of one grid of squares of two colours, and all of it.

    Detectors take the cut edge of a board for its outer corners, and grids that are turned or shifted by a square.
    Then neighbouring squares do not alternate, or the outer ring has another spacing than the squares beside it. Of a
    larger board they find a part: then two rings of squares follow.
    """
    value = _squares(grid, picture)
    j, i = np.indices(value.shape)
    signed = np.where((i + j) % 2 == 0, value, -value)
    steps = (signed[:, 1:] + signed[:, :-1], signed[1:] + signed[:-1])  # of neighbours: twice the contrast
    every = np.concatenate([step.ravel() for step in steps])
    contrast = float(np.median(every))
    if contrast < 0.0:
        every, steps, contrast = -every, (-steps[0], -steps[1]), -contrast
    if float(np.mean(every > MIN_CONTRAST_SHARE * contrast)) < MIN_ALTERNATING_SHARE:
        return False
    lines = [*steps[0].T, *steps[0], *steps[1], *steps[1].T]  # those of one border between two lines of squares, too
    if any(float(np.median(line)) < MIN_CONTRAST_SHARE * contrast for line in lines if line.size):
        return False
    sides = (grid, grid[:, ::-1], grid.swapaxes(0, 1), grid[::-1].swapaxes(0, 1))
    return all(map(_even_spacing, sides)) and not any(_goes_on(side, picture, contrast) for side in sides)


def _even_spacing(grid: Array) -> bool:
    """Return whether the first squares along the rows of a grid (rows, columns, 2) are as long as those behind them
    let expect."""
    if grid.shape[1] < 4:
        return True
    lengths = np.linalg.norm(grid[:, 1:4] - grid[:, :3], axis=-1)
    ratio = np.median(lengths[:, 0] * lengths[:, 2] / np.maximum(lengths[:, 1], 1e-9) ** 2)  # 1 to first order
    return bool(1.0 / MAX_SPACING_RATIO < ratio < MAX_SPACING_RATIO)


def _goes_on(grid: Array, picture: Picture, contrast: float) -> bool:
    """Return whether a second column of squares follows before the first corners of a grid (rows, columns, 2)."""
    step = grid[:, 0] - grid[:, 1]
    at = grid[:, 0] + 1.5 * step + 0.375 * (step - (grid[:, 1] - grid[:, 2]))  # squares get smaller with the distance
    centres = np.rint(0.5 * (at[1:] + at[:-1])).astype(int)
    height, width = picture.shape
    if (centres < 0).any() or (centres >= (width, height)).any() or len(centres) < 2:
        return False
    value = picture[centres[:, 1], centres[:, 0]].astype(float)
    steps = np.diff(value) * np.where(np.arange(len(value) - 1) % 2 == 0, 1.0, -1.0)
    return bool(abs(float(np.median(steps))) > 0.5 * contrast)


def shown_size(pictures: Iterable[Picture]) -> tuple[int, int] | None:
    """Return the columns and rows of corners of the chessboard that pictures show, more columns than rows; or None."""
    cv2 = opencv()
    for picture in pictures:
        found, _, meta = cv2.findChessboardCornersSBWithMeta(smaller(picture), (3, 3), flags=cv2.CALIB_CB_LARGER)
        if found and min(meta.shape) >= 3:
            return max(meta.shape), min(meta.shape)
    return None


def in_small(picture: Picture, board: Board) -> bool:
    """Return whether a small copy of a picture shows the board."""
    return bool(opencv().findChessboardCornersSB(smaller(picture), (board.columns, board.rows), flags=0)[0])


def smaller(picture: Picture) -> Picture:
    """Return a picture of at most `PROBE_SIDE_PX` a side, in which a board is searched for quickly."""
    factor = PROBE_SIDE_PX / max(picture.shape)
    if factor >= 1.0:
        return picture
    cv2 = opencv()
    return np.asarray(cv2.resize(picture, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA))


def _ordered(grid: Array, picture: Picture) -> NDArray[np.intp]:
    """Numbers (rows, columns) of corners (rows, columns, 2) such that z points away and the colours, or else the
    picture, decide where x points."""
    turned, flat = unmirrored(grid), grid.reshape(-1, 2)
    dark = np.array([_first_is_dark(flat[one], picture) for one in turned])
    if dark.any() and not dark.all():
        turned = [one for one, is_dark in zip(turned, dark, strict=True) if is_dark]
    return turned_right(flat, turned)


def unmirrored(grid: Array) -> list[NDArray[np.intp]]:
    """Numbers (rows, columns) of points (rows, columns, 2) in all orders of a board that is seen from the front."""
    number = np.arange(grid.shape[0] * grid.shape[1]).reshape(grid.shape[:2])
    along = (grid[:, 1:] - grid[:, :-1]).mean(axis=(0, 1))
    down = (grid[1:] - grid[:-1]).mean(axis=(0, 1))
    if along[0] * down[1] - along[1] * down[0] < 0:
        number = number[:, ::-1]
    return [np.rot90(number, k) for k in (range(4) if grid.shape[0] == grid.shape[1] else (0, 2))]


def turned_right(flat: Array, turned: list[NDArray[np.intp]]) -> NDArray[np.intp]:
    """Return the one of some orders of points (m, 2) in which x points most to the right."""
    right = [(flat[one[:, -1]] - flat[one[:, 0]]).mean(axis=0) for one in turned]
    return turned[int(np.argmax([d[0] / np.hypot(*d) for d in right]))]


def _squares(grid: Array, picture: Picture) -> Array:
    """Return the brightness (rows - 1, columns - 1) of the squares between corners, at five points of each."""
    centres = 0.25 * (grid[1:, 1:] + grid[1:, :-1] + grid[:-1, 1:] + grid[:-1, :-1])
    x = 0.15 * (grid[:-1, 1:] - grid[:-1, :-1])
    y = 0.15 * (grid[1:, :-1] - grid[:-1, :-1])
    height, width = picture.shape
    value = np.zeros(centres.shape[:2])
    for shift in (0 * x, x, -x, y, -y):
        u, v = np.moveaxis(np.rint(centres + shift).astype(int), -1, 0)
        value += picture[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
    return value / 5.0


def _first_is_dark(grid: Array, picture: Picture) -> bool:
    """Return whether the square between the first four corners is of the darker colour, judged by all squares."""
    value = _squares(grid, picture)
    j, i = np.indices(value.shape)
    even = (i + j) % 2 == 0
    return bool(value[even].mean() < value[~even].mean())
