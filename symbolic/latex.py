"""The matrices of the registry as a LaTeX document: shared subexpressions, then the matrix or its entries."""

from __future__ import annotations

import re
import textwrap

from sympy import Expr
from sympy.printing.latex import LatexPrinter

from .elimination import Derived
from .language import CODE_WIDTH, CONVENTIONS, STEM, Form, banner, shape_of
from .matrices import ClosedForm

MAX_ROW_CHARACTERS = 72  # characters of an entry row, without commands, that fit the page
MAX_TERMS_PER_LINE = 8  # terms on a line
PRINTER = LatexPrinter({"fold_short_frac": False})
PREAMBLE = r"""\documentclass[10pt]{article}
\usepackage[margin=20mm]{geometry}
\usepackage{amsmath}
\setcounter{MaxMatrixCols}{32}
\allowdisplaybreaks
\begin{document}
"""


def latex_files(forms: list[Form], version: str) -> dict[str, str]:
    """File name -> text of the document."""
    head = banner("%", version, [CONVENTIONS])
    sections = [_section(form, derived) for form, derived in forms]
    return {f"{STEM}.tex": "\n".join([head, PREAMBLE, *sections, "\\end{document}\n"])}


def _section(form: ClosedForm, derived: Derived) -> str:
    rows = [f"{form.meaning}.", f"Source: {form.equation}."]
    rows += [f"{a.name} ({shape_of(a.shape)}): {a.meaning}." for a in form.arguments]
    text = "\n\n".join("\n".join(textwrap.wrap(_escaped(row), CODE_WIDTH)) for row in rows)
    return "\n".join([f"\\subsection*{{\\texttt{{{_escaped(form.name)}}}}}", text, _display(form, derived)])


def _display(form: ClosedForm, derived: Derived) -> str:
    """The matrix as it is if it fits the page, else by its shared subexpressions, else entry by entry."""
    name = _name(form.name)
    if _fits(form, derived.entries):
        return _equation(name, _matrix(form, derived.entries))
    lines = [f"{PRINTER.doprint(symbol)} &= {_sum(value)}" for symbol, value in derived.temporaries]
    shared = "\\begin{align*}\n" + " \\\\\n".join(lines) + "\n\\end{align*}\n" if lines else ""
    if _fits(form, derived.reduced):
        return shared + _equation(name, _matrix(form, derived.reduced))
    entries = []
    for number, value in enumerate(derived.reduced):
        if value != 0:
            i, k = divmod(number, form.shape[1] if len(form.shape) == 2 else 1)
            place = f"{i + 1},{k + 1}" if len(form.shape) == 2 else f"{i + 1}"
            entries.append(f"\\bigl[{name}\\bigr]_{{{place}}} &= {_sum(value)}")
    listed = "\\begin{align*}\n" + " \\\\\n".join(entries) + "\n\\end{align*}\n"
    return shared + listed + ("All other entries are 0.\n" if 0 in derived.reduced else "")


def _equation(name: str, matrix: str) -> str:
    return f"\\begin{{equation*}}\n{name} = {matrix}\n\\end{{equation*}}\n"


def _rows(form: ClosedForm, values: tuple[Expr, ...]) -> list[list[str]]:
    columns = form.shape[1] if len(form.shape) == 2 else 1
    texts = [PRINTER.doprint(value) for value in values]
    return [texts[i : i + columns] for i in range(0, len(texts), columns)]


def _fits(form: ClosedForm, values: tuple[Expr, ...]) -> bool:
    rows = _rows(form, values)
    widths = [max(len(re.sub(r"\\[a-z]+|[{}_^ ]", "", row[k])) for row in rows) for k in range(len(rows[0]))]
    return sum(widths) + 2 * len(widths) <= MAX_ROW_CHARACTERS


def _matrix(form: ClosedForm, values: tuple[Expr, ...]) -> str:
    rows = " \\\\\n".join(" & ".join(row) for row in _rows(form, values))
    return f"\\begin{{pmatrix}}\n{rows}\n\\end{{pmatrix}}"


def _sum(value: Expr) -> str:
    """A sum over several lines if it is long."""
    parts = re.split(r" (?=[+-] )", PRINTER.doprint(value))
    lines = [" ".join(parts[i : i + MAX_TERMS_PER_LINE]) for i in range(0, len(parts), MAX_TERMS_PER_LINE)]
    return " \\\\\n&\\quad ".join(lines)


def _name(name: str) -> str:
    """J_11 as a symbol with an index, dF11_db as a derivative."""
    if found := re.fullmatch(r"d(\w+)_d(\w+)", name):
        top = re.sub(r"(\d+)", r"_{\1}", found[1])
        below = {"xi": r"\xi"}.get(found[2], found[2])
        # vec of a matrix, by columns; vectors have small letters
        top = top if top[0].islower() or top.endswith("q") else rf"\operatorname{{vec}} {top}"
        return rf"\frac{{\partial {top}}}{{\partial {below}}}"
    symbol, _, index = name.partition("_")
    if name == "sigma_to_R":
        return r"R(\sigma)"
    index = index if len(index) < 3 else rf"\mathrm{{{index}}}"
    return f"{symbol}_{{{index}}}" if index else re.sub(r"(\d+)", r"_{\1}", symbol)


def _escaped(text: str) -> str:
    """Plain text, which has `_`, `^` and other characters that LaTeX reads as commands."""
    table = {"_": r"\_", "^": r"\^{}", "&": r"\&", "%": r"\%", "#": r"\#", "{": r"\{", "}": r"\}", "~": r"\~{}"}
    table |= {"<": r"$<$", ">": r"$>$", "|": r"$|$", "$": r"\$", "\\": r"\textbackslash{}", '"': "''"}
    return "".join(table.get(character, character) for character in text)
