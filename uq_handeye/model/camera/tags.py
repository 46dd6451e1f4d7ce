r"""Tags in a picture: grids of them, also in part, and single ones, by OpenCV's ArUco module.

Kalibr's AprilGrid has tags with a black border two cells wide, and small black squares between the corners of
neighbouring tags, which make chessboard corners of them: these are refined as such. Other corners are where the edges
of a tag meet (`edges`). Grids printed with a border of one cell, or without squares, are read as well.

Grid of tags as the pictures show it: how many columns it has, and how far its tags are apart.

The four corners of a tag give the plane of the board in units of its side, in which a neighbour lies at (1 + gap, 0).
That is as exact as the tags are large, and does without a camera.

Tags that are in pictures in which the board was not found: their dictionary and ids, for the message.

Corners of dark quadrangles on white: straight lines fitted to the four edges of each, and their intersections.

``cornerSubPix`` draws the corner of a single dark square inwards, as blur rounds its tip. Here the tip is left out.
Along each edge the grey is looked at across it, from h pixels inside to h pixels outside, and the edge is where a step
from the inner to the outer grey has the same sum as what is there,

    o = h - integral_{-h}^{h} (I(x) - I(-h)) dx / (I(h) - I(-h))

which blur, pixels and symmetric smoothing do not change. A line through the o of an edge, once more without those far
off it, gives one of the two lines of a corner.

A lens that bends edges moves such a corner, too: the line of an edge of length L with the curvature kappa is off by
``-kappa L^2 / 12`` at its ends, which `adjustment.bent_edges` takes out; it knows these corners by a negative window.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError
from .adjustment.initial_guess import opencv
from .description import APRILTAGS, WIDEST, Board, dictionary_of, drawn_upside_down
from .squares import Found, Picture, refined

Tags = tuple[NDArray[np.intp], Array]  # ids (k,) and corners (k, 4, 2) of one picture
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
# Offset across, in sides, up to which a tag is a neighbour in a row or column.
ALIGNED = 0.25
# Pairs of neighbours of which there must be so many, and pictures that are looked at.
FEWEST_SEEN, MOST_COLUMNS = 8, 40
# Difference of the gap from the one that was given, in sides, and in standard errors, from which on it is wrong; and
# what the distortion of a wide lens makes of it, times the square of the share of the picture that a tag is wide.
WRONG, CLEAR_GRID, BENT = 0.006, 6.0, 3.0


class Grid(NamedTuple):
    """Columns, gap (sides) with its standard error, and whether ids grow upwards; None: not seen."""

    columns: int | None
    gap: float | None
    error: float = np.inf
    upwards: bool | None = None


def grid_as_seen(pictures: list[Tags]) -> Grid:
    """Return what neighbouring tags say of their grid."""
    along: list[float] = []
    down: list[int] = []
    turns: list[float] = []
    for ids, quads in pictures[:MOST_COLUMNS]:
        for k, quad in enumerate(quads):
            H = opencv().getPerspectiveTransform(quad.astype(np.float32), SQUARE.astype(np.float32))
            at = opencv().perspectiveTransform(quads.reshape(-1, 1, 2), H).reshape(-1, 4, 2).mean(axis=1) - 0.5
            near = (np.abs(at) < 2.0 + WIDEST).all(axis=1) & (np.abs(at).max(axis=1) > 0.5)
            row = near & (np.abs(at[:, 1]) < ALIGNED) & (np.abs(ids - ids[k]) == 1)
            along += np.abs(at[row, 0]).tolist()
            right = np.sign(np.sum(at[row, 0] * (ids[row] - ids[k])))  # of growing ids; the tag may stand upside down
            column = near & (np.abs(at[:, 0]) < ALIGNED)
            if column.any():
                nearest = np.argmin(np.where(column, np.abs(at[:, 1]), np.inf))
                down.append(abs(int(ids[nearest] - ids[k])))
                turns.append(right * np.sign(at[nearest, 1] * (ids[nearest] - ids[k])))
    columns = int(np.median(down)) if len(down) >= FEWEST_SEEN else None
    upwards = bool(np.sum(turns) < 0) if abs(np.sum(turns)) >= FEWEST_SEEN else None
    if len(along) < FEWEST_SEEN:
        return Grid(columns, None, upwards=upwards)
    values = np.array(along) - 1.0
    gap = float(np.median(values))
    return Grid(columns, gap, 1.5 * float(np.median(np.abs(values - gap))) / np.sqrt(len(values)), upwards)


def contradiction(board: Board, pictures: list[Tags], width: int) -> str | None:
    """Return what the pictures, so many pixels wide, say against a grid of tags; None: nothing."""
    if min(board.columns, board.rows) < 2:
        return None
    found = grid_as_seen(pictures)
    if found.columns is not None and found.columns != board.columns and found.columns > 0:
        return (
            f"The tags of the pictures lie in rows of {found.columns}, not of {board.columns}: give columns and rows, "
            f"--board {found.columns}xROWS."
        )
    if found.upwards is not None and found.upwards != (board.kind == "aprilgrid"):
        kind, way = ("aprilgrid", "upwards, as those of Kalibr") if found.upwards else ("aruco", "downwards")
        return f"The ids of the tags grow {way}: it is kind={kind!r} (--pattern {kind})."
    given = board.gap / board.side
    sides = [np.linalg.norm(quads[:, 1] - quads[:, 0], axis=1) for _, quads in pictures]
    share = float(np.median(np.concatenate(sides))) / width if sides else 0.0
    if found.gap is None or abs(found.gap - given) < max(WRONG + BENT * share**2, CLEAR_GRID * found.error):
        return None
    if board.kind == "aprilgrid":
        option = f"spacing={found.gap:.3g} (--spacing {found.gap:.3g})"
    else:
        option = f"`spacing` about {1e3 * found.gap * board.side:.3g} mm (--spacing)"
    return (
        f"The tags of the pictures are {found.gap:.3g} of their side apart, not {given:.3g}. Measure the gap and give "
        f"it: {option}."
    )


SIZES = (50, 100, 250, 1000)
FAMILIES = (*APRILTAGS, *(f"{k}X{k}_1000" for k in (4, 5, 6, 7)), "ARUCO_ORIGINAL")
# Share of the pictures in which an id is no chance.
OFTEN = 0.5
NAMED = 6


def other_tags(board: Board, pictures: Iterable[Picture]) -> str:
    """Return a sentence on the tags in pictures in which ``board`` is not; empty if there are none."""
    pictures = list(pictures)
    (name, ids), (mirrored, others) = (_commonest_tags([one[:, ::way] for one in pictures]) for way in (1, -1))
    if len(others) > max(2 * len(ids), FEWEST):
        return f" The pictures are mirror images: mirrored, they show tags of {mirrored}. Flip them."
    if not ids:
        return ""
    seen = f" The pictures show tags of {name}: {', '.join(map(str, ids[:NAMED]))}{' and more' * (len(ids) > NAMED)}"
    if board.kind == "chessboard":
        return f"{seen}. If the board has tags, name its kind (--pattern charuco, aprilgrid, aruco or apriltag)."
    if max(ids) < len(dictionary_of(board.dictionary).bytesList) and _same_family(name, str(board.dictionary)):
        return f"{seen}. These are of the dictionary that was looked for: check columns, rows and kind of the board."
    return f"{seen} (--dictionary {name})."


def _same_family(one: str, other: str) -> bool:
    """Return whether small dictionaries are parts of the same large one: 4X4_50 and 4X4_250."""
    first, second = (name if name in FAMILIES else name.partition("_")[0] for name in (one.upper(), other.upper()))
    return first == second


def _commonest_tags(pictures: list[Picture]) -> tuple[str, list[int]]:
    """Return the dictionary with most ids that are in many of the pictures, the smallest that has them; and these."""
    found: dict[str, list[int]] = {}
    cv2 = opencv()
    for name in FAMILIES:
        counts: Counter[int] = Counter()
        for border in (1, 2) if name in APRILTAGS else (1,):
            how = cv2.aruco.DetectorParameters()
            how.markerBorderBits = border
            detector = cv2.aruco.ArucoDetector(dictionary_of(name), how)
            for picture in pictures:
                _, ids, _ = detector.detectMarkers(np.ascontiguousarray(picture))
                counts.update(set(() if ids is None else np.asarray(ids).ravel().tolist()))
        found[name] = sorted(number for number, count in counts.items() if count >= OFTEN * len(pictures))
    name = max(found, key=lambda name: len(found[name]))
    ids = found[name]
    if ids and name.endswith("_1000"):
        name = f"{name[:3]}_{next(size for size in SIZES if max(ids) < size)}"
    return name, ids


PLACES = 48  # along an edge
ACROSS = 33  # places across it
TIP = 3.0  # pixels at both ends of an edge that are left out, and at most this share of it:
TIP_SHARE = 0.2
# Half the profile in pixels: at most, at least, and so much shorter than the distance to the next structure, which is
# blurred as well.
FARTHEST, NEAREST, BLURRED = 5.0, 1.0, 2.0
ROUNDS = 9
WIDE = 4  # rounds with twice as long profiles
CLEAR = 0.4  # share of the median contrast below which a profile is not of the edge
FAR = 3.0  # robust standard deviations beyond which a place does not count


def corners_by_edges(picture: Picture, quads: Array, border: float, gap: float) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (k, 4, 2) of quadrangles whose corners are known to a few pixels, in their order around each; and which
    of the quadrangles (k,) have four clear edges.

    ``border`` and ``gap`` are how far the nearest structure is inside and outside of an edge, as shares of its length.
    """
    grey, found = picture.astype(np.float32), np.array(quads, dtype=float)
    inside = _area(found)
    for k in range(ROUNDS):
        start, along = found, np.roll(found, -1, axis=1) - found
        length = np.maximum(np.linalg.norm(along, axis=-1), 1e-9)
        tangent = along / length[..., None]
        outward = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1) * np.sign(inside)[:, None, None]
        room = np.abs(inside)[:, None] / (2.0 * length) * min(border, gap)  # area over length: the width across it
        h = np.clip(room - BLURRED, NEAREST, FARTHEST)
        h = np.maximum(h, np.minimum(0.8 * room, 2 * FARTHEST)) if k < WIDE else h
        tip = np.minimum(TIP, TIP_SHARE * length)
        s = tip[..., None] + (length - 2 * tip)[..., None] * (np.arange(PLACES) + 0.5) / PLACES  # (k, 4, PLACES)
        offset, clear = _offsets(grey, start, tangent, outward, s, h)
        line, enough = _lines(s, offset, clear)
        line = line * enough[..., None]  # others stay where they are
        point = start + line[..., :1] * outward
        direction = tangent + line[..., 1:] * outward
        found = _meet(point, direction)
    good = enough.all(axis=1)
    moved = np.linalg.norm(found - quads, axis=-1).max(axis=1)
    size = np.linalg.norm(np.roll(found, -1, axis=1) - found, axis=-1).min(axis=1)
    good &= np.isfinite(found).all(axis=(1, 2)) & (moved < np.maximum(3.0, 0.2 * size))
    return found, good


