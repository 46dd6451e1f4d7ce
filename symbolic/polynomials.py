"""Matrices over a polynomial ring Q[symbols]: a normal form, and far faster than `expand`."""

from __future__ import annotations

from collections.abc import Iterable

from sympy import QQ, Matrix, Symbol
from sympy.polys.matrices import DomainMatrix


def symbols_of(*matrices: Matrix) -> list[Symbol]:
    """All symbols of the matrices, sorted by name, so that every run orders a ring in the same way."""
    return sorted(set().union(*(matrix.free_symbols for matrix in matrices)), key=lambda symbol: symbol.name)


def over_ring(matrix: Matrix, symbols: Iterable[Symbol]) -> DomainMatrix:
    """The matrix with entries in Q[symbols]; equal polynomials have equal representations."""
    return DomainMatrix.from_Matrix(Matrix(matrix)).convert_to(QQ[tuple(symbols)]).to_dense()


def identical(left: Matrix, right: Matrix) -> bool:
    """True if the two matrices of polynomials are equal for every value of their symbols."""
    symbols = symbols_of(left, right)
    if not symbols:
        return Matrix(left) == Matrix(right)
    return over_ring(left, symbols) == over_ring(right, symbols)
