r"""A scene that is known, and later pictures that are placed in it.

Its points keep descriptors of their features. A later picture is matched with them, its pose follows from the points
that it shows, and all pictures, old and new, are adjusted together. The frame and the unit of the scene are those of
the old camera poses, to which the adjusted ones are moved back by the similarity a of least squares with the
information U_i of each old pose by itself,

    min_a sum_old (zeta_i - Q_i a)^T U_i (zeta_i - Q_i a)

By the same condition the errors of the new poses are those against the old frame: with B = U Q of the old poses, 0 of
the new, and any covariance P of all poses and the lens, ``P' = T P T^T``, ``T = I - Q (B^T Q)^-1 B^T``.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files.one_line import refused
from ..core.geometry.se3 import Array, difference, inverse, perturb
from ..core.rounding import TINY
from ..errors import InputError
from ..formats.numpy_poses import members
from ..model.camera.models import CORNER_PX
from ..model.errors.joint_covariance import JointCovariance
from . import colmap
from .adjust import Reduced, Scene, adjust, joint_covariance, reduce
from .estimate import MIN_POINTS, Placed
from .lens import Lens
from .poses import similarity
from .tracks import Tracks


class KnownScene(NamedTuple):
    """A scene of old pictures, with descriptors of its points."""

    scene: Scene
    poses: Array  # (n, 4, 4) the camera poses that a result has of it: they define its frame and unit
    described: NDArray[np.intp]  # (d,) observations that have a descriptor, ascending
    descriptors: NDArray[np.uint8]  # (d, 128)
    weak: bool  # whether features of low contrast were looked for


class LaterPictures(NamedTuple):
    """Pictures that were placed in a known scene."""

    rows: NDArray[np.int64]  # their numbers
    poses: Array  # (m, 4, 4)
    covariance: JointCovariance
    shown: NDArray[np.intp]  # (m,) number of points that each shows
    names: tuple[str, ...]  # of all pictures


def known_scene(placed: Placed, poses: Array, seen: colmap.Matched, most: int = 4000) -> KnownScene | None:
    """Return a scene with descriptors of its ``most`` points that most pictures show, two of each.

    None where too few points are seen in three pictures.
    """
    t = placed.scene.tracks
    count = np.bincount(t.point, minlength=t.m)
    kept = np.zeros(t.m, dtype=bool)
    kept[np.argsort(-count, kind="stable")[:most]] = True
    kept &= count > 2
    if kept.sum() < MIN_POINTS:
        return None
    scene = placed.scene.where(kept[t.point])
    t = scene.tracks
    first = t.first
    last = np.append(first[1:], len(t)) - 1
    described = np.unique(np.concatenate([(2 * first + last) // 3, (first + 2 * last + 2) // 3]))
    descriptors = np.zeros((len(described), 128), np.uint8)
    for k, row in enumerate(placed.rows):
        here = np.flatnonzero(t.picture[described] == k)
        number = {tuple(at): i for i, at in enumerate((seen.keypoints[row] - CORNER_PX).tolist())}
        at = [number[tuple(pixel)] for pixel in t.pixels[described[here]].tolist()]
        descriptors[here] = seen.descriptors(row)[at]
    return KnownScene(scene, poses, described, descriptors, seen.weak)


def packed(known: KnownScene | None) -> str:
    """Return a known scene as text (base64), empty for None."""
    if known is None:
        return ""
    scene, buffer = known.scene, io.BytesIO()
    t, lens = scene.tracks, scene.lens
    np.savez_compressed(
        buffer,
        picture=t.picture.astype(np.uint16),
        point=np.diff(t.point, prepend=0).astype(np.uint8),
        pixels=t.pixels.astype(np.float32),
        image_size=np.array(t.image_size),
        names=np.array(t.names),
        adjusted=scene.poses,
        points=scene.points,
        lens=np.stack([lens.values, lens.free, lens.mean, lens.sd]),
        square=np.array(lens.square),
        poses=known.poses,
        described=known.described.astype(np.uint32),
        descriptors=known.descriptors,
        weak=np.array(known.weak),
    )
    return base64.b64encode(buffer.getvalue()).decode()


def unpacked(text: str) -> KnownScene:
    """Return the known scene of `packed`; raises `InputError` for anything else."""
    with refused("the scene of the result cannot be read"):
        of = members(base64.b64decode(text), "the scene of the result")
        width, height = (int(value) for value in of["image_size"])
        names = tuple(map(str, of["names"]))
        point = np.cumsum(of["point"].astype(np.intp))
        tracks = Tracks(of["picture"].astype(np.intp), point, of["pixels"].astype(float), names, (width, height))
        values, free, mean, sd = of["lens"]
        lens = Lens(values, free > 0, mean, sd, bool(of["square"]))
        scene = Scene(tracks, of["adjusted"], of["points"], lens)
        described = of["described"].astype(np.intp)
        beyond = (
            tracks.picture.max() >= len(scene.poses),
            point.max() >= len(scene.points),
            described.max() >= len(point),
        )
        if any(beyond) or len(of["descriptors"]) != len(described) or len(of["poses"]) != len(scene.poses):
            raise InputError("the scene of the result: its arrays do not belong together.")
        return KnownScene(scene, of["poses"], described, of["descriptors"], bool(of["weak"]))


def points_in_frame(known: KnownScene, most: int) -> Array:
    """Return up to ``most`` points (m, 3), without those far away, in the frame and unit of the poses of the result."""
    first, wanted = known.scene.poses[0], known.poses[0]
    spread, of_result = (
        float(np.linalg.norm(at - at.mean(axis=0)))
        for at in (inverse(C)[:, :3, 3] for C in (known.scene.poses, known.poses))
    )
    seen = (known.scene.points @ first[:3, :3].T + first[:3, 3]) * of_result / max(spread, TINY)
    back = inverse(wanted)
    points = np.asarray(seen @ back[:3, :3].T + back[:3, 3])
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    near = np.flatnonzero(away <= 4.0 * np.median(away))
    some = np.linspace(0, len(near) - 1, min(most, len(near))).astype(int)
    return np.asarray(points[near[some]], dtype=float)


def place_pictures(
    known: KnownScene, paths: Sequence[Path], folder: Path, say: Callable[[str], None], max_error: float = 4.0
) -> LaterPictures:
    """Place pictures in a known scene; those that show too little of it are left out.

    ``max_error``: largest residual of an observation, px.

    Raises
    ------
    InputError
        A file that is no picture, or of another size than the old ones.
    NotConvergedError
        The adjustment of all pictures does not converge.
    """
    old = known.scene
    t = old.tracks
    seen = colmap.features(paths, folder, old.lens, None, say, known.weak, image_size=t.image_size)
    say("placing pictures")
    rows: list[int] = []
    poses, parts = [], [(t.picture, t.point, t.pixels)]
    for row, at in enumerate(seen.keypoints):
        feature, point = _matched(seen.descriptors(row), known)
        pixels = at[feature] - CORNER_PX
        if len(feature) < MIN_POINTS:
            continue
        found = colmap.pose_by_points(old.points[point], pixels, old.lens, t.image_size, max_error)
        if found is None or found[1].sum() < MIN_POINTS:
            continue
        kept = found[1]
        parts.append((np.full(int(kept.sum()), t.n + len(rows)), point[kept], pixels[kept]))
        rows.append(row)
        poses.append(found[0])
    names = (*t.names, *(seen.names[row] for row in rows))
    picture, of_point, pixels = (np.concatenate(values) for values in zip(*parts, strict=True))
    tracks = Tracks.of(picture, of_point, pixels, names, t.image_size)
    if rows:
        found_poses, covariance = adjusted_with(known, tracks, np.array(poses))
    else:
        found_poses, covariance = np.zeros((0, 4, 4)), JointCovariance(np.zeros((0, 6, 6)), np.zeros((0, 6, 0)))
    return LaterPictures(np.array(rows, np.int64), found_poses, covariance, tracks.per_picture[t.n :], seen.names)


def adjusted_with(known: KnownScene, tracks: Tracks, start: Array) -> tuple[Array, JointCovariance]:
    """Return camera poses (m, 4, 4) of later pictures with their covariance, in the frame of a known scene.

    ``tracks``: of the old pictures and m later ones behind them; ``start`` (m, 4, 4): where these are about.
    """
    old = known.scene
    whole, noise = adjust(Scene(tracks, np.concatenate([old.poses, start]), old.points, old.lens))
    at = reduce(whole, noise)
    poses = _in_frame(at, whole.poses, known.poses)
    return poses[len(known.poses) :], _against_old(at, poses, len(known.poses))


def _matched(
    descriptors: NDArray[np.uint8], known: KnownScene, max_ratio: float = 0.8, max_angle: float = 0.7
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return features (k,) and points (k,) that are the nearest of each other, by the angles of their descriptors.

    ``max_ratio``: largest ratio of the angle to that of the next point; ``max_angle``: largest angle, rad.
    """
    of_point = known.scene.tracks.point[known.described]
    points, first = np.unique(of_point, return_index=True)
    if not len(descriptors) or len(points) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    new, old = (
        D / np.linalg.norm(D, axis=1, keepdims=True) for D in (np.float32(descriptors), np.float32(known.descriptors))
    )
    cosine = np.empty((len(new), len(points)), np.float32)
    for start in range(0, len(new), 500):  # features at once
        cosine[start : start + 500] = np.maximum.reduceat(new[start : start + 500] @ old.T, first, axis=1)
    two = np.partition(cosine, -2, axis=1)[:, -2:]
    nearest, feature = cosine.argmax(axis=1), np.arange(len(new))
    angle, following = (np.arccos(np.clip(two[:, k], -1.0, 1.0)) for k in (1, 0))
    good = (angle < max_ratio * following) & (angle < max_angle) & (cosine.argmax(axis=0)[nearest] == feature)
    return np.flatnonzero(good), np.asarray(points[nearest[good]], dtype=np.intp)


