r"""Corners of dark quadrangles on white, such as tags: lines fitted to the four edges of each, and their intersections.

``cornerSubPix`` draws the corner of a single dark square inwards, because blur rounds its tip. Here the tips are left
out. The grey profile across an edge runs from h pixels inside to h pixels outside. The edge lies where a step from the
inner to the outer grey has the same integral as the profile,

    o = h - integral_{-h}^{h} (I(x) - I(-h)) dx / (I(h) - I(-h))

which blur, the size of pixels and symmetric smoothing do not change. A line is fitted to the offsets o along an edge,
and once more without outliers; a corner is where the lines of two edges meet.

A lens that bends edges moves such a corner, too: the line of an edge of length L with the curvature kappa is off by
``-kappa L^2 / 12`` at its ends, which `adjustment.bent_edges` takes out; it knows these corners by a negative window.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .corner_refinement import Picture

# Half the length of the profile across an edge; where there is room, twice that in the first half of the rounds.
MAX_HALF_PROFILE_PX = 5.0
# A profile with less than this share of the median contrast of its edge is not of that edge.
MIN_CONTRAST_SHARE = 0.4
# Offsets farther from the line of their edge than this, in robust standard deviations, do not count.
MAX_OFFSET_SD = 3.0


def corners_by_edges(
    picture: Picture, quads: Array, border: float, gap: float, rounds: int = 9
) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (k, 4, 2) of quadrangles whose corners are known to a few pixels, in their order around each; and which
    of the quadrangles (k,) have four clear edges.

    ``border`` and ``gap`` are how far the nearest structure is inside and outside of an edge, as shares of its length.
    """
    grey, found = picture.astype(np.float32), np.array(quads, dtype=float)
    inside = _area(found)
    for k in range(rounds):
        start, along = found, np.roll(found, -1, axis=1) - found
        length = np.maximum(np.linalg.norm(along, axis=-1), 1e-9)
        tangent = along / length[..., None]
        outward = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1) * np.sign(inside)[:, None, None]
        room = np.abs(inside)[:, None] / (2.0 * length) * min(border, gap)  # area over length: the width across it
        h = np.clip(room - 2.0, 1.0, MAX_HALF_PROFILE_PX)  # the next structure is blurred by two pixels as well
        h = np.maximum(h, np.minimum(0.8 * room, 2 * MAX_HALF_PROFILE_PX)) if k < rounds // 2 else h
        tip = np.minimum(3.0, 0.2 * length)  # pixels at both ends of an edge that are left out
        places = np.arange(48) + 0.5
        s = tip[..., None] + (length - 2 * tip)[..., None] * places / len(places)  # (k, 4, places)
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
    """Return how far (k, 4, places) outside of the line the edge is, and whether there is one."""
    cv2 = opencv()
    o = h[..., None] * np.linspace(-1.0, 1.0, 33)
    at = (start[..., None, :] + s[..., None] * tangent[..., None, :])[..., None, :]
    at = at + o[:, :, None, :, None] * outward[..., None, None, :]  # (k, 4, places, across, 2)
    flat = at.astype(np.float32).reshape(4 * len(at), at.shape[2] * at.shape[3], 2)
    seen = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    seen = seen.reshape(at.shape[:-1]).astype(float)
    # of the ends the mean over the places of the edge: they are of one black and one white
    low, high = np.median(seen[..., 0], axis=-1), np.median(seen[..., -1], axis=-1)
    contrast = np.maximum(high - low, 1e-9)
    share = (seen - low[..., None, None]) / contrast[..., None, None]
    total = 0.5 * (share[..., 1:] + share[..., :-1]).mean(axis=-1)  # integral over 2h
    offset = h[..., None] * (1.0 - 2.0 * total)
    clear = (seen[..., -1] - seen[..., 0] > MIN_CONTRAST_SHARE * contrast[..., None]) & (high - low > 5.0)[..., None]
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
        weight = clear * (left < np.maximum(MAX_OFFSET_SD * scale, 0.02)[..., None])
    return line, weight.sum(axis=-1) > 0.4 * s.shape[-1]


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
