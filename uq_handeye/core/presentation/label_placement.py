"""Names beside points in a small panel: each with a leader, clear of the points, the lines and the other names.

Points closer than a few typographic points share one name. Each label takes the place of least cost: what it covers,
what its leader crosses, how far it is. Further rounds move those that later ones left a better place to, and where
something is still crossed, other orders are tried.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from ..geometry.se3 import Array

HALO = [withStroke(linewidth=2.2, foreground="white")]
MAP_HALO = [withStroke(linewidth=2.2, foreground="#fefefe")]  # on a coloured map: white also where the page is dark
_SIZE = 5.6  # of the font, typographic points, as all lengths here
_CLOSE = 4.5  # points nearer than this share a label
_CLEAR = 2.6  # half the square that a point occupies
_RADII, _TURNS = (6, 10, 15, 21, 28, 36, 45, 55), np.radians(np.arange(0, 360, 15))

# Cost of a label that has no place, of a point in the way of a leader, of a point or leader under a label.
_MISSING, _CROSSED, _COVERED = 200.0, 40.0, 70.0
# Orders in which the labels are placed until none is crossed or covered, and rounds of each.
ORDERS, ROUNDS = 30, 3


class Named(NamedTuple):
    """A point with its name, in data coordinates."""

    name: str
    x: float
    y: float
    colour: str


class _Place(NamedTuple):
    anchor: Array  # (2,) where the leader ends
    low: Array  # (2,) corners of the box
    high: Array
    cost: float


def label_points(axis: Axes, named: list[Named], points: Array, lines: Array) -> None:
    """Write the names; ``points`` (k, 2) and the vertices ``lines`` (m, 2) are what to keep clear of."""
    side = axis.get_window_extent().width * 72 / axis.figure.dpi
    corner = np.array([axis.get_xlim()[0], axis.get_ylim()[0]])
    extent = np.array([np.ptp(axis.get_xlim()), np.ptp(axis.get_ylim())])
    points, lines = side * (points - corner) / extent, side * (lines - corner) / extent
    clusters = _clusters(named, side * (np.array([[p.x, p.y] for p in named]).reshape(-1, 2) - corner) / extent)
    places = _layout(clusters, side, points, lines)
    for k, (anchor, members, text) in enumerate(clusters):
        place = places.get(k)
        if place is None:
            continue
        axis.annotate(
            "\n".join(text),
            xy=(anchor[0] / side, anchor[1] / side),
            xytext=tuple((place.low + place.high) / 2 / side),
            xycoords="axes fraction",
            ha="center",
            va="center",
            fontsize=_SIZE,
            color=members[0].colour if len(members) == 1 else "0.15",
            linespacing=1.0,
            path_effects=HALO,
            arrowprops={"arrowstyle": "-", "color": "0.45", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 2},
            zorder=12,
        )


def _layout(
    clusters: list[tuple[Array, list[Named], list[str]]], side: float, points: Array, lines: Array
) -> dict[int, _Place | None]:
    """A place for each label that has one, in the best of some orders."""
    best: tuple[float, dict[int, _Place | None]] = (np.inf, {})
    rng = np.random.default_rng(0)  # the same names have the same places
    for _ in range(ORDERS):
        places: dict[int, _Place | None] = {}
        for k in rng.permutation(len(clusters)).tolist() * ROUNDS:
            anchor, _, text = clusters[k]
            w, h = 0.55 * _SIZE * max(map(len, text)) + 2, 1.15 * _SIZE * len(text)
            others = [place for j, place in places.items() if j != k and place is not None]
            places[k] = _place(anchor, w, h, side, others, points, lines)
        costs = [_MISSING if place is None else place.cost for place in places.values()]
        if sum(costs) < best[0]:
            best = sum(costs), places
        if max(costs, default=0.0) < _CROSSED:
            break
    return best[1]


def _clusters(named: list[Named], where: Array) -> list[tuple[Array, list[Named], list[str]]]:
    """Close points together: where their leader ends, who they are, the lines of their label."""
    groups: list[list[int]] = []
    for k in range(len(named)):
        near = [group for group in groups if np.abs(where[group] - where[k]).max(axis=1).min() < _CLOSE]
        groups = [group for group in groups if group not in near] + [sorted([k, *(j for group in near for j in group)])]
    clusters = []
    for group in sorted(groups):
        centre = where[group].mean(axis=0)
        anchor = where[group][np.argmin(np.linalg.norm(where[group] - centre, axis=1))]
        members = [named[k] for k in group]
        names = [member.name for member in members]
        shown = names if len(names) <= 4 else [*names[:3], f"+{len(names) - 3}"]
        clusters.append((anchor, members, [", ".join(shown[k : k + 2]) for k in range(0, len(shown), 2)]))
    return clusters


def _place(
    anchor: Array, w: float, h: float, side: float, others: list[_Place], points: Array, lines: Array
) -> _Place | None:
    """A box w by h near the anchor, inside the panel and off the other names, of least cost; None: there is none."""
    radii, turns = (grid.ravel() for grid in np.meshgrid(_RADII, _TURNS, indexing="ij"))
    directions = np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    centres = anchor + radii[:, None] * directions + directions * (w / 2, h / 2)
    half = np.array([w, h]) / 2
    low, high = centres - half, centres + half
    free = (low >= 2).all(axis=1) & (high <= side - 2).all(axis=1)
    for other in others:
        free &= ~((low < other.high + 1) & (other.low < high + 1)).all(axis=1)
    if not free.any():
        return None
    cost, centres, low, high = radii[free].astype(float), centres[free], low[free], high[free]
    cost += _COVERED * _inside(points, low - _CLEAR, high + _CLEAR) + 1.5 * _inside(lines, low, high)
    samples = anchor + np.linspace(0, 1, 15)[:, None, None] * (centres - anchor)  # of the leaders
    for point in points[np.abs(points - anchor).max(axis=1) > _CLOSE]:
        cost += _CROSSED * (_distances(point, anchor, centres) < _CLEAR)
    for other in others:
        along = np.linspace(other.anchor, (other.low + other.high) / 2, 15)
        cost += _COVERED * (_inside(along, low, high) > 0)
        cost += _COVERED * ((samples > other.low) & (samples < other.high)).all(axis=-1).any(axis=0)
        cost += _COVERED * _crosses(anchor, centres, along[0], along[-1])
    k = int(np.argmin(cost))
    return _Place(anchor, low[k], high[k], float(cost[k]))


def _inside(points: Array, low: Array, high: Array) -> Array:
    """Count the points (m, 2) that lie in each box, ``low`` to ``high`` (k, 2)."""
    x, y = ((points[:, axis] > low[:, axis, None]) & (points[:, axis] < high[:, axis, None]) for axis in (0, 1))
    return np.asarray((x & y).sum(axis=1), dtype=float)


def _distances(point: Array, start: Array, ends: Array) -> Array:
    """Distances (k,) of a point from the segments between ``start`` and ``ends`` (k, 2)."""
    along = ends - start
    s = np.clip(along @ (point - start) / np.maximum((along * along).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(point - start - s[:, None] * along, axis=1))


def _crosses(start: Array, ends: Array, a: Array, b: Array) -> Array:
    """Return whether the segments between ``start`` and ``ends`` (k, 2) cross that from a to b."""

    def turn(p: Array, q: Array, r: Array) -> Array:
        d, e = q - p, r - p
        return np.asarray(d[..., 0] * e[..., 1] - d[..., 1] * e[..., 0])

    apart = turn(start, ends, a) * turn(start, ends, b) < 0
    return np.asarray(apart & (turn(a, b, start) * turn(a, b, ends) < 0))
