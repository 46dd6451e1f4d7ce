r"""First guesses of intrinsics and camera poses, by OpenCV, for boards that are flat.

Both poses that a small flat target may have, by the two minima of its reprojection error.

Where perspective is weak there are two: with l the unit line of sight to the middle of the target and R its rotation,
the columns r_1, r_2 and the same with what they have along l reversed,

    R' = (1 - 2 l l^T) R diag(1, 1, -1)

have the same picture in the limit of a far target (the two solutions of IPPE, Collins and Bartoli, Int. J. Comput.
Vision 109, 2014). Least squares from there on gives the other minimum, or ends in the first where there is only one.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ....errors import InputError, MissingExtraError
from ..board_shape import BoardShape
from ..corners import Corners, picked
from ..models import CameraModel
from .bundle import Asked, Bundle, Sight, adjust, poses_only

# Focal lengths of a fisheye that are tried, as multiples of half the picture's width per radian.
FISHEYE_FOCAL = np.geomspace(0.3, 3.0, 16)
ENOUGH = 60  # corners of a picture, for a start
WIDEST = np.radians(80.0)  # corners farther from the axis are not used for the start
# The distortion of a fisheye that is a pinhole: tan(phi) as a series.
TANGENT = (1 / 3, 2 / 15, 17 / 315, 62 / 2835)
# Median distance from a homography, as a share of the spread of a picture's corners, and as a multiple of that of most
# pictures, beyond which the corners are not those of a board: distortion alone does not bend one so much.
BENT, OFTEN = 0.1, 5.0


def opencv() -> Any:
    """The module cv2, or a `MissingExtraError` that says how to get it."""
    try:
        import cv2
    except ImportError as error:
        raise MissingExtraError(
            "Calibrating a camera needs OpenCV for its start: pip install '.[camera]' in the clone of uq-handeye."
        ) from error
    return cv2


def first_guess(model: CameraModel, corners: Corners, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Parameters (k,) without distortion, and poses (n, 4, 4).

    Raises `InputError` for boards that are not flat, and pictures that do not determine a focal length.
    """
    few = _thinned(corners)
    flat = _flat(few)
    if model.name == "fisheye":
        return _fisheye(model, few, flat, image_size)
    parameters = np.zeros(len(model.names))
    parameters[:4] = _linear(few, flat, image_size)
    return parameters, poses_of(corners, (corners.pixels - parameters[2:4]) / parameters[:2])


def _linear(corners: Corners, flat: Array, image_size: tuple[int, int]) -> Array:
    """fx, fy, cx, cy of a camera without distortion, from the homographies of all pictures."""
    parts, cv2 = [corners.picture == i for i in range(corners.n)], opencv()
    K = np.zeros((3, 3))
    with suppress(cv2.error):  # corners in one place have no homography
        K = cv2.initCameraMatrix2D(
            [flat[part].astype(np.float32) for part in parts],
            [corners.pixels[part].astype(np.float32) for part in parts],
            image_size,
            1.0,
        )
    if not np.isfinite(K).all() or K[0, 0] <= 0:
        raise InputError(
            "The pictures do not determine the focal length, not even roughly: take some in which the board is tilted "
            "by 20 degrees and more, or give `intrinsics`."
        )
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


