r"""Test of one unknown pose for a step in time: from some row on it is another one.

With whitened rows ``e = rho + A (x, z)`` of a fit, A (N, q) their derivatives by unknowns and shared errors and
``H = A^T A + P_0``, a copy of the pose in the rows from a moment on adds the columns B (N, 6), 0 before it. The
difference d between the copy and the pose has

    d = -M^-1 B^T e,      Cov d = M^-1,      M = B^T B - B^T A H^-1 A^T B,      d^T M d ~ chi^2_6

Sums over rows give all moments at once. Directions of d that the other rows do not determine (share of M in B^T B below
`MIN_INFORMATION_SHARE`) do not count: 6 minus their number. Of all moments the one with the largest chi-square is kept;
its p allows for the choice (DeLong 1981 for the maximum over all moments, or the number of moments if that is less).
Reference: D. W. K. Andrews (1993), Econometrica 61, 821; A. Estrella (2003), Econometric Theory 19, 1128.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaln

from ...core.geometry.se3 import Array
from ...core.numbers.levels import DOUBTFUL
from ...model.noise.cholesky import checked_cholesky
from ...model.noise.joint_covariance import joint_form
from ...model.noise.square_roots import LEAST_WEIGHT
from .gauss_helmert import Fit

# A direction of a change counts where the other rows give at least this share of the information.
MIN_INFORMATION_SHARE = 1e-5
# Moments that are needed on either side of a step.
MIN_MOMENTS = 3
# Moments in a row of which most views are rejected that make a run.
MIN_RUN = 5
# Probability of a false finding in one data set: it is one of about ten tests.
FALSE_FINDING = DOUBTFUL.probability / 10


class Step(NamedTuple):
    """The step of the largest chi-square."""

    begin: int  # number of the first group of rows after it, in order of time
    chi_square: float
    dof: int
    p: float
    change: Array  # (6,) the pose before it minus that after it
    covariance: Array  # (6, 6) of the change


def sums_of(B: Array, rows: Array) -> Array:
    """(g, 6, 6 + q + 1) ``B^T [B, A, e]`` of groups of rows: B (g, d, 6), rows [A, e] (g, d, q + 1)."""
    return np.asarray(B.mT @ np.concatenate([B, rows], axis=-1))


def differences(inverse: Array, sums: Array) -> tuple[Array, NDArray[np.intp], Array, Array]:
    """Chi-squares (k,), degrees of freedom (k,), d (k, 6) and covariances (k, 6, 6) of sums (k, 6, 6 + q + 1).

    ``inverse`` (q, q): H^-1.
    """
    G, C, g = sums[..., :6], sums[..., 6:-1], sums[..., -1:]
    root = np.linalg.inv(np.linalg.cholesky(G))
    share, vectors = np.linalg.eigh(root @ (G - C @ inverse @ C.mT) @ root.mT)
    resolved = share > MIN_INFORMATION_SHARE
    scale = np.where(resolved, 1.0 / np.where(resolved, share, 1.0), 0.0)
    D = root.mT @ vectors
    along = (D.mT @ g)[..., 0]
    d = -(D @ (scale * along)[..., None])[..., 0]
    return (scale * along**2).sum(axis=-1), resolved.sum(axis=-1), d, (D * scale[..., None, :]) @ D.mT


def largest_step(inverse: Array, sums: Array, at: NDArray[np.intp]) -> Step | None:
    """Return the step of the largest chi-square; None where too few moments are on either side.

    Parameters
    ----------
    inverse : (q, q)
        H^-1.
    sums : (g, 6, 6 + q + 1)
        Of groups of rows in order of time (`sums_of`).
    at : (g,)
        Moment of each group; no step is within one moment.
    """
    begins = np.flatnonzero(np.diff(at)) + 1
    begins = begins[(begins >= MIN_MOMENTS) & (begins <= len(at) - MIN_MOMENTS)]
    if not len(begins):
        return None
    after = np.cumsum(sums[::-1], axis=0)[::-1]  # from each group on
    square, dof, d, S = differences(inverse, after[begins])
    square = np.where(dof == dof.max(), square, 0.0)
    best = int(np.argmax(square))
    p = _largest_by_chance(float(square[best]), int(dof[best]), begins / len(at))
    return Step(int(begins[best]), float(square[best]), int(dof[best]), p, d[best], S[best])


def _largest_by_chance(square: float, dof: int, shares: Array) -> float:
    """Probability that the largest chi-square of all moments, at these shares of the rows, is as large."""
    each = float(chdtrc(dof, square)) * len(shares)
    if square <= dof:
        return min(1.0, each)
    odds = np.log(shares[-1] / (1.0 - shares[-1])) - np.log(shares[0] / (1.0 - shares[0]))
    density = np.exp(0.5 * dof * np.log(0.5 * square) - 0.5 * square - gammaln(0.5 * dof))
    return float(min(1.0, each, density * ((1.0 - dof / square) * odds + 2.0 / square)))


def steps_of(fit: Fit, order: NDArray[np.intp]) -> list[Step]:
    """Return the largest step of X and of W of a fit on poses, whose rows come in this order of time.

    Rows with a robust weight w count by w. Raises `SingularNoiseError` where the noise of a pose is singular.
    """
    n, S = len(order), joint_form(fit.S, len(fit.residual))
    half = np.linalg.inv(checked_cholesky(S.own[order]))
    if fit.weights is not None:
        half = np.sqrt(np.maximum(fit.weights[order], LEAST_WEIGHT))[:, None, None] * half
    white = half @ np.concatenate([fit.linear.J[order], S.shared[order], fit.residual[order][..., None]], axis=-1)
    A, e = white[..., :-1].reshape(6 * n, -1), white[..., -1].reshape(-1)
    H = A.T @ A
    np.einsum("ii->i", H)[12:] += 1.0
    if fit.prior is not None:
        H[:12, :12] += fit.prior.normal_equations(fit.X, fit.W)[0]
    F = A[:, 12:]
    white[..., -1] -= (F @ np.linalg.solve(H[12:, 12:], F.T @ e)).reshape(n, 6)  # shared errors as they are estimated
    inverse, at = np.linalg.inv(H), np.arange(n)
    found = (largest_step(inverse, sums_of(white[..., of], white), at) for of in (slice(0, 6), slice(6, 12)))
    return [step for step in found if step is not None]
