"""The covariance of many poses that share a few errors, stored by its parts.

Poses of one camera share the errors of its intrinsics: the errors of pose i are ``xi_i = eta_i + F_i z`` with eta_i of
its own, covariance S_i, and z standard normal, common to all (q components, 4 to 12 for a camera). The joint covariance

    Sigma = blkdiag(S_1 .. S_n) + F F^T,        F = [F_1; ..; F_n]  (6n, q)

takes n (36 + 6q) numbers, and everything that is done with it takes time in proportion to n. With the Cholesky factor
B of the blocks, ``V = B^-1 F``, ``V^T V = Y diag(h^2 - 1) Y^T`` and ``U = V Y``

    Sigma = L L^T,   L = B (I + V V^T)^(1/2),   L^-1 = (I - U diag(1 / (h (1 + h))) U^T) B^-1

which `JointFactor` applies without forming it. The columns of many poses are a `Columns`. A column may have the key of
the error that it is a number of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ...core.files.json_values import JsonObject
from ...core.geometry.checks import checked_covariance
from ...core.geometry.se3 import Array
from ...core.read_only import ReadOnlyArrays
from ...errors import InputError
from .cholesky import checked_cholesky, substitute, substitute_transposed
from .columns import MANY_POSES, Columns, against, parts_of, scaled, second_moment, side_by_side, squares, times
from .key import ErrorKey

# Poses by their numbers or by a mask.
Index: TypeAlias = NDArray[np.intp] | NDArray[np.bool_]


@dataclass(frozen=True, eq=False, init=False)
class JointCovariance(ReadOnlyArrays):
    """``blkdiag(own) + F F^T`` of n poses: own (..., n, 6, 6) and the n blocks of F, shared (..., n, 6, q).

    ``keys`` (q) of the columns: one standard deviation of that number of an error; None where a column has none.
    It may be given where a (6n, 6n) array may, has its shape, multiplies like it, and ``np.asarray`` forms it.

    >>> S = JointCovariance(np.tile(np.eye(6), (3, 1, 1)), np.ones((3, 6, 1)))
    >>> S.shape, float(np.asarray(S)[0, 17]), S.n
    ((18, 18), 1.0, 3)
    """

    own: Array
    columns: Array | Columns
    keys: tuple[ErrorKey | None, ...]

    correlated: ClassVar[bool] = True
    __array_ufunc__ = None  # `array @ S` comes here

    def __init__(self, own: Array, shared: Array | Columns, keys: Sequence[ErrorKey | None] = ()) -> None:
        own = np.asarray(own, dtype=float)
        columns = shared if isinstance(shared, Columns) else np.asarray(shared, dtype=float)
        shape = columns.shape
        if own.ndim < 3 or own.shape[-2:] != (6, 6) or len(shape) < 3 or shape[-3:-1] != (own.shape[-3], 6):
            raise InputError(f"Expected `own` (n, 6, 6) and `shared` (n, 6, q) of one n, got {own.shape} and {shape}.")
        object.__setattr__(self, "own", own)
        object.__setattr__(self, "columns", columns)
        keys = tuple(keys) or (None,) * shape[-1]
        if len(keys) != shape[-1]:
            raise InputError(f"Expected a key for each of {shape[-1]} shared columns, got {len(keys)}.")
        object.__setattr__(self, "keys", keys)
        self.__post_init__()

    @classmethod
    def of_each(cls, own: Array) -> JointCovariance:
        """Return the covariance of poses that share no errors, own (n, 6, 6)."""
        return cls(own, np.zeros((*own.shape[:-1], 0)))

    @property
    def shared(self) -> Array:
        """F (..., n, 6, q) as an array."""
        return self.columns.array() if isinstance(self.columns, Columns) else self.columns

    def checked(self, name: str) -> JointCovariance:
        """Return it as a side of `PoseNoise`: of one set of poses, finite, positive semidefinite."""
        if self.own.ndim != 3 or len(self.columns.shape) != 3:
            raise InputError(f"Expected the covariance `{name}` to be that of one set of poses, got {self.shape}.")
        if not np.isfinite(second_moment(self.columns)).all():
            raise InputError(f"Expected the covariance `{name}` to be finite, got NaN or infinity.")
        return JointCovariance(checked_covariance(self.own, name, joint=False), self.columns, self.keys)

    @property
    def n(self) -> int:
        """Number of poses."""
        return int(self.own.shape[-3])

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array, (..., 6n, 6n)."""
        return (*np.broadcast_shapes(self.own.shape[:-3], self.columns.shape[:-3]), 6 * self.n, 6 * self.n)

    @property
    def ndim(self) -> int:
        return len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    @cached_property
    def flat(self) -> Array:
        """F (..., 6n, q)."""
        shared = self.shared
        return shared.reshape(*shared.shape[:-3], 6 * self.n, shared.shape[-1])

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        dense = np.array(np.broadcast_to(self.flat @ self.flat.mT, self.shape), dtype=dtype)
        blocks = dense.reshape(*dense.shape[:-2], self.n, 6, self.n, 6)
        index = np.arange(self.n)
        blocks[..., index, :, index, :] += np.moveaxis(self.own, -3, 0)
        return dense

    def __matmul__(self, values: Array) -> Array:
        """Times (..., 6n) or (..., 6n, p)."""
        if values.ndim == 1:
            return np.asarray((self @ values[:, None])[..., 0])
        by_pose = self.own @ values.reshape(*values.shape[:-2], self.n, 6, values.shape[-1])
        if isinstance(self.columns, Columns):
            of_all = against(self.columns, values.reshape(self.n, 6, values.shape[-1]))
            return (by_pose + times(self.columns, of_all)).reshape(values.shape)
        found = by_pose.reshape(*by_pose.shape[:-3], *values.shape[-2:]) + self.flat @ (self.flat.mT @ values)
        return np.asarray(found)

    def __rmatmul__(self, values: Array) -> Array:
        """(..., p, 6n) times it."""
        return (self @ values.mT).mT

    def __mul__(self, factor: float) -> JointCovariance:
        return JointCovariance(factor * self.own, scaled(self.columns, float(np.sqrt(factor))), self.keys)

    __rmul__ = __mul__

    def any(self) -> bool:
        """Return whether it is not zero."""
        return bool(self.own.any() or np.diagonal(second_moment(self.columns), axis1=-2, axis2=-1).any())

    @property
    def blocks(self) -> Array:
        """(..., n, 6, 6) the covariance of each pose by itself."""
        return np.asarray(self.own + squares(self.columns))

    def rows(self, index: Index) -> JointCovariance:
        """Return the joint covariance of some of the poses."""
        F = self.columns
        own = self.own[..., index, :, :]
        if not isinstance(F, Columns):
            return JointCovariance(own, F[..., index, :, :], self.keys)
        return JointCovariance(own, F.rows(index) if len(own) <= MANY_POSES else F.kept(index), self.keys)

    def some(self, of: Sequence[int] | NDArray[np.intp]) -> Array | Columns:
        """Return some of the columns (..., n, 6, k), by their numbers in ascending order."""
        F = self.columns
        return F.some(np.asarray(of, dtype=np.intp)) if isinstance(F, Columns) else F[..., list(of)]

    def carried(self, D: Array) -> JointCovariance:
        """Return the covariance of ``D_i xi_i``, D (..., n, 6, 6)."""
        F = self.columns
        return JointCovariance(D @ self.own @ D.mT, F.carried(D) if isinstance(F, Columns) else D @ F, self.keys)

    def weighted(self, scale: Array) -> JointCovariance:
        """Return the covariance with each pose's own part times ``scale`` (..., n), and the shared part as it is.

        Scaling the whole of each block would make an error that all poses share look like one that averages out.
        """
        return JointCovariance(scale[..., None, None] * self.own, self.columns, self.keys)

    def plus(self, other: Array | JointCovariance) -> JointCovariance:
        """Add independent errors of each pose (..., n, 6, 6), or another joint covariance."""
        if isinstance(other, JointCovariance):
            F = side_by_side([self.columns, other.columns])
            return JointCovariance(self.own + other.own, F, self.keys + other.keys)
        return JointCovariance(self.own + other, self.columns, self.keys)

    def to_dict(self) -> JsonObject:
        """Plain numbers, for files; `from_dict` reads them."""
        of = [None if key is None else key.to_dict() for key in self.keys]
        named: JsonObject = {"keys": list(of)} if any(of) else {}
        same = self.own.ndim == 3 and (self.own == self.own[:1]).all()  # one block serves all poses
        own = self.own[0] if same else self.own
        return {"own": own.tolist(), "shared": self.shared.tolist(), **named}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> JointCovariance:
        """Read what `to_dict` wrote; KeyError for parts that are missing."""
        own = np.asarray(values["own"], dtype=float)
        shared = np.asarray(values["shared"], dtype=float)
        if own.shape == (6, 6):
            own = np.tile(own, (len(shared), 1, 1))
        shared = shared.reshape(*own.shape[:-1], -1)
        return cls(
            own, shared, tuple(None if key is None else ErrorKey.from_dict(key) for key in values.get("keys", ()))
        )

    @cached_property
    def factor(self) -> JointFactor:
        """L with ``Sigma = L L^T``; raises `SingularNoiseError` where a block of ``own`` is singular."""
        return JointFactor.of(self.own, self.columns)