def _offsets(
    grey: NDArray[np.float32], start: Array, tangent: Array, outward: Array, s: Array, h: Array
) -> tuple[Array, Array]:
    """Return how far (k, 4, PLACES) outside of the line the edge is, and whether there is one."""
    cv2 = opencv()
    o = h[..., None] * np.linspace(-1.0, 1.0, ACROSS)
    at = (start[..., None, :] + s[..., None] * tangent[..., None, :])[..., None, :]
    at = at + o[:, :, None, :, None] * outward[..., None, None, :]  # (k, 4, PLACES, ACROSS, 2)
    flat = at.astype(np.float32).reshape(-1, PLACES * ACROSS, 2)
    seen = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = seen.reshape(at.shape[:-1]).astype(float)
    # of the ends the mean over the places of the edge: they are of one black and one white
    low, high = np.median(seen[..., 0], axis=-1), np.median(seen[..., -1], axis=-1)
    contrast = np.maximum(high - low, 1e-9)
    share = (seen - low[..., None, None]) / contrast[..., None, None]
    total = 0.5 * (share[..., 1:] + share[..., :-1]).mean(axis=-1)  # integral over 2h
    offset = h[..., None] * (1.0 - 2.0 * total)
    clear = (seen[..., -1] - seen[..., 0] > CLEAR * contrast[..., None]) & (high - low > 5.0)[..., None]
    return offset, clear & (np.abs(offset) < 0.8 * h[..., None])


