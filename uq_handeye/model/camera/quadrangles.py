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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from .adjustment.opencv import opencv
from .corner_refinement import Picture

# Half the length of the profile across an edge; twice that where edges are placed.
MAX_HALF_PROFILE_PX = 5.0
# The next structure inside or outside of an edge is nearer by so much, because it is blurred; and the rim of the paper,
# which is where the white begins to fall.
EDGE_BLUR_PX, RIM_BLUR_PX = 2.5, 1.5
# Profiles of an edge, and parts of it that are placed.
PLACES, PARTS = 48, 6
# Least white beyond an edge, where the rim of the paper is near.
MIN_WHITE_PX = 2.5
# Fall of the grey beyond an edge, as a share of the contrast, by which the rim of the paper is known.
RIM_FALL_SHARE = 0.06
# A profile with less than this share of the median contrast of its edge is not of that edge.
CLEAR_CONTRAST_SHARE = 0.4
# Offsets farther from the line of their edge than this, in robust standard deviations, do not count.
MAX_OFFSET_SD = 3.0


def corners_by_edges(
    picture: Picture, quads: Array, border: float, gap: float, rounds: int = 5
) -> tuple[Array, NDArray[np.bool_]]:
    """Corners (k, 4, 2) of quadrangles whose corners are known to a few pixels, in their order around each; and which
    of the quadrangles (k,) have four clear edges.

    ``border`` and ``gap`` are how far the nearest structure is inside and outside of an edge, as shares of its length.
    Outside the rim of the paper may be nearer: it is looked for in the picture.
    """
    grey, found = picture.astype(np.float32), np.array(quads, dtype=float)
    for _ in range(2):  # to about a pixel
        edges = _Edges.of(found)
        found = _placed(grey, edges, edges.width * border, edges.width * gap)
    for k in range(rounds):
        edges = _Edges.of(found)
        inner, outer = edges.width * border, edges.width * gap
        if k < 2:  # the rim of the paper is looked for in the first rounds
            rim = _rim(grey, edges, inner, outer)
        h = np.clip(np.minimum(np.minimum(inner, outer) - EDGE_BLUR_PX, rim - RIM_BLUR_PX), 1.0, MAX_HALF_PROFILE_PX)
        offset, clear = _offsets(grey, edges, h)
        line, enough = _lines(edges.s, offset, clear)
        found = edges.meet(line * enough[..., None])  # others stay where they are
    good = enough.all(axis=1) & ((rim >= MIN_WHITE_PX) | (rim >= edges.width * gap)).all(axis=1)
    moved = np.linalg.norm(found - quads, axis=-1).max(axis=1)
    size = np.linalg.norm(np.roll(found, -1, axis=1) - found, axis=-1).min(axis=1)
    good &= np.isfinite(found).all(axis=(1, 2)) & (moved < np.maximum(3.0, 0.2 * size))
    return found, good


