"""Corners between dark and light squares, refined to a fraction of a pixel by the gradients around them.

Chessboards in a picture, and which of their corners is the first.

ChArUco boards in a picture, also in part.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from .adjustment.initial_guess import opencv
from .corners import smoothing
from .description import Board, dictionary_of

WINDOW = (2, 30)  # bounds of half the side of the window in which a corner is refined, pixels
RIM = 2  # pixels beyond the window that a corner moved a little, and the gradient, take

Picture = NDArray[np.uint8]
# Numbers of the board's points, their pixels, and half the widths of the windows in which these were refined.
Seen = tuple[NDArray[np.intp], Array, NDArray[np.intp]]
Found = Seen | None


def refined(
    picture: Picture, corners: Array, share: float, room: Array | None = None
) -> tuple[Array, NDArray[np.intp]]:
    """Refine corners by the gradients around each of them (m, 2); also return half the width (m,) of the window: a
    share of the ``room`` (m,) that each has, pixels, or else of the distance to the nearest neighbour, but within the
    picture, as beyond its rim edges would seem to run on along the rows.
    """
    cv2 = opencv()
    flat = np.asarray(corners, dtype=float).reshape(-1, 2)
    if room is None:
        apart = np.linalg.norm(flat[:, None] - flat, axis=-1) + 1e9 * np.eye(len(flat))
        room = apart.min(axis=1)
        room = np.minimum(room, 1.2 * np.median(room))  # a neighbour may not have been found
    rim = np.minimum(flat, np.array(picture.shape[::-1]) - 1 - flat).min(axis=1) - RIM
    windows = np.clip(np.minimum(share * room, rim), *WINDOW).astype(np.intp)
    enough = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    grey, sigma = picture.astype(np.float32), smoothing(windows)
    smooth = {s: cv2.GaussianBlur(grey, (0, 0), s) for s in set(sigma.tolist())}
    found = [
        cv2.cornerSubPix(smooth[s], np.array(corner, dtype=np.float32).reshape(1, 1, 2), (w, w), (-1, -1), enough)
        for corner, w, s in zip(flat, windows.tolist(), sigma.tolist(), strict=True)
    ]
    return np.concatenate(found)[:, 0].astype(float), windows


SHARE = 0.4  # half the side of the window in which a corner is refined, of the distance to the nearest


def chessboard_finder(board: Board) -> Callable[[Picture], Found]:
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
        pixels, window = refined(picture, corners, SHARE)
        order = _ordered(pixels.reshape(board.rows, board.columns, 2), picture).ravel()
        return numbers, pixels[order], window[order]

    return find


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


# Fewest corners that are worth a pose.
FEWEST = 6
# Half the side of the window in which a corner is refined: a share of the white around the markers, whose corners are
# no part of a corner of the board.
SHARE_OF_MARKERS = 0.33


def charuco_finder(board: Board) -> Callable[[Picture], Found]:
    cv2 = opencv()
    words = dictionary_of(board.dictionary)

    share = SHARE_OF_MARKERS * (1.0 - float(board.marker or 0.0) / board.side)

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
            if ids is None or len(ids) < FEWEST:
                continue
            numbers = np.asarray(ids, dtype=np.intp).ravel()
            if np.linalg.matrix_rank(board.points[numbers, :2] - board.points[numbers[0], :2]) < 2:
                continue  # corners of one line
            if k:
                detectors.reverse()  # it will be this one in all pictures
            # Releases of OpenCV differ by half a pixel here; refined once more, all give the same.
            return numbers, *refined(picture, corners, share)
        return None

    return find
