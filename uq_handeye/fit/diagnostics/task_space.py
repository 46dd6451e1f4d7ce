r"""Task space: the uncertainty of a point that the camera measures, and the sources of that uncertainty.

Model: a point p_c (3, m) in camera coordinates is expressed in another frame,

    through X      p = R_X p_c + t_X                  in the gripper frame (eye-in-hand) or base frame (eye-to-hand)
    the robot      p = G (X p_c)                      G = base_T_gripper, or gripper_T_base for eye-to-hand
    the target     p = W inv(C) p_c                   W = base_T_target, or gripper_T_target for eye-to-hand

Errors are ``xi = (theta, tau)`` of the poses (left rotation in rad, additive translation in m) and 3-vectors of the
point; those of X, of the robot pose, of the camera pose and of the point are independent of each other. To first order
a pose T with ``q = T p`` adds ``J xi`` with ``J = [-[R p]x, I]`` and rotates the covariance of p by R.

*Budget.* Any estimate that is smooth in the data has the error ``xi = sum_k D_k xi_k`` over the poses k of robot and
camera, so that ``Sigma = sum over sources of D Sigma_source D^T``. Sources are the rotation and the translation of
each side; the contribution of the covariances between rotation and translation of one side is its coupling (negative,
if it compensates). For `Fit`, ``D = -C J^T S^-1 D_side`` (`constraint`, `gauss_helmert`). Shares of one variance sum to
1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.files.records import Record
from ...core.geometry.checks import as_numbers, as_transforms, checked_covariance
from ...core.geometry.se3 import Array, inverse, inverse_jacobian, skew
from ...core.limits import MAX_LISTED
from ...core.presentation.document import Document, Table, document_of
from ...core.presentation.numbers import concise, digits
from ...core.presentation.shown import Shown
from ...core.presentation.units import MM_PER_M
from ...core.quantiles import radius_holding
from ...errors import InputError
from ..graph.open_directions import MIN_OPEN_PART
from .pose_table import MAX_TABLE_ROWS


@dataclass(frozen=True, eq=False, repr=False)
class PointUncertainty(Record, Shown):
    """Points and their covariances in one frame, in metres.

    Attributes
    ----------
    points : (..., 3)
    covariance : (..., 3, 3)
        Infinite on the diagonal of coordinates that move along what is open.
    frame : str
    open_directions : (..., k, 3) or None
        How the points move along what is open; None: nothing is.
    tails : float
        How many times `radius_95` is that of Gaussian errors of the same covariance: above 1 where the sizes of the
        errors are uncertain.
    """

    _in_file: ClassVar[str] = "frame points covariance std radius_95 open_directions"
    _if_any: ClassVar[str] = "open_directions"

    points: Array
    covariance: Array
    frame: str
    open_directions: Array | None = None
    tails: float = 1.0

    @property
    def std(self) -> Array:
        """(..., 3) standard deviations along the axes of the frame."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance, axis1=-2, axis2=-1)))

    @property
    def radius_95(self) -> Array:
        """(...) radius of the sphere that holds 95 % of the errors of a point, in all directions; or infinite."""
        some = np.asarray(np.isfinite(self.std).all(axis=-1))
        finite = np.where(some[..., None, None], self.covariance, 0.0)
        return np.asarray(np.where(some, self.tails * radius_holding(finite), np.inf))

    @property
    def frame_words(self) -> str:
        """The frame in words: "base frame"."""
        return self.frame if " " in self.frame else f"{self.frame} frame"

    def __repr__(self) -> str:
        radius = MM_PER_M * np.asarray(self.radius_95).ravel()
        count = f"{len(radius):,} point{'' if len(radius) == 1 else 's'} in the {self.frame_words}"
        ends = [digits(x, 2) if np.isfinite(x) else "open" for x in (radius.min(initial=np.inf), radius.max(initial=0))]
        if not len(radius):
            return f"PointUncertainty({count})"
        sizes = " to ".join(dict.fromkeys(ends)) + ("" if ends[1] == "open" else " mm")
        return f"PointUncertainty({count}: 95 % radius {sizes})"

    def left_open(self, moves: Array) -> PointUncertainty:
        """Return the points with infinite variance in coordinates that move along open directions, (..., k, 3) metres
        for one of length 1.
        """
        moved = np.asarray((np.abs(moves) > MIN_OPEN_PART).any(axis=-2))
        if not moved.any():
            return self
        S = np.where(moved[..., :, None] | moved[..., None, :], 0.0, self.covariance)
        index = np.arange(3)
        S[..., index, index] = np.where(moved, np.inf, S[..., index, index])
        return PointUncertainty(self.points, S, self.frame, moves, self.tails)


class Link(NamedTuple):
    """A pose that points go through, by name, with its covariance (..., 6, 6); None: it is exact."""

    name: str
    T: ArrayLike  # (..., 4, 4)
    covariance: ArrayLike | None
    inverted: bool = False  # points go through its inverse