class _Edges(NamedTuple):
    """Edges of quadrangles, and the places along each at which its profile is taken."""

    start: Array  # (k, 4, 2)
    tangent: Array  # (k, 4, 2)
    outward: Array  # (k, 4, 2)
    width: Array  # (k, 4) of the quadrangle across the edge
    s: Array  # (k, 4, places) along the edge

    @classmethod
    def of(cls, quads: Array) -> _Edges:
        along, area = np.roll(quads, -1, axis=1) - quads, _area(quads)
        length = np.maximum(np.linalg.norm(along, axis=-1), 1e-9)
        tangent = along / length[..., None]
        outward = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1) * np.sign(area)[:, None, None]
        tip = np.minimum(3.0, 0.2 * length)  # pixels at both ends of an edge that are left out
        places = (np.arange(PLACES) + 0.5) / PLACES
        s = tip[..., None] + (length - 2 * tip)[..., None] * places
        return cls(quads, tangent, outward, np.abs(area)[:, None] / (2.0 * length), s)

    def profiles(self, grey: NDArray[np.float32], o: Array) -> Array:
        """Grey (k, 4, places, across) at the distances ``o`` (k, 4, across) outside of the edges."""
        cv2 = opencv()
        at = (self.start[..., None, :] + self.s[..., None] * self.tangent[..., None, :])[..., None, :]
        at = at + o[:, :, None, :, None] * self.outward[..., None, None, :]
        flat = at.astype(np.float32).reshape(4 * len(at), at.shape[2] * at.shape[3], 2)
        seen = cv2.remap(grey, flat[..., 0], flat[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(seen.reshape(at.shape[:-1]), dtype=float)

    def meet(self, line: Array) -> Array:
        """Corners (k, 4, 2) of the edges moved by intercept and slope (k, 4, 2) along ``s``."""
        return _meet(self.start + line[..., :1] * self.outward, self.tangent + line[..., 1:] * self.outward)


def _placed(grey: NDArray[np.float32], edges: _Edges, inner: Array, outer: Array) -> Array:
    """Return the corners where edges are moved to the steepest rise of the grey, to about a pixel.

    What a profile meets inside and outside of the edge, bits and the rim of the paper, falls outwards.
    """
    reach = np.stack([np.minimum(0.8 * room, 2 * MAX_HALF_PROFILE_PX) for room in (inner, outer)], axis=-1)
    both = reach[..., :1] * np.linspace(-1, 0, 17)[:-1], reach[..., 1:] * np.linspace(0, 1, 17)
    o = np.concatenate(both, axis=-1)
    parts = edges.profiles(grey, o).reshape(*o.shape[:2], PARTS, PLACES // PARTS, o.shape[-1]).mean(axis=3)
    # Rise over about two pixels.
    rise = parts[..., 2:] - parts[..., :-2]
    run = o[..., 2:] - o[..., :-2]
    steepest = np.argmax(rise / run[:, :, None], axis=-1)  # (k, 4, parts)
    offset = np.take_along_axis(o[..., 1:-1], steepest, axis=-1)
    s = edges.s.reshape(*o.shape[:2], PARTS, -1).mean(axis=-1)
    line, _ = _lines(s, offset, np.ones(offset.shape, dtype=bool))
    return edges.meet(line)


def _rim(grey: NDArray[np.float32], edges: _Edges, inner: Array, outer: Array) -> Array:
    """Return how far outside of each edge (k, 4) the white ends, where it does before ``outer``."""
    o = outer[..., None] * np.linspace(0.0, 1.0, 65)
    white = np.median(edges.profiles(grey, o), axis=2)  # (k, 4, across)
    black = np.median(edges.profiles(grey, -0.5 * inner[..., None]), axis=2)
    white = white - black
    lightest = np.maximum.accumulate(white, axis=-1)
    ends = (white < (1.0 - RIM_FALL_SHARE) * lightest) & (o > 1.0)
    return np.where(ends.any(axis=-1), np.take_along_axis(o, ends.argmax(axis=-1)[..., None], axis=-1)[..., 0], outer)


def _offsets(grey: NDArray[np.float32], edges: _Edges, h: Array) -> tuple[Array, Array]:
    """Return how far (k, 4, places) outside of the line the edge is, and whether there is one."""
    seen = edges.profiles(grey, h[..., None] * np.linspace(-1.0, 1.0, 33))
    # of the ends the mean over the places of the edge: they are of one black and one white
    low, high = np.median(seen[..., 0], axis=-1), np.median(seen[..., -1], axis=-1)
    contrast = np.maximum(high - low, 1e-9)
    share = (seen - low[..., None, None]) / contrast[..., None, None]
    total = 0.5 * (share[..., 1:] + share[..., :-1]).mean(axis=-1)  # integral over 2h
    offset = h[..., None] * (1.0 - 2.0 * total)
    clear = (seen[..., -1] - seen[..., 0] > CLEAR_CONTRAST_SHARE * contrast[..., None]) & (high - low > 5.0)[..., None]
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
