r"""Columns of errors that many poses share, made from their factors some rows at a time.

The columns F (n, 6, q) of the errors that 100,000 poses share take some 0.8 GB, and a fit works with them at the poses,
carried to the residuals, in units of each pose's noise and in halves. `Columns` holds what they are made of, once,

    F_i = L_i [D_i K_i M, ..],        K_i = [G_i, c_i (x) E_i, ..]

G (n, 6, k) arrays, products of coordinates c (n, a) with blocks E (n, 6, b) (`Products`), M a scale of each column or a
matrix, D and L (n, 6, 6) derivatives; and makes the rows that are asked for. Sums over all rows are those of parts.
Fewer poses than `MANY_POSES` have arrays, which the functions here take as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import accumulate
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array

# Of more poses than this the columns are made some rows at a time.
MANY_POSES = 2_000

Rows: TypeAlias = slice | NDArray[np.intp] | NDArray[np.bool_]


class Products(NamedTuple):
    """(n, 6, a b) products of coordinates (n, a) with blocks (n, 6, b)."""

    coordinates: Array
    blocks: Array

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.coordinates.shape[-1] * self.blocks.shape[-1])

    def rows(self, of: Rows = slice(None)) -> Array:
        """Return the columns of some rows."""
        products = np.einsum("nj,nik->nijk", self.coordinates[of], self.blocks[of])
        return np.asarray(products.reshape(len(products), 6, -1))

    def times(self, M: Array, of: Rows) -> Array:
        """Return some rows times M (a b, p)."""
        c, E = self.coordinates[of], self.blocks[of]
        by_block = c @ M.reshape(c.shape[1], -1)
        return np.asarray(E @ by_block.reshape(len(c), E.shape[2], -1))

    def against(self, values: Array, of: Rows) -> Array:
        """Return ``F^T values`` (a b, p) of some rows."""
        c, E = self.coordinates[of], self.blocks[of]
        by_block = E.mT @ values
        return np.asarray((c.T @ by_block.reshape(len(c), -1)).reshape(self.width, -1))


Factor: TypeAlias = Array | Products


def count_of(factor: Factor) -> int:
    """Return the number of columns of a factor."""
    return factor.width if isinstance(factor, Products) else int(factor.shape[-1])


def rows_of_factor(factor: Factor, of: Rows) -> Factor:
    """Return a factor at some of the poses."""
    return Products(factor.coordinates[of], factor.blocks[of]) if isinstance(factor, Products) else factor[of]


def some_rows(columns: Factor | Columns, of: Rows) -> Array:
    """Return some rows of columns (n, 6, k) as an array."""
    return np.asarray(columns[of]) if isinstance(columns, np.ndarray) else columns.rows(of)


class Part(NamedTuple):
    """``D [factors] M``: columns of one side, side by side."""

    factors: tuple[Factor, ...]
    M: Array  # (k,) scales, or (k, r)
    D: Array | None = None  # (n, 6, 6)

    def rows(self, of: Rows) -> Array:
        """Return the columns of some rows."""
        each = [some_rows(factor, of) for factor in self.factors]
        found = each[0] if len(each) == 1 else np.concatenate(each, axis=-1)
        found = (
            found * self.M
            if self.M.ndim == 1
            else (found.reshape(-1, len(self.M)) @ self.M).reshape(*found.shape[:2], self.M.shape[1])
        )
        return np.asarray(found if self.D is None else self.D[of] @ found)

    @property
    def ends(self) -> list[int]:
        """Places where the columns of each factor begin, and the last ends."""
        return [0, *accumulate(map(count_of, self.factors))]

    def times(self, M: Array, of: Rows) -> Array:
        """Return some rows times M (r, p), without making them."""
        inner = self.M[:, None] * M if self.M.ndim == 1 else self.M @ M
        found: Array | float = 0.0
        for factor, a, b in zip(self.factors, self.ends, self.ends[1:], strict=False):
            if isinstance(factor, Products):
                found = found + factor.times(inner[a:b], of)
            else:
                rows = factor[of]
                found = found + (rows.reshape(-1, b - a) @ inner[a:b]).reshape(len(rows), 6, -1)
        return np.asarray(found if self.D is None else self.D[of] @ found)

    def against(self, values: Array, of: Rows) -> Array:
        """Return ``F^T values`` (r, p) of some rows, without making them."""
        u, found = values if self.D is None else self.D[of].mT @ values, list[Array]()
        for factor in self.factors:
            if isinstance(factor, Products):
                found.append(factor.against(u, of))
            else:
                found.append(factor[of].reshape(-1, factor.shape[-1]).T @ u.reshape(-1, u.shape[-1]))
        each = np.concatenate(found)
        return np.asarray(self.M[:, None] * each if self.M.ndim == 1 else self.M.T @ each)


@dataclass(frozen=True, eq=False)
class Columns:
    """(n, 6, q) columns that n poses share; see the module."""

    n: int
    parts: tuple[Part, ...]
    left: Array | None = None  # (n, 6, 6) L

    @classmethod
    def of(cls, factors: Sequence[Factor], M: Array | None = None) -> Columns:
        """Return the columns of factors side by side, of scales (k,) or turned by M (k, r)."""
        first = factors[0]
        n = len(first.coordinates if isinstance(first, Products) else first)
        return cls(n, (Part(tuple(factors), np.ones(sum(map(count_of, factors))) if M is None else M),))

    @property
    def count(self) -> int:
        """Number of columns q."""
        return sum(part.M.shape[-1] for part in self.parts)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the array."""
        return self.n, 6, self.count

    def rows(self, of: Rows) -> Array:
        """Return the columns of some rows as an array."""
        each = [part.rows(of) for part in self.parts]
        found = each[0] if len(each) == 1 else np.concatenate(each, axis=-1)
        return found if self.left is None else np.asarray(self.left[of] @ found)

    def times(self, M: Array, of: Rows) -> Array:
        """Return some rows times M (q, p), without making them."""
        found: Array | float = 0.0
        start = 0
        for part in self.parts:
            found = found + part.times(M[start : start + part.M.shape[-1]], of)
            start += part.M.shape[-1]
        return np.asarray(found if self.left is None else self.left[of] @ found)

    def against(self, values: Array, of: Rows) -> Array:
        """Return ``F^T values`` (q, p) of some rows, without making them."""
        u = values if self.left is None else self.left[of].mT @ values
        return np.concatenate([part.against(u, of) for part in self.parts])

    def array(self) -> Array:
        """Return all columns as one array."""
        found = np.empty(self.shape)
        for of in parts_of(self.n):
            found[of] = self.rows(of)
        return found

    def kept(self, of: Rows) -> Columns:
        """Return the columns at some of the poses."""
        parts = tuple(
            Part(tuple(rows_of_factor(factor, of) for factor in factors), M, None if D is None else D[of])
            for factors, M, D in self.parts
        )
        return Columns(len(np.arange(self.n)[of]), parts, None if self.left is None else self.left[of])

    def carried(self, D: Array) -> Columns:
        """Return ``D F``, D (n, 6, 6)."""
        if self.left is None and all(part.D is None for part in self.parts):
            return replace(self, parts=tuple(part._replace(D=D) for part in self.parts))
        return replace(self, left=D if self.left is None else np.asarray(D @ self.left))

    def beside(self, other: Columns) -> Columns:
        """Return these columns and others of the same poses side by side."""
        assert self.left is None and other.left is None  # sides come together before what serves both
        return Columns(self.n, self.parts + other.parts)

    def scaled(self, scale: Array | float) -> Columns:
        """Return each column times its scale (q,), or all of them times one."""
        ends = [0, *accumulate(part.M.shape[-1] for part in self.parts)]
        of = np.broadcast_to(np.asarray(scale, dtype=float), self.count)
        parts = (part._replace(M=part.M * of[a:b]) for part, a, b in zip(self.parts, ends, ends[1:], strict=False))
        return replace(self, parts=tuple(parts))

    def turned(self, M: Array) -> Columns:
        """Return ``F M`` for M (q, r), of columns that are not carried yet."""
        assert self.left is None and all(part.D is None and part.M.ndim == 1 for part in self.parts)
        factors = tuple(factor for part in self.parts for factor in part.factors)
        return Columns.of(factors, np.concatenate([part.M for part in self.parts])[:, None] * M)

    def some(self, of: NDArray[np.intp]) -> Columns:
        """Return some of the columns, by their numbers in ascending order."""
        parts, start = list[Part](), 0
        for factors, M, D in self.parts:
            chosen = of[(of >= start) & (of < start + M.shape[-1])] - start
            start += M.shape[-1]
            if M.ndim == 2:
                parts += [Part(factors, M[:, chosen], D)] if len(chosen) else []
                continue
            at = 0
            for factor in factors:
                k = count_of(factor)
                inside = chosen[(chosen >= at) & (chosen < at + k)]
                turn = np.eye(k)[:, inside - at] * M[inside]
                if len(inside):
                    parts.append(Part((factor,), M[at : at + k] if len(inside) == k else turn, D))
                at += k
        return replace(self, parts=tuple(parts))


