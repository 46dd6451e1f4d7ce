r"""Does the noise explain the residuals, and how many degrees of freedom has a covariance that was made from them.

Goodness of fit. With residuals e after the fit, their covariance S from the noise and p unknowns

    chi2 = e^T S^-1 e  ~  chi-square with dof = 6 n - p,      sigma_0^2 = chi2 / dof  (1 if the noise is right)

With noise that was estimated from the same residuals (`noise_estimation`) sigma_0 is 1 by construction: the test then
says nothing, that of rotation and translation alone little.

Rotation and translation alone: ``sum e_i^T S_i^-1 e_i`` over that part, over its expectation
``sum tr(S_i^-1 (S_i - J_i C J_i^T))`` (the redundancy of that part; C is the covariance of the unknowns).

Degrees of freedom. Where the noise was estimated, ``e^T Sigma_X^-1 e`` is not chi-square: Sigma_X itself is uncertain.
``F = e^T Sigma_X^-1 e / 6`` is about F(6, nu). To second order in the error of the variances phi, with covariance V,

    E F = 1 + A / 6,    A = sum_kl V_kl tr(Sigma^-1 Sigma_k Sigma^-1 Sigma_l),    Sigma_k = d Sigma_X / d phi_k
    nu = 12 / A

which is exact where all variances have one unknown factor (nu is then the degrees of freedom of its estimate), and for
6 = 1 is Satterthwaite's rule (Fai and Cornelius 1996; Kenward and Roger 1997).
The 95 % ellipsoids by F hold the truth as often as they say with 30 and with 8 poses; with 8, those by chi-square too
seldom (tests/test_noise_estimation.py, 1,000 sets each, one noise each). Not accounted for, and felt with few poses:
weights from estimated noise are not the best ones (Kackar and Harville 1984).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import gammainc, gammaincc

from .errors import InputError
from .likelihood import Fit, whiten
from .noise import is_joint
from .se3 import Array

if TYPE_CHECKING:
    from .noise_estimation import NoiseEstimate


@dataclass(frozen=True)
class GoodnessOfFit:
    """Chi-square test of the noise. ``sigma0`` is the root of ``chi2 / dof``: 1 where the noise is right."""

    chi2: float
    dof: float
    sigma0: float
    p_value: float  # two-sided: small where residuals are larger or smaller than the noise says
    rotation_sigma0: float
    translation_sigma0: float


def goodness_of_fit(fit: Fit) -> GoodnessOfFit:
    """Of one fit (no leading axes); a pose of robust weight w counts as w poses.

    Raises `InputError` where there are no degrees of freedom left.
    """
    _require_one(fit)
    n, p = fit.residual.shape[0], fit.covariance.shape[-1]
    w = np.ones(n) if fit.weights is None else np.asarray(fit.weights)
    dof = 6.0 * float(w.sum()) - p
    if dof <= 0:
        raise InputError(f"Expected residuals to judge the noise by, got {dof:g} degrees of freedom.")
    # The weights belong into S before it is whitened: a joint S would carry a rejected pose into the others' rows.
    chi2 = float(np.sum(whiten(fit.weighted_factor, fit.residual[..., None]) ** 2))
    tails = float(gammainc(dof / 2, chi2 / 2)), float(gammaincc(dof / 2, chi2 / 2))
    S, J, e = fit.S, fit.linear.J, fit.residual
    if is_joint(S):
        S = S.reshape(n, 6, n, 6)[np.arange(n), :, np.arange(n), :]
    parts = []
    for part in (slice(3), slice(3, 6)):
        inverse = np.linalg.inv(S[:, part, part])
        left = S[:, part, part] - J[:, part] @ fit.covariance @ J[:, part].mT
        expected = float((w * (inverse * left).sum(axis=(-2, -1))).sum())
        found = float((w * (e[:, None, part] @ inverse @ e[:, part, None])[:, 0, 0]).sum())
        parts.append(float(np.sqrt(found / expected)))
    return GoodnessOfFit(chi2, dof, float(np.sqrt(chi2 / dof)), min(1.0, 2.0 * min(tails)), *parts)


def effective_dof(fit: Fit, estimate: NoiseEstimate) -> float:
    """nu, for a fit with the noise of the estimate: ``e^T Sigma_X^-1 e / 6`` is about F(6, nu); infinite if fixed.

    Raises `InputError` for a fit with noise that is joint over poses.
    """
    _require_one(fit)
    if is_joint(fit.S):
        raise InputError("Expected a fit with noise independent from pose to pose, got a joint covariance.")
    A = float(spread_of(fit, estimate.covariance))
    return float("inf") if A <= 0 else 12.0 / A


def spread_of(fit: Fit, covariance: Array) -> Array:
    """A (...) of the module, for the covariance (..., 3, 3) of the variances."""
    relative = np.linalg.solve(fit.covariance_X[..., None, :, :], covariance_derivatives(fit))
    return np.asarray(np.einsum("...kl,...kij,...lji->...", covariance, relative, relative))


def covariance_derivatives(fit: Fit) -> Array:
    """``d Sigma_X / d phi_k`` (..., 3, 6, 6) = ``C J^T S^-1 V_k S^-1 J C`` by the variances of `NoiseEstimate`."""
    _, white = fit.white
    pull = np.linalg.solve(fit.factor.mT, white) @ fit.covariance[..., None, :, :6]
    first, second = fit.linear.sides
    if fit.weights is not None:
        pull = np.sqrt(fit.weights)[..., None, None] * pull
    found = []
    for U in (first[..., :3], second[..., :3], second[..., 3:]):
        part = U.mT @ pull
        flat = part.reshape(*part.shape[:-3], -1, 6)
        found.append(flat.mT @ flat)
    return np.stack(found, axis=-3)


def _require_one(fit: Fit) -> None:
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the fit of one data set, got leading axes {fit.covariance.shape[:-2]}.")