def _lines(s: Array, offset: Array, clear: Array) -> tuple[Array, Array]:
    """Intercept and slope (k, 4, 2) of the offsets over s, and where there are enough of them (k, 4)."""
    weight = clear.astype(float)
    line = np.zeros((*s.shape[:2], 2))
    for _ in range(2):
        total = np.maximum(weight.sum(axis=-1), 1e-9)
        middle, mean = (weight * s).sum(axis=-1) / total, (weight * offset).sum(axis=-1) / total
        away = s - middle[..., None]
        slope = (weight * away * offset).sum(axis=-1) / np.maximum((weight * away**2).sum(axis=-1), 1e-9)
        line = np.stack([mean - slope * middle, slope], axis=-1)
        left = np.abs(offset - line[..., :1] - line[..., 1:] * s)
        scale = 1.4826 * np.median(np.where(clear, left, np.nanmax(left)), axis=-1)
        weight = clear * (left < np.maximum(FAR * scale, 0.02)[..., None])
    return line, weight.sum(axis=-1) > 0.4 * PLACES


def _meet(point: Array, direction: Array) -> Array:
    """Points (k, 4, 2) in which each line meets the one before it."""
    before, way = np.roll(point, 1, axis=1), np.roll(direction, 1, axis=1)
    cross = way[..., 0] * direction[..., 1] - way[..., 1] * direction[..., 0]
    between = point - before
    t = between[..., 0] * direction[..., 1] - between[..., 1] * direction[..., 0]
    t = t / np.where(cross == 0, np.nan, cross)
    return np.asarray(before + t[..., None] * way)


