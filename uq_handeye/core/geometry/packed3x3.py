"""Algebra of many 3x3 matrices at once, on arrays that hold the pairs last: (T, entries, m) for trials T and pairs m.

NumPy is fastest on long rows, so that each entry of the matrices is one row over the pairs. A symmetric 3x3 matrix is
packed as ``(xx, yy, zz, yz, xz, xy)``. The functions of `se3` for matrices (..., 3, 3) have their counterparts here in
that layout: cross matrices, exponentials and Jacobians of rotation vectors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..rounding import SOLUTION_ROUNDING, TINY
from .se3 import Array

# Determinant over that of the isotropic matrix of equal trace below which LAPACK inverts: cofactors cancel there.
MIN_RELATIVE_DETERMINANT = 1e-7

EYE = np.eye(3)
# Arrays and `take`, which is several times faster than a list between brackets.
_ROWS, _COLUMNS = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])  # of the packed entries
_PACK, _PACK_TRANSPOSED = np.array([0, 4, 8, 5, 2, 1]), np.array([0, 4, 8, 7, 6, 3])
_UNPACK = np.array([0, 5, 4, 5, 1, 3, 4, 3, 2])
_COFACTOR = np.array([[1, 2, 0, 4, 5, 3], [2, 0, 1, 5, 3, 4], [3, 4, 5, 0, 1, 2], [3, 4, 5, 3, 4, 5]])
# [v]x, row by row, is _CROSS v; the sum of a x b is minus the entries of sum a b^T times _CROSS.
_CROSS = np.cross(np.eye(3)[None], np.eye(3)[:, None]).reshape(9, 3) + 0.0


def _information_of_moments() -> Array:
    """The (9, 36) matrix from packed ``sum a a^T (x) W`` to ``sum [a]x^T W [a]x``.

    With it the sum over pairs is one product of matrices, instead of two products of 3x3 matrices for every pair.
    """
    basis = _CROSS.reshape(3, 3, 3)  # [e_k]x = basis[:, :, k]
    W = np.zeros((6, 3, 3))
    W[range(6), _ROWS, _COLUMNS] = W[range(6), _COLUMNS, _ROWS] = 1.0
    by_pair = np.einsum("jil,njk,kmp->lpnim", basis, W, basis)
    twice = [by_pair[i, j] + (by_pair[j, i] if i != j else 0.0) for i, j in zip(_ROWS, _COLUMNS, strict=True)]
    return np.stack(twice).reshape(36, 9).T


_INFORMATION = _information_of_moments()


# ----------------------------------------------------------------------------------------------------- rotation vectors


def _of_axis(scalar: Array, axial: Array | float, outer: Array, v: Array) -> Array:
    """``scalar I + axial [v]x + outer v v^T``: vectors (..., 3, m) and factors (..., m) -> (..., 3, 3, m)."""
    factor = axial if isinstance(axial, float) else axial[..., None, :]
    result = (_CROSS @ (factor * v)).reshape(*v.shape[:-2], 3, 3, v.shape[-1])
    result += (outer[..., None, :] * v)[..., :, None, :] * v[..., None, :, :]
    for i in range(3):
        result[..., i, i, :] += scalar
    return np.asarray(result)


def inverse_jacobian(v: Array, squares: Array) -> Array:
    """``J_l(v)^-1 = I - [v]x / 2 + c [v]x^2``, ``c = (1 - (a/2) cot(a/2)) / a^2``; (..., 3, m) -> (..., 3, 3, m)."""
    half = 0.5 * np.sqrt(squares)
    large = half > 0.25
    safe = np.where(large, half, 1.0)
    c = 0.25 * (1.0 - safe / np.tan(safe)) / (safe * safe)
    if not large.all():  # Bernoulli numbers; the closed form cancels
        s = squares
        series = 1 / 12 + s * (1 / 720 + s * (1 / 30240 + s * (1 / 1209600 + s / 47900160)))
        c = np.where(large, c, series)
    return _of_axis(1.0 - c * squares, -0.5, c, v)


def rotation(v: Array) -> Array:
    """``exp([v]x)``: (..., 3, m) -> (..., 3, 3, m)."""
    squares = np.einsum("...im,...im->...m", v, v)
    sinc, first = _sinc(squares)
    return _of_axis(1.0 - first * squares, sinc, first, v)


def _sinc(squares: Array) -> tuple[Array, Array]:
    """``sin(a) / a`` and ``(1 - cos a) / a^2`` of ``a^2``."""
    half = 0.5 * np.sqrt(squares + TINY)  # no 0 / 0
    sine = np.sin(half) / half
    return np.cos(half) * sine, 0.5 * sine * sine


def exponential(v: Array) -> tuple[Array, Array]:
    """``exp([v]x)`` and ``J_l(v)``: (..., 3, m) -> (..., 3, 3, m) each."""
    squares = np.einsum("...im,...im->...m", v, v)
    sinc, first = _sinc(squares)
    large = squares > 0.25
    second = (1.0 - sinc) / np.where(large, squares, 1.0)  # (a - sin a) / a^3
    if not large.all():
        s = squares
        second = np.where(large, second, 1 / 6 - s / 120 * (1 - s / 42 * (1 - s / 72 * (1 - s / 110))))
    return _of_axis(1.0 - first * squares, sinc, first, v), _of_axis(sinc, first, second, v)


# -------------------------------------------------------------------------------------------- packed symmetric matrices


def unpack(S: Array) -> Array:
    """(T, 6, m) -> (T, 3, 3, m)."""
    return S.take(_UNPACK, axis=1).reshape(len(S), 3, 3, -1)


def pack(S: Array) -> Array:
    """(T, 3, 3, m), symmetric -> (T, 6, m)."""
    return S.reshape(len(S), 9, -1).take(_PACK, axis=1)


def carried(R: Array, S: Array) -> Array:
    """Packed ``R S R^T`` (T, 6, m) of S (T, 3, 3, m)."""
    by_entry = R.take(_ROWS, axis=1)[:, :, :, None] * R.take(_COLUMNS, axis=1)[:, :, None, :]
    return np.asarray(by_entry.reshape(len(R), 6, 9) @ S.reshape(len(S), 9, -1))


class NotDefinite(Exception):
    """`packed_inverse`'s word that a matrix is not positive definite, with its eigenvalues (3)."""

    def __init__(self, eigenvalues: Array) -> None:
        super().__init__(f"eigenvalues {eigenvalues.tolist()}")
        self.eigenvalues = eigenvalues


