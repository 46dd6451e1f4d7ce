"""Detection of grids of discs in a picture, symmetric and asymmetric, black on white or white on black.

OpenCV's `findCirclesGrid` finds which discs belong to the grid. Their centres are then the centroids of what is darker
(or lighter) than the paper around them, between the grey of the disc and that of the paper: unbiased where the picture
is blurred, and to 0.01 pixels where it has little noise. OpenCV's order of a symmetric grid follows the picture, and is
mirrored at some rolls of the camera: the grid is put in the order of a board that is seen from the front, with x to the
right, as a chessboard of which half a turn cannot be seen.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .chessboard import turned_right, unmirrored
from .corner_refinement import Detection, Picture
from .description import Board

# Discs cover at most this share of the picture.
MAX_DISC_SHARE = 0.05
# Pixels beyond the edge of a disc that are no paper: the edge is blurred; and how far the paper about it counts, from
# its edge (0) to half way to the next disc (1).
EDGE_PX, PAPER_TO = 2.5, 0.7


def circles_finder(board: Board) -> Callable[[Picture], Detection]:
    """Return the function that finds the grid in a picture."""
    cv2 = opencv()
    size, asymmetric = (board.columns, board.rows), board.kind == "circles-asymmetric"
    numbers, points = np.arange(board.columns * board.rows), board.points[:, :2]
    pitch = board.side * (np.sqrt(2.0) if asymmetric else 1.0)  # of nearest neighbours
    radius = 0.5 * board.disc
    grid = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID

    def find(picture: Picture) -> Detection:
        options = cv2.SimpleBlobDetector_Params()
        options.maxArea = MAX_DISC_SHARE * picture.size
        blobs = cv2.SimpleBlobDetector_create(options)
        for seen in (picture, 255 - picture):
            for how in (grid, grid | cv2.CALIB_CB_CLUSTERING):
                ok, centres = cv2.findCirclesGrid(seen, size, flags=how, blobDetector=blobs)
                if not ok:
                    continue
                pixels = np.asarray(centres, dtype=float).reshape(-1, 2)
                if not asymmetric:
                    of = unmirrored(pixels.reshape(board.rows, board.columns, 2))
                    pixels = pixels[turned_right(pixels, of).ravel()]
                elif _mirrored(pixels, points):
                    continue
                found = _centroids(seen.astype(float), pixels, points, radius, pitch)
                return numbers, found, np.zeros(len(numbers), dtype=np.intp)
        return None

    return find


def _affine(pixels: Array, points: Array) -> Array:
    """(2, 3) affine map of points of the board to pixels, least squares."""
    A = np.column_stack([points, np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(A, pixels)[0].T)


def _mirrored(pixels: Array, points: Array) -> bool:
    return bool(np.linalg.det(_affine(pixels, points)[:, :2]) < 0)


def _centroids(picture: Array, pixels: Array, points: Array, radius: float, pitch: float) -> Array:
    """Centroids (m, 2) of the discs near ``pixels``, of which each lies by the point of the board."""
    height, width = picture.shape
    found, room = pixels.copy(), 0.5 * pitch - radius
    for k in range(len(pixels)):
        near = np.argsort(np.sum((points - points[k]) ** 2, axis=-1), kind="stable")[:7]
        to_pixels = _affine(pixels[near], points[near])[:, :2]
        to_board = np.linalg.inv(to_pixels)
        edge = min(EDGE_PX / (room * np.sqrt(abs(np.linalg.det(to_pixels)))), 0.5 * PAPER_TO)
        reach = 0.5 * pitch * np.linalg.norm(to_pixels, axis=1) + 2.0  # half the size of a window that holds it
        at = pixels[k]
        for _ in range(3):  # rounds in which the window follows the centroid
            low = np.maximum(np.floor(at - reach), 0).astype(int)
            high = np.minimum(np.ceil(at + reach) + 1, (width, height)).astype(int)
            v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
            d = np.stack([u - at[0], v - at[1]], axis=-1)
            away = (np.linalg.norm(d @ to_board.T, axis=-1) - radius) / room  # 0: edge, 1: half way
            grey = picture[low[1] : high[1], low[0] : high[0]]
            paper, inner = (away > edge) & (away < PAPER_TO), away < -0.5 * radius / room
            if paper.sum() < 8 or inner.sum() < 4:
                break
            A = np.stack([np.ones(grey.shape), d[..., 0], d[..., 1]], axis=-1)
            light = A @ np.linalg.lstsq(A[paper], grey[paper])[0]  # uneven light is a plane about the disc
            dark = float(np.median(grey[inner]))
            w = np.where(away < edge, (light - grey) / np.maximum(light - dark, 1.0), 0.0)
            step = np.einsum("ij,ijk->k", w, d) / max(float(w.sum()), 1e-9)
            if not np.linalg.norm(step) < reach.max():
                break
            at = at + step
        found[k] = at
    return found