def parts_of(n: int, together: int = 1000) -> Iterator[slice]:
    """Yield slices of n rows, all of them where they are not `MANY_POSES`."""
    together = n if n <= MANY_POSES else together
    for start in range(0, n, max(together, 1)):
        yield slice(start, start + together)


def as_columns(F: Array | Columns) -> Columns:
    """Return an array (n, 6, q) as columns."""
    return F if isinstance(F, Columns) else Columns.of([F])


def scaled(F: Array | Columns, scale: float) -> Array | Columns:
    """``scale F``."""
    return F.scaled(scale) if isinstance(F, Columns) else scale * F


def turned(F: Array | Columns, M: Array) -> Array | Columns:
    """``F M`` for M (q, r)."""
    return F.turned(M) if isinstance(F, Columns) else F @ M


def side_by_side(found: Sequence[Array | Columns]) -> Array | Columns:
    """Columns of the same poses, an array where all of them are arrays."""
    arrays = [F for F in found if not isinstance(F, Columns)]
    if len(arrays) == len(found):
        return np.concatenate(arrays, axis=-1)
    return reduce(Columns.beside, map(as_columns, found))


def times(F: Array | Columns, M: Array) -> Array:
    """``F M`` (.., n, 6, p) for M (.., q, p), or (.., n, 6) for M (q,)."""
    if not isinstance(F, Columns):
        if M.ndim == 1:
            return np.asarray(F @ M)
        flat = F.reshape(*F.shape[:-3], F.shape[-3] * F.shape[-2], F.shape[-1]) @ M
        return np.asarray(flat.reshape(*flat.shape[:-2], *F.shape[-3:-1], M.shape[-1]))
    matrix = M[:, None] if M.ndim == 1 else M
    found = np.empty((F.n, 6, matrix.shape[1]))
    for of in parts_of(F.n):
        found[of] = F.times(matrix, of)
    return found[..., 0] if M.ndim == 1 else found


