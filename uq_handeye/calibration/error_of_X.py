r"""The distribution of the error of X: points drawn from it, and the lengths that hold 95 % of it.

Model: the error ``xi = (theta, tau)`` of X has the posterior of the calibration: Gaussian with its covariance S, or
where sizes are estimated the mixture over them. Without a posterior (motions, covariances by the residuals) it is
Gaussian, or Student's t with the degrees of freedom of the `reference`: ``xi = L z sqrt(nu / c)``, ``L L^T = S``, z
standard normal, c chi-square with nu degrees of freedom, so that ``xi^T S^-1 xi / 6`` is F(6, nu).

Every statement for 95 % is made of these points by one rule: the length T with ``P(|e| <= T) = 95 %``, e the error of
the rotation (theta), of the translation (tau), or of a point p straight ahead of the camera (``theta x R p + tau``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.geometry.pose_numbers import principal_axes
from ..core.geometry.se3 import Array, skew
from ..core.quantiles import POINTS, holding, normal_points, radius_holding, uniform_points
from ..fit.graph.posterior import Posterior
from ..fit.graph.reference import Reference
from ..model.errors.cholesky import symmetric_factor


class PointAhead(NamedTuple):
    """The error of a point straight ahead of a camera; m."""

    distance: float
    sd: float  # in the worst direction
    within_95: float  # the length that 95 % of its errors are within


def points_of(S: Array, reference: Reference, posterior: Posterior | None) -> Array:
    """Errors (N, 6) of X, of covariance S (6, 6), drawn from its distribution; see the module.

    ``posterior``: where it is the mixture over the sizes of errors, the points are drawn from that. Infinite where too
    few poses determine no distribution.
    """
    if not reference.determined:
        return np.full((POINTS, 6), np.inf)
    z, u = normal_points(7)[:, :6], uniform_points(7)[:, 6]
    if posterior is not None and posterior.points is not None:
        weights, means, covariances = posterior.mixture_of("X")
        of = np.searchsorted(np.cumsum(weights)[:-1], u)
        return np.asarray(means[of] + np.einsum("nij,nj->ni", symmetric_factor(covariances)[of], z))
    xi = z @ symmetric_factor(S).T
    if reference.dof is not None:
        from scipy.special import chdtri

        nu = reference.dof - 5 if reference.kind == "Hotelling" else reference.dof
        scale = reference.dof - 2 if reference.kind == "t" else reference.dof
        xi = xi * np.sqrt(scale / np.maximum(chdtri(nu, u), 1e-300))[:, None]
    return np.asarray(xi)


def moved(xi: Array, arm: Array) -> Array:
    """Errors (N, 3) of a point ``R p + t`` by those of X (N, 6), with ``arm = R p`` (3,)."""
    return np.asarray(xi[:, 3:] + np.cross(xi[:, :3], arm))


def radius_95(errors: Array) -> float:
    """The length that 95 % of errors (N, 3) are within."""
    return float(holding(np.linalg.norm(errors, axis=-1)))


def tails_of(errors: Array, S: Array) -> float:
    """Ratio of the length that 95 % of errors (N, 3) are within to that of a Gaussian of their covariance S."""
    gaussian = float(radius_holding(S))
    return radius_95(errors) / gaussian if gaussian > 0 else 1.0


def point_ahead_of(T: Array, S: Array, reference: Reference, distance: float) -> PointAhead:
    """Return the error of a point so far (m) straight ahead of a camera at T (4, 4), of covariance S (6, 6)."""
    arm = T[:3, 2] * distance
    J = np.hstack([-skew(arm), np.eye(3)])
    sd = float(principal_axes(J @ S @ J.T)[0][0])
    return PointAhead(distance, sd, radius_95(moved(points_of(S, reference, None), arm)))