def packed_inverse(S: Array, indefinite_raises: bool) -> tuple[Array, NDArray[np.bool_] | None]:
    """Inverses of packed symmetric matrices (T, 6, m), and which trials (T,) hold one that is not positive definite.

    By cofactors where these are accurate. The second is None if all are positive definite. Raises `NotDefinite` for the
    first that is not, or inverts it all the same.
    """
    i, j, k, m = _COFACTOR
    inverse = S.take(i, axis=1)
    inverse *= S.take(j, axis=1)
    subtracted = S.take(k, axis=1)
    subtracted *= S.take(m, axis=1)
    inverse -= subtracted
    # cofactors (xx, yy, zz, yz, xz, xy): det = xx C_xx + xy C_xy + xz C_xz
    determinant = S[:, 0] * inverse[:, 0] + S[:, 5] * inverse[:, 5] + S[:, 4] * inverse[:, 4]
    third = (S[:, 0] + S[:, 1] + S[:, 2]) / 3.0
    bad: NDArray[np.bool_] | None = None
    if (determinant > MIN_RELATIVE_DETERMINANT * third * third * third).all():
        inverse /= determinant[:, None]
    else:
        full = np.moveaxis(unpack(S), 3, 1)
        values, vectors = np.linalg.eigh(full)
        regular = values[..., 0] > SOLUTION_ROUNDING * values[..., 2]
        if not regular.all():
            if indefinite_raises:
                raise NotDefinite(values[~regular][0])
            bad = np.asarray(~regular.all(axis=-1))
        W = (vectors / values[..., None, :]) @ vectors.mT
        inverse = W.reshape(*W.shape[:2], 9)[..., _PACK].swapaxes(1, 2)
    return inverse, bad


# ----------------------------------------------------------------------------------------- products and sums over pairs


def times(M: Array, v: Array) -> Array:
    """``M v`` per pair: (T, 3, 3, m), (T, 3, m) -> (T, 3, m)."""
    return np.asarray(np.einsum("tijm,tjm->tim", M, v))


def product(M: Array, N: Array) -> Array:
    """``M N`` per pair, (T, 3, 3, m)."""
    return np.asarray(np.einsum("tijm,tjkm->tikm", M, N))


def product_transposed(M: Array, N: Array) -> Array:
    """``M N^T`` per pair, (T, 3, 3, m)."""
    return np.asarray(np.einsum("tijm,tkjm->tikm", M, N))


def cross(v: Array) -> Array:
    """``[v]x`` per pair: (T, 3, m) -> (T, 3, 3, m)."""
    return np.asarray((_CROSS @ v).reshape(len(v), 3, 3, -1))


def plus_symmetric(S: Array, M: Array) -> Array:
    """``S + M + M^T`` per pair, packed: S (T, 6, m), M (T, 3, 3, m) -> (T, 6, m)."""
    entries = M.reshape(len(M), 9, -1)
    return np.asarray(S + entries.take(_PACK, axis=1) + entries.take(_PACK_TRANSPOSED, axis=1))


def sum_of_crosses(a: Array, b: Array) -> Array:
    """``sum a x b`` over the pairs: (T, 3, m) -> (T, 3)."""
    return np.asarray(-((a @ b.mT).reshape(-1, 9) @ _CROSS))


def sum_of_informations(a: Array, W: Array) -> Array:
    """``sum [a]x^T W [a]x`` over the pairs: (T, 3, m), W packed (T, 6, m) -> (T, 3, 3)."""
    moments = (a.take(_ROWS, axis=1) * a.take(_COLUMNS, axis=1)) @ W.mT
    return np.asarray((moments.reshape(-1, 36) @ _INFORMATION.T).reshape(-1, 3, 3))
