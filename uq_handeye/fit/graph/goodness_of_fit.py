r"""Goodness of fit: a test whether the noise explains the residuals, all together, of rotation and of translation.

With residuals e after the fit, their covariance S from the noise and p unknowns

    chi2 = e^T S^-1 e  ~  chi-square with dof = 6 n - p,      sigma_0^2 = chi2 / dof  (1 if the noise is right)

Unknowns along open directions take no degree of freedom. A prior of X or W counts as further measurements:
``xi^T Lambda xi`` is part of chi2, the rank of Lambda of dof.

With noise that was estimated from the same residuals (`estimation`) sigma_0 is 1 by construction: the test then has
no power, and that of rotation or translation only has little.

For rotation or translation only sigma_0^2 is ``sum e_i^T S_i^-1 e_i`` over that part, divided by its expectation
``sum tr(S_i^-1 (S_i - J_i C J_i^T))`` (the redundancy of that part; C is the covariance of the unknowns). Where errors
are shared by the poses (T4b) those residuals are all alike; there ``g = S^-1 e`` takes their place, the part of each
pose that the others do not predict, with the covariance ``P = S^-1 - S^-1 J C J^T S^-1``: ``sum g_i^T P_ii^-1 g_i``
over that part, divided by the number of its components.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammainc, gammaincc

from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.errors.square_roots import (
    inverse_blocks,
    is_joint,
    marginals,
    pulled,
    weighed_blocks,
    whiten,
)
from .gauss_helmert import Fit

if TYPE_CHECKING:
    from ...model.errors.noise_estimate import NoiseEstimate


@dataclass(frozen=True)
class GoodnessOfFit:
    """Chi-square test of the noise. ``sigma0`` is the root of ``chi2 / dof``: 1 where the noise is right."""

    chi2: float
    dof: float
    sigma0: float
    p_value: float | None  # two-sided: small where residuals are larger or smaller than the noise says; None: no test,
    # as the noise was made of the same residuals
    rotation_sigma0: float
    translation_sigma0: float


def goodness_of_fit(fit: Fit) -> GoodnessOfFit:
    """Test one fit (no leading axes); a pose of robust weight w counts as w poses.

    Raises `InputError` where there are no degrees of freedom left.
    """
    _require_one(fit)
    n, p = fit.residual.shape[0], fit.spent
    w = np.ones(n) if fit.weights is None else np.asarray(fit.weights)
    dof = 6.0 * float(w.sum()) - p
    if dof <= 0:
        raise InputError(f"Expected residuals to judge the noise by, got {dof:g} degrees of freedom.")
    # The weights belong into S before it is whitened: a joint S would carry a rejected pose into the others' rows.
    chi2 = float(np.sum(whiten(fit.weighted_factor, fit.residual[..., None]) ** 2)) + fit.square_of_prior
    tails = float(gammainc(dof / 2, chi2 / 2)), float(gammaincc(dof / 2, chi2 / 2))
    parts = _parts_of_joint(fit, w) if is_joint(fit.S) else _parts(fit, w)
    return GoodnessOfFit(chi2, dof, float(np.sqrt(chi2 / dof)), min(1.0, 2.0 * min(tails)), *parts)


def _parts(fit: Fit, w: Array) -> list[float]:
    """sigma_0 of rotation and of translation, 0 where the fit leaves none of their residuals free.

    Residuals are independent from pose to pose.
    """
    S, J, e = marginals(fit.S), fit.linear.J, fit.residual
    parts = []
    for part in (slice(3), slice(3, 6)):
        inverse = np.linalg.inv(S[:, part, part])
        left = S[:, part, part] - J[:, part] @ fit.covariance @ J[:, part].mT
        expected = float((w * (inverse * left).sum(axis=(-2, -1))).sum())
        found = float((w * (e[:, None, part] @ inverse @ e[:, part, None])[:, 0, 0]).sum())
        parts.append(float(np.sqrt(found / expected)) if expected > 0 else 0.0)
    return parts


def _parts_of_joint(fit: Fit, w: Array) -> list[float]:
    """The same where the residuals are joint over the poses."""
    factor = fit.weighted_factor
    back = pulled(factor, whiten(factor, np.concatenate([fit.linear.J, fit.residual[..., None]], axis=-1)))
    Q, g = back[..., :-1], back[..., -1:]
    P = inverse_blocks(factor) - Q @ fit.covariance @ Q.mT
    own = weighed_blocks(fit.S)
    parts = []
    for part in (slice(3), slice(3, 6)):
        L = np.linalg.cholesky(own[:, part, part])
        mu, V = np.linalg.eigh(L.mT @ P[:, part, part] @ L)
        along = (V.mT @ L.mT @ g[:, part])[..., 0]
        told = (mu > 1e-9) & (w[:, None] > 0)  # the rest of the data predicts it, and the pose counts
        squares = np.where(told, along**2 / np.where(told, mu, 1.0), 0.0)
        parts.append(float(np.sqrt(squares.sum() / max(int(told.sum()), 1))))
    return parts


def effective_dof(fit: Fit, estimate: NoiseEstimate) -> float:
    """nu of the multivariate t that X follows where the sizes of its errors are open (`estimation`); else infinite."""
    _require_one(fit)
    return float("inf") if estimate.shape is None else estimate.shape


def components_of(fit: Fit) -> int:
    """Number of components of X that are determined, of one fit."""
    return 6 - len(fit.open_directions_X)


def _require_one(fit: Fit) -> None:
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the fit of one data set, got leading axes {fit.covariance.shape[:-2]}.")
