r"""New measurements against a calibration, and the posterior that takes them in.

A measurement of k numbers differs from what the calibration says by r. If nothing has changed,

    r = V u + own noise,      u ~ N(0, I) (`state`),      Sigma = blkdiag(own) + V V^T

V (p) holds the errors of X, W and what all poses share, of the robot's accuracy, and errors that these measurements
share by themselves (a tool that is not known). Then ``d^2 = r^T Sigma^-1 r`` is chi-square with all mk degrees of
freedom. A cause with the columns C, ``E r = C a``, is estimated by generalised least squares,

    a = (C^T Sigma^-1 C)^-1 C^T Sigma^-1 r,      Cov a = (C^T Sigma^-1 C)^-1

and takes ``a^T Cov(a)^-1 a`` away from d^2. The errors of the estimates, ``s = A u``, given r are

    E s = A V^T Sigma^-1 r,      Cov s = A A^T - A V^T Sigma^-1 V A^T

which is the update of a Kalman filter, and the fit of all data together to first order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..errors import InputError
from ..geometry.se3 import Array
from ..noise.joint_covariance import JointFactor
from ..noise.triangular import checked_cholesky, substitute
from ..runtime.read_only import ReadOnlyArrays
from .state import State


class Explained(NamedTuple):
    """A cause of given columns, by generalised least squares."""

    estimate: Array  # (c,)
    covariance: Array  # (c, c)
    gain: float  # by how much d^2 falls


class Absorbed(NamedTuple):
    """The errors of the estimates once the measurements are known."""

    mean: Array  # (12 + q,) of s: estimates less truth, so that the new estimate is the old one less it
    covariance: Array  # (12 + q, 12 + q)


@dataclass(frozen=True, eq=False)
class Evidence(ReadOnlyArrays):
    """m measurements of k numbers each against a calibration; see the module."""

    r: Array  # (m, k) measured less stated; rad, m
    by_unit: Array  # (m, k, p + z) V: by the u of the state, then by errors of these measurements only
    own: Array  # (m, k, k) covariance of each measurement's own noise
    state: State

    @property
    def dof(self) -> int:
        """Number of numbers."""
        return int(self.r.size)

    @cached_property
    def factor(self) -> JointFactor:
        """L with ``Sigma = L L^T``; raises `SingularNoiseError` where a measurement has no noise of its own."""
        B = checked_cholesky(self.own)
        V = substitute(B, self.by_unit).reshape(self.dof, -1)
        squares, Y = np.linalg.eigh(V.T @ V)
        return JointFactor(B, V @ Y, np.sqrt(1.0 + np.maximum(squares, 0.0)))

    def whitened(self, columns: Array) -> Array:
        """``L^-1 C`` (mk, c) of columns (m, k, c)."""
        white = self.factor.whiten(columns)
        return np.asarray(white.reshape(-1, white.shape[-1]))

    @cached_property
    def white(self) -> Array:
        """``L^-1 r`` (mk,)."""
        return self.whitened(self.r[..., None])[:, 0]

    @property
    def d2(self) -> float:
        """``r^T Sigma^-1 r``."""
        return float(self.white @ self.white)

    @property
    def covariance(self) -> Array:
        """(mk, mk) of r."""
        V = self.by_unit.reshape(self.dof, -1)
        result = V @ V.T
        m, k = self.r.shape
        for i in range(m):
            result[i * k : i * k + k, i * k : i * k + k] += self.own[i]
        return result

    def information(self, columns: Array) -> Array:
        """``C^T Sigma^-1 C`` (c, c) of the columns (m, k, c) of a cause: of its noncentrality by its size."""
        white = self.whitened(columns)
        return np.asarray(white.T @ white)

    def explained_by(self, columns: Array) -> Explained:
        """Estimate a cause by its columns (m, k, c); combinations of them without effect get the estimate 0.

        The covariance is then that of the others.
        """
        white = self.whitened(columns)
        size = np.linalg.norm(white, axis=0)
        size = np.where(size > 0, size, 1.0)
        U, s, Vt = np.linalg.svd(white / size, full_matrices=False)
        told = s > s.max(initial=0.0) * 1e-9
        along = U.T[told] @ self.white
        back = (Vt[told].T / s[told]) / size[:, None]
        return Explained(back @ along, back @ back.T, float(along @ along))

    def absorbed(self) -> Absorbed:
        """Return the errors of the estimates, given these measurements."""
        own = replace(self, by_unit=self.by_unit[..., :0])
        V, r = own.whitened(self.by_unit), own.whitened(self.r[..., None])[:, 0]
        p = self.state.A.shape[1]
        inner = cho_factor(np.eye(V.shape[1]) + V.T @ V)  # u given r has the covariance (1 + V^T V)^-1
        A = np.zeros((len(self.state.A), V.shape[1]))
        A[:, :p] = self.state.A
        covariance = A @ cho_solve(inner, A.T)
        return Absorbed(A @ cho_solve(inner, V.T @ r), 0.5 * (covariance + covariance.T))

    def rows(self, index: Array) -> Evidence:
        """Some of the measurements, by their numbers or a mask."""
        return Evidence(self.r[index], self.by_unit[index], self.own[index], self.state)

    def joined(self, other: Evidence) -> Evidence:
        """The measurements of both, each by itself made of uncorrelated numbers of variance 1.

        Errors that only one of them has stay its own. Raises `InputError` for evidence against different states.
        """
        if self.state is not other.state:
            raise InputError("Expected evidence against the same state of one calibration.")
        p = self.state.A.shape[1]
        parts = [(of.r[..., None], of.by_unit[..., :p], of.by_unit[..., p:], checked_cholesky(of.own))
                 for of in (self, other)]  # fmt: skip
        white = [
            [substitute(B, x).reshape(x.shape[0] * x.shape[1], -1 if x.size else 0) for x in part] for *part, B in parts
        ]
        widths = [part[2].shape[-1] for part in white]
        own = [np.pad(part[2], [(0, 0), (sum(widths[:i]), sum(widths[i + 1 :]))]) for i, part in enumerate(white)]
        r = np.concatenate([part[0] for part in white])
        by_unit = np.concatenate([np.hstack([part[1], z]) for part, z in zip(white, own, strict=True)])
        return Evidence(r, by_unit[:, None], np.ones((len(r), 1, 1)), self.state)