def _held(at: Reduced, poses: Array, n: int) -> tuple[Array, Array]:
    """Q and B of the module, (6n, 7) each of the first ``n`` poses."""
    Q = similarity(poses[:n])
    return Q, (at.own[:n] @ Q.reshape(n, 6, 7)).reshape(6 * n, 7)


def _in_frame(at: Reduced, poses: Array, wanted: Array) -> Array:
    """Return camera poses moved by the similarity that brings the first ones to those that are ``wanted``."""
    n = len(wanted)
    for _ in range(3):  # first order each
        Q, B = _held(at, poses, n)
        a = np.linalg.solve(B.T @ Q, B.T @ difference(wanted, poses[:n]).ravel())
        poses = perturb(poses, (similarity(poses) @ a).reshape(-1, 6))
    return poses


def _against_old(at: Reduced, poses: Array, n: int) -> JointCovariance:
    """Covariance of the errors of the poses behind the first ``n``, in the frame of those."""
    k = 6 * at.n
    P = joint_covariance(at, None, similarity(poses))[:k, :k]
    Q, B = _held(at, poses, n)
    all_Q = similarity(poses)
    T = np.eye(k)
    T[:, : 6 * n] -= all_Q @ np.linalg.solve(B.T @ Q, B.T)
    P = (T @ P @ T.T)[6 * n :, 6 * n :]
    own = np.linalg.inv(at.own[n:])
    m = len(own)
    h = np.sqrt(np.einsum("nii->ni", own)).ravel()
    rest = P / np.outer(h, h)
    rest.reshape(m, 6, m, 6)[np.arange(m), :, np.arange(m), :] -= own / (h.reshape(m, 6, 1) * h.reshape(m, 1, 6))
    e, E = np.linalg.eigh(0.5 * (rest + rest.T))
    some = e > 1e-6
    shared = (h[:, None] * E[:, some] * np.sqrt(e[some])).reshape(m, 6, -1)
    return JointCovariance(0.5 * (own + own.mT), shared)
