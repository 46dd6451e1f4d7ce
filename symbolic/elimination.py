"""Derive a registered matrix and share its common subexpressions: the input of every printer."""

from __future__ import annotations

from typing import NamedTuple

from sympy import Expr, Symbol, cse, numbered_symbols

from .matrices import ClosedForm


class Derived(NamedTuple):
    """A derived matrix, row by row, as it is (`entries`) and after elimination.

    Evaluating `temporaries` in order and then `reduced` gives the same values as `entries`.
    """

    entries: tuple[Expr, ...]
    temporaries: tuple[tuple[Symbol, Expr], ...]
    reduced: tuple[Expr, ...]


def derive(form: ClosedForm) -> Derived:
    """Derive the matrix from first principles (no cache) and eliminate its common subexpressions."""
    matrix = form.derive()
    rows, columns = (*form.shape, 1)[:2]
    if matrix.shape != (rows, columns):
        raise ValueError(f"{form.name}: registered with shape {form.shape}, derived with {matrix.shape}")
    if not matrix.free_symbols <= form.symbols:
        raise ValueError(f"{form.name}: unregistered symbols {matrix.free_symbols - form.symbols}")
    entries = tuple(matrix)
    temporaries, reduced = cse(entries, symbols=numbered_symbols("x"), order="canonical")
    return Derived(entries, tuple(temporaries), tuple(reduced))