def relative_difference(F: Array | Columns, other: Array) -> float:
    """Return the largest difference from an array (n, 6, q), over the largest number of F."""
    off, size = 0.0, 0.0
    for of in parts_of(len(other)):
        each = some_rows(F, of)
        off = max(off, float(np.abs(each - other[of]).max(initial=0.0)))
        size = max(size, float(np.abs(each).max(initial=0.0)))
    return off / size if size > 0 else off


def carried_sum(D: Array, F: Array | Columns) -> Array:
    """``sum_i D_i F_i`` (d, q) for D (n, d, 6)."""
    if not isinstance(F, Columns):
        return np.asarray((D @ F).sum(axis=0))
    found = np.zeros((D.shape[1], F.count))
    for of in parts_of(F.n):
        found += (D[of] @ F.rows(of)).sum(axis=0)
    return found


def against(F: Array | Columns, values: Array) -> Array:
    """``F^T values`` (.., q, p), summed over all rows of values (.., n, 6, p)."""
    if not isinstance(F, Columns):
        flat = F.reshape(*F.shape[:-3], F.shape[-3] * F.shape[-2], F.shape[-1])
        return np.asarray(flat.mT @ values.reshape(*values.shape[:-3], flat.shape[-2], values.shape[-1]))
    found = np.zeros((F.count, values.shape[-1]))
    for of in parts_of(F.n):
        found += F.against(values[of], of)
    return found


def squares(F: Array | Columns, M: Array | None = None) -> Array:
    """``F_i M M^T F_i^T`` (.., n, 6, 6) of each row; M (q, r), None: the identity."""
    if not isinstance(F, Columns):
        F = F if M is None else F @ M
        return np.asarray(F @ F.mT)
    found = np.empty((F.n, 6, 6))
    for of in parts_of(F.n):
        each = F.rows(of) if M is None else F.rows(of) @ M
        found[of] = each @ each.mT
    return found


def second_moment(F: Array | Columns) -> Array:
    """``F^T F`` (.., q, q), summed over all rows."""
    if not isinstance(F, Columns):
        flat = F.reshape(*F.shape[:-3], F.shape[-3] * F.shape[-2], F.shape[-1])
        return np.asarray(flat.mT @ flat)
    found = np.zeros((F.count, F.count))
    for of in parts_of(F.n):
        flat = F.rows(of).reshape(-1, F.count)
        found += flat.T @ flat
    return found
