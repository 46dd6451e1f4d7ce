"""The derived matrices against the ones printed in the paper."""

import re
import runpy
from pathlib import Path

import pytest
from sympy import Matrix, Symbol, sqrt

from uq_handeye.symbolic.matrices import FORMS

PRINTED = runpy.run_path(str(Path(__file__).with_name("paper_matrices.py")))["PRINTED"]
# (matrix, row, column), counted from one: (derived, printed)
ERRATA = {("J_34", 3, 3): ("-e43 - z43", "-e43 - z23")}


def linear(text):
    """Sum of signed symbols, as printed in the paper."""
    compact = text.replace(" ", "")
    terms = re.findall(r"([+-]?)([A-Za-z]\w*)", compact)
    assert "".join(sign + name for sign, name in terms) == compact
    return sum((-1 if sign == "-" else 1) * Symbol(name) for sign, name in terms)


def printed(name):
    return Matrix([[linear(entry) for entry in row.split(",")] for row in PRINTED[name].strip().splitlines()])


def derived(name):
    """The derived matrix in the symbols of the paper; P_i, Q_i without their factor 1/sqrt(2)."""
    letters = [Symbol(letter) for letter in "abcdpqrs"]
    if name[0] in "PQ":
        names = {Symbol(f"s{k + 1}"): letter / sqrt(2) for k, letter in enumerate(letters)}
        return (sqrt(2) * FORMS[name].derive().subs(names, simultaneous=True)).expand()
    quaternion = letters[4:] if name == "R_R" else letters[:4]
    names = {Symbol(f"q{k}"): letter for k, letter in enumerate(quaternion)}
    return FORMS[name].derive().subs(names, simultaneous=True)


def test_table_is_complete():
    sixteen = {f"J_{j}{k}" for j in range(1, 5) for k in range(1, 5)}
    assert set(PRINTED) == {"R_L", "R_R", "K", *(f"{x}_{i}" for x in "PQ" for i in range(1, 5)), *sixteen}


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PRINTED))
def test_against_the_paper(name):
    """Every printed entry agrees, except the errata listed above."""
    ours, theirs = derived(name), printed(name)
    assert ours.shape == theirs.shape
    differences = {
        (name, i + 1, j + 1): (ours[i, j], theirs[i, j])
        for i in range(ours.rows)
        for j in range(ours.cols)
        if ours[i, j] != theirs[i, j]
    }
    errata = {at: tuple(map(linear, pair)) for at, pair in ERRATA.items() if at[0] == name}
    assert differences == errata
