r"""Propagation of noise through the derivatives of X: the sums ``sum F Sigma F^T`` over pairs and over their poses.

A covariance to first order is ``Sigma_X = Q (sum of F Sigma F^T) Q^T`` with the derivatives F (2, 6, 6, T, m) of the
estimator by the errors of A and B (`methods.method.Derivatives`), block after block of pairs, for T trials. This
module has the noise of the data: noise that is independent for each pair (T3), noise of poses that pairs share (T4),
joint or not, and noise of poses treated as if it were independent for each pair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ..core.geometry.checks import entry_rows
from ..core.geometry.se3 import Array, block, inverse, skew
from ..core.scratch import scratch
from ..errors import InputError
from ..model.errors.cholesky import factor
from ..model.errors.models import Noise, PairNoise, PoseNoise, is_joint, marginals, require_count
from ..model.poses.motions import Motions
from ..model.poses.pose_pairs import PosePairs
from .method import ErrorFactors
from .sensitivity import cross_rows, trials_first

_EYE = np.eye(3)


# Accumulator of F Sigma F^T: its `add` takes the derivatives F (2, 6, 6, T, m) of block after block of pairs.
DataSide: TypeAlias = "Independent | Shared | Unshared"
Start = Callable[[slice], DataSide]


def data_side(noise: Noise, kind: str | None, motions: Motions | None, N: int) -> Start:
    """Return the start of a sum for some trials; raises `InputError` where noise, kind and motions do not fit."""
    default, others = ("poses", "pairs") if noise.ITEM == "pose" else ("pairs", "literal")
    if kind not in (None, default, others):
        raise InputError(f"Expected `kind` with {type(noise).__name__} to be {default!r} or {others!r}, got {kind!r}.")
    if noise.ITEM == "motion":
        require_count(noise.A, N, "A", "motions")
        require_count(noise.B, N, "B", "motions")
        pair_noise = noise
        return lambda trials: Independent(pair_noise)
    made = made_from_poses(motions)
    poses, index, pose_noise = made.poses, made.pairs, noise
    assert poses is not None and index is not None
    require_count(noise.robot, poses.n, "robot", "poses")
    require_count(noise.camera, poses.n, "camera", "poses")
    form = Unshared if kind == "pairs" else Shared
    return lambda trials: form(poses, index, pose_noise, trials)


def made_from_poses(motions: Motions | None) -> Motions:
    if motions is None or motions.poses is None:
        raise InputError(
            "PoseNoise needs Motions that were made from poses (relative_motions); for motions without poses use "
            "PairNoise."
        )
    return motions


def noise_of_pairs(motions: Motions | None, noise: Noise) -> PairNoise:
    """The covariance of each pair (N, 6, 6) that PoseNoise makes, to first order: what pairs share is lost.

    Noise of pairs is returned as it is. Raises `InputError` for PoseNoise of motions without poses.
    """
    if noise.ITEM == "motion":
        return noise
    motions = made_from_poses(motions)
    poses, index = motions.poses, motions.pairs
    assert poses is not None and index is not None
    side = Unshared(poses, index, noise, slice(0, 1))
    unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, len(index)))
    found: list[Array | None] = []
    for k, L in enumerate(side.factors):
        if L is None:
            found.append(None)
            continue
        D = side.by_difference(unit, k, slice(None))[:, :, 0].transpose(2, 0, 1)
        parts = [D @ L[0, pose] for pose in index.T]
        found.append(parts[0] @ parts[0].mT + parts[1] @ parts[1].mT)
    return PairNoise(*found)


class Independent:
    """``sum_i F_i Sigma_i F_i^T`` for noise of each pair's own (T3)."""

    def __init__(self, noise: PairNoise) -> None:
        self.factors = noise.factors
        self.sum: Array | float = 0.0

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in zip(F, self.factors, strict=True):
            if L is not None:
                self.sum = self.sum + _outer(_times(side, L if L.ndim == 2 else L[None, pairs]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _times(F: Array, L: Array) -> Array:
    """``F L`` with pairs last: F (6, 6, T, m) and L (6, 6) or (T, m, 6, 6)."""
    out = scratch("times", *F.shape)
    if L.ndim == 2:
        np.matmul(L.T, F.reshape(6, 6, -1), out=out.reshape(6, 6, -1))
    else:
        np.einsum("ijtm,tmjk->iktm", F, np.broadcast_to(L, (*F.shape[2:], 6, 6)), out=out)
    return out


def _outer(FL: Array) -> Array:
    """``sum over pairs of FL FL^T`` per trial: (6, 6, T, m) -> (T, 6, 6)."""
    stacked = trials_first(FL)
    return np.asarray(stacked @ stacked.mT)


class FromPoses:
    """Derivatives by the left twists of the poses behind the pairs.

    With ``P = G`` (robot) or ``P = inv(C)`` (camera), both motions are ``inv(P_j) P_i``. For left twists
    ``P -> exp(zeta) P`` only ``delta = zeta_i - zeta_j`` enters, so that one 6x6 block serves both poses of a
    pair, with opposite signs:  ``theta = R_j^T delta_theta``, ``tau = R_j^T (delta_rho - [t_i]x delta_theta)``.
    """

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        self.pairs = index
        self.model, self.noise = noise, (noise.robot, noise.camera)
        frames, self.by_pose = pose_twists(poses, trials)
        entries = [entry_rows(P.reshape(-1, 4, 4)).reshape(4, 4, *P.shape[:2]) for P in frames]
        self.R = [P[:3, :3] for P in entries]
        self.t = [cross_rows(P[:3, 3]) for P in entries]

    def by_difference(self, F: Array, side: int, pairs: slice) -> Array:
        """``F d xi / d delta`` of one side, F (6, 6, T, m)."""
        i, j = self.pairs[pairs].T
        T, m = F.shape[2:]
        by_twist: Array = np.einsum("ajtm,kjtm->aktm", F.reshape(12, 3, T, m), self.R[side].take(j, axis=-1)).reshape(
            6, 6, T, m
        )
        by_twist[:, :3] -= np.einsum("ajtm,jktm->aktm", by_twist[:, 3:], self.t[side].take(i, axis=-1))
        return by_twist


class Shared(FromPoses):
    """``sum_k D_k Sigma_k D_k^T`` over poses, ``D_k`` summed over the pairs that use pose k (T4).

    A joint covariance of all poses is used whole: ``D = [D_1 .. D_n]``, ``D Sigma D^T`` (T4b).
    """

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        super().__init__(poses, index, noise, trials)
        self.sums = [np.zeros_like(by_pose) for by_pose in self.by_pose]

    def add(self, F: Array, pairs: slice) -> None:
        incidence = _incidence(self.pairs[pairs], self.sums[0].shape[1])
        for side in (0, 1):
            if self.noise[side] is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                T, m = by_difference.shape[2:]
                spread = incidence @ by_difference.reshape(-1, m).T
                self.sums[side] += spread.reshape(-1, 6, 6, T).transpose(3, 0, 1, 2)

    def by_error(self) -> list[Array | None]:
        """The sums times the derivative of the twist by the error of the pose: (T, n, 6, 6); None: exact."""
        return [
            None if covariance is None else twist @ pose
            for twist, pose, covariance in zip(self.sums, self.by_pose, self.noise, strict=True)
        ]

    def covariance(self) -> Array:
        return covariance_of_poses(self.by_error(), self.model)

    @property
    def joint(self) -> bool:
        """True if the errors of different poses are correlated."""
        return any(covariance is not None and is_joint(covariance) for covariance in self.noise)

    @property
    def twice(self) -> bool:
        """True if two pairs have both poses in common."""
        return len(np.unique(np.sort(self.pairs, axis=1), axis=0)) < len(self.pairs)

    def pose_factors(self, pairs: slice) -> Array:
        """``d (xi_A, xi_B) / dz`` (2, m, 12, 12) of pairs of the first trial by their two poses, z standard normal."""
        index = self.pairs[pairs].T
        unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, index.shape[1]))
        found = np.zeros((2, index.shape[1], 12, 12))
        for side, (by_pose, covariance) in enumerate(zip(self.by_pose, self.noise, strict=True)):
            if covariance is not None:
                D = self.by_difference(unit, side, pairs)[:, :, 0].transpose(2, 0, 1)
                part = slice(6 * side, 6 * side + 6)
                found[:, :, part, part] = D @ (by_pose[0] @ factor(covariance))[index] * [[[[1.0]]], [[[-1.0]]]]
        return found

    @property
    def count(self) -> int:
        """Number of error components of all poses."""
        noisy = sum(1 for covariance in self.noise if covariance is not None)
        return 6 * int(self.sums[0].shape[1]) * noisy

    def factors(self) -> ErrorFactors:
        """``d (xi_A, xi_B) / dz`` (m, 12, k) of pairs of the first trial, z independent standard normal."""
        n = self.sums[0].shape[1]
        of_poses: list[Array | None] = []  # (n, 6, 6n) each
        for by_pose, covariance in zip(self.by_pose, self.noise, strict=True):
            if covariance is None:
                of_poses.append(None)
                continue
            L = factor(covariance)
            whole = L if is_joint(covariance) else block_diag(*np.broadcast_to(L, (n, 6, 6)))
            of_poses.append(by_pose[0] @ whole.reshape(n, 6, 6 * n))

        def of_pairs(pairs: slice) -> Array:
            i, j = self.pairs[pairs].T
            unit = np.broadcast_to(np.eye(6)[:, :, None, None], (6, 6, 1, len(i)))
            found = np.zeros((len(i), 12, self.count))
            first = 0
            for side, L in enumerate(of_poses):
                if L is not None:
                    D = self.by_difference(unit, side, pairs)[:, :, 0].transpose(2, 0, 1)
                    found[:, 6 * side : 6 * side + 6, first : first + 6 * n] = D @ (L[i] - L[j])
                    first += 6 * n
            return found

        return of_pairs


