r"""Errors that pass on from pose to pose: a drift, or noise that is correlated in time.

A stationary first-order Markov process z (6 components, the state) runs beside the poses at the times t_1 <= .. <= t_n
and reaches pose i through a regular matrix H_i (6, 6):

    xi_i = eta_i + H_i z_i,   E z_i z_j^T = exp(-|t_i - t_j| / length) P

eta_i is of each pose itself, covariance S_i. At equal times this is an AR(1) process with the coefficient
``exp(-1 / length)`` per step; over a length of the whole session it is a random walk about a mean that is not known
either (steps of the covariance ``2 P / length`` each). Nothing of it is dense: in the frame of the state
``y_i = H_i^-1 xi_i``, with ``a_i = exp(-(t_i - t_(i-1)) / length)`` and differences ``(B y)_i = y_i - a_i y_(i-1)``,

    Cov(B y) = M,   M_ii = T_i + a_i^2 T_(i-1) + (1 - a_i^2) P,   M_(i,i-1) = -a_i T_(i-1),   T_i = H_i^-1 S_i H_i^-T

(``M_11 = T_1 + P``) is block tridiagonal: with its banded Cholesky factor C

    Sigma = L L^T,   L^-1 = C^-1 B H^-1,   log|Sigma| = log|M| + 2 sum log|det H_i|

in time and memory proportional to n.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ..errors import InputError
from ..geometry.se3 import Array
from ..runtime.read_only import ReadOnlyArrays

_I, _J = np.tril_indices(6)


@dataclass(frozen=True, eq=False)
class SerialErrors(ReadOnlyArrays):
    """The part ``H_i z_i`` of the errors of n poses, whatever the order of the rows; see the module.

    >>> drift = SerialErrors(np.arange(3.0), np.tile(np.eye(6), (3, 1, 1)), np.eye(6), 1.0)
    >>> float(np.asarray(drift.times(np.eye(18)))[0, 12].round(4)), drift.n
    (0.1353, 3)
    """

    time: Array  # (n,) in any unit
    by_state: Array  # H (..., n, 6, 6)
    state: Array  # P (6, 6)
    length: float  # in the unit of time
    name: str = ""  # of what moves, in budgets

    def __post_init__(self) -> None:
        time, H, P = (np.asarray(getattr(self, name), dtype=float) for name in ("time", "by_state", "state"))
        fits = time.ndim == 1 and H.ndim >= 3 and H.shape[-3:] == (len(time), 6, 6) and P.shape == (6, 6)
        if not fits or not (np.isfinite(time).all() and np.isfinite(P).all() and 0 < self.length < np.inf):
            raise InputError(
                "Expected serial errors as `time` (n,), `by_state` (n, 6, 6), `state` (6, 6), finite, and a `length` "
                f"above 0, got {time.shape}, {H.shape}, {P.shape} and {self.length!r}."
            )
        for name, value in (("time", time), ("by_state", H), ("state", P)):
            object.__setattr__(self, name, value)
        super().__post_init__()

    @property
    def n(self) -> int:
        """Number of poses."""
        return len(self.time)

    @cached_property
    def order(self) -> NDArray[np.intp]:
        """(n,) rows by time."""
        return np.argsort(self.time, kind="stable")

    @cached_property
    def passed_on(self) -> Array:
        """a (n,) by time: the share of the state before that is left; 0 for the first."""
        steps = np.diff(self.time[self.order])
        return np.concatenate([[0.0], np.exp(-steps / self.length)])

    @property
    def blocks(self) -> Array:
        """(..., n, 6, 6) the covariance of each pose by itself."""
        return np.asarray(self.by_state @ self.state @ self.by_state.mT)

    def rows(self, index: NDArray[Any]) -> SerialErrors:
        """Return the errors of some of the poses."""
        return SerialErrors(self.time[index], self.by_state[..., index, :, :], self.state, self.length, self.name)

    def carried(self, D: Array) -> SerialErrors:
        """Return the errors ``D_i xi_i``, D (..., n, 6, 6)."""
        return SerialErrors(self.time, D @ self.by_state, self.state, self.length, self.name)

    def scaled(self, factor: float) -> SerialErrors:
        """Their covariance times a factor."""
        return SerialErrors(self.time, self.by_state, factor * self.state, self.length, self.name)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for files; `from_dict` reads them."""
        arrays = {name: getattr(self, name).tolist() for name in ("time", "by_state", "state")}
        return {**arrays, "length": self.length, "name": self.name}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> SerialErrors:
        """Read what `to_dict` wrote; KeyError for parts that are missing."""
        time, by_state, state = (np.asarray(values[name], dtype=float) for name in ("time", "by_state", "state"))
        return cls(time, by_state, state, float(values["length"]), str(values["name"]))

    def draw(self, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
        """Errors (*shape, n, 6); H without leading axes."""
        values, vectors = np.linalg.eigh(self.state)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        z = rng.standard_normal((*shape, self.n, 6)) @ root.T
        a = self.passed_on
        z[..., 1:, :] *= np.sqrt(1.0 - a[1:] ** 2)[:, None]
        for i in range(1, self.n):
            z[..., i, :] += a[i] * z[..., i - 1, :]
        back = np.empty_like(z)
        back[..., self.order, :] = z
        return np.asarray((self.by_state @ back[..., None])[..., 0])

    def times(self, values: Array) -> Array:
        """Their covariance times (..., 6n, p)."""
        by_pose = values.reshape(*values.shape[:-2], self.n, 6, values.shape[-1])
        v = (self.by_state.mT @ by_pose)[..., self.order, :, :]
        a = self.passed_on
        ahead, behind = np.array(v), np.zeros_like(v)
        for i in range(1, self.n):
            ahead[..., i, :, :] += a[i] * ahead[..., i - 1, :, :]
        for i in range(self.n - 2, -1, -1):
            behind[..., i, :, :] = a[i + 1] * (behind[..., i + 1, :, :] + v[..., i + 1, :, :])
        both = np.empty_like(v)
        both[..., self.order, :, :] = self.state @ (ahead + behind)
        found = self.by_state @ both
        return np.asarray(found.reshape(*found.shape[:-3], *values.shape[-2:]))

    def factor(self, own: Array) -> SerialFactor:
        """L of the sum of these errors and those of each pose itself, own (..., n, 6, 6).

        Raises `numpy.linalg.LinAlgError` where the sum is singular.
        """
        inverse = np.asarray(np.linalg.inv(self.by_state[..., self.order, :, :]))
        T = inverse @ own[..., self.order, :, :] @ inverse.mT
        bands: Array = np.stack([banded_factor(of) for of in self.bands(T).reshape(-1, 12, 6 * self.n)])
        return SerialFactor(
            self.order, self.passed_on, inverse, bands.reshape(*T.shape[:-3], 12, 6 * self.n),
        )  # fmt: skip

    def bands(self, T: Array) -> Array:
        """M (..., 12, 6n) as LAPACK stores the lower half of a band matrix, of T (..., n, 6, 6) by time."""
        a = self.passed_on
        squared = (a * a)[:, None, None]
        own = T + (1.0 - squared) * self.state
        own[..., 1:, :, :] += squared[1:] * T[..., :-1, :, :]
        below = -a[1:, None, None] * T[..., :-1, :, :]  # rows of pose i + 1, columns of pose i
        return fill_bands(own, below)


def fill_bands(own: Array, below: Array) -> Array:
    """Blocks (..., n, 6, 6) on the diagonal and (..., n - 1, 6, 6) below it as a lower band (..., 12, 6n)."""
    n = own.shape[-3]
    bands = np.zeros((*own.shape[:-3], 12, n, 6))
    for column in range(6):
        bands[..., : 6 - column, :, column] = own[..., column:, column].mT
        bands[..., 6 - column : 12 - column, :-1, column] = below[..., column].mT
    return bands.reshape(*bands.shape[:-2], 6 * n)


def banded_factor(bands: Array) -> Array:
    """Cholesky factor of one matrix as `fill_bands` makes it, stored likewise."""
    found, info = lapack.dpbtrf(bands, lower=1)
    if info != 0:
        raise np.linalg.LinAlgError("the covariance is not positive definite")
    return np.asarray(found)


def solve_banded(bands: Array, values: Array, transposed: bool = False) -> Array:
    """``C^-1 values`` or ``C^-T values`` (m, p) for the factor C (12, m)."""
    found, _ = lapack.dtbtrs(bands, values, uplo="L", trans="T" if transposed else "N")
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class SerialFactor:
    """``L^-1 = C^-1 B H^-1``: row i of what it whitens is what the poses before i do not predict of pose i."""

    order: NDArray[np.intp]  # (n,) rows by time
    passed_on: Array  # a (n,) by time
    inverse: Array  # H^-1 (..., n, 6, 6) by time
    bands: Array  # C (..., 12, 6n)

    def whiten(self, values: Array) -> Array:
        """``L^-1 values`` (..., n, 6, p)."""
        y = self.inverse @ values[..., self.order, :, :]
        y[..., 1:, :, :] -= self.passed_on[1:, None, None] * y[..., :-1, :, :]
        return self._restored(self._solved(y, False))

    def pull(self, white: Array) -> Array:
        """``L^-T white`` (..., n, 6, p)."""
        y = self._solved(white[..., self.order, :, :], True)
        y[..., :-1, :, :] -= self.passed_on[1:, None, None] * y[..., 1:, :, :]
        return self._restored(self.inverse.mT @ y)

    def _restored(self, values: Array) -> Array:
        found = np.empty_like(values)
        found[..., self.order, :, :] = values
        return found

    def _solved(self, values: Array, transposed: bool) -> Array:
        size, p = 6 * values.shape[-3], values.shape[-1]
        if p == 0:
            return values
        leading = np.broadcast_shapes(self.bands.shape[:-2], values.shape[:-3])
        bands = np.broadcast_to(self.bands, (*leading, 12, size)).reshape(-1, 12, size)
        flat = np.broadcast_to(values, (*leading, *values.shape[-3:])).reshape(-1, size, p)
        found = np.stack([solve_banded(C, one, transposed) for C, one in zip(bands, flat, strict=True)])
        return found.reshape(*leading, *values.shape[-3:])

    def log_determinant(self) -> Array:
        """(...) ``log|Sigma|``."""
        return np.asarray(
            2.0 * np.log(self.bands[..., 0, :]).sum(axis=-1)
            - 2.0 * np.linalg.slogdet(self.inverse)[1].sum(axis=-1)
        )  # fmt: skip

    def inverse_blocks(self) -> Array:
        """(..., n, 6, 6) diagonal blocks of ``Sigma^-1 = H^-T B^T M^-1 B H^-1``.

        Those of ``N = M^-1`` and beside its diagonal follow from the last to the first (Takahashi, Fagan and Chen
        1973): with ``U_i = C_(i+1,i) C_ii^-1``, ``N_(i+1,i) = -N_(i+1,i+1) U_i`` and
        ``N_ii = (C_ii C_ii^T)^-1 + U_i^T N_(i+1,i+1) U_i``.
        """
        n = len(self.order)
        stored = self.bands.reshape(*self.bands.shape[:-2], 12, n, 6)
        C = np.zeros((*stored.shape[:-3], n, 6, 6))
        below = np.zeros((*stored.shape[:-3], n - 1, 6, 6))
        for column in range(6):
            C[..., column:, column] = stored[..., : 6 - column, :, column].mT
            below[..., column] = stored[..., 6 - column : 12 - column, :-1, column].mT
        half = np.linalg.inv(C)
        N = half.mT @ half
        U = below @ half[..., :-1, :, :]
        for i in range(n - 2, -1, -1):
            N[..., i, :, :] += U[..., i, :, :].mT @ N[..., i + 1, :, :] @ U[..., i, :, :]
        a = self.passed_on[1:, None, None]
        beside = N[..., 1:, :, :] @ U  # -N_(i+1,i)
        found = np.array(N)
        found[..., :-1, :, :] += a * (beside + beside.mT) + a * a * N[..., 1:, :, :]
        return self._restored(self.inverse.mT @ found @ self.inverse)