def _area(quads: Array) -> Array:
    """Twice the area (k,) of quadrangles (k, 4, 2), positive where they run clockwise as the picture is seen."""
    x, y = quads[..., 0], quads[..., 1]
    return np.asarray((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))


# Fewest tags of a grid that are worth a pose: one has two.
FEWEST = 2
# How much darker than its surroundings black is (`adaptiveThreshConstant`): that of OpenCV, which poor contrast needs,
# and where tags are missing a larger one, which parts tags that blur joins to the squares at their corners.
CONSTANTS = (7.0, 15.0)
# Half the side of the window of a chessboard corner, as a share of the distance to the next structure.
SHARE = 0.6
# Tags farther from their place in the grid than this share of their side are others.
ASTRAY = 0.5
# Pixels from the rim of the picture within which a corner is not used.
RIM = 3
# Grey beyond a corner, between black 0 and white 1, below which there is a square.
DARK = 0.35
MOST = 0.5  # share of the corners of a print with squares that have one, at least


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


def tag_finder(board: Board, seen: list[tuple[NDArray[np.intp], Array]] | None = None) -> Callable[[Picture], Found]:
    """Return the function that finds the corners of the board in a picture; tags of each go to ``seen``."""
    cv2, words, layout = opencv(), dictionary_of(board.dictionary), layout_of(board)
    if int(layout.ids.max()) >= len(words.bytesList):
        raise InputError(
            f"The {board} needs tags up to {layout.ids.max()}, and {board.dictionary} has {len(words.bytesList)}: name "
            "another `dictionary` (--dictionary), or a smaller `first_id` (--first-id)."
        )

    def detector(border: int, constant: float) -> Any:
        how = cv2.aruco.DetectorParameters()
        how.markerBorderBits, how.adaptiveThreshConstant = border, constant
        return cv2.aruco.ArucoDetector(words, how)

    wanted = set() if board.single and board.first_id is None else set(layout.ids.tolist())

    def detected(picture: Picture, border: int) -> tuple[NDArray[np.intp], Array]:
        """Ids (k,) and corners (k, 4, 2) of tags, some perhaps twice."""
        ids: list[int] = []
        quads: list[Array] = []
        for one in detectors[border]:
            corners, numbers, _ = one.detectMarkers(picture)
            if numbers is not None:
                ids += np.asarray(numbers).ravel().tolist()
                quads += [np.asarray(corner, dtype=float).reshape(4, 2) for corner in corners]
            if wanted.issubset(ids) and ids:
                break
        return np.array(ids, dtype=np.intp), np.array(quads).reshape(-1, 4, 2)

    borders = [2, 1] if board.kind == "aprilgrid" else [1, 2]
    detectors = {border: [detector(border, constant) for constant in CONSTANTS] for border in borders}
    upside_down = drawn_upside_down(board.dictionary)
    # Which corner of OpenCV's is the upper left one. Grids of AprilTags are about that OpenCV 4 drew.
    turns = [2, 0] if upside_down else [0, 2]
    turns = turns if str(board.dictionary).startswith("APRILTAG") and not board.single else turns[:1]

    def find(picture: Picture) -> Found:
        for border in borders:
            ids, quads = detected(picture, border)
            if not len(ids):
                continue
            share = border / (words.markerSize + 2 * border)
            quads, good = corners_by_edges(picture, quads, share, _room(board))
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
    far = np.array(picture.shape[::-1]) - 1 - RIM
    return np.asarray(((quads >= RIM) & (quads <= far)).all(axis=(1, 2)))


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
    if len(np.unique(rows)) < FEWEST:
        return None
    best: tuple[int, int, Array, NDArray[np.bool_]] | None = None
    for turn in turns:
        turned = np.roll(quads, -turn, axis=1)
        off = _off(layout.points[rows], turned)
        size = _size(quads)
        near = off < ASTRAY * size
        for row in np.unique(rows[near]):  # of the same id the nearest
            same = np.flatnonzero((rows == row) & near)
            near[same] = False
            near[same[np.argmin(off[same])]] = True
        if best is None or near.sum() > best[0]:
            best = int(near.sum()), turn, turned, near
    assert best is not None
    if best[0] < FEWEST:
        return None
    turns.sort(key=lambda turn: turn != best[1])  # it will be this one in all pictures
    return rows[best[3]], best[2][best[3]]


