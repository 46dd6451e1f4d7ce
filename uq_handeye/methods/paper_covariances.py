"""The paper's covariances at a finite scaling factor d, on SO(4) and of the parts of X, (42)-(48), (53)-(59), (66).

Sigma_sigma is the covariance of the octonion, for independent pairs or literally by the shared mean covariance of (45).
Sigma_R, Sigma_t and the cross terms follow from it; `so4_covariance` has Sigma_R4 from the 6x6 covariance of X.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..core.geometry.checks import as_numbers, as_transforms
from ..core.geometry.se3 import Array, vee
from ..errors import require_type
from ..model.errors.models import PairNoise, require_count
from . import _closed_form
from .pairs import MotionsLike, as_pairs, pair_blocks
from .scaled import solve_scaled
from .scaled_sensitivity import Linearised, ScaledDerivatives, columns_by_octonion, linearised

# The scaling factor of the paper's experiments, used where a formula exists at finite d only.
PAPER_SCALE = 1e4


class OctonionCovariance(NamedTuple):
    """The octonion of X and its covariance at finite d."""

    sigma: Array  # (..., 8): (q_L, q_R) / sqrt(2)  (18)
    covariance: Array  # (..., 8, 8): (48), of sigma itself


def octonion_covariance(
    A: MotionsLike, B: MotionsLike, noise: PairNoise, *, scale: float = PAPER_SCALE, literal: bool = False
) -> OctonionCovariance:
    """Sigma_sigma (42)-(48): both diagonal blocks and the cross block (46)-(47), for independent pairs.

    The sum over pairs is ``sum_i D_i Sigma_i D_i^T``; ``literal=True`` takes the averaged derivative and one
    shared Sigma_b of (45) instead. The paper's blocks are those of (q_L, q_R); sigma carries the factor
    1/sqrt(2) of (18), its covariance 1/2, which (48) leaves out and (55) needs.

    Parameters
    ----------
    A, B : (..., N, 4, 4)
    noise : PairNoise
    scale : float
        The scaling factor d.
    """
    require_type("noise", noise, PairNoise, "PairNoise")
    A, B = as_pairs(A, B)
    require_count(noise.A, A.shape[-3], "A", "motions")
    require_count(noise.B, A.shape[-3], "B", "motions")
    solution = solve_scaled(A, B, scale)
    total = literal_sum if literal else _octonion_sum
    S = _per_trial(A, B, noise, linearised(solution, None, scale), total)
    return OctonionCovariance(solution.sigma, S.reshape(*A.shape[:-3], 8, 8))


def literal_covariance(A: Array, B: Array, noise: PairNoise, X: Array | None, scale: float) -> Array:
    """Sigma_X (T, 6, 6) through (45) as printed; A, B (..., N, 4, 4) and X (T, 4, 4) or None to solve for it."""
    at = linearised(solve_scaled(A, B, scale), X, scale)
    S = _per_trial(A, B, noise, at, literal_sum)
    return np.asarray(at.to_X @ S @ at.to_X.mT)


def _per_trial(
    A: Array,
    B: Array,
    noise: PairNoise,
    at: Linearised,
    total: Callable[[ScaledDerivatives, Array, Array, PairNoise], Array],
) -> Array:
    flat_A, flat_B = (T.reshape(-1, *T.shape[-3:]) for T in (A, B))
    trials = [slice(k, k + 1) for k in range(len(flat_A))]
    return np.array([total(ScaledDerivatives(at, k), flat_A[k], flat_B[k], noise) for k in trials]).reshape(-1, 8, 8)


def _octonion_sum(derivatives: ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    S = np.zeros((8, 8))
    for pairs in pair_blocks(A.shape[1]):
        by_pair = derivatives.of_octonion(A[:, pairs], B[:, pairs])[:, 0]
        for D, covariance in zip(by_pair, (noise.A, noise.B), strict=True):
            if covariance is not None:
                S += (D @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ D.mT).sum(axis=0)
    return S


def literal_sum(derivatives: ScaledDerivatives, A: Array, B: Array, noise: PairNoise) -> Array:
    """(45): ``D Sigma_b D^T`` with the mean derivative by b and the mean covariance of b over the pairs."""
    N = A.shape[1]
    D, S_b = np.zeros((8, 32)), np.zeros((32, 32))
    for pairs in pair_blocks(N):
        D += derivatives.by_image(A[:, pairs], B[:, pairs])[0].sum(axis=0) / N
        for k, (T, covariance) in enumerate(((A, noise.A), (B, noise.B))):
            if covariance is not None:
                J = _closed_form.dF2_dxi(T[0, pairs], derivatives.scale)
                half = slice(16 * k, 16 * k + 16)
                S_b[half, half] += (J @ (covariance if covariance.ndim == 2 else covariance[pairs]) @ J.mT).sum(
                    axis=0
                ) / N
    return D @ S_b @ D.T


class PaperCovariances(NamedTuple):
    """Covariances that (53)-(59) read off Sigma_sigma."""

    R4: Array  # (..., 4, 4): <dR4 dR4^T> on SO(4) (56)
    R: Array  # (..., 3, 3): Sigma_R = <dR dR^T> (58) = tr(Sigma_theta) I - Sigma_theta
    t: Array  # (..., 3, 3): Sigma_t (59)
    R_t: Array  # (..., 3, 3, 3): [i] = <delta R_column_i delta t^T>, d times the blocks c_i, c_4 of (55)


def paper_covariances(sigma: Array, covariance_sigma: Array, scale: float) -> PaperCovariances:
    """Sigma_R, Sigma_t and the rotation-translation cross terms from Sigma_sigma (55)-(59)."""
    P = columns_by_octonion(sigma)
    S = np.asarray(covariance_sigma)[..., None, :, :]
    R4 = 4.0 * (P @ S @ P.mT).sum(axis=-3)  # (56)
    cross = 4.0 * (P[..., :3, :, :] @ S @ P[..., 3:, :, :].mT)  # (55) with i = 1, 2, 3 and j = 4
    Sigma_t = 4.0 * scale**2 * (P[..., 3, :, :] @ np.asarray(covariance_sigma) @ P[..., 3, :, :].mT)
    Sigma_t = 0.5 * (Sigma_t + Sigma_t.mT)  # symmetric to rounding, which d^2 enlarges
    return PaperCovariances(R4, R4[..., :3, :3], Sigma_t[..., :3, :3], scale * cross[..., :3, :3])


def so4_covariance(X: Array, covariance: Array, scale: float) -> Array:
    """``<dR4 dR4^T>`` of ``R4 = F2(X, d)`` from the 6x6 covariance of X: (65)-(66), (..., 4, 4).

    Exact to first order in the errors. The approximation printed in (66) drops the term of
    ``<theta x tau>``, and (65) prints ``t^T dt`` where ``dt^T dt`` is meant.
    """
    covariance = as_numbers(covariance, "covariance")
    t = as_transforms(X, "X", stack=False)[..., :3, 3]
    theta, tau = covariance[..., :3, :3], covariance[..., 3:, 3:]
    cross = covariance[..., :3, 3:]
    Sigma_R = np.trace(theta, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - theta
    twist = vee(cross.mT)  # <theta x tau>
    Rt = (Sigma_R @ t[..., None])[..., 0]
    result = np.empty((*covariance.shape[:-2], 4, 4))
    result[..., :3, :3] = Sigma_R + tau / scale**2
    result[..., :3, 3] = result[..., 3, :3] = -(twist + Rt) / scale
    result[..., 3, 3] = (
        np.trace(tau, axis1=-2, axis2=-1) + 2.0 * np.sum(t * twist, axis=-1) + np.sum(t * Rt, axis=-1)
    ) / scale**2
    return result
