r"""Poses, shape and the variances of the noise together: least squares, and restricted maximum likelihood (REML).

Model: `model`, `least_squares`. With the residuals of group g (1 lateral, two numbers a point; 2 axial, one), their
growth removed, the restricted likelihood is greatest where

    phi_g = sum r^2 / (n_g - tr H_gg),    H the hat matrix of the weighted fit

(Helmert's variance components), which is iterated with the steps of the fit. ``n_g - tr H_gg`` are the degrees of
freedom of phi_g: its relative standard deviation is about ``sqrt(2 / dof)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.se3 import Array
from .least_squares import Normal, Sight
from .model import NoiseModel, sight_lines, weight_matrices
from .start import placed

# The last step of a pose (standard deviations) and of a variance (relative), and how often at most.
STILL, STILL_VARIANCE, MOST_STEPS = 1e-5, 1e-5, 300
# Standard deviations below this share of the distance are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Fit:
    """Poses and shape with the variances of the noise."""

    model: NoiseModel
    phi: Array  # (2,) lateral, axial, m^2
    dof: Array  # (2,) degrees of freedom of each
    normal: Normal
    u: Array  # (k, 3) lines of sight
    growth: Array  # (k, 2)
    converged: bool

    @property
    def total_dof(self) -> float:
        """Degrees of freedom of all residuals."""
        return float(self.dof.sum())

    @property
    def squares(self) -> Array:
        """(2,) sums of the residuals squared, lateral and axial, their growth removed, m^2."""
        return np.asarray(split_squares(self.normal.r, self.u, self.growth).sum(axis=0))

    @property
    def deviance(self) -> float:
        """Minus twice the restricted log-likelihood, but for a constant."""
        log_V = 2 * np.log(self.phi[0]) + np.log(self.phi[1]) + np.log(self.growth) @ [2.0, 1.0]
        return float(log_V.sum() + self.normal.log_determinant() + (self.squares / self.phi).sum())

    def covariance_of(self, points: Array) -> Array:
        """V (k, 3, 3) of the noise at points (k, 3)."""
        growth = self.model.growth(points)
        return weight_matrices(sight_lines(points), *(growth * self.phi).T)


def split_squares(r: Array, u: Array, growth: Array) -> Array:
    """(k, 2) squares of residuals across and along the line of sight, over their growth."""
    along = np.einsum("ka,ka->k", r, u)
    across = np.maximum(np.einsum("ka,ka->k", r, r) - along**2, 0.0)
    return np.asarray(np.stack([across, along**2], axis=-1) / growth)


def robust_variances(r: Array, u: Array, growth: Array, isotropic: bool, share: float) -> Array:
    """(2,) variances by the medians of the squares, ``share`` the residual degrees of freedom over all numbers."""
    squares = split_squares(r, u, growth)
    if isotropic:
        phi = np.full(2, np.median(squares.sum(axis=-1)) / 2.366)  # median of chi-square with 3 degrees of freedom
    else:
        phi = np.median(squares, axis=0) / np.array([1.386, 0.455])
    return np.asarray(phi / max(share, 0.1))


def fit(sight: Sight, T: Array, p: Array, model: NoiseModel, phi: Array, *, shape_open: bool, estimate: bool) -> Fit:
    """Poses, shape where it is open, and variances where they are to be estimated, from a start of all."""
    k = len(sight.y)
    least = (ROUNDING * max(float(np.abs(sight.y).max()), 1e-3)) ** 2
    phi = np.maximum(phi, least)
    converged = False
    dof = np.zeros(2)
    for step in range(MOST_STEPS):
        at = placed(T, p[sight.point], sight.pose)
        u, growth = sight_lines(at), model.growth(at)
        W = weight_matrices(u, *(1.0 / (growth * phi)).T)
        before = Normal(sight, T, p, W, shape_open)
        if shape_open and not before.determined:
            normal = before
            break
        normal, size = before.moved()
        T, p = normal.T, normal.p
        if not np.isfinite(T).all():
            break
        Q = before.predicted_covariance(sight)  # at the end both are one
        along = np.einsum("ka,kab,kb->k", u, Q, u)
        across = np.trace(Q, axis1=-2, axis2=-1) - along
        used = (np.stack([across, along], axis=-1) / (growth * phi)).sum(axis=0)
        dof = np.array([2.0 * k, float(k)]) - used
        change = 0.0
        if estimate:
            squares = split_squares(normal.r, u, growth).sum(axis=0)
            if model.isotropic:
                new = np.full(2, squares.sum() / max(float(dof.sum()), 1e-9))
            else:
                new = squares / np.maximum(dof, 1e-9)
            new = np.maximum(new, least)
            change = float(np.abs(new / phi - 1.0).max())
            phi = new
        if size < STILL and change < STILL_VARIANCE and step:
            converged = True
            break
    return Fit(model, phi, dof, normal, u, growth, converged)


def refitted(found: Fit, sight: Sight, estimate: bool) -> Fit:
    """The fit of other measurements, from what was found."""
    start = found.normal
    return fit(sight, start.T, start.p, found.model, found.phi, shape_open=start.shape_open, estimate=estimate)


def with_model(found: Fit, model: NoiseModel) -> Fit:
    """The fit of the same measurements with another model of the noise."""
    return refitted(replace(found, model=model), found.normal.sight, True)
