r"""The two possible poses of a small flat target: the minima of its reprojection error.

Where perspective is weak there are two minima: with l the unit line of sight to the middle of the target and R its
rotation, the columns r_1, r_2 and the same with their component along l reversed,

    R' = (1 - 2 l l^T) R diag(1, 1, -1)

have the same picture in the limit of a far target (the two solutions of IPPE, Collins and Bartoli, Int. J. Comput.
Vision 109, 2014). Least squares from there on gives the other minimum, or ends in the first where there is only one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ..board_shape import BoardShape
from ..corners import Corners
from ..models import CameraModel
from .bundle import Bundle, BundleUnknowns, Sight, adjust, poses_only

# A target of fewer points may have a second minimum at the start of a fit.
MAX_AMBIGUOUS_POINTS = 8
# A picture decides alone where the sums of squares of both minima, over s^2, differ by more than this.
DECISIVE_SQUARES = 60.0
# The same before the second minimum is reached, by one linear step: that step overestimates the difference.
DECISIVE_SQUARES_OF_START = 20.0 * DECISIVE_SQUARES
# Minima nearer to each other than this rotation are one.
MIN_ROTATION_BETWEEN_MINIMA_DEG = 0.5


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
        two = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))) > MIN_ROTATION_BETWEEN_MINIMA_DEG
        return np.asarray(two & (self.squares[1] - self.squares[0] < DECISIVE_SQUARES))


def flipped(poses: Array, middle: Array) -> Array:
    """Return the poses (n, 4, 4) that look alike from afar, with the ``middle`` (3,) of the target where it is."""
    at = (poses[:, :3, :3] @ middle) + poses[:, :3, 3]
    distance = np.linalg.norm(at, axis=-1, keepdims=True)
    sight = at / np.where(distance > 0.0, distance, 1.0)  # a pose at the camera is none, and stays where it is
    found = poses.copy()
    found[:, :3, :3] = (np.eye(3) - 2 * sight[:, :, None] * sight[:, None, :]) @ poses[:, :3, :3]
    found[:, :3, 2] *= -1.0
    found = np.where(distance[..., None] > 0.0, found, poses)
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
    return bool((gain < DECISIVE_SQUARES_OF_START * bundle.pixel_noise**2).any())


def both_minima(bundle: Bundle, corners: Corners) -> Minima:
    """Return both minima of the pictures of a camera, its intrinsics as they are; see the module."""
    first = poses_only(bundle, corners, bundle.poses, bundle.used, bundle.weights)
    start = flipped(first.poses, corners.on_board[0].mean(axis=0))
    second = poses_only(bundle, corners, start, bundle.used, bundle.weights)
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
    once = adjust(BundleUnknowns.poses_only(model, shape), corners, (np.array(parameters), poses), pixel_noise=1.0)
    return np.asarray(both_minima(once, corners).poses[0])
