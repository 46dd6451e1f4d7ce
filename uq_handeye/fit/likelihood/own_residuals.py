r"""Residuals after the errors that all poses share are taken out of them.

With ``S = blkdiag(S_i) + F F^T`` and r the residuals after the fit, ``z = (F^T S_i^-1 F + 1)^-1 F^T S_i^-1 r`` is the
estimate of the shared errors, and ``e = r - F z`` are those of each pose itself, whitened by S_i. They belong to one
pose each, as residuals of independent noise do, with the unknowns (X, W, z).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.noise.joint_covariance import JointCovariance
from ...model.noise.square_roots import cholesky_of, gram, whiten
from .gauss_helmert import Fit

# Information (1 where it equals that of the prior) below which the data tell nothing of a shared error.
TOLD = 1e-4


class OwnResiduals(NamedTuple):
    """Own residuals of one fit, in units of each pose's own noise, without the weights."""

    e: Array  # (n, 6)
    J: Array  # (n, 6, p + q), q combinations of shared errors of which the data tell something
    M: Array  # (p + q, p + q) covariance of the unknowns, with weights and priors
    known: Array  # (p + q, p + q) information of the priors


def has_own_residuals(fit: Fit) -> bool:
    """Return whether the poses have errors in common of this kind."""
    return isinstance(fit.S, JointCovariance)


def own_residuals(fit: Fit) -> OwnResiduals:
    """See the module; raises `InputError` on fits of several data sets."""
    S, p = fit.S, fit.covariance.shape[-1]
    assert isinstance(S, JointCovariance)
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected one data set beside shared errors, got leading axes {fit.covariance.shape[:-2]}.")
    values = np.concatenate([fit.linear.J, S.shared, fit.residual[..., None]], axis=-1)
    root = np.ones(len(values)) if fit.weights is None else np.sqrt(fit.weights)
    white = whiten(cholesky_of(S.own), values)
    sums = gram(white * root[:, None, None])
    q = S.shared.shape[-1]
    F = slice(p, p + q)
    z = np.linalg.solve(sums[F, F] + np.eye(q), sums[F, -1])
    # The z are N(0, I) in any axes: those of what the data tell. 0: X and W, or other columns, take it in.
    told, axes = np.linalg.eigh(sums[F, F] - sums[F, :p] @ np.linalg.solve(sums[:p, :p], sums[:p, F]))
    axes = axes[:, told > TOLD]
    J = np.concatenate([white[..., :p], white[..., F] @ axes], axis=-1)
    known = np.diag((np.arange(J.shape[-1]) >= p).astype(float))
    M = np.asarray(np.linalg.inv(gram(J * root[:, None, None]) + known))
    return OwnResiduals(white[..., -1] - white[..., F] @ z, J, M, known)