def through(
    links: Sequence[Link],
    points: ArrayLike,
    frame: str,
    points_covariance: ArrayLike | None = None,
    tails: float = 1.0,
) -> PointUncertainty:
    """Points (..., 3) in camera coordinates, expressed in the ``frame`` that poses, independent of each other, lead to.

    Parameters
    ----------
    links : sequence of Link
        The nearest to the camera first; leading axes broadcast with the points'.
    points : (..., 3)
        Metres, in the camera frame.
    points_covariance : (3, 3), (..., 3, 3) or None
        Noise of the points themselves, in the camera frame.
    tails : float
        See `PointUncertainty`.

    Raises
    ------
    InputError
        Wrong shapes or numbers, covariances that are not positive semidefinite.
    """
    p = _points(points)
    covariance = point_noise(points_covariance, p)
    for name, pose, noise, inverted in links:
        T, S = _pose(pose, np.zeros((6, 6)) if noise is None else noise, name)
        if inverted:
            J = inverse_jacobian(T)
            T, S = inverse(T), J @ S @ J.mT
        p, covariance = _carried(T, S, p, covariance)
    return PointUncertainty(p, np.asarray(covariance), frame, tails=tails)


def _carried(T: Array, S: Array, points: Array, noise: Array | None) -> tuple[Array, Array]:
    """``T p`` and its covariance."""
    R = T[..., :3, :3]
    arm = (R @ points[..., None])[..., 0]
    J = by_pose(arm)
    total = J @ S @ J.mT
    if noise is not None:
        total = total + R @ noise @ R.mT
    return arm + T[..., :3, 3], np.asarray(total)


def by_pose(arm: Array) -> Array:
    """``[-[arm]x, I]`` (..., 3, 6)."""
    J = np.empty((*arm.shape, 6))
    J[..., :3] = -skew(arm)
    J[..., 3:] = np.eye(3)
    return J


def moves_of_points(arm: Array, basis: Array, carried: Array | None = None) -> Array:
    """Return how points ``R p + t`` with ``R p = arm`` (..., 3) move along errors of the pose, the basis (k, 6): (...,
    k, 3).

    ``carried`` (..., 3, 3) is the rotation of the pose that carries them further.
    """
    moves = basis @ by_pose(arm).mT
    return np.asarray(moves if carried is None else moves @ carried.mT)


def frames_of(setup: str | None) -> tuple[str, str]:
    """Parent frame of X, and the frame at the other end of the robot; of motions that came without poses unknown."""
    if setup is None:
        return "parent frame of X", ""
    return ("gripper", "base") if setup == "eye-in-hand" else ("base", "gripper")


def _pose(T: ArrayLike, covariance: ArrayLike, name: str) -> tuple[Array, Array]:
    S = as_numbers(covariance, f"covariance of {name}")
    if S.ndim < 2 or S.shape[-2:] != (6, 6) or not np.isfinite(S).all():
        raise InputError(f"Expected the covariance of `{name}` to be finite numbers (..., 6, 6), got shape {S.shape}.")
    checked_covariance(S.reshape(-1, 6, 6), f"{name}_covariance" if name in ("robot", "camera") else name, joint=False)
    return as_transforms(T, name, stack=False), S


def _points(points: ArrayLike) -> Array:
    p = as_numbers(points, "points")
    if p.ndim < 1 or p.shape[-1] != 3 or not np.isfinite(p).all():
        raise InputError(f"Expected `points` to be finite numbers (..., 3) in metres, got shape {p.shape}.")
    return p


def point_noise(covariance: ArrayLike | None, points: Array) -> Array | None:
    """Noise of points (..., 3), one or of each, as it was given; raises `InputError`."""
    if covariance is None:
        return None
    S = as_numbers(covariance, "points_covariance")
    if S.shape not in ((3, 3), (*points.shape, 3)) or not np.isfinite(S).all():
        raise InputError(
            f"Expected `points_covariance` to be finite numbers (3, 3) or {(*points.shape, 3)}, got shape {S.shape}."
        )
    padded = np.zeros((S.size // 9, 6, 6))
    padded[:, 3:, 3:] = S.reshape(-1, 3, 3)
    checked_covariance(padded, "points_covariance", joint=False)
    return S


@document_of.register(PointUncertainty)
def points_document(found: PointUncertainty) -> Document:
    """Return a row per point: coordinates with standard deviations, and the radius that holds 95 %."""
    points, std, radius = found.points.reshape(-1, 3), found.std.reshape(-1, 3), found.radius_95.reshape(-1)
    shown = range(min(len(points), MAX_TABLE_ROWS))
    rows = [
        [
            str(k),
            *(concise(MM_PER_M * x, MM_PER_M * s) for x, s in zip(points[k].tolist(), std[k].tolist(), strict=True)),
            digits(MM_PER_M * radius[k], 2) if np.isfinite(radius[k]) else "open",
        ]
        for k in shown
    ]
    many = len(points) != 1
    caption = f"{len(points):,} point{'s' if many else ''} in the {found.frame_words}, with 1 sigma"
    head, units = ["point", "x", "y", "z", "95 % radius"], ["", "mm", "mm", "mm", "mm"]
    first = Table(caption, head, rows[:MAX_LISTED], units=units)
    if len(rows) <= MAX_LISTED:
        return [[first]]
    more = f"the first {MAX_TABLE_ROWS}" if len(points) > MAX_TABLE_ROWS else "all"
    return [[first], [Table(f"Points, {more}", head, rows, units=units)]]
