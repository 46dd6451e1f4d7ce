r"""The covariance of camera poses that come without corners, computed from the geometry of the views.

Model: pose i, ``C_i = camera_T_target``, is the least-squares fit to the pixels of the points P_j of a board, each with
independent noise of standard deviation s per coordinate,

    z_ij = project(k, C_i P_j) + e_ij,      e ~ N(0, s^2)

whose corners are no longer available. To first order they are not needed: their places follow from board, pose and
intrinsics k. With the derivatives A_i of the pixels by k and B_i by the error ``xi_i = (theta, tau)`` of pose i
(left rotation, additive translation, in the camera frame; rad and m)

    V_i = B_i^T B_i,     G_i = d xi_i / d k = -V_i^-1 B_i^T A_i
    Cov(xi_i, xi_j) = delta_ij s^2 V_i^-1 + G_i Sigma_k G_j^T

and the covariance Sigma_k of the intrinsics is

- estimated from these pictures: ``s^2 (sum_i (A_i + B_i G_i)^T (A_i + B_i G_i))^-1``, the inverse of the Schur
  complement; it grows with the pixel noise;
- that of another calibration: as given, whatever the pixel noise is here;
- 0 where they are exact.

The first is the covariance that a bundle adjustment of the corners has (`camera.adjustment.bundle`, T4b), without them:
pixels are compared with the same model at the same place. Intrinsics that are estimated are fx, fy, cx, cy and, as most
pictures are calibrated with them, k1, k2, p1, p2, about 0 where none are known: poses share their errors as well, those
of the tangential ones with the centre's. Pictures that were calibrated as those of a pinhole have the first four.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, skew
from ...core.rounding import SOLUTION_ROUNDING
from ...errors import InputError
from ..camera.description import spacing_of
from ..camera.known_intrinsics import KnownIntrinsics
from ..camera.models import LINEAR, MODELS, CameraModel
from ..camera.result import CameraCalibration
from ..errors.camera_noise import CameraNoise, checked_pixels
from ..errors.joint_covariance import JointCovariance
from ..errors.keys import FOCAL_LENGTH, INTRINSICS, PRINCIPAL_POINT
from ..poses.pose_pairs import PosePairs
from .shared_error import DEFAULT_SD

ESTIMATED, PINHOLE, EXACT = "estimated", "pinhole", "exact"
# Coefficients that are estimated with the linear intrinsics.
DISTORTION = ("k1", "k2", "p1", "p2")
# Smallest number of points of a target with which a camera is calibrated.
MIN_POINTS_OF_BOARD = 8
# Smallest focal length that can be in pixels.
MIN_FOCAL_LENGTH_PX = 10.0
# Smallest and largest width of a board over its distance, and its smallest angle to the line of sight.
BOARD_SPAN = (0.01, 20.0)
MIN_BOARD_TILT_RAD = np.radians(2.0)
# Largest share of the picture by which points may lie outside of it, and largest share of poses in which they may.
MAX_OUTSIDE, MAX_POSES_OUTSIDE = 0.1, 0.2


class Lens(NamedTuple):
    """Intrinsics (k,) of a model, their covariance (k, k) where it is known, and the size of the pictures."""

    model: CameraModel
    parameters: Array
    covariance: Array | None = None
    image_size: tuple[int, int] | None = None

    @property
    def extent(self) -> Array:
        """(2,) width and height in pixels; twice the principal point where they are not known."""
        return 2.0 * self.parameters[2:4] if self.image_size is None else np.array(self.image_size, dtype=float)


def camera_noise(
    poses: PosePairs | ArrayLike,
    points: ArrayLike,
    camera_matrix: ArrayLike | KnownIntrinsics | CameraCalibration | Lens,
    intrinsics: str | ArrayLike | None = None,
    *,
    pixel_sd: float | str | None = None,
    image_size: tuple[int, int] | None = None,
) -> CameraNoise:
    """The noise of finished camera poses, for one pixel of noise, from board, poses and camera matrix; see the module.

    Parameters
    ----------
    poses : PosePairs or (n, 4, 4)
        Or the camera poses only, ``camera_T_target``, of pictures without distortion.
    points : (m, 3)
        The points of the target that the poses were made from, in its frame, m; `Board.points`. Where the origin is
        matters: the first corner, the middle, a corner of a tag. All points are taken as seen in every picture.
    camera_matrix : (3, 3), (fx, fy, cx, cy), KnownIntrinsics or CameraCalibration
        In pixels; `read_intrinsics` and `read_camera` read files. They may bring a covariance of their own.
    intrinsics : "estimated", "pinhole", "exact", covariance or None
        ``estimated`` from the same pictures, so that their errors go with the pixel noise, ``pinhole`` without any
        distortion; or a covariance, (4, 4) of fx, fy, cx, cy or (1, 1) of one focal length (pixels^2), from another
        calibration. None: the covariance that the `camera_matrix` brings; where it brings none ``estimated``, and of
        fewer than 8 points, such as a single tag, which no camera is calibrated with, a focal length within 0.1 % and
        a centre within 0.001 of it (`SharedError`).
    pixel_sd : float, text or None
        Standard deviation of a pixel coordinate, pixels; None: `calibrate` estimates it.
    image_size : (width, height) or None
        Of the pictures, to see whether the board lies in them; None: what the camera says, or twice the centre.

    Raises
    ------
    InputError
        A camera matrix that is not in pixels or does not fit the poses, points in another unit, a board that is seen
        edge-on, a covariance that is none, views that do not determine the intrinsics.

    Examples
    --------
    >>> import uq_handeye as uq
    >>> poses = uq.simulate(n_poses=12, seed=1)
    >>> points = uq.Board(9, 6, "20mm").points
    >>> noise = uq.camera_noise(poses, points, (900, 900, 640, 480), intrinsics="exact", pixel_sd=0.2)
    >>> noise.covariance().shape
    (72, 72)
    """
    C = poses.camera if isinstance(poses, PosePairs) else as_transforms(poses, "poses")
    if C.ndim != 3:
        raise InputError(f"Expected `poses` to be one set, (n, 4, 4), got {C.shape}.")
    P = _checked_points(points)
    lens = lens_of(camera_matrix, image_size)
    views = _views(P, lens, intrinsics)
    _require_scale(C, P)
    _require_in_view(C, P, lens)
    lens, directions, Sigma = _unknowns(lens, intrinsics, len(P))
    A, B = _derivatives(lens, C, P)
    A = A @ directions
    own = _inverse(B.mT @ B, "The views do not determine the pose of the board")
    G = -own @ (B.mT @ A)
    scales = np.full(A.shape[-1], Sigma is None)
    if Sigma is None:
        rest = A + B @ G
        Sigma = _inverse(
            np.einsum("nij,nik->jk", rest, rest),
            "These views do not determine the intrinsics, which they are said to be estimated from",
        )
    joint = JointCovariance(0.5 * (own + own.mT), G @ np.linalg.cholesky(Sigma), (INTRINSICS,) * len(Sigma))
    return CameraNoise(joint, scales, None if pixel_sd is None else checked_pixels(pixel_sd), spacing_of(P), views)


def _views(P: Array, lens: Lens, intrinsics: Any) -> dict[str, Any]:
    """Return board and camera as plain numbers, which `camera_noise_at` takes."""
    return {
        "points": P.tolist(),
        "model": lens.model.name,
        "parameters": np.asarray(lens.parameters).tolist(),
        "covariance": None if lens.covariance is None else np.asarray(lens.covariance).tolist(),
        "image_size": None if lens.image_size is None else list(lens.image_size),
        "intrinsics": intrinsics
        if intrinsics is None or isinstance(intrinsics, str)
        else np.asarray(intrinsics).tolist(),
    }


def camera_noise_at(poses: PosePairs, views: Mapping[str, Any], pixel_sd: float | None = None) -> CameraNoise:
    """Return the noise of other poses of the same board and camera, by the ``views`` of a `CameraNoise`."""
    size, covariance = views["image_size"], views["covariance"]
    lens = Lens(
        MODELS[views["model"]],
        np.asarray(views["parameters"], dtype=float),
        None if covariance is None else np.asarray(covariance, dtype=float),
        None if size is None else (int(size[0]), int(size[1])),
    )
    return camera_noise(poses, views["points"], lens, views["intrinsics"], pixel_sd=pixel_sd)


def _derivatives(lens: Lens, C: Array, P: Array) -> tuple[Array, Array]:
    """A (n, 2m, k) and B (n, 2m, 6): of the pixels by the intrinsics and by the errors of the poses."""
    n, m = len(C), len(P)
    turned = P @ C[:, :3, :3].mT
    seen = lens.model.project(lens.parameters, turned + C[:, None, :3, 3])
    by_pose = np.concatenate([-seen.by_point @ skew(turned), seen.by_point], axis=-1)
    return seen.by_parameters.reshape(n, 2 * m, -1), by_pose.reshape(n, 2 * m, 6)


def _inverse(information: Array, what: str) -> Array:
    """Invert (..., k, k); raises `InputError` that begins with ``what`` where it is singular."""
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(information, axis1=-2, axis2=-1), np.finfo(float).tiny))
    scaled = information * unit[..., :, None] * unit[..., None, :]
    if not (np.linalg.eigvalsh(scaled)[..., 0] > SOLUTION_ROUNDING).all():
        raise InputError(f"{what}: give more points or poses, or intrinsics='exact' or their covariance.")
    return np.asarray(np.linalg.inv(scaled) * unit[..., :, None] * unit[..., None, :])


# ------------------------------------------------------------------------------------------- what is given


def _checked_points(points: ArrayLike) -> Array:
    try:
        P = np.array(points, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError("Expected `points` to be the points of the board, (m, 3) numbers in metres.") from error
    if P.ndim != 2 or P.shape[1] != 3 or not np.isfinite(P).all():
        raise InputError(f"Expected `points` to be finite points of the board, (m, 3) in metres, got {P.shape}.")
    spread = np.linalg.svd(P - P.mean(axis=0), compute_uv=False) if len(P) else np.zeros(3)
    if len(P) < 4 or not spread[1] > 1e-6 * spread[0]:
        raise InputError(f"Expected at least 4 `points` that are not on one line, got {len(P)}.")
    return P


def lens_of(given: Any, image_size: tuple[int, int] | None = None) -> Lens:
    """Return the lens of a ``camera_matrix`` as `camera_noise` takes it."""
    if isinstance(given, Lens):
        lens = given
    elif isinstance(given, CameraCalibration):
        size = image_size or given.image_size
        lens = Lens(given.bundle.model, given.bundle.intrinsics, given.bundle.intrinsics_covariance, size)
    elif isinstance(given, KnownIntrinsics):
        lens = _of_known(given, image_size)
    else:
        lens = Lens(MODELS["pinhole"], _linear(given), None, image_size)
    fx, fy, cx, cy = lens.parameters[:4]
    if not (np.isfinite(lens.parameters).all() and min(fx, fy) >= MIN_FOCAL_LENGTH_PX and min(cx, cy) > 0):
        raise InputError(
            f"Expected `camera_matrix` in pixels, focal lengths of at least {MIN_FOCAL_LENGTH_PX:g} and a centre "
            f"within the picture, got fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}: "
            "millimetres, degrees or normalised units?"
        )
    return lens


def _linear(given: Any) -> Array:
    """fx, fy, cx, cy of a camera matrix."""
    try:
        K = np.array(given, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError("Expected `camera_matrix` to be (3, 3) or (fx, fy, cx, cy), numbers in pixels.") from error
    if K.shape == (4,):
        return K
    if K.shape != (3, 3):
        raise InputError(f"Expected `camera_matrix` to be (3, 3) or (fx, fy, cx, cy), in pixels, got {K.shape}.")
    if K[1, 0] != 0 or K[0, 1] != 0 or (K[2] != [0, 0, 1]).any():
        raise InputError("Expected `camera_matrix` to be [fx 0 cx; 0 fy cy; 0 0 1], got other numbers.")
    return np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])


def _of_known(given: KnownIntrinsics, image_size: tuple[int, int] | None) -> Lens:
    model = MODELS[given.model or ("brown" if set(given.values) - set(LINEAR) else "pinhole")]
    if missing := [name for name in LINEAR if name not in given.values]:
        raise InputError(f"Expected a `camera_matrix` with fx, fy, cx and cy, got none of {', '.join(missing)}.")
    if unknown := sorted(set(given.values) - set(model.names)):
        raise InputError(f"Expected a `camera_matrix` of the model {model.name}, got {', '.join(unknown)} too.")
    known = [given.values.get(name, 0.0) for name in model.names]
    mean, sd = np.array([value if isinstance(value, tuple) else (value, 0.0) for value in known]).T
    return Lens(model, mean, np.diag(sd**2) if sd.any() else None, image_size or given.image_size)


def _unknowns(lens: Lens, given: Any, points: int) -> tuple[Lens, Array, Array | None]:
    """The lens, the directions (k, p) in which its intrinsics are open, their covariance; None: to be estimated."""
    k = len(lens.parameters)
    if given is None and lens.covariance is None and points < MIN_POINTS_OF_BOARD:
        f = lens.parameters[:2].mean()
        directions = np.stack([np.eye(k)[:2].sum(axis=0), *np.eye(k)[2:4]], axis=-1)
        sd = f * np.array([DEFAULT_SD[FOCAL_LENGTH], DEFAULT_SD[PRINCIPAL_POINT], DEFAULT_SD[PRINCIPAL_POINT]])
        return lens, directions, np.diag(sd**2)
    if given is None:
        given = ESTIMATED if lens.covariance is None else lens.covariance
    if isinstance(given, str):
        if given not in (ESTIMATED, PINHOLE, EXACT):
            raise InputError(
                f"Expected `intrinsics` to be {ESTIMATED}, {PINHOLE}, {EXACT} or a covariance, got {given!r}."
            )
        if given == EXACT:
            return lens, np.zeros((len(lens.parameters), 0)), np.zeros((0, 0))
        if given == PINHOLE:
            return lens, np.eye(len(lens.parameters))[:, : len(LINEAR)], None
        if lens.model.name == "pinhole":  # undistorted pictures were looked at for distortion all the same
            model = MODELS["brown"]
            lens = lens._replace(model=model, parameters=np.append(lens.parameters, np.zeros(len(model.coefficients))))
        free = np.isin(lens.model.names, [*LINEAR, *DISTORTION]) | (lens.parameters != 0)
        return lens, np.eye(len(free))[:, free], None
    try:
        S = np.atleast_2d(np.array(given, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError("Expected `intrinsics` to be a covariance of numbers, (4, 4) or (1, 1).") from error
    if given is lens.covariance:
        directions = np.eye(k)[:, np.diag(S) > 0]
        S = directions.T @ S @ directions
    elif S.shape in ((1, 1), (4, 4)):
        directions = np.eye(k)[:, :4] if len(S) == 4 else np.eye(k)[:, :2].sum(axis=1, keepdims=True)
    else:
        raise InputError(
            f"Expected `intrinsics` to be a covariance (4, 4) of fx, fy, cx, cy or (1, 1) of f, got {S.shape}."
        )
    unit = np.sqrt(np.maximum(np.diag(S), np.finfo(float).tiny))
    correlation = S / unit[:, None] / unit
    if not (np.isfinite(S).all() and np.abs(correlation - correlation.T).max() < 1e-6):
        raise InputError("Expected the covariance `intrinsics` to be finite and symmetric, in pixels^2.")
    if not np.linalg.eigvalsh(correlation)[0] > SOLUTION_ROUNDING:
        raise InputError(
            "Expected the covariance `intrinsics` to be positive definite, got a singular or an indefinite one. Where "
            "only the focal length is uncertain give its variance (1, 1); intrinsics='exact' has none."
        )
    return lens, directions, 0.5 * (S + S.T)


def _require_scale(C: Array, P: Array) -> None:
    """Points and poses in one unit."""
    span = float(np.linalg.norm(np.ptp(P, axis=0)))
    away = float(np.median(np.linalg.norm(C[:, :3, 3], axis=-1)))
    if not BOARD_SPAN[0] * away <= span <= BOARD_SPAN[1] * away:
        raise InputError(
            f"The `points` span {span:.3g} m and the board is {away:.3g} m away: expected both in metres, is one of "
            "them in millimetres?"
        )


def _require_in_view(C: Array, P: Array, lens: Lens) -> None:
    """The board in front of the camera, in the picture and not seen edge-on, but for a few outliers."""
    n = len(C)
    points = P @ C[:, :3, :3].mT + C[:, None, :3, 3]
    depth = points[..., 2].min(axis=1)
    if (depth <= 0).any():
        raise InputError(
            f"In {int((depth <= 0).sum())} of {n} poses the board is behind the camera, in pose {depth.argmin()} by "
            f"{-depth.min():.3g} m: expected camera_T_target, z along the view. Are the poses inverted, or `points` of "
            "another board?"
        )
    pixels = lens.model.project(lens.parameters, points).pixels
    beyond = np.maximum(-pixels, pixels - lens.extent) / lens.extent
    out = np.median(beyond.max(axis=-1), axis=1)  # of half of the points
    if (out > MAX_OUTSIDE).sum() > max(1.0, MAX_POSES_OUTSIDE * n):
        k = int(out.argmax())
        middle = pixels[k].mean(axis=0)
        raise InputError(
            f"The `camera_matrix` does not fit: in {int((out > MAX_OUTSIDE).sum())} of {n} poses the board lies out of "
            f"the picture ({lens.extent[0]:.0f} x {lens.extent[1]:.0f} pixels), in pose {k} at ({middle[0]:.0f}, "
            f"{middle[1]:.0f}). Is it of another camera or resolution, or are `points` of another board?"
        )
    middle_of, normal = P.mean(axis=0), np.linalg.svd(P - P.mean(axis=0))[2][2]
    towards = C[:, :3, 3] + C[:, :3, :3] @ middle_of
    if np.linalg.svd(P - middle_of, compute_uv=False)[2] > 1e-3 * np.ptp(P):
        return  # no plane: seen from everywhere
    rise = np.arcsin(np.abs(np.sum(towards * (C[:, :3, :3] @ normal), axis=1)) / np.linalg.norm(towards, axis=1))
    if (rise < MIN_BOARD_TILT_RAD).any():
        k = int(rise.argmin())
        raise InputError(
            f"Seen edge-on a board has no pose: in {int((rise < MIN_BOARD_TILT_RAD).sum())} of {n} poses it is, in "
            f"pose {k} at {np.degrees(rise[k]):.2g} degrees from its plane. Leave them out, or mend the "
            "frame of `points`."
        )
