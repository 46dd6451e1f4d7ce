r"""Goodness of fit: tests whether the noise explains the residuals of all poses or of one, with their distributions.

*Test of all residuals.* With residuals e after the fit, their covariance S from the noise and p unknowns

    chi2 = e^T S^-1 e  ~  chi-square with dof = 6 n - p,      sigma_0^2 = chi2 / dof  (1 if the noise is right)

Unknowns along open directions take no degree of freedom. A prior of X or W counts as further measurements:
``xi^T Lambda xi`` is part of chi2, the rank of Lambda of dof.

With noise that was estimated from the same residuals (`one_model`) sigma_0 is 1 by construction: the test then has
no power, and that of rotation or translation only has little.

*Test of rotation or translation only*: ``sum e_i^T S_i^-1 e_i`` over that part, divided by its expectation
``sum tr(S_i^-1 (S_i - J_i C J_i^T))`` (the redundancy of that part; C is the covariance of the unknowns). Where errors
are shared by the poses (T4b) those residuals are all alike; there ``g = S^-1 e`` takes their place, the part of each
pose that the others do not predict, with the covariance ``P = S^-1 - S^-1 J C J^T S^-1``: ``sum g_i^T P_ii^-1 g_i``
over that part, divided by the number of its components.

*Own residuals* are those after the errors that all poses share are removed: with ``S = blkdiag(S_i) + F F^T``, r the
residuals after the fit and z the estimate of the shared errors (`Fit.told`), ``e = r - F z``, whitened by S_i. They
belong to one pose each, as residuals of independent noise do, with the unknowns (X, W, z).

*Reference*: the distribution of ``d^2 = xi^T Sigma^-1 xi`` of the error xi of X, which gives the size of an ellipsoid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from scipy.special import chdtrc, chdtri, fdtrc, fdtri, gammainc, gammaincc

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...errors import InputError
from ...model.noise.joint_covariance import joint_of
from ...model.noise.square_roots import (
    cholesky_of,
    inverse_blocks,
    is_joint,
    marginals,
    pulled,
    weighed_blocks,
    whiten,
)
from .constraint import MIN_RESOLVED_SHARE
from .gauss_helmert import Fit

if TYPE_CHECKING:
    from ...model.noise.estimate import NoiseEstimate


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
    """sigma_0 of rotation and of translation; residuals independent from pose to pose."""
    S, J, e = marginals(fit.S), fit.linear.J, fit.residual
    parts = []
    for part in (slice(3), slice(3, 6)):
        inverse = np.linalg.inv(S[:, part, part])
        left = S[:, part, part] - J[:, part] @ fit.covariance @ J[:, part].mT
        expected = float((w * (inverse * left).sum(axis=(-2, -1))).sum())
        found = float((w * (e[:, None, part] @ inverse @ e[:, part, None])[:, 0, 0]).sum())
        parts.append(float(np.sqrt(found / expected)))
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
    """nu of the multivariate t that X follows where the sizes of its errors are open (`one_model`); else infinite."""
    _require_one(fit)
    return float("inf") if estimate.shape is None else estimate.shape


def components_of(fit: Fit) -> int:
    """Number of components of X that are determined, of one fit."""
    return 6 - len(fit.open_directions_X)


def _require_one(fit: Fit) -> None:
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected the fit of one data set, got leading axes {fit.covariance.shape[:-2]}.")


class OwnResiduals(NamedTuple):
    """Own residuals of one fit, in units of each pose's own noise, without the weights."""

    e: Array  # (n, 6)
    J: Array  # (n, 6, p + q), q combinations of shared errors of which the data tell something
    M: Array  # (p + q, p + q) covariance of the unknowns, with weights and priors
    known: Array  # (p + q, p + q) information of the priors