def poses_of(corners: Corners, normalised: Array, keep: Array | None = None) -> Array:
    """camera_T_target (n, 4, 4) of every picture from normalised coordinates (m, 2) without distortion."""
    cv2 = opencv()
    poses = np.zeros((corners.n, 4, 4))
    poses[:, 3, 3] = 1.0
    for i in range(corners.n):
        part = corners.picture == i
        if keep is not None:
            part &= keep
        ok = False
        with suppress(cv2.error):  # of corners on one line
            ok, turn, shift = cv2.solvePnP(
                corners.points[part], normalised[part], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
            )
        if not ok or not np.isfinite([turn, shift]).all():
            raise InputError(f"OpenCV finds no pose for the corners of {corners.names[i]}: leave that picture out.")
        poses[i, :3, :3], poses[i, :3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    return poses


def unlike_a_board(corners: Corners) -> NDArray[np.bool_]:
    """Pictures (n,) whose corners are no picture of the flat board by any camera: they would spoil the start of all."""
    few = _thinned(corners)
    try:
        off = _off_homography(few, _flat(few)[:, :2], 0)
        if (off > BENT).any():  # few wrong corners may bend least squares, not the least median
            off = _off_homography(corners, _flat(corners)[:, :2], opencv().LMEDS)
    except InputError:
        return np.zeros(corners.n, dtype=bool)
    return np.asarray(off > max(BENT, OFTEN * float(np.median(off))))


def _off_homography(corners: Corners, flat: Array, method: int) -> Array:
    """(n,) median distance of each picture's corners from a homography of the board, as a share of their spread."""
    cv2, off = opencv(), np.zeros(corners.n)
    for i in range(corners.n):
        part = corners.picture == i
        points, pixels, H = flat[part], corners.pixels[part], None
        with suppress(cv2.error):  # of corners on one line
            H, _ = cv2.findHomography(points, pixels, method)
        if H is not None:
            distance = np.linalg.norm(cv2.perspectiveTransform(points[None], H)[0] - pixels, axis=1)
            off[i] = np.median(distance) / max(float(np.linalg.norm(pixels.std(axis=0))), 1e-9)
    return off


def _thinned(corners: Corners) -> Corners:
    """About ENOUGH corners of each picture, spread as multiples of the golden section are, whatever the columns."""
    part = (corners.place * 0.618034) % 1.0 < ENOUGH / np.bincount(corners.picture)[corners.picture]
    return picked(corners, part)


def _flat(corners: Corners) -> Array:
    """The points in coordinates of their plane, (m, 3) with z = 0."""
    centre = corners.points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners.points - centre, full_matrices=False)
    if sizes[2] > 1e-6 * sizes[0]:
        raise InputError("Expected the points of the board to lie in a plane, or `intrinsics` to start from.")
    if sizes[1] <= 1e-6 * sizes[0]:
        raise InputError("Expected the points of the board to span a plane, got points of one line.")
    axes[2] = np.cross(axes[0], axes[1])
    flat = (corners.points - centre) @ axes.T
    flat[:, 2] = 0.0
    return np.asarray(flat)