def joint_of(S: Array | JointCovariance | None) -> JointCovariance | None:
    """Return a covariance that is kept as what it is made of; None for any other, and for none."""
    return S if isinstance(S, JointCovariance) else None


def joint_form(S: Array | JointCovariance | None, n: int) -> JointCovariance:
    """Return the covariance of n poses as blocks of each and columns that they share.

    ``S``: None (exact), one (6, 6), (n, 6, 6), a joint covariance, or full (6n, 6n): that by its eigenvectors, with
    equal blocks of the smallest eigenvalue.
    """
    if isinstance(S, JointCovariance):
        return S
    own = np.zeros((6, 6)) if S is None else np.asarray(S, dtype=float)
    if own.shape[-2:] == (6, 6):
        return JointCovariance(np.broadcast_to(own, (n, 6, 6)), np.zeros((n, 6, 0)))
    values, vectors = np.linalg.eigh(own)
    least = max(float(values[0]), 0.0)
    columns = vectors * np.sqrt(np.maximum(values - least, 0.0))
    return JointCovariance(np.tile(least * np.eye(6), (n, 1, 1)), columns.reshape(n, 6, 6 * n))


@dataclass(frozen=True, eq=False)
class JointFactor:
    """``L^-1 = (I - V K V^T) B^-1`` of a `JointCovariance`; L is square, not triangular.

    V is the shared part over B and C the Cholesky factor of ``I + V^T V``. With ``K = (C (I + C)^T)^-1`` and
    ``M = I - V K V^T``, ``M^T M = I - V (C C^T)^-1 V^T = (I + V V^T)^-1``.
    """

    B: Array  # (..., n, k, k)
    V: Array | Columns  # (..., n, k, q)
    C: Array  # (..., q, q)
    K: Array  # (..., q, q)

    @classmethod
    def of(cls, own: Array, shared: Array | Columns) -> JointFactor:
        """L with ``L L^T`` the covariance by blocks (..., n, k, k) and columns (..., n, k, q).

        Raises `SingularNoiseError` where a block is singular.
        """
        B = checked_cholesky(own)
        V = (
            shared.carried(np.asarray(np.linalg.inv(B), dtype=float))
            if isinstance(shared, Columns)
            else substitute(B, shared)
        )
        one = np.eye(V.shape[-1])
        C = np.asarray(np.linalg.cholesky(one + second_moment(V)), dtype=float)
        return cls(B, V, C, np.linalg.inv(C @ (one + C).mT))

    def _reflected(self, values: Array, K: Array) -> Array:
        """``(I - V K V^T)`` times (..., n, k, p), which are overwritten where the columns are made in parts."""
        moved = K @ against(self.V, values)
        if not isinstance(self.V, Columns):
            return values - times(self.V, moved)
        for of in parts_of(len(values)):
            values[of] -= self.V.times(moved, of)
        return values

    def whiten(self, values: Array) -> Array:
        """``L^-1 values`` (..., n, k, p)."""
        return self._reflected(np.asarray(substitute(self.B, values)), self.K)

    def pull(self, white: Array) -> Array:
        """``L^-T white`` (..., n, k, p)."""
        values = white.copy() if isinstance(self.V, Columns) else white
        return substitute_transposed(self.B, self._reflected(values, self.K.mT))

    def log_determinant(self) -> Array:
        """(...) ``log|Sigma|``: of the blocks, and of what is shared ``log|C C^T|``."""
        own = 2.0 * np.log(np.diagonal(self.B, axis1=-2, axis2=-1)).sum(axis=(-2, -1))
        return np.asarray(own + 2.0 * np.log(np.diagonal(self.C, axis1=-2, axis2=-1)).sum(axis=-1))

    def inverse_blocks(self) -> Array:
        """(..., n, 6, 6) diagonal blocks of ``Sigma^-1 = B^-T (I - V (C C^T)^-1 V^T) B^-1``."""
        half, root = (np.asarray(np.linalg.inv(M), dtype=float) for M in (self.B, self.C.mT))
        if not isinstance(self.V, Columns):
            left = half.mT @ times(self.V, root)
            return np.asarray(half.mT @ half - left @ left.mT)
        return np.asarray(half.mT @ half - squares(self.V.carried(half.mT), root))
