"""Derived matrices on disk, as JSON prefix trees. Nothing read from a file is evaluated.

Folder: `$UQ_HANDEYE_CACHE/symbolic`, else `$XDG_CACHE_HOME/uq-handeye/symbolic`, else
`~/.cache/uq-handeye/symbolic`. One file per matrix, so the folder cannot grow. An entry is used only if its
key (derivation sources and SymPy version), shape and symbols fit; anything else is derived again and
replaced. No fault of the disk or of a file can make a derivation fail.

A tree is an integer, the name of a symbol, or a list: ["/", p, q], ["+", trees..], ["*", trees..],
["^", tree, integer].
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import tempfile
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import sympy
from sympy import Add, Expr, Integer, Mul, Pow, Rational, Symbol

from .elimination import Derived, derive
from .matrices import ClosedForm

SCHEMA = 1
MAX_ENTRY_BYTES = 4_000_000  # bytes; the largest entry of the registry has about 50 kB
MAX_POWER = 8
# every module whose text can change what an entry holds
SOURCES = (
    "octonion.py",
    "polynomials.py",
    "procrustes.py",
    "so4.py",
    "limit.py",
    "derivatives.py",
    "matrices.py",
    "elimination.py",
)


class ForeignEntry(ValueError):
    """A cache file that is not the wanted entry: another key, another shape, or not an entry at all."""


@cache
def source_key() -> str:
    """Digest of SymPy's version and of the derivation sources, the same for all entries."""
    digest = hashlib.sha256(f"{SCHEMA} {sympy.__version__}".encode())
    for name in SOURCES:
        # line endings differ between checkouts, the derivation does not
        text = (files(__package__) / name).read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"\0{name}\0{len(text)}\0".encode() + text)
    return digest.hexdigest()


def directory() -> Path | None:
    """Folder of the entries, or None if the platform has no place for it."""
    if root := os.environ.get("UQ_HANDEYE_CACHE"):
        return Path(root) / "symbolic"
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if not base.is_absolute():  # unset, empty or, by the XDG specification, to be ignored
        try:
            base = Path.home() / ".cache"
        except RuntimeError:
            return None
    return base / "uq-handeye" / "symbolic"


def derived(form: ClosedForm, build: Callable[[ClosedForm], Derived] = derive) -> Derived:
    """The derived matrix: from the cache if its entry fits, else from `build`, which then fills the cache."""
    folder = directory()
    if folder is None:
        return build(form)
    path = folder / f"{form.name}.json"
    with contextlib.suppress(OSError, ValueError, RecursionError):
        return _decode(_read(path), form)
    value = build(form)
    with contextlib.suppress(OSError):
        _write(path, json.dumps(_encode(value, form), separators=(",", ":")))
    return value


# Files ------------------------------------------------------------------------------------------------------


def _read(path: Path) -> Any:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_ENTRY_BYTES:
        raise ForeignEntry(f"{path.name} is not a file of at most {MAX_ENTRY_BYTES} bytes")
    with path.open("rb") as stream:
        return json.loads(stream.read(MAX_ENTRY_BYTES))  # bounded although the file may have grown since


def _write(path: Path, text: str) -> None:
    """Write a temporary file, then rename it: a reader sees the old entry or the new one, never a part."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="ascii") as stream:
            stream.write(text)
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


# Entries ----------------------------------------------------------------------------------------------------


def _encode(value: Derived, form: ClosedForm) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "key": source_key(),
        "name": form.name,
        "shape": list(form.shape),
        "entries": [_to_tree(expression) for expression in value.entries],
        "temporaries": [[symbol.name, _to_tree(expression)] for symbol, expression in value.temporaries],
        "reduced": [_to_tree(expression) for expression in value.reduced],
    }


def _decode(entry: Any, form: ClosedForm) -> Derived:
    if not isinstance(entry, dict):
        raise ForeignEntry("not an entry")
    expected = {"schema": SCHEMA, "key": source_key(), "name": form.name, "shape": list(form.shape)}
    if any(entry.get(field) != value for field, value in expected.items()):
        raise ForeignEntry("another key, name or shape")
    lists: list[Any] = [entry.get(field) for field in ("entries", "temporaries", "reduced")]
    if not all(isinstance(value, list) for value in lists) or {len(lists[0]), len(lists[2])} != {form.size}:
        raise ForeignEntry("wrong number of entries")

    symbols = {symbol.name: symbol for symbol in form.symbols}
    entries = tuple(_from_tree(tree, symbols) for tree in lists[0])
    temporaries = []
    for number, pair in enumerate(lists[1]):
        if not (isinstance(pair, list) and len(pair) == 2 and pair[0] == f"x{number}"):
            raise ForeignEntry("temporaries are x0, x1, .. in order")
        symbol = Symbol(pair[0])
        temporaries.append((symbol, _from_tree(pair[1], symbols)))
        symbols[symbol.name] = symbol  # from here on, not before its definition
    reduced = tuple(_from_tree(tree, symbols) for tree in lists[2])
    return Derived(entries, tuple(temporaries), reduced)


def _to_tree(expression: Expr) -> Any:
    if expression.is_Symbol:
        return expression.name
    if expression.is_Integer:
        return int(expression)
    if expression.is_Rational:
        return ["/", int(expression.p), int(expression.q)]
    if expression.is_Add:
        return ["+", *(_to_tree(argument) for argument in expression.args)]
    if expression.is_Mul:
        return ["*", *(_to_tree(argument) for argument in expression.args)]
    if expression.is_Pow and expression.exp.is_Integer:
        return ["^", _to_tree(expression.base), int(expression.exp)]
    raise TypeError(f"not a polynomial in its symbols and their reciprocals: {expression}")


def _from_tree(tree: Any, symbols: dict[str, Symbol]) -> Expr:
    if isinstance(tree, str):
        if tree not in symbols:
            raise ForeignEntry(f"unknown symbol {tree!r}")
        return symbols[tree]
    if _is_integer(tree):
        return Integer(tree)
    match tree:
        case ["/", p, q] if _is_integer(p) and _is_integer(q) and q > 0:
            return Rational(p, q)
        case ["+", *rest] if len(rest) > 1:
            return Add(*(_from_tree(argument, symbols) for argument in rest))
        case ["*", *rest] if len(rest) > 1:
            return Mul(*(_from_tree(argument, symbols) for argument in rest))
        case ["^", base, power] if _is_integer(power) and 0 < abs(power) <= MAX_POWER:
            expression = _from_tree(base, symbols)
            if not expression.is_number:  # powers of numbers would let a small file ask for a huge result
                return Pow(expression, Integer(power))
    raise ForeignEntry("not an expression")


def _is_integer(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)