def own_residuals(fit: Fit) -> OwnResiduals:
    """See the module; raises `InputError` on fits of several data sets."""
    S = joint_of(fit.S)
    assert S is not None
    if fit.covariance.ndim != 2:
        raise InputError(f"Expected one data set beside shared errors, got leading axes {fit.covariance.shape[:-2]}.")
    z, response, left = fit.told(S.shared)
    # The z are N(0, I) in any axes: those of what the data tell. 1: X and W, or other columns, take it in.
    share, axes = np.linalg.eigh(left)
    axes = axes[:, share * (1.0 + MIN_RESOLVED_SHARE) < 1.0]
    p, q = fit.covariance.shape[-1], axes.shape[-1]
    F = S.shared @ axes
    white = whiten(
        cholesky_of(S.own), np.concatenate([fit.linear.J, F, (fit.residual - S.shared @ z)[..., None]], axis=-1)
    )
    M = np.block([[fit.covariance, response @ axes], [(response @ axes).T, axes.T @ left @ axes]])
    known = np.diag((np.arange(p + q) >= p).astype(float))
    if fit.prior is not None:
        known[:p, :p] = fit.prior.normal_equations(fit.X, fit.W)[0]
    return OwnResiduals(white[..., -1], white[..., :-1], M, known)


@dataclass(frozen=True)
class Reference(Record):
    """Distribution of d^2 with 6 components; fewer where directions of X stay open, along which an error has no d^2.

    - ``chi-square``: the covariance is that of known noise.
    - ``F``: it is that of noise estimated from the same data, ``d^2 / 6 ~ F(6, dof)`` (`effective_dof`).
    - ``t``: it is that of a mixture over the sizes of the errors (`one_model`), a multivariate t with this covariance:
      ``d^2 dof / (6 (dof - 2)) ~ F(6, dof)``, dof above 2.
    - ``Hotelling``: it comes from the residuals of few poses, ``d^2 (dof - 5) / (6 dof) ~ F(6, dof - 5)`` (`sandwich`).
    """

    _in_file: ClassVar[str] = "kind dof components=some_open"
    _if_any: ClassVar[str] = "components"

    kind: str = "chi-square"
    dof: float | None = None
    components: int = 6

    def __post_init__(self) -> None:
        if self.kind not in ("chi-square", "F", "t", "Hotelling"):
            raise InputError(f"Expected the reference to be chi-square, F, t or Hotelling, got {self.kind!r}.")
        least = 2 if self.kind == "t" else 0
        if (self.dof is None) != (self.kind == "chi-square") or (self.dof is not None and not self.dof > least):
            raise InputError(
                f"Expected degrees of freedom with F, t and Hotelling only, above {least}, got {self.dof!r} with "
                f"{self.kind}."
            )
        if self.components not in range(1, 7):
            raise InputError(f"Expected 1 to 6 components of X that are determined, got {self.components!r}.")

    @property
    def some_open(self) -> int | None:
        """Number of components where some are open."""
        return None if self.components == 6 else self.components

    @property
    def _stretch(self) -> float:
        """Variance of F's own scale: a t is stated with its covariance, which is dof / (dof - 2) times its scale."""
        assert self.dof is not None
        return (self.dof - 2.0) / self.dof if self.kind == "t" else 1.0

    @property
    def determined(self) -> bool:
        """True if there are quantiles: Hotelling needs more than 5 degrees of freedom."""
        return self.kind != "Hotelling" or (self.dof is not None and self.dof > 5)

    def quantile(self, level: float) -> float:
        """The d^2 below which the share ``level`` of all errors lies; infinite where that is not determined."""
        if not 0 < level < 1:
            raise InputError(f"Expected `level` to lie between 0 and 1, got {level!r}.")
        if self.dof is None:
            return float(chdtri(self.components, 1 - level))
        if not self.determined:
            return float("inf")
        if self.kind in ("F", "t"):
            return self._stretch * self.components * float(fdtri(self.components, self.dof, level))
        return 6 * self.dof / (self.dof - 5) * float(fdtri(6, self.dof - 5, level))

    def p_value(self, d2: float) -> float:
        """The probability of a d^2 at least as large."""
        if self.dof is None:
            return float(chdtrc(self.components, d2))
        if not self.determined:
            return 1.0
        if self.kind in ("F", "t"):
            return float(fdtrc(self.components, self.dof, d2 / (self._stretch * self.components)))
        return float(fdtrc(6, self.dof - 5, d2 * (self.dof - 5) / (6 * self.dof)))

    def __str__(self) -> str:
        if self.dof is None:
            return f"chi-square with {self.components} degrees of freedom"
        if self.kind == "F":
            return f"{self.components} F({self.components}, {self.dof:.3g})"
        if self.kind == "t":
            return f"a multivariate t with {self.dof:.3g} degrees of freedom"
        return f"Hotelling's distribution with {self.dof:.3g} degrees of freedom"
