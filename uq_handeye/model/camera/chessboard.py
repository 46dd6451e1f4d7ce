"""Detection of chessboards in a picture, and of the first of their corners."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .corner_refinement import Detection, Picture, refined
from .description import Board


def chessboard_finder(board: Board) -> Callable[[Picture], Detection]:
    cv2 = opencv()
    size = (board.columns, board.rows)
    numbers = np.arange(board.columns * board.rows)

    def find(picture: Picture) -> Detection:
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
        pixels, window = refined(picture, corners, share=0.4)
        order = _ordered(pixels.reshape(board.rows, board.columns, 2), picture).ravel()
        return numbers, pixels[order], window[order]

    return find


def _ordered(grid: Array, picture: Picture) -> NDArray[np.intp]:
    """Numbers (rows, columns) of corners (rows, columns, 2) such that z points away and the colours, or else the
    picture, decide where x points."""
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