def _size(quads: Array) -> Array:
    """(k,) mean side in pixels."""
    return np.asarray(np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1).mean(axis=1))


def _off(points: Array, quads: Array) -> Array:
    """(k,) pixels by which the tags are off a homography of most of them."""
    within = 0.5 * ASTRAY * float(np.median(_size(quads)))
    H, _ = opencv().findHomography(points.reshape(-1, 1, 2), quads.reshape(-1, 1, 2), opencv().RANSAC, within)
    if H is None:
        return np.full(len(quads), np.inf)
    away = opencv().perspectiveTransform(points.reshape(-1, 1, 2), H).reshape(quads.shape) - quads
    return np.asarray(np.linalg.norm(away, axis=-1).max(axis=1))


def _seen(layout: Layout, tags: NDArray[np.intp], quads: Array, picture: Picture, border: float) -> Found:
    """Numbers, pixels and windows of the corners; where black squares touch tags, refined as those of a chessboard."""
    size = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=-1)
    size = np.sqrt(size * np.roll(size, 1, axis=1))  # (k, 4) of both edges that meet in a corner
    window = -np.rint(size).astype(np.intp)
    pixels = quads.copy()
    if layout.board.kind == "aprilgrid" and not layout.board.single:
        crossed = _crossed(layout.board, quads, picture)
        if crossed.mean() > MOST:
            room = size * min(border, _room(layout.board))
            found, width = refined(picture, quads[crossed], SHARE, room[crossed])
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
    return np.asarray(square - dark < DARK * (white - dark))


def _grey(picture: Picture, at: Array) -> Array:
    at = at.astype(np.float32)
    return np.asarray(opencv().remap(picture.astype(np.float32), at[..., 0], at[..., 1], opencv().INTER_LINEAR))
