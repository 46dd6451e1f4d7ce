r"""Restricted likelihood of standard deviations, those of noise and those of many errors that all rows share.

Model, of n blocks of r rows (6 of a pose, 3 of a point) that are linear in p unknowns x without prior:

    y_i = J_i x + B_i e + v_i,     v_i ~ N(0, K_i + sum_k s_k^2 U_ik U_ik^T),     e_j ~ N(0, s_(g(j))^2)

K known, s_k and s_g unknown standard deviations; a column of B without a group has the standard deviation 1. Many
errors e share one standard deviation. With S = blkdiag(K + ..), ``e = T z``, T the diagonal of the standard deviations,
z ~ N(0, I), and the normal equations

    M = [J, B T]^T S^-1 [J, B T] + blkdiag(known, I),    c = [J, B T]^T S^-1 y,   (x, z) = M^-1 c

minus twice the restricted log-likelihood is (Patterson and Thompson 1971; Harville 1977, for errors with a prior)

    d = log|S| + log|M| + y^T S^-1 y - c^T M^-1 c

which is that of ``S + B T^2 B^T`` and x only. Its derivatives by the logarithms of the standard deviations, with C =
M^-1 and the residual ``w = S^-1 (y - [J, B T] (x, z))``, are

    of a group:  2 sum_(j in g) (1 - C_jj - z_j^2)
    of noise:    2 s_k^2 ( tr(S^-1 V_k) - tr(C N_k) - w^T V_k w ),   V_k = U_k U_k^T

with ``N_k = [J, B T]^T S^-1 V_k S^-1 [J, B T]``.

All sums are over rows, O(n (p + m)^2); with the noise held, other standard deviations of groups cost no sum over rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.se3 import Array
from ..noise.triangular import checked_cholesky, substitute, substitute_transposed


class OwnPart(NamedTuple):
    """Noise of its own of every block, ``U U^T`` times the variance of a parameter."""

    parameter: int
    U: Array  # (n, r, a)


class AtDeviations(NamedTuple):
    """Likelihood at given logarithms of the standard deviations (k,)."""

    deviance: float
    gradient: Array  # (k,)
    unknowns: Array  # (p,) x
    errors: Array  # (m,) z, in standard deviations
    covariance: Array  # (p + m, p + m) of (x, z)


class Sums(NamedTuple):
    """Sums over the rows, once the noise of each block is known."""

    N: Array  # (p + m + 1, p + m + 1) of [J, B, y]
    log_determinant: float  # of S
    white: Array  # (n, r, p + m + 1) L^-1 [J, B, y]
    L: Array  # (n, r, r)


@dataclass(frozen=True, eq=False)
class ScaleRows:
    """The rows of the model; see the module."""

    J: Array  # (n, r, p)
    y: Array  # (n, r)
    own: Sequence[OwnPart]
    known: Array | None  # (n, r, r) K; None: 0
    B: Array  # (n, r, m)
    group: NDArray[np.intp]  # (m,) the parameter that is the deviation of each column; -1: it is 1
    prior: Array | None = None  # (p + 1, p + 1) what is known of x adds to ``[J, y]^T S^-1 [J, y]``

    @property
    def p(self) -> int:
        return int(self.J.shape[-1])

    def scales(self, x: Array) -> Array:
        """(m,) T."""
        return np.where(self.group < 0, 1.0, np.exp(x[self.group]))

    def sums(self, x: Array) -> Sums:
        """Return the sums at the noise of each block; the standard deviations of the groups do not matter."""
        n, r = self.y.shape
        S = np.zeros((n, r, r)) if self.known is None else np.array(self.known)
        for parameter, U in self.own:
            S += np.exp(2 * x[parameter]) * (U @ U.mT)
        L = checked_cholesky(S)
        white = substitute(L, np.concatenate([self.J, self.B, self.y[..., None]], axis=-1))
        flat = white.reshape(n * r, -1)
        N = flat.T @ flat
        if self.prior is not None:
            ends = np.append(np.arange(self.p), len(N) - 1)
            N[np.ix_(ends, ends)] += self.prior
        return Sums(N, 2.0 * float(np.log(np.diagonal(L, axis1=-2, axis2=-1)).sum()), white, L)

    def at(self, x: Array, sums: Sums | None = None) -> AtDeviations:
        """Deviance, derivatives, and the estimates of x and z with their covariance.

        With ``sums``, made at the same noise, the derivatives are those by the standard deviations of the groups only.
        """
        rows = self.sums(x) if sums is None else sums
        p, T = self.p, np.append(np.ones(self.p), self.scales(x))
        N = rows.N[:-1, :-1] * T[:, None] * T
        M = N + np.diag(np.repeat([0.0, 1.0], [p, len(T) - p]))
        c = T * rows.N[:-1, -1]
        unit = 1.0 / np.sqrt(np.diag(M))
        try:
            half = np.linalg.inv(np.linalg.cholesky(M * unit[:, None] * unit)) * unit
        except np.linalg.LinAlgError:
            raise InputError(
                "The errors of the arm are assumed so much larger than the noise that numbers cannot hold both, or the "
                "poses do not determine X: expected smaller standard deviations, or poses that differ more."
            ) from None
        C = half.T @ half
        found = C @ c
        z = found[p:]
        log_M = -2.0 * float(np.log(np.diag(half)).sum())
        deviance = rows.log_determinant + log_M + float(rows.N[-1, -1] - c @ found)
        gradient = np.zeros(len(x))
        free = 1.0 - np.diag(C)[p:] - z * z
        told = self.group >= 0
        np.add.at(gradient, self.group[told], 2.0 * free[told])
        if sums is None:
            z_white = rows.white[..., -1] - rows.white[..., :-1] @ (T * found)
            w = substitute_transposed(rows.L, z_white[..., None])
            for parameter, U in self.own:
                whole = substitute(rows.L, U)  # (n, r, a)
                seen = (whole.mT @ rows.white[..., :-1]).reshape(-1, len(T)) * T @ half.T
                part = np.sum(whole**2) - np.sum(seen**2) - np.sum((U.mT @ w) ** 2)
                gradient[parameter] += 2.0 * float(np.exp(2 * x[parameter])) * float(part)
        return AtDeviations(deviance, gradient, found[:p], z, C)
