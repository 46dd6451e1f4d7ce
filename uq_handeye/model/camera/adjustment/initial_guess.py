"""First guesses of intrinsics and camera poses, by OpenCV, for boards that are flat."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ....errors import InputError
from ..board_shape import MAX_THICKNESS_SHARE
from ..corners import Corners, picked
from ..models import CameraModel
from .opencv import opencv

# The corners of a picture are not those of a board where their median distance from a homography is beyond this share
# of their spread, and this multiple of that of most pictures: distortion alone does not bend a board so much.
MAX_SHARE_OFF_HOMOGRAPHY = 0.1
MAX_RATIO_OFF_HOMOGRAPHY = 5.0


def first_guess(model: CameraModel, corners: Corners, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Parameters (k,) without distortion, and poses (n, 4, 4).

    Raises `InputError` for boards that are not flat, and pictures that do not determine a focal length.
    """
    few = _thinned(corners)
    flat = _flat(few)
    if model.wide:
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


def poses_of(corners: Corners, normalised: Array, keep: NDArray[np.bool_] | None = None) -> Array:
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
        if (off > MAX_SHARE_OFF_HOMOGRAPHY).any():  # few wrong corners may bend least squares, not the least median
            off = _off_homography(corners, _flat(corners)[:, :2], opencv().LMEDS)
    except InputError:
        return np.zeros(corners.n, dtype=bool)
    return np.asarray(off > max(MAX_SHARE_OFF_HOMOGRAPHY, MAX_RATIO_OFF_HOMOGRAPHY * float(np.median(off))))


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


def _thinned(corners: Corners, enough: int = 60) -> Corners:
    """About ``enough`` corners of each picture, spread as multiples of the golden section are, whatever the columns."""
    part = (corners.place * 0.618034) % 1.0 < enough / np.bincount(corners.picture)[corners.picture]
    return picked(corners, part)


def _flat(corners: Corners) -> Array:
    """The points in coordinates of their plane, (m, 3) with z = 0."""
    centre = corners.points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(corners.points - centre, full_matrices=False)
    if sizes[2] > MAX_THICKNESS_SHARE * sizes[0]:
        raise InputError("Expected the points of the board to lie in a plane, or `intrinsics` to start from.")
    if sizes[1] <= MAX_THICKNESS_SHARE * sizes[0]:
        raise InputError("Expected the points of the board to span a plane, got points of one line.")
    axes[2] = np.cross(axes[0], axes[1])
    flat = (corners.points - centre) @ axes.T
    flat[:, 2] = 0.0
    return np.asarray(flat)


def _fisheye(model: CameraModel, corners: Corners, flat: Array, image_size: tuple[int, int]) -> tuple[Array, Array]:
    """Choose, of equidistant lenses of many focal lengths and a pinhole, the one that predicts the corners best."""
    width, height = image_size
    # Focal lengths as multiples of half the width of the picture per radian. Corners far from the axis are not used.
    focal_lengths, widest = np.geomspace(0.3, 3.0, 16) * 0.5 * width, np.radians(80.0)
    pinhole = (1 / 3, 2 / 15, 17 / 315, 62 / 2835)  # the fisheye that is a pinhole: tan(phi) as a series
    more = np.zeros(len(model.names) - 8)
    starts = [np.array([f, f, 0.5 * (width - 1), 0.5 * (height - 1), 0, 0, 0, 0, *more]) for f in focal_lengths]
    with suppress(InputError):  # of a wide lens, where it may fail
        starts.append(np.concatenate([_linear(corners, flat, image_size), pinhole, more]))
    best: tuple[float, Array, Array] | None = None
    for parameters in starts:
        away = (corners.pixels - parameters[2:4]) / parameters[:2]
        radius = np.linalg.norm(away, axis=1)
        equidistant = not parameters[4:].any()
        keep = radius < (widest if equidistant else np.inf)
        if np.bincount(corners.picture[keep], minlength=corners.n).min() < 6:
            continue
        stretch = np.tan(np.minimum(radius, widest)) / np.maximum(radius, 1e-9) if equidistant else np.ones(corners.m)
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
