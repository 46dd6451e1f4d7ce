r"""Forms of a covariance S of poses or residuals, their square roots ``S = L L^T``, and operations with them.

S has one of three forms: blocks (..., n, 6, 6), independent from pose to pose, or one (6, 6) for all; an array
(..., 6n, 6n), joint; or a `JointCovariance`, joint by a few errors that all share. Values are (..., n, 6, p) always.
`form_of` returns the form; each form has its own implementation of the same operations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, overload

import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from ...core.geometry.se3 import Array
from .cholesky import checked_cholesky, substitute, substitute_transposed
from .joint_covariance import Index, JointCovariance, JointFactor

Covariance = Array | JointCovariance
Factor = Array | JointFactor
# Smallest weight of a pose: it replaces a robust weight of 0.
LEAST_WEIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class _Blocks:
    """S or L of independent poses, (..., n, 6, 6), or (6, 6) that serves all."""

    M: Array
    correlated: ClassVar[bool] = False

    @property
    def blocks(self) -> Array:
        return self.M

    own = blocks

    @property
    def factor(self) -> Array:
        return checked_cholesky(self.M)

    def rows(self, index: Index) -> Array:
        return self.M if self.M.ndim == 2 else np.asarray(self.M[..., index, :, :])

    def weighted(self, scale: Array) -> Array:
        return self.M * scale[..., None, None]

    def whiten(self, values: Array) -> Array:
        return substitute(self.M, values)

    def pull(self, white: Array) -> Array:
        return substitute_transposed(self.M, white)

    def inverse_blocks(self) -> Array:
        half = np.linalg.inv(self.M)
        return np.asarray(half.mT @ half)

    def log_determinant(self) -> Array:
        logs = 2.0 * np.log(np.diagonal(self.M, axis1=-2, axis2=-1)).sum(axis=-1)
        return np.asarray(logs.sum(axis=-1) if self.M.ndim > 2 else logs)


class _Dense(_Blocks):
    """S or L of all poses together, (..., 6n, 6n)."""

    correlated: ClassVar[bool] = True

    @property
    def blocks(self) -> Array:
        n = self.M.shape[-1] // 6
        index = np.arange(n)
        return np.moveaxis(self.M.reshape(*self.M.shape[:-2], n, 6, n, 6)[..., index, :, index, :], 0, -3)

    own = blocks

    def rows(self, index: Index) -> Array:
        numbers = np.arange(self.M.shape[-1] // 6)[index]
        flat = (6 * numbers[:, None] + np.arange(6)).ravel()
        return np.asarray(self.M[..., flat[:, None], flat])

    def weighted(self, scale: Array) -> Array:
        batch = np.broadcast_shapes(self.M.shape[:-2], scale.shape[:-1])
        found = np.array(np.broadcast_to(self.M, (*batch, *self.M.shape[-2:])))
        for k in range(scale.shape[-1]):
            own = slice(6 * k, 6 * k + 6)
            found[..., own, own] *= scale[..., k, None, None]
        return found

    def whiten(self, values: Array) -> Array:
        return self._solved(values, 0)

    def pull(self, white: Array) -> Array:
        return self._solved(white, 1)

    def _solved(self, values: Array, transposed: Literal[0, 1]) -> Array:
        flat = values.reshape(*values.shape[:-3], values.shape[-3] * 6, values.shape[-1])
        found = np.asarray(solve_triangular(self.M, flat, lower=True, trans=transposed))
        return found.reshape(*found.shape[:-2], *values.shape[-3:])

    def inverse_blocks(self) -> Array:
        one = np.broadcast_to(np.eye(self.M.shape[-1]), self.M.shape)
        return _Dense(np.asarray(cho_solve((self.M, True), one))).blocks

    def log_determinant(self) -> Array:
        return np.asarray(2.0 * np.log(np.diagonal(self.M, axis1=-2, axis2=-1)).sum(axis=-1))


@overload
def form_of(M: Array) -> _Blocks: ...
@overload
def form_of(M: JointCovariance) -> JointCovariance: ...
@overload
def form_of(M: JointFactor) -> JointFactor: ...
def form_of(M: Array | JointCovariance | JointFactor) -> _Blocks | JointCovariance | JointFactor:
    """Return what knows how to deal with S or with L: itself where it is no array."""
    if not isinstance(M, np.ndarray):
        return M
    return (_Blocks if M.shape[-1] == 6 else _Dense)(M)


def is_joint(S: Covariance) -> bool:
    """Return whether the errors of different poses are correlated."""
    return bool(form_of(S).correlated)


def cholesky_of(S: Covariance) -> Factor:
    """L with ``S = L L^T``; raises where the noise leaves a part of the residuals exact."""
    return form_of(S).factor


def whiten(factor: Factor, values: Array) -> Array:
    """``L^-1 values``."""
    return np.asarray(form_of(factor).whiten(values))


def pulled(factor: Factor, white: Array) -> Array:
    """``L^-T white``; of whitened values, ``S^-1 values``."""
    return np.asarray(form_of(factor).pull(white))


def inverse_blocks(factor: Factor) -> Array:
    """(..., n, 6, 6) diagonal blocks of ``S^-1``: what the other poses leave open of each."""
    return np.asarray(form_of(factor).inverse_blocks())


def log_determinant(factor: Factor) -> Array:
    """``log|S|`` (...); of independent poses the sum over them."""
    return np.asarray(form_of(factor).log_determinant())


def marginals(S: Covariance) -> Array:
    """(..., n, 6, 6) the covariance of each pose by itself; (6, 6) where one serves all."""
    return np.asarray(form_of(S).blocks)


def weighed_blocks(S: Covariance) -> Array:
    """(..., n, 6, 6) what the weight of a pose divides: its own part of a `JointCovariance`, else its whole block."""
    return np.asarray(form_of(S).own)


def rows_of(S: Covariance, index: Index) -> Covariance:
    """S of some of the poses or motions, by their numbers or a mask: their own, or their part of a joint one."""
    return form_of(S).rows(index)


def weighted(S: Covariance, weights: Array) -> Covariance:
    """S with `weighed_blocks` divided by the weights; a weight of 0 becomes `LEAST_WEIGHT`."""
    return form_of(S).weighted(1.0 / np.maximum(weights, LEAST_WEIGHT))


def gram(white: Array) -> Array:
    """``sum over poses of white^T white``: (..., n, 6, q) -> (..., q, q)."""
    flat = white.reshape(*white.shape[:-3], -1, white.shape[-1])
    return np.asarray(flat.mT @ flat)
