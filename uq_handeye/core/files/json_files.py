"""Writing of JSON files in a form that people can read, and reading them back."""

from __future__ import annotations

import json
from typing import Any

from ...errors import InputError
from ..numbers.limits import MAX_TABLE_BYTES
from .atomic import write_atomically
from .open import StrPath, as_path, opened, shown


def json_text(data: Any, path: StrPath | None = None) -> str:
    """Return ``data`` as JSON text, indented, a list of numbers or texts on one line; also write it to ``path``.

    Raises ValueError for NaN and infinity, which JSON has not.
    """
    text = _indented(data, "\n") + "\n"
    if path is not None:
        write_atomically(path, text)
    return text


def _indented(data: Any, start: str) -> str:
    """JSON text whose lines begin with ``start``."""
    inside = f"{start}  "
    if type(data) is dict and data:
        parts = [f"{json.dumps({name: 0})[1:-4]}: {_indented(part, inside)}" for name, part in data.items()]
        return f"{{{inside}{f',{inside}'.join(parts)}{start}}}"
    if type(data) in (list, tuple) and any(type(part) in (dict, list, tuple) for part in data):
        return f"[{inside}{f',{inside}'.join(_indented(part, inside) for part in data)}{start}]"
    return json.dumps(data, allow_nan=False)


def parsed(path: StrPath) -> Any:
    """Return what the JSON of a file holds; raises `InputError` where it is no JSON, or larger than a result can be."""
    if str(path).lstrip()[:1] in ("{", "["):
        raise InputError("Expected the path of a JSON file, got JSON text: from_dict(json.loads(text)) takes it.")
    with opened(as_path(path), MAX_TABLE_BYTES) as file:
        text = file.read()
    try:
        return json.loads(text.decode("utf-8"), parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{shown(as_path(path))} is not JSON: {error}.") from error


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant}")
