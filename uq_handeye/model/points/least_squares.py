r"""Poses, shape of the target and noise of its points: weighted least squares, covariance, leverages, variances.

Noise of a measured point: the error of point y in the frame of the camera is Gaussian with zero mean and

    V = g_1(r) phi_1 (I - u u^T) + g_2(r) phi_2 u u^T,     u = y / |y|,  r = |y| / r_0

phi_1 (m^2) across the line of sight, lateral; phi_2 along it, axial; r_0 the median distance. The growth g is 1, or
``g_1 = r^2, g_2 = r^4``: a camera with one error in pixels and one of disparity has a lateral standard deviation in
proportion to the distance and an axial one in proportion to its square. With one variance, phi_1 = phi_2, V is
isotropic, as that of a tracker with several cameras.

Model: point j of the target is measured in pose i as ``y_ij = R_i p_j + t_i + e_ij``, e_ij of covariance V_ij.
Unknowns are the poses, ``xi_i = (theta, tau)``, left rotation and additive translation, and, where the target is not
known, its points p_j. With ``a = R_i p_j``, ``W = V^-1``

    d y = J_i xi_i + R_i dp_j,   J_i = [-[a]x, I]
    N_i = sum_j J^T W J,   N_ip = J^T W R,   S = blkdiag(sum_i R^T W R) - sum_i N_ip^T N_i^-1 N_ip

S is singular along the six motions of the target in its own frame. They are held by ``sum dp_j = 0`` and ``sum p_j x
dp_j = 0``; with G an orthonormal basis of them the covariance of the shape is ``C = (S + s G G^T)^-1 - G G^T / s``.
That of the poses is

    Sigma = blkdiag(N_i^-1) + F F^T,   F_i = G_i L,   G_i = -N_i^-1 N_ip,   C = L L^T

to first order in the noise: each pose has its own part, and all share the errors of the shape.

The variances are those of the restricted maximum likelihood (REML). With the residuals of group g (1 lateral, two
numbers a point; 2 axial, one), their growth removed, it is greatest where

    phi_g = sum r^2 / (n_g - tr H_gg),    H the hat matrix of the weighted fit

(Helmert's variance components), which is iterated with the steps of the fit. ``n_g - tr H_gg`` are the degrees of
freedom of phi_g: its relative standard deviation is about ``sqrt(2 / dof)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.formatting.units import parse_length
from ...core.geometry.se3 import Array, perturb, skew
from ...errors import InputError
from ..camera.adjustment import variable_projection as schur
from ..camera.adjustment.variable_projection import Blocks
from .measured import placed, sums


@dataclass(frozen=True)
class NoiseModel:
    """Kinds of variances: one (isotropic) or two, constant or growing with the distance."""

    isotropic: bool = False
    growing: bool = False
    distance: float = 1.0  # r_0, m

    @property
    def name(self) -> str:
        """``isotropic``, ``lateral and axial``, and whether they grow."""
        return ("isotropic" if self.isotropic else "lateral and axial") + (", growing" if self.growing else "")

    def growth(self, points: Array) -> Array:
        """(k, 2) of the variances at points (k, 3): lateral, axial."""
        if not self.growing:
            return np.ones((len(points), 2))
        r2 = np.sum(points * points, axis=-1) / self.distance**2
        return np.stack([r2, r2 if self.isotropic else r2 * r2], axis=-1)


def sight_lines(points: Array) -> Array:
    """(k, 3) unit vectors from the camera to points (k, 3)."""
    length = np.linalg.norm(points, axis=-1, keepdims=True)
    return np.asarray(np.where(length > 0, points / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0]))


def weight_matrices(u: Array, lateral: Array, axial: Array) -> Array:
    """``w_1 (I - u u^T) + w_2 u u^T`` (k, 3, 3) for weights (k,)."""
    return np.asarray(
        lateral[:, None, None] * np.eye(3) + (axial - lateral)[:, None, None] * (u[:, :, None] * u[:, None])
    )


ISOTROPIC = "isotropic"
EXPECTED = (
    "Expected `noise` (--noise) to be standard deviations lateral,axial such as 0.1mm,0.5mm, one such as 0.2mm for "
    "isotropic noise, or 'isotropic' to estimate one"
)


@dataclass(frozen=True)
class GivenNoise:
    """One variance for both directions or two, and the variances (2,) where they are given."""

    isotropic: bool
    phi: Array | None


def given_noise(noise: Any) -> GivenNoise:
    """Read the argument; raises `InputError`."""
    parts = [part.strip() for part in noise.split(",")] if isinstance(noise, str) else list(np.atleast_1d(noise))
    if parts in ([None], [""], ["auto"], [ISOTROPIC]):
        return GivenNoise(parts == [ISOTROPIC], None)
    try:
        sd = [parse_length(part) for part in parts]
    except InputError:
        sd = []
    if len(sd) not in (1, 2):
        raise InputError(f"{EXPECTED}, got {noise!r}.")
    if not all(1e-9 <= one <= 1.0 for one in sd):
        raise InputError(f"{EXPECTED}, between 1 nm and 1 m, got {noise!r}.")
    return GivenNoise(len(sd) == 1, np.array([sd[0], sd[-1]]) ** 2)


# A direction of the shape with less than this share of the information of the best is open.
OPEN = 1e-10


class Sight(NamedTuple):
    """Pose and point of each measurement, and how many of both there are."""

    y: Array  # (k, 3)
    pose: NDArray[np.intp]
    point: NDArray[np.intp]
    n: int
    m: int

    def where(self, mask: NDArray[np.bool_]) -> Sight:
        """Return some of the measurements."""
        return Sight(self.y[mask], self.pose[mask], self.point[mask], self.n, self.m)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations at poses and points, for weight matrices (k, 3, 3): those of `variable_projection`, with the
    points of the shape for values, the poses for blocks, and its motions held by a prior."""

    sight: Sight
    T: Array  # (n, 4, 4)
    p: Array  # (m, 3)
    W: Array  # (k, 3, 3)
    shape_open: bool

    @cached_property
    def r(self) -> Array:
        """(k, 3) measured minus predicted."""
        return self.sight.y - placed(self.T, self.p[self.sight.point], self.sight.pose)

    @cached_property
    def J(self) -> Array:
        """(k, 3, 6)."""
        return self._by_pose(self.sight)

    def _by_pose(self, sight: Sight) -> Array:
        """J (k, 3, 6) of measurements."""
        a = (self.T[sight.pose, :3, :3] @ self.p[sight.point][..., None])[..., 0]
        return np.concatenate([-skew(a), np.broadcast_to(np.eye(3), (len(a), 3, 3))], axis=-1)

    @cached_property
    def blocks(self) -> Blocks:
        """The equations of each pose: N_i, N_ip and the gradient."""
        sight, weighted = self.sight, self.J.mT @ self.W  # (k, 6, 3)
        mixed = np.zeros((sight.n, 6, sight.m if self.shape_open else 0, 3))
        if self.shape_open:
            mixed[sight.pose, :, sight.point] = weighted @ self.T[sight.pose, :3, :3]
        h = -sums((weighted @ self.r[..., None])[..., 0], sight.pose, sight.n)
        return Blocks.of(sums(weighted @ self.J, sight.pose, sight.n), h, mixed.reshape(sight.n, 6, -1))

    @cached_property
    def reduced(self) -> tuple[Array, Array]:
        """S (3m, 3m) and half the gradient (3m,)."""
        m, R, (V, h, G, *_) = self.sight.m, self.T[self.sight.pose, :3, :3], self.blocks
        g = (
            np.einsum("nak,na->k", G, h)
            - sums((R.mT @ (self.W @ self.r[..., None]))[..., 0], self.sight.point, m).ravel()
        )
        S = -np.tensordot(G, V @ G, axes=([0, 1], [0, 1]))
        blocks = S.reshape(m, 3, m, 3)
        blocks[np.arange(m), :, np.arange(m)] += sums(R.mT @ self.W @ R, self.sight.point, m)
        return 0.5 * (S + S.T), np.asarray(g)

    @cached_property
    def gauge(self) -> Array:
        """G (3m, 6)."""
        motions = np.concatenate([-skew(self.p), np.tile(np.eye(3), (self.sight.m, 1, 1))], axis=-1)
        return np.asarray(np.linalg.qr(motions.reshape(-1, 6))[0])

    @cached_property
    def held(self) -> tuple[schur.Normal, float]:
        """The equations with the motions of the shape held, and s of ``S + s G G^T``."""
        if not self.shape_open:
            return schur.Normal.of_sums(0.0, np.zeros((0, 0)), np.zeros(0), self.blocks, np.zeros((0, 0))), 1.0
        S, g = self.reduced
        s = float(np.trace(S)) / len(S)
        return schur.Normal.of_sums(0.0, S, g, self.blocks, np.sqrt(s) * self.gauge.T), s

    @property
    def determined(self) -> bool:
        """Return whether the poses have all points of an unknown shape in common."""
        e = self.held[0].e
        return bool(e.min(initial=1.0) > OPEN * e[np.isfinite(e)].max(initial=0.0) and np.isfinite(e).all())

    @property
    def own(self) -> Array:
        """(n, 6, 6) covariance of each pose beside the shape."""
        return self.blocks.covariance

    @cached_property
    def C(self) -> Array:
        """(3m, 3m) covariance of the shape; (0, 0) of one that is known."""
        held, s = self.held
        C = (held.Q / held.e) @ held.Q.T
        C = C - self.gauge @ self.gauge.T / s if self.shape_open else C
        return np.asarray(0.5 * (C + C.T))

    @cached_property
    def L(self) -> Array:
        """(3m, 3m - 6) with ``C = L L^T``."""
        values, vectors = np.linalg.eigh(self.C)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0)))[:, 6:])

    @cached_property
    def shared(self) -> Array:
        """F (n, 6, q); q = 0 for a target that is known."""
        F = self.blocks.G @ self.L
        n, q = self.sight.n, F.shape[-1]
        if q <= 6 * n:
            return np.asarray(F)
        return np.asarray(np.linalg.qr(F.reshape(6 * n, q).T)[1].T.reshape(n, 6, 6 * n))  # F F^T is the same

    def moved(self) -> tuple[Normal, float]:
        """Return the equations after one step, and the largest step of a pose in standard deviations."""
        dp, xi, _ = self.held[0].step(0.0)
        size = float(np.sqrt(np.maximum(np.einsum("na,nab,nb->n", xi, self.blocks.V, xi), 0.0).max(initial=0.0)))
        # dp keeps centroid and axes: they need no correction
        p = self.p + dp.reshape(-1, 3) if self.shape_open else self.p
        return Normal(self.sight, perturb(self.T, xi), p, self.W, self.shape_open), size

    def predicted_covariance(self, sight: Sight) -> Array:
        """Q (k, 3, 3) of predicted points, those of the fit or others."""
        R, J, own = self.T[sight.pose, :3, :3], self._by_pose(sight), self.own[sight.pose]
        if not self.shape_open:
            return np.asarray(J @ own @ J.mT)
        m, G = self.sight.m, self.blocks.G
        GC = G @ self.C
        across = J @ GC.reshape(len(GC), 6, m, 3)[sight.pose, :, sight.point] @ R.mT
        shape = self.C.reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m)][sight.point]
        return np.asarray(J @ (own + (GC @ G.mT)[sight.pose]) @ J.mT + across + across.mT + R @ shape @ R.mT)

    def log_determinant(self) -> float:
        """Return that of the normal equations, without the gauge."""
        own = float(np.linalg.slogdet(self.blocks.V)[1].sum())
        if not self.shape_open:
            return own
        s = self.held[1]
        return own + float(np.linalg.slogdet(self.reduced[0] + s * self.gauge @ self.gauge.T)[1] - 6 * np.log(s))


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
