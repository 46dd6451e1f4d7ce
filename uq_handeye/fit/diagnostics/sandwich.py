r"""Covariances of X and W from the residuals only, by pose: sandwich and bootstrap.

Model: to first order the estimate errs by ``xi = (xi_X, xi_W) = sum_k B_k r_k``, with the residual r_k (6) of pose k at
true X and W (`constraint`; rad and m, left rotation, additive translation), r_k of mean zero. Nothing else is assumed
about the covariances of r_k: they may differ from pose to pose in any way. After the fit the residuals are
``e = (1 + J B) r``. In units in which a *working* covariance S_k of r_k is the unit matrix,

    V_k = [(1 + J B)(1 + J B)^T]_kk = 1 + J_k B_k + (J_k B_k)^T + J_k (sum_j B_j B_j^T) J_k^T
    c_k = B_k V_k^(-1/2) e_k,        Cov = sum_k c_k c_k^T                                               (sandwich)

is unbiased where the working covariance is right up to a factor, and consistent in any case. Weighted least squares
(`likelihood.Fit`) has ``B_k = -M J_k^T``, ``V_k = 1 - H_kk`` with the leverage ``H_kk = J_k M J_k^T``: the bias-reduced
linearisation CR2 of R. M. Bell and D. F. McCaffrey, "Bias reduction in standard errors for linear regression with
multi-stage samples", Survey Methodology 28 (2002) 169-181; the line above is the same for any linear estimator.

Any smooth estimator of X depends on the errors of pose k only through r_k, so that ``B_k = (d xi_X / d xi_G,k)
(d r_k / d xi_G,k)^-1`` from its derivatives by the robot poses (T4); with W the mean of ``G X C``,
``B_W,k = 1/n + mean(J_X) B_X,k``. Its working covariance is the mean of ``e_k e_k^T``, equal for all poses.

*Bootstrap.* To first order the estimate of poses that count m_k times solves

    sum_k m_k B_k (e_k + J_k (x* - x)) - M Lambda (x* - x) = const,      x for m_k = 1

(Lambda: the prior information about the unknowns, below). n poses drawn with replacement, m multinomial, move it by

    x* - x = (M Lambda - sum_k m_k B_k J_k)^-1 sum_k (m_k - 1) B_k e_k

For linearised weighted least squares that is exact. Of published methods it is what solving again gives but for shares
of the order of 1/n (tests/empirical_covariance); where the poses' shares ``-B_k J_k`` are no weights (`li`, few poses),
there is no bootstrap. The covariance is that of the draws that determine X (B. Efron, Ann. Statist. 7 (1979) 1-26). On
30 simulated poses with the true noise model (tests/empirical_covariance) the sandwich is on average the sampling
covariance, the variances of the bootstrap are between 8 % smaller and 2 % larger, on average over all directions.

Poses are taken as independent. Where neighbours share errors, as in a video, thin the poses, or let the drift be
estimated with the noise (`drift`).

Errors that all poses share and that were declared with a standard deviation (`SharedError`) are further unknowns z with
the prior N(0, 1), X and W may have one as well, ``M = (J^T J + Lambda)^-1``: residuals determine the covariance of the
poses' own errors; the contribution of the prior, ``M Lambda M`` (`of_known`), is that of the model.

Reference distribution. Such a covariance is itself random. Under the working model with Gaussian errors it is close to
a Wishart matrix of nu degrees of freedom, nu from its second moments, so that for the 6 components of X

    d^2 (nu - 5) / (6 nu)  ~  F(6, nu - 5),        d^2 = xi_X^T Cov_X^-1 xi_X           (`d2_distribution`, Hotelling)

Source: J. E. Pustejovsky and E. Tipton, J. Business & Economic Statistics 36 (2018) 672-683 (their AHT test, which
carries the degrees of freedom of Bell and McCaffrey from one component to several). A chi-square with 6 degrees of
freedom would claim too much: with 30 poses fewer sets are inside by more than 10 % of all (tests/empirical_covariance).
Coverage of the 95 % ellipsoid, Gaussian errors whose size was estimated (``python -m studies.real_cell --full``): 0.960
with 30 poses, 0.996 with 15: on the safe side with few poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.checks import CHUNK
from ...core.geometry.se3 import Array
from ...core.rounding import PRODUCT_ROUNDING, SOLUTION_ROUNDING
from ...errors import DegenerateMotionError, InputError, require_integer
from ...model.errors.joint_covariance import joint_of
from ...model.errors.square_roots import cholesky_of, is_joint, whiten
from ..graph.constraint import MIN_RESOLVED_SHARE
from ..graph.gauss_helmert import Fit
from ..graph.own_residuals import own_residuals

# The shares ``-B_k J_k`` of the poses in the estimate add up to 1; one with an eigenvalue below this is no weight.
MIN_SHARE_OF_POSE = -0.05

# Draws of the bootstrap of one data set that are solved together at least: the shares of all poses are read once.
MIN_DRAWS_TOGETHER = 32

# Why there is no such covariance under joint noise.
JOINT = (
    "The noise is joint over the poses: they share errors, so that no two of them are independent, and clustering by "
    "pose would miss what they share. Use the covariance of that noise, or noise that is independent per pose."
)


@dataclass(frozen=True, eq=False)
class Influence:
    """Influence of each pose (or motion) on the estimate, to first order, in units of the working covariance."""

    residual: Array  # (..., n, 6), e; of a rig 6 rows for each view of a group, 0 where it has fewer
    J: Array  # (..., n, 6, p)
    B: Array  # (..., n, p, 6)
    known: Array | None = None  # (p, p) Lambda, information on the unknowns that is not of the poses

    def __post_init__(self) -> None:
        if self.n <= 6:  # n contributions add up to about 0: their products have the rank n - 1, of 6 components
            raise InputError(
                "A covariance from the residuals needs at least 7 poses (or motions) with a weight above "
                f"0, got {self.n}. Give the noise instead, or more poses."
            )

    @property
    def n(self) -> int:
        """Number of clusters."""
        return int(self.residual.shape[-2])

    @cached_property
    def covariance(self) -> Array:
        """Covariance of the working model (..., p, p)."""
        rows = self.B.swapaxes(-3, -2).reshape(*self.B.shape[:-3], self.B.shape[-2], -1)
        return np.asarray(rows @ rows.mT)

    @cached_property
    def _variance(self) -> Array:
        """V (..., n, 6, 6)."""
        V = self.J @ self.B + (self.B.mT + times(self.J, self.covariance)) @ self.J.mT
        V += np.eye(self.residual.shape[-1])
        return np.asarray(V)

    @cached_property
    def adjustment(self) -> Array:
        """``V_k^(-1/2)`` (..., n, 6, 6)."""
        values, vectors = np.linalg.eigh(self._variance)
        require_dispensable(values[..., 0] > MIN_RESOLVED_SHARE)
        return np.asarray((vectors / np.sqrt(values)[..., None, :]) @ vectors.mT)

    @cached_property
    def contributions(self) -> Array:
        """c (..., n, p): their products are the sandwich."""
        return np.asarray((self.B @ (self.adjustment @ self.residual[..., None]))[..., 0])

    def sandwich(self) -> Array:
        """The covariance (..., p, p) from the residuals, cluster-robust by pose (CR2): no noise model is trusted."""
        return np.asarray(self.contributions.mT @ self.contributions)

    def bootstrap(self, replicates: int = 2000, seed: int | np.random.Generator = 0) -> Array:
        """The covariance (..., p, p) over poses drawn with replacement; all leading axes see the same draws.

        Raises `InputError` for fewer than 2 replicates and where the shares of the poses are no weights,
        `DegenerateMotionError` where more than half of the draws do not determine X and W.
        """
        require_integer("replicates", replicates, 2)
        n, p, rng = self.n, self.J.shape[-1], np.random.default_rng(seed)
        half = np.asarray(np.linalg.cholesky(self._bread), dtype=float)  # information of all, and what is known, is 1
        J, B = times(self.J, half), times(self.B.mT, np.linalg.inv(half).mT).mT
        known, free = np.zeros((p, p)), np.eye(p)
        if self.known is not None:
            # Only where the data say more than half, no prior keeps a draw from being singular: its inverse is large.
            known = half.T @ self.known @ half
            share, directions = np.linalg.eigh(known)
            free = directions[:, share < 0.5]
        own, shares = (B @ self.residual[..., None])[..., 0], -(B @ J)
        if self.known is None and np.linalg.eigvalsh(0.5 * (shares + shares.mT)).min() < MIN_SHARE_OF_POSE:
            raise InputError(
                "Bootstrap over poses is not available for this method on these poses: to draw one more often would "
                "make X less certain in some direction. Choose 'sandwich', or give more poses."
            )
        shares = shares.reshape(*own.shape[:-1], p * p)
        batch = own.shape[:-2]
        total, square = np.zeros((*batch, p)), np.zeros((*batch, p, p))
        used = np.zeros(batch, dtype=np.intp)
        sets = math.prod(batch)
        size = max(1, MIN_DRAWS_TOGETHER // sets, 12 * CHUNK // (sets * 3 * p * p + n))
        for start in range(0, replicates, size):
            counts = rng.multinomial(n, np.full(n, 1.0 / n), size=min(size, replicates - start)).astype(float)
            information = (counts @ shares).reshape(*batch, -1, p, p)
            # far below the information of a draw that counts, and enough for a singular matrix to have an inverse
            information = information + known + SOLUTION_ROUNDING * np.eye(p)
            right = ((counts - 1.0) @ own)[..., None]
            right = np.concatenate([right, np.broadcast_to(free, (*right.shape[:-2], *free.shape))], axis=-1)
            solved = np.linalg.solve(information, right)
            ok = np.linalg.norm(solved[..., 1:], axis=(-2, -1)) < 100.0 / MIN_RESOLVED_SHARE  # else near singular
            moves = np.where(ok[..., None], solved[..., 0], 0.0)
            total += moves.sum(axis=-2)
            square += moves.mT @ moves
            used += ok.sum(axis=-1)
        if (fewest := int(used.min())) <= replicates // 2:
            raise DegenerateMotionError(
                f"Only {fewest} of {replicates} draws from the poses determine X and W: there are too few poses to "
                "draw from. Use the sandwich or a noise model.",
                np.eye(6),
            )
        mean = total / used[..., None]
        about = (square - used[..., None, None] * mean[..., :, None] * mean[..., None, :]) / (used - 1)[..., None, None]
        covariance = half @ about @ half.mT
        return np.asarray(0.5 * (covariance + covariance.mT))

    @property
    def _bread(self) -> Array:
        """M (p, p), of all that is known."""
        if self.known is None:
            return self.covariance
        flat = self.J.reshape(-1, self.J.shape[-1])
        return np.asarray(np.linalg.inv(flat.T @ flat + self.known), dtype=float)

    @cached_property
    def freedom(self) -> Array:
        """nu (...) of the sandwich of X, for ``Reference("Hotelling", nu)``; that of the bootstrap is near.

        Fewer than poses, and still fewer where a few poses carry the estimate; 5 or less bounds no ellipsoid.
        With ``D = sum_k c_k c_k^T`` whitened to the mean 1 and ``T_kl = Cov(c_k, c_l)``,
        ``nu = 6 (6 + 1) / sum_kl [tr(T_kl)^2 + tr(T_kl T_kl)]``. For k != l, T_kl is of rank 2 p in factors of k and of
        l, so that the double sum is one of products of two single sums.
        """
        p = self.J.shape[-1]
        try:  # in these units the covariance of all unknowns is 1, ...
            half = np.asarray(np.linalg.cholesky(self.covariance), dtype=float)
        except np.linalg.LinAlgError:
            raise DegenerateMotionError(
                "The poses hardly determine X and W by this method: the covariance of their residuals' influence is "
                "singular to rounding. Rotate the robot about different axes, by 30 degrees or more.",
                np.eye(6),
            ) from None
        J = times(self.J, half)
        B = times(self.B.mT, np.linalg.inv(half).mT).mT  # ... and that of X, its first 6 rows, too
        F = B[..., :6, :] @ self.adjustment
        Z = np.concatenate([F @ J, F @ B.mT], axis=-1)  # T_kl = Z_k N Z_l^T, N = [[1, 1], [1, 0]], for k != l
        ZN = np.concatenate([Z[..., :p] + Z[..., p:], Z[..., :p]], axis=-1)
        G, H = (
            (flat.mT @ flat).reshape(*flat.shape[:-2], 6, 2 * p, 6, 2 * p)
            for flat in (T.reshape(*T.shape[:-2], 12 * p) for T in (Z, ZN))
        )
        total = (G * H).sum(axis=(-4, -3, -2, -1)) + (G * H.swapaxes(-4, -2)).sum(axis=(-4, -3, -2, -1))
        own = B[..., :6, :] @ B[..., :6, :].mT
        total += (_second_moment(own) - _second_moment(ZN @ Z.mT)).sum(axis=-1)
        return np.asarray(42.0 / total)


def times(rows: Array, M: Array) -> Array:
    """``rows M`` for rows (..., n, d, p) and M (..., p, p) of each data set, as one product of tall matrices."""
    n, d = rows.shape[-3:-1]
    return np.asarray((rows.reshape(*rows.shape[:-3], d * n, rows.shape[-1]) @ M).reshape(rows.shape))


def _second_moment(T: Array) -> Array:
    return np.asarray(np.trace(T, axis1=-2, axis2=-1) ** 2 + (T * T.mT).sum(axis=(-2, -1)))


def require_dispensable(ok: NDArray[np.bool_]) -> None:
    """Raise for the first pose (..., n) without which the others leave X or W open."""
    if not ok.all():
        k = int(np.unravel_index(int(np.argmin(ok)), ok.shape)[-1])
        raise DegenerateMotionError(
            f"Without pose (or motion) {k} the others do not determine X and W, so its residual says nothing about "
            "its error. Add poses that rotate about other axes, or use the covariance of a noise model.",
            np.eye(6),
        )


def influence_of(fit: Fit, most_with_errors: int = 10_000) -> Influence:
    """Return the influence for `efficient` or `maximum_likelihood`, with the noise of the fit as the working model.

    Poses with the robust weight 0 are left out where there is one data set; weights are taken as given numbers.
    Declared errors that all poses share follow X and W among the unknowns, as far as the data tell anything of them;
    what a prior says of X and W is known beforehand. On motions the clusters are motions, which must not share poses.
    Raises `InputError` for fewer than 7 clusters, for noise that is joint over the poses, which then are no independent
    clusters, and beside declared errors for more poses than ``most_with_errors``: they are dense then.
    """
    known: Array | None = None
    if not is_joint(fit.S):
        residual, J = fit.white
        covariance = fit.covariance
        if fit.prior is not None and covariance.ndim == 2:
            known = fit.prior.normal_equations(fit.X, fit.W)[0]
    elif _declared(fit) and len(fit.residual) > most_with_errors:
        raise InputError(
            f"Beside errors that all poses share, sandwich and bootstrap take at most {most_with_errors:,} poses, got "
            f"{len(fit.residual):,}. Take covariance='model', or every tenth pose."
        )
    elif _declared(fit):
        residual, J, covariance, known = own_residuals(fit)
    else:
        raise InputError(JOINT)
    if fit.weights is not None:
        root = np.sqrt(fit.weights)
        residual, J = residual * root[..., None], J * root[..., None, None]
        if fit.weights.ndim == 1:
            residual, J = residual[fit.weights > 0], J[fit.weights > 0]
    return Influence(residual, J, times(J, -covariance).mT, known)


def of_known(fit: Fit) -> Array:
    """``M Lambda M`` (p, p) of X and W: what declared errors that all poses share and a prior add; 0 without them."""
    S, found = joint_of(fit.S), np.zeros_like(fit.covariance)
    if S is not None and _declared(fit):
        response = fit.told_of_shared.response
        found = found + response @ response.mT
    if fit.prior is not None:
        found = found + fit.covariance @ fit.prior.normal_equations(fit.X, fit.W)[0] @ fit.covariance
    return np.asarray(found)


def _declared(fit: Fit) -> bool:
    """Return whether all that the poses share are errors with a name."""
    S = joint_of(fit.S)
    return S is not None and all(S.keys)


def pooled_influence(residual: Array, J: Array, B: Array) -> Influence:
    """Return the influence for any estimator, from e (n, 6), J (n, 6, p) and B (n, p, 6); the residuals' mean square
    is the working model.
    """
    found = Influence(residual, J, B)  # which refuses few poses
    S = residual.T @ residual / len(residual)
    scale = np.sqrt(np.diagonal(S))
    rounding = PRODUCT_ROUNDING * max(1.0, float(np.abs(J).max()))
    if not (scale > rounding).all() or np.linalg.eigvalsh(S / np.outer(scale, scale))[0] < SOLUTION_ROUNDING:
        raise InputError(
            "Some component of the residuals is 0 for all poses: exact residuals say nothing about the noise. Use the "
            "covariance of a noise model."
        )
    L = np.asarray(cholesky_of(S))
    white = whiten(L, np.concatenate([J, residual[..., None]], axis=-1))
    return replace(found, residual=white[..., -1], J=white[..., :-1], B=B @ L)
