"""An object of the scene that moved between pictures: its points are there twice, at two places.

Each place is a part of the scene that some of the pictures see, so that X does not depend on it. Features that match
although their points are far apart link the two places: where a rigid motion moves many points of one to those of the
other, and no picture shows both, the object moved.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..core.limits import MAX_LISTED
from ..findings import Finding
from ..model.camera.models import CORNER_PX
from .colmap import Matched
from .estimate import Placed


def moved_object(
    placed: Placed, seen: Matched, in_metres: bool, least_points: int = 8, least_share: float = 0.05
) -> Finding | None:
    """Return what is said of the largest object that moved; None where none did.

    It has ``least_points`` or more at each place, and ``least_share`` of all links: of links by chance 2 to 4 of 90
    agree with one motion.
    """
    links = _links(placed, seen)
    least_points = max(least_points, int(np.ceil(least_share * len(links))))
    before, after = placed.scene.points[links].transpose(1, 0, 2)
    kept = _rigid(before, after, 8.0 * _metres_per_pixel(placed), least_points)
    links = links[kept]
    if min(len(np.unique(side)) for side in links.T) < least_points:
        return None
    t = placed.scene.tracks
    first, second = (np.bincount(t.picture[np.isin(t.point, links[:, k])], minlength=t.n) for k in (0, 1))
    if np.minimum(first, second).sum() > 0.1 * min(first.sum(), second.sum()):  # what repeats is seen twice at a time
        return None
    groups = [np.flatnonzero(one > other) for one, other in ((first, second), (second, first))]
    names = [[t.names[k] for k in one[:MAX_LISTED]] for one in sorted(groups, key=lambda one: float(np.median(one)))]
    length = float(np.median(np.linalg.norm(np.diff(placed.scene.points[links], axis=1), axis=-1)))
    values = {
        "before": names[0],
        "after": names[1],
        "points": len(np.unique(links)),
        "of": t.m,
        "length": length if in_metres else None,
    }
    return Finding("scene.moved", "caution", values)


def _links(placed: Placed, seen: Matched, least_px: float = 12.0) -> NDArray[np.intp]:
    """Points (l, 2) whose features match, each seen where the other is not: further off than ``least_px``."""
    t = placed.scene.tracks
    number = []  # the point of each feature of each picture, -1 where it has none
    for row, of_picture in zip(placed.rows, t.of_each_picture, strict=True):
        of = {tuple(at): k for at, k in zip(t.pixels[of_picture].tolist(), t.point[of_picture].tolist(), strict=True)}
        number.append(np.array([of.get(tuple(at), -1) for at in (seen.keypoints[row] - CORNER_PX).tolist()], np.intp))
    place = {int(row): k for k, row in enumerate(placed.rows)}
    found, where = [], []
    for (i, j), matches in seen.raw.items():
        if i not in place or j not in place:
            continue
        pairs = np.stack([number[place[i]][matches[:, 0]], number[place[j]][matches[:, 1]]], axis=1)
        kept = (pairs >= 0).all(axis=1) & (pairs[:, 0] != pairs[:, 1])
        found.append(pairs[kept])
        where.append(np.tile([place[i], place[j]], (int(kept.sum()), 1)))
    links = np.concatenate([*found, np.zeros((0, 2), np.intp)])
    pictures = np.concatenate([*where, np.zeros((0, 2), np.intp)])
    far = np.ones(len(links), dtype=bool)
    for k in (0, 1):  # the other point in the picture of this one
        size = _sizes(placed, pictures[:, k], links[:, k], links[:, 1 - k])
        far &= size > least_px
    return np.unique(links[far], axis=0)


def _sizes(placed: Placed, picture: NDArray[np.intp], point: NDArray[np.intp], other: NDArray[np.intp]) -> Array:
    """Distance (px) between two points in a picture."""
    scene = placed.scene
    at = []
    for which in (point, other):
        tracks = replace(
            scene.tracks, picture=picture, point=np.arange(len(picture)), pixels=np.zeros((len(picture), 2))
        )
        at.append(replace(scene, tracks=tracks, points=scene.points[which]).residuals())
    return np.asarray(np.linalg.norm(at[1] - at[0], axis=-1))


def _metres_per_pixel(placed: Placed) -> float:
    depth = placed.scene.in_camera()[:, 2]
    return float(np.median(depth) / placed.scene.lens.values[0])


def _rigid(before: Array, after: Array, near: float, least: int, draws: int = 1000) -> NDArray[np.bool_]:
    """Return which pairs of points (l, 3) agree with the rigid motion that most of them agree with."""
    # a link says not which of its points was there first: both ways are tried
    P, Q = np.concatenate([before, after]), np.concatenate([after, before])
    best = np.zeros(len(P), dtype=bool)
    if len(before) < least:
        return best[: len(before)]
    rng = np.random.default_rng(0)
    for _ in range(draws):
        # three links of one neighbourhood: an object is small
        one = rng.integers(len(P))
        near_one = np.argsort(np.linalg.norm(P - P[one], axis=1), kind="stable")[:30]
        some = np.append(one, rng.choice(near_one, 2, replace=False))
        R, t = _motion(P[some], Q[some])
        fits = np.linalg.norm(P @ R.T + t - Q, axis=1) < near
        if fits.sum() > best.sum():
            best = fits
    for _ in range(3):
        if best.sum() < 3:
            break
        R, t = _motion(P[best], Q[best])
        best = np.linalg.norm(P @ R.T + t - Q, axis=1) < near
    forth, back = best[: len(before)], best[len(before) :]
    return forth if forth.sum() >= back.sum() else back


def _motion(P: Array, Q: Array) -> tuple[Array, Array]:
    """Rotation and translation that move points P to Q."""
    p, q = P.mean(axis=0), Q.mean(axis=0)
    U, _, Vt = np.linalg.svd((Q - q).T @ (P - p))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return R, q - R @ p
