"""Recognition of the grid of the tags in a picture: number of columns, gap between tags, direction of the ids.

The four corners of a tag give the plane of the board in units of its side, in which a neighbour lies at (1 + gap, 0).
This needs no camera, and its accuracy is that of the corners over the size of a tag. `contradiction` compares what the
pictures show with the board that was named.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...core.levels import IMPOSSIBLE
from ...core.presentation.units import MM_PER_M
from .adjustment.opencv import opencv
from .description import MAX_GAP_SIDES, Board

Tags = tuple[NDArray[np.intp], Array]  # ids (k,) and corners (k, 4, 2) of one picture
# A tag is a neighbour in the same row or column where it is off by less than this across, in sides.
MAX_NEIGHBOUR_OFFSET_SIDES = 0.25
# Columns, gap and direction of the ids are used where this number of pairs of neighbours shows them.
MIN_NEIGHBOURS = 8
# The gap that was given is doubted where that of the pictures differs by more than this, in sides; the distortion of a
# wide lens adds this multiple of the square of the share of the picture that a tag is wide.
MIN_GAP_ERROR_SIDES = 0.006
GAP_ERROR_BY_DISTORTION_SIDES = 3.0


def _neighbours(pictures: list[Tags]) -> tuple[list[float], list[int], list[float]]:
    """Return distances (sides) of neighbours in rows; differences of ids in columns, and whether these grow upwards.

    The last are -1 where ids grow upwards in the frame in which they grow to the right, else 1.
    """
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    along: list[float] = []
    down: list[int] = []
    turns: list[float] = []
    for ids, quads in pictures:
        for k, quad in enumerate(quads):
            H = opencv().getPerspectiveTransform(quad.astype(np.float32), square)
            at = opencv().perspectiveTransform(quads.reshape(-1, 1, 2), H).reshape(-1, 4, 2).mean(axis=1) - 0.5
            near = (np.abs(at) < 2.0 + MAX_GAP_SIDES).all(axis=1) & (np.abs(at).max(axis=1) > 0.5)
            row = near & (np.abs(at[:, 1]) < MAX_NEIGHBOUR_OFFSET_SIDES) & (np.abs(ids - ids[k]) == 1)
            along += np.abs(at[row, 0]).tolist()
            right = np.sign(np.sum(at[row, 0] * (ids[row] - ids[k])))  # of growing ids; the tag may stand upside down
            column = near & (np.abs(at[:, 0]) < MAX_NEIGHBOUR_OFFSET_SIDES)
            if column.any():
                nearest = np.argmin(np.where(column, np.abs(at[:, 1]), np.inf))
                down.append(abs(int(ids[nearest] - ids[k])))
                turns.append(right * np.sign(at[nearest, 1] * (ids[nearest] - ids[k])))
    return along, down, turns


def contradiction(board: Board, pictures: list[Tags], width: int) -> str | None:
    """Return what the pictures, ``width`` pixels wide, show against a grid of tags; None: nothing."""
    if min(board.columns, board.rows) < 2:
        return None
    along, down, turns = _neighbours(pictures)
    columns = int(np.median(down)) if len(down) >= MIN_NEIGHBOURS else board.columns
    if columns not in (0, board.columns):
        return (
            f"The tags of the pictures lie in rows of {columns}, not of {board.columns}: give columns and rows, "
            f"--board {columns}xROWS."
        )
    upwards = bool(np.sum(turns) < 0)
    if abs(np.sum(turns)) >= MIN_NEIGHBOURS and upwards != (board.kind == "aprilgrid"):
        kind, way = ("aprilgrid", "upwards, as those of Kalibr") if upwards else ("aruco", "downwards")
        return f"The ids of the tags grow {way}: it is kind={kind!r} (--pattern {kind})."
    if len(along) < MIN_NEIGHBOURS:
        return None
    gaps, given = np.array(along) - 1.0, board.gap / board.side
    gap = float(np.median(gaps))
    error = 1.5 * float(np.median(np.abs(gaps - gap))) / np.sqrt(len(gaps))
    sides = [np.linalg.norm(quads[:, 1] - quads[:, 0], axis=1) for _, quads in pictures]
    share = float(np.median(np.concatenate(sides))) / width
    smallest = MIN_GAP_ERROR_SIDES + GAP_ERROR_BY_DISTORTION_SIDES * share**2
    if abs(gap - given) < max(smallest, np.sqrt(IMPOSSIBLE.chi_square(1)) * error):
        return None
    if board.kind == "aprilgrid":
        option = f"spacing={gap:.3g} (--spacing {gap:.3g})"
    else:
        option = f"`spacing` about {MM_PER_M * gap * board.side:.3g} mm (--spacing)"
    return (
        f"The tags of the pictures are {gap:.3g} of their side apart, not {given:.3g}. Measure the gap and give "
        f"it: {option}."
    )