def pose_twists(poses: PosePairs, trials: slice) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """The frames P = G and P = inv(C), each (T, n, 4, 4), and d zeta / d xi of their left twists, (T, n, 6, 6).

    The left twist of T is ``(theta, tau + [t]x theta)``; that of inv(T) is minus the right twist of T,
    ``-(R^T theta, R^T tau)``.
    """
    robot = poses.robot.reshape(-1, poses.n, 4, 4)[trials]
    camera = poses.camera.reshape(-1, poses.n, 4, 4)[trials]
    by_camera = _minus_right_twist(camera)
    if poses.setup == "eye-in-hand":
        return (robot, inverse(camera)), (block(_EYE, 0.0, skew(robot[..., :3, 3]), _EYE), by_camera)
    return (inverse(robot), inverse(camera)), (_minus_right_twist(robot), by_camera)


def covariance_of_poses(by_error: Iterable[Array | None], noise: PoseNoise) -> Array:
    """``sum_k D_k Sigma_k D_k^T`` (..., 6, 6) over robot and camera poses, or ``D Sigma D^T`` if their noise is joint.

    D (..., n, 6, 6) are the derivatives by the error of each pose; None: that side is exact.
    """
    result: Array | float = 0.0
    for D, covariance in zip(by_error, (noise.robot, noise.camera), strict=True):
        if D is not None and covariance is not None:
            if not is_joint(covariance):
                D = D @ factor(covariance)
            row = D.swapaxes(-3, -2).reshape(*D.shape[:-3], 6, -1)
            result = result + (row @ covariance @ row.mT if is_joint(covariance) else row @ row.mT)
    result = np.asarray(result)
    return np.asarray(0.5 * (result + result.mT))


