r"""Detection of tags in a picture, single or in grids that may be seen in part, by OpenCV's ArUco module.

Kalibr's AprilGrid has tags with a black border two cells wide, and small black squares between the corners of
neighbouring tags, which make chessboard corners of them: these are refined as such (`corner_refinement`). Other corners
are where the edges of a tag meet (`quadrangles`). Grids printed with a border of one cell, or without squares, are
read as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from .adjustment.opencv import opencv
from .corner_refinement import Detection, Picture, refined
from .description import Board
from .dictionaries import dictionary_of, drawn_upside_down
from .quadrangles import corners_by_edges

if TYPE_CHECKING:
    from cv2.aruco import ArucoDetector

# Tags of a grid that a picture must show: one may be of another board.
MIN_TAGS = 2
# Corners nearer to the rim of the picture are not used.
MIN_RIM_PX = 3
# Grey beyond a corner, between black 0 and white 1, below which there is a square.
MAX_GREY_OF_SQUARE = 0.35


class Layout(NamedTuple):
    """Places of the tags of a board."""

    board: Board
    ids: NDArray[np.intp]  # (t,)
    numbers: NDArray[np.intp]  # (t, 4) of the corners, clockwise from the upper left
    points: Array  # (t, 4, 2)


def layout_of(board: Board) -> Layout:
    """Return ids and corners of the tags."""
    r, c = (part.ravel() for part in np.indices((board.rows, board.columns)))
    line = board.rows - 1 - r if board.kind == "aprilgrid" else r
    ids = (board.first_id or 0) + line * board.columns + c
    wide = 2 * board.columns
    upper = 2 * r * wide + 2 * c
    numbers = np.stack([upper, upper + 1, upper + wide + 1, upper + wide], axis=1)
    return Layout(board, ids, numbers, board.points[numbers][..., :2])


def tag_finder(
    board: Board, seen: list[tuple[NDArray[np.intp], Array]] | None = None, unclear: list[float] | None = None
) -> Callable[[Picture], Detection]:
    """Return the function that finds the corners of the board in a picture.

    Tags of each picture go to ``seen``; sides (px) of those of the board whose edges are not clear to ``unclear``.
    """
    cv2, words, layout = opencv(), dictionary_of(board.dictionary), layout_of(board)
    if int(layout.ids.max()) >= len(words.bytesList):
        raise InputError(
            f"The {board} needs tags up to {layout.ids.max()}, and {board.dictionary} has {len(words.bytesList)}: name "
            "another `dictionary` (--dictionary), or a smaller `first_id` (--first-id)."
        )

    def detectors_of(border: int) -> list[ArucoDetector]:
        """Return two detectors: as OpenCV has it, which poor contrast needs, and one that parts tags that blur joins.

        Black must be so much darker than its surroundings; where tags are missing, twice as much as by default.
        """
        usual, darker = cv2.aruco.DetectorParameters(), cv2.aruco.DetectorParameters()
        usual.markerBorderBits = darker.markerBorderBits = border
        darker.adaptiveThreshConstant = 15.0
        return [cv2.aruco.ArucoDetector(words, how) for how in (usual, darker)]

    wanted = set() if board.single and board.first_id is None else set(layout.ids.tolist())

    def detected(picture: Picture, border: int) -> tuple[NDArray[np.intp], Array]:
        """Ids (k,) and corners (k, 4, 2) of tags, some perhaps twice."""
        ids: list[int] = []
        quads: list[Array] = []
        for one in detectors[border]:
            corners, numbers, _ = one.detectMarkers(picture)
            if numbers is not None:
                ids += np.asarray(numbers, dtype=np.intp).ravel().tolist()
                quads += [np.asarray(corner, dtype=float).reshape(4, 2) for corner in corners]
            if wanted.issubset(ids) and ids:
                break
        return np.array(ids, dtype=np.intp), np.array(quads).reshape(-1, 4, 2)

    borders = [2, 1] if board.kind == "aprilgrid" else [1, 2]
    detectors = {border: detectors_of(border) for border in borders}
    upside_down = drawn_upside_down(board.dictionary)
    # Which corner of OpenCV's is the upper left one. Grids of AprilTags are about that OpenCV 4 drew.
    turns = [2, 0] if upside_down else [0, 2]
    turns = turns if str(board.dictionary).startswith("APRILTAG") and not board.single else turns[:1]

    def find(picture: Picture) -> Detection:
        for border in borders:
            ids, quads = detected(picture, border)
            if not len(ids):
                continue
            share = border / (words.markerSize + 2 * border)
            rough = quads
            quads, good = corners_by_edges(picture, quads, share, _room(board))
            if unclear is not None:
                of_board = ~good & _inside(rough, picture) & (np.isin(ids, list(wanted)) if wanted else True)
                unclear.extend(_size(rough[of_board]).tolist())
            good = good & _inside(quads, picture)
            if seen is not None:
                seen.append((ids[good], quads[good]))
            chosen = _chosen(layout, ids[good], quads[good], turns)
            if chosen is None:
                continue
            tags, quads = chosen
            return _seen(layout, tags, quads, picture, share)
        return None

    return find


def _room(board: Board) -> float:
    """Return the white around a tag, as a share of its side: the gap of a grid, and what people leave around one."""
    return board.gap / board.side if board.gap else 0.25


def _inside(quads: Array, picture: Picture) -> NDArray[np.bool_]:
    far = np.array(picture.shape[::-1]) - 1 - MIN_RIM_PX
    return np.asarray(((quads >= MIN_RIM_PX) & (quads <= far)).all(axis=(1, 2)))


def _chosen(
    layout: Layout, ids: NDArray[np.intp], quads: Array, turns: list[int]
) -> tuple[NDArray[np.intp], Array] | None:
    """Rows of the layout (k,) and their corners (k, 4, 2), clockwise from the upper left; None: too few tags."""
    board = layout.board
    if board.single:
        wanted = np.ones(len(ids), dtype=bool) if board.first_id is None else ids == board.first_id
        if not wanted.any():
            return None
        largest = int(np.argmax(np.where(wanted, _size(quads), -1.0)))
        return np.array([0]), np.roll(quads[largest], -turns[0], axis=0)[None]
    place = {int(number): k for k, number in enumerate(layout.ids)}
    rows = np.array([place.get(int(number), -1) for number in ids], dtype=np.intp)
    rows, quads = rows[rows >= 0], quads[rows >= 0]
    if len(np.unique(rows)) < MIN_TAGS:
        return None
    best: tuple[int, int, Array, NDArray[np.bool_]] | None = None
    for turn in turns:
        turned = np.roll(quads, -turn, axis=1)
        off = _off(layout.points[rows], turned)
        size = _size(quads)
        near = off < 0.5 * size  # others lie astray by half a side
        for row in np.unique(rows[near]):  # of the same id the nearest
            same = np.flatnonzero((rows == row) & near)
            near[same] = False
            near[same[np.argmin(off[same])]] = True
        if best is None or near.sum() > best[0]:
            best = int(near.sum()), turn, turned, near
    assert best is not None
    if best[0] < MIN_TAGS:
        return None
    turns.sort(key=lambda turn: turn != best[1])  # it will be this one in all pictures
    return rows[best[3]], best[2][best[3]]


def _size(quads: Array) -> Array:
    """(k,) mean side in pixels."""
    return np.asarray(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1).mean(axis=1))


def _off(points: Array, quads: Array) -> Array:
    """(k,) pixels by which the tags are off a homography of most of them."""
    within = 0.25 * float(np.median(_size(quads)))
    H, _ = opencv().findHomography(points.reshape(-1, 1, 2), quads.reshape(-1, 1, 2), opencv().RANSAC, within)
    if H is None:
        return np.full(len(quads), np.inf)
    away = opencv().perspectiveTransform(points.reshape(-1, 1, 2), H).reshape(quads.shape) - quads
    return np.asarray(np.linalg.norm(away, axis=-1).max(axis=1))


def _seen(layout: Layout, tags: NDArray[np.intp], quads: Array, picture: Picture, border: float) -> Detection:
    """Numbers, pixels and windows of the corners; where black squares touch tags, refined as those of a chessboard."""
    size = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1)
    size = np.sqrt(size * np.roll(size, 1, axis=1))  # (k, 4) of both edges that meet in a corner
    window = -np.rint(size).astype(np.intp)
    pixels = quads.copy()
    if layout.board.kind == "aprilgrid" and not layout.board.single:
        crossed = _crossed(layout.board, quads, picture)
        if crossed.mean() > 0.5:  # a print with squares
            room = size * min(border, _room(layout.board))
            found, width = refined(picture, quads[crossed], share=0.6, room=room[crossed])
            near = np.linalg.norm(found - quads[crossed], axis=1) < np.maximum(1.0, 0.5 * room[crossed])
            at = tuple(index[near] for index in np.nonzero(crossed))
            pixels[at], window[at] = found[near], width[near]
    numbers = layout.numbers[tags].ravel()
    order = np.argsort(numbers)
    return numbers[order], pixels.reshape(-1, 2)[order], window.ravel()[order]


def _crossed(board: Board, quads: Array, picture: Picture) -> NDArray[np.bool_]:
    """(k, 4) whether a dark square lies beyond the corner, by the grey in its middle."""
    away = 0.5 * _room(board) * (2 * quads - np.roll(quads, 1, axis=1) - np.roll(quads, -1, axis=1))
    side = 0.5 * _room(board) * (quads - np.roll(quads, 1, axis=1)) + 0.5 * (np.roll(quads, -1, axis=1) - quads)
    inwards = 0.05 * (np.roll(quads, 1, axis=1) + np.roll(quads, -1, axis=1) - 2 * quads)
    square, white, dark = (_grey(picture, quads + shift) for shift in (away, side, inwards))
    return np.asarray(square - dark < MAX_GREY_OF_SQUARE * (white - dark))


def _grey(picture: Picture, at: Array) -> Array:
    at = at.astype(np.float32)
    return np.asarray(opencv().remap(picture.astype(np.float32), at[..., 0], at[..., 1], opencv().INTER_LINEAR))