def _fisheye(model: CameraModel, corners: Corners, flat: Array, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Choose, of equidistant lenses of many focal lengths and a pinhole, the one that predicts the corners best."""
    width, height = image_size
    starts = [np.array([f, f, 0.5 * (width - 1), 0.5 * (height - 1), 0, 0, 0, 0]) for f in FISHEYE_FOCAL * 0.5 * width]
    with suppress(InputError):  # of a wide lens, where it may fail
        starts.append(np.concatenate([_linear(corners, flat, image_size), TANGENT]))
    best: tuple[float, Array, Array] | None = None
    for parameters in starts:
        away = (corners.pixels - parameters[2:4]) / parameters[:2]
        radius = np.linalg.norm(away, axis=1)
        equidistant = not parameters[4:].any()
        keep = radius < (WIDEST if equidistant else np.inf)
        if np.bincount(corners.picture[keep], minlength=corners.n).min() < 6:
            continue
        stretch = np.tan(np.minimum(radius, WIDEST)) / np.maximum(radius, 1e-9) if equidistant else np.ones(corners.m)
        try:
            poses = poses_of(corners, away * stretch[:, None], keep)
        except InputError:  # those kept may lie on one line
            continue
        points = (poses[corners.picture, :3, :3] @ corners.points[..., None])[..., 0] + poses[corners.picture, :3, 3]
        off = model.project(parameters, points).pixels - corners.pixels
        cost = float(np.median(np.sum(off**2, axis=1)))
        if best is None or cost < best[0]:
            best = cost, parameters, poses
    if best is None:
        raise InputError("The corners lie too far from the middle of the picture for a fisheye model to start.")
    return best[1], best[2]


# Points of a target below which the start of a fit is looked at for the other minimum.
AMBIGUOUS = 8
# Differences of the sums of squares, over s^2, from which on a picture decides alone.
DOUBTFUL = 60.0
MANY = 20.0  # times this many before the second minimum is reached
# Rotation (rad) between two minima from which on they are two.
TWO = np.radians(0.5)


class Minima(NamedTuple):
    """Both minima of n pictures; the second equals the first where there is one only."""

    poses: Array  # (2, n, 4, 4)
    own: Array  # (2, n, 6, 6) covariance by the pixel noise
    squares: Array  # (2, n) q_k / s^2

    @property
    def doubtful(self) -> NDArray[np.bool_]:
        """(n,) pictures that do not decide alone."""
        R = self.poses[..., :3, :3]
        cosine = 0.5 * (np.trace(R[0].mT @ R[1], axis1=-2, axis2=-1) - 1.0)
        two = np.arccos(np.clip(cosine, -1.0, 1.0)) > TWO
        return np.asarray(two & (self.squares[1] - self.squares[0] < DOUBTFUL))


def flipped(poses: Array, middle: Array) -> Array:
    """Return the poses (n, 4, 4) that look alike from afar, with the ``middle`` (3,) of the target where it is."""
    at = (poses[:, :3, :3] @ middle) + poses[:, :3, 3]
    distance = np.linalg.norm(at, axis=-1, keepdims=True)
    sight = at / np.where(distance > 0.0, distance, 1.0)  # a pose at the camera is none, and stays where it is
    found = poses.copy()
    found[:, :3, :3] = (np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]) @ poses[:, :3, :3]
    found[:, :3, 2] *= -1.0
    found[:, :3, 3] = at - found[:, :3, :3] @ middle
    return found


def may_be_ambiguous(bundle: Bundle, corners: Corners) -> bool:
    """Return whether any picture may have a second minimum that matters, by one linear step from the flipped poses."""
    weight = bundle.used * np.sqrt(bundle.weights)[corners.picture]
    sight = Sight.of(bundle.model, bundle.shape, corners, weight)
    start = flipped(bundle.poses, corners.on_board[0].mean(axis=0))
    free = np.zeros(len(bundle.parameters), dtype=bool)
    r, _, B = sight.rows(bundle.parameters, start, free)
    left = r - (B @ np.linalg.solve(B.mT @ B, B.mT @ r[..., None]))[..., 0]
    gain = np.sum(left**2, axis=-1) - _squares(bundle, corners)
    return bool((gain < MANY * DOUBTFUL * bundle.pixel_noise**2).any())


def both_minima(bundle: Bundle, corners: Corners) -> Minima:
    """Return both minima of the pictures of a camera, its intrinsics as they are; see the module."""
    how = {"used": bundle.used, "weights": bundle.weights}
    first = poses_only(bundle, corners, bundle.poses, **how)
    second = poses_only(bundle, corners, flipped(first.poses, corners.on_board[0].mean(axis=0)), **how)
    pair = (first, second)
    squares = np.array([_squares(one, corners) for one in pair]) / bundle.pixel_noise**2
    stay = ~np.isfinite(squares[1]) | (second.poses[:, 2, 3] <= 0)
    poses, own = (np.stack([getattr(one, name) for one in pair]) for name in ("poses", "own"))
    poses[1, stay], own[1, stay], squares[1, stay] = poses[0, stay], own[0, stay], squares[0, stay]
    better = squares.argmin(axis=0)
    order, every = np.stack([better, 1 - better]), np.arange(corners.n)
    return Minima(poses[order, every], own[order, every], squares[order, every])


def _squares(bundle: Bundle, corners: Corners) -> Array:
    """Sums of squares (n,) in pixels^2, with the weights of the pictures."""
    squares = np.sum(bundle.residuals**2, axis=1) * bundle.used * bundle.weights[corners.picture]
    return np.bincount(corners.picture, squares, corners.n).astype(np.float64)


def better_start(model: CameraModel, parameters: Array, shape: BoardShape, corners: Corners, poses: Array) -> Array:
    """Return, of poses (n, 4, 4) to start from and those that look alike, the ones that lead to the lower minimum."""
    once = adjust(Asked.poses_only(model, shape), corners, (np.array(parameters), poses), pixel_noise=1.0)
    return np.asarray(both_minima(once, corners).poses[0])
