r"""Test of one unknown pose for a step in time: from some row on it is another one.

With whitened rows ``e = rho + A (x, z)`` of a fit, A (N, q) their derivatives by unknowns and shared errors and
``H = A^T A + P_0``, a copy of the pose in the rows from a moment on adds the columns B (N, 6), 0 before it. The
difference d between the copy and the pose has

    d = -M^-1 B^T e,      Cov d = M^-1,      M = B^T B - B^T A H^-1 A^T B,      d^T M d ~ chi^2_6

Sums over rows give all moments at once. Directions of d that the other rows do not determine (share of M in B^T B below
`MIN_INFORMATION_SHARE`) do not count: 6 minus their number. Of all moments the one with the largest chi-square is kept;
its p allows for the choice (DeLong 1981 for the maximum over all moments, or the number of moments if that is less). Of
more moments than a thousand as many, evenly spread, are tried.
Reference: D. W. K. Andrews (1993), Econometrica 61, 821; A. Estrella (2003), Econometric Theory 19, 1128.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaln

from ...core.geometry.se3 import Array
from ...core.levels import DOUBTFUL
from ...model.errors.cholesky import checked_cholesky
from ...model.errors.joint_covariance import joint_form
from ...model.errors.square_roots import LEAST_WEIGHT
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


class Moments(NamedTuple):
    """Groups of rows in order of time, in as many bins as there are moments to try."""

    at: NDArray[np.intp]  # (g,) moment of each group, in order of time
    in_order_of_rows: NDArray[np.intp]  # (g,) the same
    first: NDArray[np.intp]  # (bins,) number of the first group of each bin
    of_group: NDArray[np.intp]  # (g,) bin of each group, in the order of the rows

    @classmethod
    def of(cls, moment: NDArray[np.intp], most: int = 1000) -> Moments:
        """Put groups of rows at these moments into bins; no moment is in two."""
        order = np.argsort(moment, kind="stable")
        at = moment[order]
        first = np.flatnonzero(np.diff(at, prepend=at[0] - 1)) if len(at) else np.zeros(0, dtype=np.intp)
        if len(first) > most:
            first = first[np.unique(np.linspace(0, len(first) - 1, most).round().astype(np.intp))]
        of_group = np.empty(len(at), dtype=np.intp)
        of_group[order] = np.searchsorted(first, np.arange(len(at)), side="right") - 1
        return cls(at, moment, first, of_group)

    def no_sums(self, q: int) -> Array:
        """(bins, 6, 6 + q + 1) zeros, to which `add` adds; q unknowns and shared errors."""
        return np.zeros((len(self.first), 6, 6 + q + 1))

    def add(self, sums: Array, groups: NDArray[np.intp], each: Array) -> None:
        """Add the `sums_of` of groups of rows (g, 6, 6 + q + 1), by their numbers (g,)."""
        bins = self.of_group[groups]
        order = np.argsort(bins, kind="stable")
        starts = np.flatnonzero(np.diff(bins[order], prepend=-1))
        if len(starts):
            sums[bins[order][starts]] += np.add.reduceat(each[order], starts)


def sums_of(B: Array, rows: Array) -> Array:
    """(g, c, c + q + 1) ``B^T [B, A, e]`` of groups of rows: B (g, d, c), rows [A, e] (g, d, q + 1)."""
    return np.concatenate([B.mT @ B, B.mT @ rows], axis=-1)


def differences(inverse: Array, sums: Array) -> tuple[Array, NDArray[np.intp], Array, Array]:
    """Chi-squares (k,), degrees of freedom (k,), d (k, c) and covariances (k, c, c) of sums (k, c, c + q + 1).

    ``inverse`` (q, q): H^-1. c numbers are tested together: 6 of a pose.
    """
    c = sums.shape[-2]
    G, C, g = sums[..., :c], sums[..., c:-1], sums[..., -1:]
    root = np.linalg.inv(np.linalg.cholesky(G))
    share, vectors = np.linalg.eigh(root @ (G - C @ inverse @ C.mT) @ root.mT)
    resolved = share > MIN_INFORMATION_SHARE
    scale = np.where(resolved, 1.0 / np.where(resolved, share, 1.0), 0.0)
    D = root.mT @ vectors
    along = (D.mT @ g)[..., 0]
    d = -(D @ (scale * along)[..., None])[..., 0]
    return (scale * along**2).sum(axis=-1), resolved.sum(axis=-1), d, (D * scale[..., None, :]) @ D.mT


def largest_step(inverse: Array, sums: Array, moments: Moments) -> Step | None:
    """Return the step of the largest chi-square; None where too few moments are on either side.

    Parameters
    ----------
    inverse : (q, q)
        H^-1.
    sums : (bins, 6, 6 + q + 1)
        Of the rows in each bin.
    moments : Moments
        No step is within one bin.
    """
    count = len(moments.at)
    tried = np.flatnonzero((moments.first >= MIN_MOMENTS) & (moments.first <= count - MIN_MOMENTS))
    if not len(tried):
        return None
    after = np.cumsum(sums[::-1], axis=0)[::-1]  # from each bin on
    square, dof, d, S = differences(inverse, after[tried])
    square = np.where(dof == dof.max(), square, 0.0)
    best, begins = int(np.argmax(square)), moments.first[tried]
    p = _largest_by_chance(float(square[best]), int(dof[best]), begins / count)
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
    n, S = len(order), joint_form(fit.S, len(fit.residual)).rows(order)
    half = np.linalg.inv(checked_cholesky(S.own))
    if fit.weights is not None:
        half = np.sqrt(np.maximum(fit.weights[order], LEAST_WEIGHT))[:, None, None] * half
    white = half @ np.concatenate([fit.linear.J[order], S.shared, fit.residual[order][..., None]], axis=-1)
    A, e = white[..., :-1].reshape(6 * n, -1), white[..., -1].reshape(-1)
    H = A.T @ A
    np.einsum("ii->i", H)[12:] += 1.0
    if fit.prior is not None:
        H[:12, :12] += fit.prior.normal_equations(fit.X, fit.W)[0]
    F = A[:, 12:]
    white[..., -1] -= (F @ np.linalg.solve(H[12:, 12:], F.T @ e)).reshape(n, 6)  # shared errors as they are estimated
    inverse, moments, found = np.linalg.inv(H), Moments.of(np.arange(n)), []
    for of in (slice(0, 6), slice(6, 12)):
        moments.add(sums := moments.no_sums(A.shape[-1]), np.arange(n), sums_of(white[..., of], white))
        found.append(largest_step(inverse, sums, moments))
    return [step for step in found if step is not None]
