r"""The constraint that data and unknowns satisfy, linearised: on poses ``G X C = W``, on motions ``A X = X B``.

Every measured pose or motion is its true value with the error ``xi = (theta, tau)``: ``R = exp([theta]x) R_true``,
``t = t_true + tau`` (rad, m). The residual r (6) of pose or motion i is 0 for true values. At measured data and a first
guess x_0 of the unknowns it is, to first order in the errors and in x_0's own error,

    r = J (x_0 - x) + D_1 xi_1 + D_2 xi_2,      S = D_1 Sigma_1 D_1^T + D_2 Sigma_2 D_2^T                     (T5)

with the robot as side 1 and the camera as side 2. The unknowns are errors in the same convention.

On poses (unknowns ``(xi_X, xi_W)``, 12; W is a nuisance, ``base_T_target`` for eye-in-hand; G inverted for
eye-to-hand):

    r = ( log(R_G R_X R_C R_W^T),  R_G (R_X t_C + t_X) + t_G - t_W )
    J_X = [[R_G, 0], [-R_G [R_X t_C]x, R_G]],   J_W = -I
    D_G = [[I, 0], [-[R_G (R_X t_C + t_X)]x, I]],   D_C = blkdiag(R_G R_X, R_G R_X)

On motions (unknowns ``xi_X``, 6), independent from motion to motion:

    r = ( log(R_A R_X R_B^T R_X^T),  R_A t_X + t_A - R_X t_B - t_X )
    J_X = [[R_A - I, 0], [[R_X t_B]x, R_A - I]],   D_A = [[I, 0], [-[R_A t_X]x, I]],   D_B = -blkdiag(R_X, R_X)

The derivatives hold where ``r = 0``; elsewhere they are exact to first order in r.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.nearest_rotation import orthonormalise
from ...core.geometry.se3 import Array, block, inverse, inverse_jacobian, logarithm, perturb, skew, vee
from ...errors import InputError, require_type
from ...methods.target_pose import loop_derivatives
from ...model.errors.joint_covariance import JointCovariance, joint_of
from ...model.errors.models import Noise, PairNoise, PoseNoise, is_joint, require_count
from ...model.errors.square_roots import Covariance
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs

# Largest number of rows whose motions are looked at to find the axes of rotation and a start.
MAX_AXIS_ROWS = 40
# The robot may rotate about one axis only if the mean square of sin(angle) across the main axis is below this.
ONE_AXIS_SIN2 = 0.03
# A direction on which the data have less than this share of the information on others, or of that which was given
# beforehand, is not resolved by them. The same holds for what a fit leaves of the variance of a residual.
MIN_RESOLVED_SHARE = 1e-4

_EYE = np.eye(3)
_EYE6 = np.eye(6)


class Unknowns(NamedTuple):
    """Unknowns of the estimation: X (..., 4, 4) and, on poses, W (..., 4, 4)."""

    X: Array
    W: Array | None

    def moved(self, step: Array) -> Unknowns:
        """Move the unknowns by errors (..., 6) of X, or (..., 12) of X and W."""
        if self.W is None:
            return Unknowns(perturb(self.X, step), None)
        both = perturb(
            np.stack(np.broadcast_arrays(self.X, self.W), axis=-3), step.reshape(*step.shape[:-1], 2, 6)
        )  # one call for two poses: it takes as long
        return Unknowns(both[..., 0, :, :], both[..., 1, :, :])


class Linearised(NamedTuple):
    """Residuals of n poses or motions and their derivatives; see the module."""

    r: Array  # (..., n, 6)
    J: Array  # (..., n, 6, p) by the unknowns, p = 12 on poses and 6 on motions
    sides: tuple[Array, Array]  # (..., n, 6, 6) by the errors of robot and of camera


@dataclass(frozen=True, eq=False)
class _Rows:
    """Measured data of both sides: n rows (..., n, 4, 4) each."""

    first: Array
    second: Array

    @property
    def n(self) -> int:
        """Number of rows."""
        return int(self.first.shape[-3])

    def rows(self, index: NDArray[np.intp]) -> Self:
        """Some of the rows."""
        return replace(self, first=self.first[..., index, :, :], second=self.second[..., index, :, :])

    @cached_property
    def one_axis(self) -> NDArray[np.bool_]:
        """True where the robot rotates about one axis at most (...), whatever the camera says."""
        few = self.rows(np.unique(np.linspace(0, self.n - 1, min(self.n, MAX_AXIS_ROWS)).astype(np.intp)))
        u = 0.5 * vee(few.motions()[0][..., :3, :3])
        across = np.linalg.eigvalsh(u.mT @ u / max(1, u.shape[-2]))[..., :2].sum(axis=-1)
        return np.asarray(across < ONE_AXIS_SIN2)

    def motions(self) -> tuple[Array, Array]:
        """A and B (..., m, 4, 4): of poses those between all pairs of rows, m = n (n - 1) / 2."""
        return self.first, self.second

    def residual(self, at: Unknowns, first: Array, second: Array) -> Array:
        """r (..., n, 6) at the unknowns and the (measured or corrected) data."""
        return self._closed(at, first, second)[0]

    def _closed(self, at: Unknowns, first: Array, second: Array) -> tuple[Array, ...]:
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class OnPoses(_Rows):
    """``G X C = W``: measured robot poses (not inverted, whatever the setup) and camera poses."""

    inverted: bool  # eye-to-hand: G is the inverse of the robot pose
    split_known: bool = True  # how the noise of rotations is split between robot and camera (`open_directions`)

    item: ClassVar[str] = "pose"
    sides: ClassVar[tuple[str, str]] = ("robot", "camera")
    noise: ClassVar[type[PoseNoise]] = PoseNoise
    fewest: ClassVar[int] = 3  # rows that determine the unknowns
    p: ClassVar[int] = 12  # unknowns

    @property
    def robot(self) -> Array:
        """G (..., n, 4, 4)."""
        return inverse(self.first) if self.inverted else self.first

    def complete(self, X: Array) -> Unknowns:
        """X (..., 4, 4) with the mean of ``G X C`` as W."""
        measured = self.robot @ X[..., None, :, :] @ self.second
        W = measured.mean(axis=-3)
        W[..., :3, :3] = orthonormalise(W[..., :3, :3])
        return Unknowns(X, W)

    def motions(self) -> tuple[Array, Array]:
        i, j = np.triu_indices(self.n, 1)
        G, C = self.robot, self.second
        return inverse(G[..., j, :, :]) @ G[..., i, :, :], C[..., j, :, :] @ inverse(C[..., i, :, :])

    def closure(self) -> tuple[Array, Array]:
        """K (n, 3, 4, 12) and k (n, 3, 4) with ``G X C = K vec(X) + k``, vec the first three rows, of one data set."""
        G, C = self.robot, self.second
        by_X = G[:, :3, None, :3, None] * C.mT[:, None, :, None, :]
        constant = np.zeros((self.n, 3, 4))
        constant[..., 3] = G[:, :3, 3]
        return by_X.reshape(self.n, 3, 4, 12), constant

    def _closed(self, at: Unknowns, first: Array, second: Array) -> tuple[Array, Array, Array, Array]:
        """r, and of what it is made: R_G, R_X t_C and R_G (R_X t_C + t_X)."""
        assert at.W is not None
        X, W = at.X[..., None, :, :], at.W[..., None, :, :]
        G = inverse(first) if self.inverted else first
        R_G, R_X, t_C = G[..., :3, :3], X[..., :3, :3], second[..., :3, 3:]
        r = np.empty((*np.broadcast_shapes(G.shape[:-2], X.shape[:-2]), 6))
        r[..., :3] = logarithm(R_G @ R_X @ second[..., :3, :3] @ W[..., :3, :3].mT)
        arm = R_X @ t_C
        lever = R_G @ (arm + X[..., :3, 3:])
        r[..., 3:] = (lever + G[..., :3, 3:] - W[..., :3, 3:])[..., 0]
        return r, R_G, arm, lever

    def linearise(self, at: Unknowns, first: Array, second: Array) -> Linearised:
        """Linearise at the unknowns and the (measured or corrected) poses."""
        r, R_G, arm, lever = self._closed(at, first, second)
        J = np.empty((*r.shape, 12))
        J[..., :6], D_G, D_C = loop_derivatives(R_G, at.X[..., None, :3, :3], arm[..., 0], lever[..., 0])
        J[..., 6:] = -_EYE6
        return Linearised(r, J, (D_G @ inverse_jacobian(first) if self.inverted else D_G, D_C))


@dataclass(frozen=True, eq=False)
class OnMotions(_Rows):
    """``A X = X B``: measured motions of robot and camera, each with noise of its own."""

    split_known: bool = True

    item: ClassVar[str] = "motion"
    sides: ClassVar[tuple[str, str]] = ("A", "B")
    noise: ClassVar[type[PairNoise]] = PairNoise
    fewest: ClassVar[int] = 2
    p: ClassVar[int] = 6

    def complete(self, X: Array) -> Unknowns:
        """X (..., 4, 4); there is no W."""
        return Unknowns(X, None)

    def closure(self) -> tuple[Array, Array]:
        """K (n, 3, 4, 12) and k (n, 3, 4) with ``A X - X B = K vec(X) + k``, vec the first three rows."""
        by_A = self.first[:, :3, None, :3, None] * np.eye(4)[None, None, :, None, :]
        by_B = np.eye(3)[None, :, None, :, None] * self.second.mT[:, None, :, None, :]
        constant = np.zeros((self.n, 3, 4))
        constant[..., 3] = self.first[:, :3, 3]
        return (by_A - by_B).reshape(self.n, 3, 4, 12), constant

    def _closed(self, at: Unknowns, first: Array, second: Array) -> tuple[Array, Array, Array]:
        """r, and of what it is made: R_X t_B and R_A t_X."""
        X = at.X[..., None, :, :]
        R_A, R_X, t_X = first[..., :3, :3], X[..., :3, :3], X[..., :3, 3:]
        r = np.empty((*np.broadcast_shapes(first.shape[:-2], X.shape[:-2]), 6))
        r[..., :3] = logarithm(R_A @ R_X @ (R_X @ second[..., :3, :3]).mT)
        arm = R_X @ second[..., :3, 3:]
        lever = R_A @ t_X
        r[..., 3:] = (lever + first[..., :3, 3:] - arm - t_X)[..., 0]
        return r, arm, lever

    def linearise(self, at: Unknowns, first: Array, second: Array) -> Linearised:
        """Linearise at X and the (measured or corrected) motions."""
        r, arm, lever = self._closed(at, first, second)
        turn = first[..., :3, :3] - _EYE
        turned = np.broadcast_to(-at.X[..., None, :3, :3], (*r.shape[:-1], 3, 3))
        sides = (block(_EYE, 0.0, -skew(lever[..., 0]), _EYE), block(turned, 0.0, 0.0, turned))
        return Linearised(r, block(turn, 0.0, skew(arm[..., 0]), turn), sides)


Constraint = OnPoses | OnMotions


def constraint_of(data: PosePairs | Motions, noise: Noise | None) -> Constraint:
    """On poses if there are any and the noise is not that of motions; raises if noise and data do not fit."""
    poses = data.poses
    if of_motions(noise) and data is poses:
        raise InputError("PairNoise is noise of motions: give the Motions (relative_motions), not poses.")
    require_noise_fits(noise, data)
    if of_motions(noise) or poses is None:
        assert isinstance(data, Motions)
        return OnMotions(data.A, data.B)
    return OnPoses(poses.robot, poses.camera, poses.setup == "eye-to-hand")


def covariances_of(noise: Noise) -> tuple[Covariance | None, Covariance | None]:
    """Return the covariances of side 1 and side 2, None where exact."""
    first, second = noise.sides.values()
    return first, second


def of_motions(noise: Noise | None) -> bool:
    """Return whether noise is that of motions, not of poses."""
    return getattr(noise, "ITEM", "") == PairNoise.ITEM


def residual_covariance(sides: tuple[Array, Array], noise: Noise) -> Array | JointCovariance:
    """S (..., n, 6, 6), or joint (..., 6n, 6n) where errors of different poses are correlated."""
    covariances = covariances_of(noise)
    if (found := _structured(sides, covariances)) is not None:
        return found
    n = sides[0].shape[-3]
    whole = any(S is not None and is_joint(S) for S in covariances)
    result: Array | float = 0.0
    for D, S in zip(sides, covariances, strict=True):
        if S is None:
            continue
        if not is_joint(S):
            part = D @ S @ D.mT
            result = result + (block_diagonal(part) if whole else part)
        else:
            S = np.asarray(S)
            by_first = (D @ S.reshape(n, 6, 6 * n)).reshape(*D.shape[:-3], 6 * n, n, 6)
            part = by_first.swapaxes(-3, -2) @ D.mT  # (..., n, 6n, 6)
            result = result + part.swapaxes(-3, -2).reshape(*D.shape[:-3], 6 * n, 6 * n)
    return np.asarray(result)


def _structured(sides: tuple[Array, Array], covariances: tuple[Covariance | None, ...]) -> JointCovariance | None:
    """S as a `JointCovariance` where a side is one; None where the other is a joint array, which makes it one too."""
    joint = [joint_of(S) for S in covariances]
    known = [S.carried(D) for D, S in zip(sides, joint, strict=True) if S is not None]
    others = [(D, S) for D, S, part in zip(sides, covariances, joint, strict=True) if part is None and S is not None]
    if not known or any(is_joint(S) for _, S in others):
        return None
    result = known[0]
    more: list[Covariance] = [*known[1:], *(D @ np.asarray(S) @ D.mT for D, S in others)]
    for part in more:
        result = result.plus(part)
    return result


def block_diagonal(blocks: Array) -> Array:
    """(..., n, 6, 6) -> (..., 6n, 6n)."""
    n = blocks.shape[-3]
    result = np.zeros((*blocks.shape[:-3], n, 6, n, 6))
    for k in range(n):
        result[..., k, :, k, :] = blocks[..., k, :, :]
    return result.reshape(*blocks.shape[:-3], 6 * n, 6 * n)


def require_noise_fits(noise: Noise | None, data: PosePairs | Motions) -> None:
    """Raise `InputError` unless the noise is one, of as many motions or poses."""
    if noise is None:
        return
    require_type("noise", noise, (PoseNoise, PairNoise), "PoseNoise, PairNoise or None")
    of_pairs = of_motions(noise)
    if not of_pairs and data.poses is None:
        raise InputError("PoseNoise needs poses; for motions that come without poses use PairNoise.")
    count, what, names = len(data), "motions", ("A", "B")
    if not of_pairs and data.poses is not None:
        count, what, names = data.poses.n, "poses", ("robot", "camera")
    for name, S in zip(names, covariances_of(noise), strict=True):
        require_count(S, count, name, what)
