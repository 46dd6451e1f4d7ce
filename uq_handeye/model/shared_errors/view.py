r"""Errors of camera poses without corners that depend on the view: those of a lens, a bent target and wrong corners.

Model: the error of a camera pose is a smooth function of the view of the target, the same function for all poses of a
rig. To first order it is linear in six coordinates c of the view, the direction ``t / |t|`` of the target and its
normal, both in the camera frame: centred over the poses (their mean is absorbed by X and W), divided by their
standard deviation where that is above 0.1. Each of them moves each of the six components,

    xi = sum_jk z_jk c_j E_k,      E = ( [theta in rad]; [tau in units of the distance |t|] )

36 columns of one size (rad, and relative to the distance).

*Noise by the view.* The noise of a pose that was fitted to the corners of a flat target has a shape that its distance
and tilt decide (T11): with the derivatives B of the lines of sight u (unit vectors) by the pose the covariance is
``(B^T B)^-1`` per square of their noise. Target and lens are not known here: the target is taken as a ring of points
about the point at which the cameras look (`target_centre`), with a half width of `HALF_WIDTH` times the median
distance, so that only the size of the noise is unknown. The result does not depend on the orientation of the camera's
frame, nor on that of the target's frame about its normal. That the normal is z is a convention of boards and tags, and
data confirm it: against the mean direction of the views, up to 18 degrees away, by 10 to 140 units of log probability.
Where the views contradict it, because they are 60 degrees or more from z and -z on average, the normal is the axis that
is within 35 degrees of their mean direction, such as x of targets in the convention of ROS, or else that direction.

*Intrinsics.* Focal length, centre, distortion and the ratio of the two focal lengths that are wrong by dk move the
directions by A dk (Brown's model, about none), and the poses that were fitted to them by ``-(B^T B)^-1 B^T A dk``. A
wrong centre does not turn such a pose about the camera: a frontal target takes it as a shift.

*Outline of the target.* These effects are those of a square of the usual width about the point at which the cameras
look. Other sides w and h and another place change them, to first order by dk times the change of the outline. As
neither is known, each product is an unknown: ``d xi / (dk dlog w)`` and so on, 32 columns per unit of dk and of the
change.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from ...core.geometry.se3 import Array, skew
from ..errors.columns import MANY_POSES, Products

# Half of the width of the target over its distance.
HALF_WIDTH = 0.15
# Cosine of the tilt of a target that is seen edge-on, and of the line of sight to one that is not in front of the
# camera: with 0 the pose would have an unobservable direction.
MIN_TILT_COSINE = 0.05
# Smallest depth of a point, over the median distance of the target.
MIN_DEPTH = 0.05
# Results of more poses are not kept.
MAX_KEPT_POSES = 20_000
# Standard deviations of k1, k2, p1, p2 and f_x / f_y over the first.
LENS_SHARES = np.array([1.0, 3.0, 0.1, 0.1, 0.05])


def view_scale(camera: Array, least_sd: float = 0.1) -> tuple[Array, Array]:
    """(6,) mean and divisor of the coordinates of the view over poses (n, 4, 4).

    The divisor is their standard deviation, and at least ``least_sd``.
    """
    seen = _coordinates(camera)
    return seen.mean(axis=0), np.maximum(seen.std(axis=0), least_sd)


def columns_about(camera: Array, mean: Array, scale: Array) -> Products:
    """(n, 6, 36) columns at poses (n, 4, 4), with the scale of others."""
    coordinates = (_coordinates(camera) - mean) / scale
    distance = np.linalg.norm(camera[:, :3, 3], axis=-1)
    E = np.zeros((len(camera), 6, 6))
    E[:, range(3), range(3)] = 1.0
    E[:, range(3, 6), range(3, 6)] = distance[:, None]
    return Products(coordinates, E)


def _coordinates(camera: Array) -> Array:
    """(n, 6) direction and normal of the target."""
    t = camera[:, :3, 3]
    normal = camera[:, :3, :3] @ _normal(camera)
    return np.concatenate([t / np.maximum(np.linalg.norm(t, axis=-1, keepdims=True), 1e-12), normal], axis=-1)


def view_block(
    camera: Array,
    distance: float | None = None,
    centre: Array | None = None,
) -> Array:
    """(n, 6, 6) square roots of the covariance of poses (n, 4, 4) for one rad of noise of the lines of sight.

    ``distance`` (m) that gives the target its width and ``centre`` (3,) of its points; None: those of these poses. The
    ring is as wide as gives it the second moments of the square.
    """
    distance = max(median_distance(camera) if distance is None else distance, 1e-6)
    centre = target_centre(camera, distance) if centre is None else centre
    across = _across(camera)  # (2, 3)
    return _in_parts(lambda part: _view_block(part, distance, centre, across), camera)


def _view_block(camera: Array, distance: float, centre: Array, across: Array) -> Array:
    """`view_block` of a target with these axes."""
    R, t = camera[:, :3, :3], camera[:, :3, 3]
    about = R @ centre + t
    own = np.maximum(np.linalg.norm(about, axis=-1), MIN_DEPTH * distance)
    angle = 2.0 * np.pi * np.arange(16) / 16
    turned = (
        HALF_WIDTH * distance * 1.05 * np.stack([np.cos(angle), np.sin(angle)], axis=-1) @ across @ R.mT
    )  # (n, k, 3)
    at = turned + about[:, None]
    away = np.maximum(np.linalg.norm(at, axis=-1), MIN_DEPTH * distance)[..., None]
    u = at / away
    by_point = (np.eye(3) - u[..., None] * u[..., None, :]) / away[..., None]
    by_pose = np.concatenate([-by_point @ skew(turned), by_point], axis=-1).reshape(len(camera), -1, 6)
    information = _bounded(by_pose.mT @ by_pose, len(angle), distance, own)
    root = np.linalg.cholesky(np.linalg.inv(information))
    root[:, 3:] += skew(R @ centre) @ root[:, :3]  # the pose is that of the origin
    return np.asarray(root)


def _in_parts(function: Callable[[Array], Array], camera: Array, together: int = 1000) -> Array:
    """Values of a function of each pose (n, 4, 4), of so many at once."""
    if len(camera) <= together:
        return function(camera)
    starts = range(0, len(camera), together)
    return np.concatenate([function(camera[start : start + together]) for start in starts])


def lines_of_sight(camera: Array) -> Array:
    """(n, 6, 1) a move of poses (n, 4, 4) by one metre away from the camera: the depth, which is noisier than the side.

    It does not depend on the orientation of the camera's frame.
    """
    t = camera[:, :3, 3]
    u = t / np.maximum(np.linalg.norm(t, axis=-1, keepdims=True), 1e-12)
    return np.pad(u, [(0, 0), (3, 0)])[..., None]


def target_centre(camera: Array, distance: float) -> Array:
    """(3,) about where cameras look at a target, in its frame: the point c seen in the same direction, in its plane.

    Least squares over the views, ``u_i(c) = (R_i c + t_i) / |R_i c + t_i|`` against their mean, distances that differ
    do not move it. A target that an arm turns about its wrist has c behind it: what is known of c beforehand is
    `HALF_WIDTH` of the distance from the origin in the plane, and twice that along the normal (standard deviations).
    """
    of = _centre if len(camera) <= MAX_KEPT_POSES else _centre.__wrapped__
    return np.array(of(np.ascontiguousarray(camera, dtype=float).tobytes(), float(distance)))


@functools.lru_cache(maxsize=8)
def _centre(poses: bytes, distance: float) -> Array:
    """`target_centre` of poses (n, 4, 4) as bytes; kept, because every error that follows from the view needs it."""
    camera = np.frombuffer(poses).reshape(-1, 4, 4)
    R, t = camera[:, :3, :3], camera[:, :3, 3]
    axes = np.concatenate([_across(camera), _normal(camera)[None]])  # (3, 3)
    by_c, c, sd = R @ axes.T, np.zeros(3), distance * HALF_WIDTH * np.array([1.0, 1.0, 2.0])
    for _ in range(6):
        at = by_c @ c + t
        length = np.maximum(np.linalg.norm(at, axis=-1), MIN_DEPTH * distance)[:, None]
        u = at / length
        D = (by_c - u[:, :, None] * (u[:, None] @ by_c)) / length[:, :, None]
        off, D = u - u.mean(axis=0), D - D.mean(axis=0)
        prior = max(0.5 * float((off * off).sum()) / len(t), 1e-12) / sd**2
        c = c - np.linalg.solve(
            np.einsum("nij,nik->jk", D, D) + np.diag(prior), np.einsum("nij,ni->j", D, off) + prior * c
        )
        c /= max(1.0, float(np.abs(c / (2.0 * sd)).max()))
    c = c[:2] * min(1.0, 2.0 * HALF_WIDTH * distance / max(float(np.linalg.norm(c[:2])), 1e-12))
    return np.asarray(c @ axes[:2])


def _across(camera: Array) -> Array:
    """(2, 3) axes in the plane of the target."""
    normal = _normal(camera)
    k = int(np.abs(normal).argmax())
    if normal[k] == 1.0:
        return np.eye(3)[[(k + 1) % 3, (k + 2) % 3]]
    return np.asarray(np.linalg.svd(normal[None])[2][1:])


def _normal(camera: Array, largest_angle: float = 1.05, all_around: float = 0.3, near_axis: float = 0.61) -> Array:
    """(3,) the normal of the target, in its frame; see the module.

    z is the normal unless the mean direction of the views is further than ``largest_angle`` (rad) from it, and then
    the axis within ``near_axis`` (rad). A mean shorter than ``all_around`` contradicts nothing.
    """
    towards = -(camera[:, :3, :3].mT @ camera[:, :3, 3, None])[..., 0]  # from the target to the camera
    mean = (towards / np.maximum(np.linalg.norm(towards, axis=-1, keepdims=True), 1e-12)).mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length <= all_around or abs(mean[2]) >= np.cos(largest_angle) * length:
        return np.array([0.0, 0.0, 1.0])
    k = int(np.abs(mean).argmax())
    return np.eye(3)[k] if abs(mean[k]) > np.cos(near_axis) * length else np.asarray(mean / length)


def _bounded(information: Array, count: int, distance: float, own: Array) -> Array:
    """Information of poses without open directions: an edge-on target would leave its tilt open, and one that is far
    away from the others its distance.
    """
    information[:, range(3), range(3)] += count * (MIN_TILT_COSINE * HALF_WIDTH) ** 2
    information[:, range(3, 6), range(3, 6)] += (
        count * (MIN_TILT_COSINE * HALF_WIDTH * distance / own[:, None] ** 2) ** 2
    )
    return information


def intrinsics_columns(camera: Array, distance: float | None = None, centre: Array | None = None) -> Array:
    """(n, 6, 8) errors of poses (n, 4, 4) by those of the intrinsics with which they were fitted, per unit.

    Of the focal length (relative), the image centre x and y (over the focal length, rad), k1, k2, p1, p2 and f_x / f_y.
    ``distance`` (m) that gives the target its width and ``centre`` (3,) of its points; None: those of these poses.
    """
    camera = np.asarray(camera, dtype=float)
    distance = median_distance(camera) if distance is None else distance
    centre = target_centre(camera, distance) if centre is None else centre
    return _by_intrinsics_of(camera, distance, tuple(centre.tolist()))


def outline_columns(camera: Array, distance: float, centre: Array, turn: Array | None = None) -> Array:
    """(n, 6, 32) changes of the `intrinsics_columns` at poses (n, 4, 4) with the outline of the target, or these times
    ``turn`` (32, k).

    By the logarithm of its width, that of its height, and its place along both in its usual half width; derivatives by
    a finite change.
    """
    camera = np.asarray(camera, dtype=float)
    change = 0.1
    before = intrinsics_columns(camera, distance, centre)
    place, half, across = tuple(centre.tolist()), HALF_WIDTH * distance, _across(camera)
    outlines = [(place, (np.exp(change), 1.0)), (place, (1.0, np.exp(change)))]
    outlines += [(tuple((centre + change * half * across[k]).tolist()), (1.0, 1.0)) for k in range(2)]
    changes = ((_by_intrinsics_of(camera, distance, *one) - before) / change for one in outlines)
    if turn is None or len(camera) <= MANY_POSES:
        K = np.concatenate([*changes], axis=-1)
        return K if turn is None else np.asarray(K @ turn)
    found = np.zeros((len(camera), 6, turn.shape[1]))
    for k, K in enumerate(changes):  # one after the other
        found += K @ turn[8 * k : 8 * k + 8]
    return found


def _by_intrinsics_of(
    camera: Array, distance: float, centre: tuple[float, ...], sides: tuple[float, float] = (1.0, 1.0)
) -> Array:
    """`intrinsics_columns` of a target with other sides; kept of at most `MAX_KEPT_POSES` poses."""
    of = _by_intrinsics if len(camera) <= MAX_KEPT_POSES else _by_intrinsics.__wrapped__
    return np.asarray(of(camera.tobytes(), distance, centre, sides))


@functools.lru_cache(maxsize=8)  # focal length, principal point, lens and outline ask for the same poses in turn
def _by_intrinsics(of_poses: bytes, distance: float, centre: tuple[float, ...], sides: tuple[float, float]) -> Array:
    camera = np.frombuffer(of_poses).reshape(-1, 4, 4)
    side = HALF_WIDTH * np.linspace(-1.0, 1.0, 4)
    grid = np.stack(np.meshgrid(sides[0] * side, sides[1] * side), axis=-1).reshape(-1, 2)
    points = np.array(centre) + max(distance, 1e-6) * grid @ _across(camera)
    found = _in_parts(lambda part: _by_lens(part, distance, points), camera)
    found.flags.writeable = False
    return found


def _by_lens(camera: Array, distance: float, points: Array) -> Array:
    """`intrinsics_columns` of a target with these points (k, 3)."""
    x, by_pose, information = _fitted(camera, distance, points)
    r2 = (x * x).sum(axis=-1)
    u, v = x[..., 0], x[..., 1]
    radial = x * r2[..., None]
    by_p1 = np.stack([2 * u * v, r2 + 2 * v * v], axis=-1)
    by_p2 = np.stack([r2 + 2 * u * u, 2 * u * v], axis=-1)
    one = np.broadcast_to(np.eye(2), (*u.shape, 2, 2))
    aspect = 0.5 * x * np.array([1.0, -1.0])
    by_lens = np.stack([x, one[..., 0], one[..., 1], radial, radial * r2[..., None], by_p1, by_p2, aspect], axis=-1)
    return np.asarray(-np.linalg.solve(information, by_pose.mT @ by_lens.reshape(len(camera), -1, 8)))


def median_distance(camera: Array) -> float:
    """Return the median distance (m) of the target at poses (n, 4, 4)."""
    return float(np.median(np.linalg.norm(camera[:, :3, 3], axis=-1)))


def _fitted(camera: Array, distance: float, P: Array) -> tuple[Array, Array, Array]:
    """Directions (n, k, 2) of points P (k, 3) of the target, their derivatives (n, 2k, 6) by the poses, and B^T B.

    The target has four points along each side. Directions with a tangent above 1 count as seen there, or the powers of
    the tangent that a distortion is made of would grow without bound at other poses.
    """
    turned = P @ camera[:, :3, :3].mT  # (n, k, 3)
    at = turned + camera[:, None, :3, 3]
    near = MIN_DEPTH * max(distance, 1e-6)
    z = np.where(np.abs(at[..., 2]) > near, at[..., 2], near)
    directions = at[..., :2] / z[..., None]
    directions /= np.maximum(1.0, np.linalg.norm(directions, axis=-1, keepdims=True))
    by_point = np.zeros((*at.shape[:-1], 2, 3))
    by_point[..., 0, 0] = by_point[..., 1, 1] = 1.0 / z
    by_point[..., 2] = -directions / z[..., None]
    by_pose = np.concatenate([-by_point @ skew(turned), by_point], axis=-1).reshape(len(camera), -1, 6)
    information = by_pose.mT @ by_pose
    own = np.maximum(np.linalg.norm(camera[:, :3, 3], axis=-1), near)
    return directions, by_pose, _bounded(information, len(P), distance, own)
