r"""Weighted least squares of poses and shape: Gauss-Newton, covariance, leverages.

Model: point j of the target is measured in pose i as ``y_ij = R_i p_j + t_i + e_ij``, e_ij of covariance V_ij
(`model`). Unknowns are the poses, ``xi_i = (theta, tau)``, left rotation and additive translation, and, where the
target is not known, its points p_j. With ``a = R_i p_j``, ``W = V^-1``

    d y = J_i xi_i + R_i dp_j,   J_i = [-[a]x, I]
    N_i = sum_j J^T W J,   N_ip = J^T W R,   S = blkdiag(sum_i R^T W R) - sum_i N_ip^T N_i^-1 N_ip

S is singular along the six motions of the target in its own frame. They are held by ``sum dp_j = 0`` and ``sum p_j x
dp_j = 0``; with G an orthonormal basis of them the covariance of the shape is ``C = (S + s G G^T)^-1 - G G^T / s``.
That of the poses is

    Sigma = blkdiag(N_i^-1) + F F^T,   F_i = -N_i^-1 N_ip L,   C = L L^T

to first order in the noise: each pose has its own part, and all share the errors of the shape.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.se3 import Array, perturb, skew
from .start import placed, sums

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
    """Normal equations at poses and points, for weight matrices (k, 3, 3)."""

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
        R = self.T[self.sight.pose, :3, :3]
        a = (R @ self.p[self.sight.point][..., None])[..., 0]
        J = np.zeros((len(a), 3, 6))
        J[:, :, :3], J[:, :, 3:] = -skew(a), np.eye(3)
        return J

    @cached_property
    def _weighted(self) -> Array:
        """(k, 6, 3) ``J^T W``."""
        return np.asarray(self.J.mT @ self.W)

    @cached_property
    def N(self) -> Array:
        """(n, 6, 6)."""
        return sums(self._weighted @ self.J, self.sight.pose, self.sight.n)

    @cached_property
    def own(self) -> Array:
        """(n, 6, 6) covariance of each pose beside the shape."""
        inverse = np.linalg.inv(self.N)
        return np.asarray(0.5 * (inverse + inverse.mT))

    @cached_property
    def b(self) -> Array:
        """(n, 6)."""
        return sums((self._weighted @ self.r[..., None])[..., 0], self.sight.pose, self.sight.n)

    @cached_property
    def mixed(self) -> Array:
        """(n, 6, 3m)."""
        N = np.zeros((self.sight.n, 6, self.sight.m, 3))
        N[self.sight.pose, :, self.sight.point] = self._weighted @ self.T[self.sight.pose, :3, :3]
        return N.reshape(self.sight.n, 6, 3 * self.sight.m)

    @cached_property
    def of_points(self) -> Array:
        """(m, 3, 3) information of each point, and (m, 3) its right side below."""
        R = self.T[self.sight.pose, :3, :3]
        return sums(R.mT @ self.W @ R, self.sight.point, self.sight.m)

    @cached_property
    def reduced(self) -> tuple[Array, Array]:
        """S (3m, 3m) and its right side (3m,)."""
        m, R = self.sight.m, self.T[self.sight.pose, :3, :3]
        right = sums((R.mT @ (self.W @ self.r[..., None]))[..., 0], self.sight.point, m).ravel()
        solved = self.own @ self.mixed
        S = -np.tensordot(self.mixed, solved, axes=([0, 1], [0, 1]))
        blocks = S.reshape(m, 3, m, 3)
        blocks[np.arange(m), :, np.arange(m)] += self.of_points
        right = right - np.einsum("nak,na->k", solved, self.b)
        return 0.5 * (S + S.T), np.asarray(right)

    @cached_property
    def gauge(self) -> Array:
        """G (3m, 6)."""
        motions = np.concatenate([-skew(self.p), np.tile(np.eye(3), (self.sight.m, 1, 1))], axis=-1)
        return np.asarray(np.linalg.qr(motions.reshape(-1, 6))[0])

    @cached_property
    def held_information(self) -> tuple[Array, float]:
        """``S + s G G^T`` (3m, 3m), and s."""
        S, G = self.reduced[0], self.gauge
        s = float(np.trace(S)) / len(S)
        return S + s * G @ G.T, s

    @cached_property
    def pivots(self) -> Array:
        """(3m,) squared pivots of ``S + s G G^T``; zeros where it is singular."""
        try:
            return np.asarray(np.diag(np.linalg.cholesky(self.held_information[0])) ** 2)
        except np.linalg.LinAlgError:
            return np.zeros(3 * self.sight.m)

    @property
    def determined(self) -> bool:
        """Return whether the poses have all points of an unknown shape in common."""
        return bool(self.pivots.min() > OPEN * self.pivots.max())

    @cached_property
    def C(self) -> Array:
        """(3m, 3m) covariance of the shape."""
        A, s = self.held_information
        C = np.linalg.inv(A) - self.gauge @ self.gauge.T / s
        return np.asarray(0.5 * (C + C.T))

    @cached_property
    def L(self) -> Array:
        """(3m, 3m - 6) with ``C = L L^T``."""
        values, vectors = np.linalg.eigh(self.C)
        return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0)))[:, 6:])

    @cached_property
    def shared(self) -> Array:
        """F (n, 6, q); q = 0 for a target that is known."""
        if not self.shape_open:
            return np.zeros((self.sight.n, 6, 0))
        F = -self.own @ (self.mixed @ self.L)
        n, q = self.sight.n, F.shape[-1]
        if q <= 6 * n:
            return np.asarray(F)
        return np.asarray(np.linalg.qr(F.reshape(6 * n, q).T)[1].T.reshape(n, 6, 6 * n))  # F F^T is the same

    def step(self) -> tuple[Array, Array]:
        """The Gauss-Newton step of poses (n, 6) and points (m, 3)."""
        if not self.shape_open:
            return np.asarray((self.own @ self.b[..., None])[..., 0]), np.zeros((self.sight.m, 3))
        dp = self.C @ self.reduced[1]
        xi = self.own @ (self.b - self.mixed @ dp)[..., None]
        return np.asarray(xi[..., 0]), dp.reshape(-1, 3)

    def moved(self) -> tuple[Normal, float]:
        """Return the equations after one step, and the largest step of a pose in standard deviations."""
        xi, dp = self.step()
        size = float(np.sqrt(np.maximum(np.einsum("na,nab,nb->n", xi, self.N, xi), 0.0).max(initial=0.0)))
        T, p = perturb(self.T, xi), self.p + dp  # dp keeps centroid and axes: they need no correction
        return Normal(self.sight, T, p, self.W, self.shape_open), size

    def predicted_covariance(self, sight: Sight) -> Array:
        """Q (k, 3, 3) of predicted points, those of the fit or others."""
        R = self.T[sight.pose, :3, :3]
        J = np.zeros((len(R), 3, 6))
        J[:, :, :3], J[:, :, 3:] = -skew((R @ self.p[sight.point][..., None])[..., 0]), np.eye(3)
        S = self.own[sight.pose]
        if not self.shape_open:
            return np.asarray(J @ S @ J.mT)
        m = self.sight.m
        K = self.own @ self.mixed  # (n, 6, 3m)
        KC = K @ self.C
        across = KC.reshape(len(KC), 6, m, 3)[sight.pose, :, sight.point] @ R.mT  # (k, 6, 3)
        shape = self.C.reshape(m, 3, m, 3)[np.arange(m), :, np.arange(m)][sight.point]
        mixed = J @ across
        whole = S + (KC @ K.mT)[sight.pose]
        return np.asarray(J @ whole @ J.mT - mixed - mixed.mT + R @ shape @ R.mT)

    def log_determinant(self) -> float:
        """Return that of the normal equations, without the gauge."""
        own = float(np.linalg.slogdet(self.N)[1].sum())
        if not self.shape_open:
            return own
        return own + float(np.log(np.maximum(self.pivots, 1e-300)).sum() - 6 * np.log(self.held_information[1]))
