"""Fields of dataclasses and named tuples in the reference, from the comments that stand beside them in the source."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
import tokenize
from io import StringIO
from typing import Any

from sphinx.application import Sphinx


def fields_of(cls: type) -> list[tuple[str, str, str]]:
    """Name, type and comment of each field that is no private one, those of the bases in the package first."""
    bases = [base for base in reversed(cls.__mro__) if base.__module__.partition(".")[0] == "uq_handeye"]
    return list({field[0]: field for base in bases for field in _own_fields(base)}.values())


def _own_fields(cls: type) -> list[tuple[str, str, str]]:
    source = textwrap.dedent(inspect.getsource(cls))
    comments = {
        token.start[0]: token.string.lstrip("# ").rstrip()
        for token in tokenize.generate_tokens(StringIO(source).readline)
        if token.type == tokenize.COMMENT
    }
    (body,) = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    return [
        (node.target.id, ast.unparse(node.annotation), comments.get(node.end_lineno or 0, ""))
        for node in body.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and not node.target.id.startswith("_")
    ]


def describe(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Append a section of attributes, unless the docstring has one or says the same as parameters."""
    if what != "class" or not (dataclasses.is_dataclass(obj) or hasattr(obj, "_fields")):
        return
    if {"Parameters", "Attributes"} & set(lines):
        return
    lines += ["", "Attributes", "----------"]
    for field, kind, comment in fields_of(obj):
        lines += [f"{field} : {kind}", *([f"    {comment}"] if comment else [])]
    lines.append("")


def setup(app: Sphinx) -> dict[str, bool]:
    app.setup_extension("sphinx.ext.autodoc")
    app.connect("autodoc-process-docstring", describe, priority=50)  # before the markup is mended and napoleon reads
    return {"parallel_read_safe": True, "parallel_write_safe": True}