def _incidence(pairs: NDArray[np.intp], n: int) -> Any:
    """The (n, m) matrix with +1 at pose i and -1 at pose j of each pair."""
    from scipy.sparse import csc_array  # slow to import and needed here only

    m = len(pairs)
    return csc_array((np.tile([1.0, -1.0], m), pairs.ravel(), np.arange(0, 2 * m + 1, 2)), shape=(n, m))


class Unshared(FromPoses):
    """Noise of the poses, but each pair as if its poses were its own: what T3 makes of PoseNoise."""

    def __init__(self, poses: PosePairs, index: NDArray[np.intp], noise: PoseNoise, trials: slice) -> None:
        super().__init__(poses, index, noise, trials)
        self.sum: Array | float = 0.0
        self.factors = [
            None if covariance is None else by_pose @ factor(marginals(covariance))
            for by_pose, covariance in zip(self.by_pose, self.noise, strict=True)
        ]

    def add(self, F: Array, pairs: slice) -> None:
        for side, L in enumerate(self.factors):
            if L is not None:
                by_difference = self.by_difference(F[side], side, pairs)
                for pose in self.pairs[pairs].T:
                    self.sum = self.sum + _outer(_times(by_difference, L[:, pose]))

    def covariance(self) -> Array:
        return np.asarray(self.sum)


def _minus_right_twist(T: Array) -> Array:
    R_T = T[..., :3, :3].mT
    return -block(R_T, 0.0, 0.0, R_T)
