r"""Poses of a target from its measured points by weighted least squares, and the noise of the points.

Model: point j of the target, p_j in its own frame, is measured in pose i as ``y_ij = R_i p_j + t_i + e_ij``. The errors
e_ij are independent and Gaussian with zero mean and covariance

    V = phi_1 (I - u u^T) + phi_2 u u^T,     u = y / |y|

phi_1 (m^2) across the line of sight, lateral; phi_2 along it, axial. The axial noise of a depth camera is several times
its lateral noise: one size for both would make the covariance of the poses wrong. With ``phi_1 = phi_2`` V is
isotropic, as that of a tracker with several cameras.

With ``xi_i = (theta, tau)``, left rotation and additive translation, ``a = R_i p_j`` and ``W = V^-1``

    d y = J_i xi_i,   J_i = [-[a]x, I],      N_i = sum_j J^T W J

The target counts as exact, so that the poses are independent, each with covariance ``N_i^-1`` to first order.

Variances that are not given follow from the residuals of all poses. Those of direction g (1 lateral, two numbers a
point; 2 axial, one) have

    phi_g = sum r^2 / (n_g - tr H_gg),    H the hat matrix of the weighted fit

(Helmert's variance components, which maximise the restricted likelihood), iterated with the steps of the fit.
``n_g - tr H_gg`` are the degrees of freedom of phi_g: its relative standard deviation is about ``sqrt(2 / dof)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from ...core.geometry.se3 import Array, perturb, skew
from ...core.iterations import MAX_STEPS
from ...core.presentation.units import parse_length
from ...core.rounding import CHAIN_ROUNDING, TINY
from ...errors import InputError, NotConvergedError
from .closed_form import placed, sums

EXPECTED = (
    "Expected `noise` (--noise) to be standard deviations lateral,axial such as 0.1mm,0.5mm, or one such as 0.2mm for "
    "both"
)
# The fit has converged at a step below this: of each pose in standard deviations, of the variances relative to them.
CONVERGED_STEP = 1e-5


def given_variances(noise: str | ArrayLike | None) -> Array | None:
    """Variances (2,) lateral and axial of the argument ``noise``; None where they are to be estimated."""
    if noise is None:
        return None
    parts = [part.strip() for part in noise.split(",")] if isinstance(noise, str) else list(np.atleast_1d(noise))
    try:
        sd = [parse_length(part) for part in parts]
    except InputError:
        sd = []
    if len(sd) not in (1, 2):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    if not all(1e-9 <= one <= 1.0 for one in sd):
        raise InputError(f"{EXPECTED}, between 1 nm and 1 m, got {noise!r}.")
    return np.array([sd[0], sd[-1]]) ** 2


def sight_lines(points: Array) -> Array:
    """(k, 3) unit vectors from the camera to points (k, 3)."""
    length = np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0, points / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0]))


def by_direction(u: Array, lateral: float, axial: float) -> Array:
    """``lateral (I - u u^T) + axial u u^T`` (k, 3, 3) for lines of sight u (k, 3)."""
    return lateral * np.eye(3) + (axial - lateral) * (u[:, :, None] * u[:, None])


def split_squares(r: Array, u: Array) -> Array:
    """(k, 2) squares of residuals r (k, 3) across and along the lines of sight u (k, 3)."""
    along = np.einsum("ka,ka->k", r, u) ** 2
    return np.stack([np.maximum(np.einsum("ka,ka->k", r, r) - along, 0.0), along], axis=-1)


class Matches(NamedTuple):
    """Measured points with the points of the target that they are, sorted by pose."""

    y: Array  # (k, 3) camera frame
    p: Array  # (k, 3) target frame
    pose: NDArray[np.intp]  # (k,) 0 .. n - 1
    n: int

    def where(self, mask: NDArray[np.bool_]) -> Matches:
        """Return some of the points."""
        return Matches(self.y[mask], self.p[mask], self.pose[mask], self.n)

    def derivatives(self, T: Array) -> Array:
        """J (k, 3, 6) of the predicted points by the pose errors, at poses T (n, 4, 4)."""
        a = (T[self.pose, :3, :3] @ self.p[..., None])[..., 0]
        return np.concatenate([-skew(a), np.broadcast_to(np.eye(3), (len(a), 3, 3))], axis=-1)


@dataclass(frozen=True, eq=False)
class Fit:
    """Poses, their normal equations, and the variances of the noise."""

    points: Matches  # that were used
    T: Array  # (n, 4, 4)
    W: Array  # (k, 3, 3) weights of the points
    phi: Array  # (2,) variances lateral and axial, m^2
    dof: Array  # (2,) their degrees of freedom

    @cached_property
    def r(self) -> Array:
        """(k, 3) measured minus predicted."""
        return self.points.y - placed(self.T, self.points.p, self.points.pose)

    @cached_property
    def J(self) -> Array:
        """(k, 3, 6)."""
        return self.points.derivatives(self.T)

    @cached_property
    def N(self) -> Array:
        """(n, 6, 6) information on each pose."""
        return sums(self.J.mT @ self.W @ self.J, self.points.pose, self.points.n)

    @cached_property
    def covariance(self) -> Array:
        """(n, 6, 6) covariance of each pose."""
        S = np.linalg.inv(self.N)
        return 0.5 * (S + S.mT)

    @property
    def squares(self) -> Array:
        """(2,) sums of the squares of the residuals, lateral and axial, m^2."""
        at = placed(self.T, self.points.p, self.points.pose)
        return np.asarray(split_squares(self.r, sight_lines(at)).sum(axis=0))

    @cached_property
    def score(self) -> Array:
        """(n, 6) sums of ``J^T W r``, zero at the minimum."""
        return sums((self.J.mT @ (self.W @ self.r[..., None]))[..., 0], self.points.pose, self.points.n)

    def predicted_covariance(self, points: Matches) -> Array:
        """Q (k, 3, 3) of predicted points, those of the fit or others."""
        J = points.derivatives(self.T)
        return np.asarray(J @ self.covariance[points.pose] @ J.mT)


def median_variances(r: Array, u: Array, share: float) -> Array:
    """(2,) variances by the medians of the squares; ``share`` of the numbers are degrees of freedom."""
    return np.asarray(np.median(split_squares(r, u), axis=0) / chi2.median([2, 1]) / share)


def fit(points: Matches, T: Array, phi: Array, *, estimate: bool) -> Fit:
    """Poses, and variances if they are to be estimated, from a start of both.

    Raises `NotConvergedError`; its ``partial`` is the fit that was reached.
    """
    k = len(points.y)
    least = (CHAIN_ROUNDING * float(np.abs(points.y).max())) ** 2 + TINY
    phi = np.maximum(phi, least)
    for step in range(MAX_STEPS):
        u = sight_lines(placed(T, points.p, points.pose))
        before = Fit(points, T, by_direction(u, *(1.0 / phi)), phi, np.zeros(2))
        try:
            xi = np.asarray(np.linalg.solve(before.N, before.score[..., None])[..., 0], dtype=float)
        except np.linalg.LinAlgError:
            break
        T = perturb(T, xi)
        if not np.isfinite(T).all():
            break
        size = float(np.sqrt(np.einsum("na,nab,nb->n", xi, before.N, xi).max()))
        Q = before.predicted_covariance(points)
        along = np.einsum("ka,kab,kb->k", u, Q, u)
        hat = np.array([(np.trace(Q, axis1=-2, axis2=-1) - along).sum(), along.sum()]) / phi
        found = Fit(points, T, before.W, phi, np.array([2.0 * k, float(k)]) - hat)
        change = 0.0
        if estimate:
            squares = split_squares(found.r, u).sum(axis=0)
            phi = np.maximum(squares / np.maximum(found.dof, 1.0), least)
            change = float(np.abs(phi / found.phi - 1.0).max())
            found = Fit(points, T, before.W, phi, found.dof)
        if size < CONVERGED_STEP and change < CONVERGED_STEP and step:
            return found
    raise NotConvergedError(
        "The fit of the poses to the points did not converge. Look at the names of the points and at the target; "
        "or give the `noise` (--noise).",
        before,
    )
