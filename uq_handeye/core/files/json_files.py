"""Writing of JSON files in a form that people can read, and reading them back.

Result files carry a checksum of their values, so that a file edited by hand is refused in place of being believed.
Layout and order of the names may change.
"""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Any

from ...errors import InputError
from ..limits import MAX_TABLE_BYTES
from .atomic import write_atomically
from .open import StrPath, as_path, opened, shown
from .packed import packed

# Parts of a result file with arrays for this program; X, its covariance and the table of poses are lists of numbers.
COMPACT_PARTS = ("noise", "posterior", "analysis", "shared", "data", "corrected", "rig")
# Name of the checksum in a result file, and the hash function that makes it.
CHECKSUM, HASH = "checksum", "sha256"
# Name of the result in the folder that ``calibrate -o`` writes.
RESULT_NAME = "result.json"


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


def result_file(path: Path) -> Path:
    """Return the file of a result: of a folder that ``calibrate -o`` wrote the one in it, else the path itself."""
    return path / RESULT_NAME if (path / RESULT_NAME).is_file() else path


def parsed(path: StrPath) -> Any:
    """Return what the JSON of a file, or of a folder with a result, holds.

    Raises `InputError` where it is no JSON, or larger than a result can be.
    """
    if str(path).lstrip()[:1] in ("{", "["):
        raise InputError("Expected the path of a JSON file, got JSON text: from_dict(json.loads(text)) takes it.")
    with opened(result_file(as_path(path)), MAX_TABLE_BYTES) as file:
        text = file.read()
    try:
        return json.loads(text.decode("utf-8"), parse_constant=_refuse, parse_float=_finite)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{shown(as_path(path))} is not JSON: {error}.") from error


def signed_text(data: dict[str, Any], path: StrPath | None = None) -> str:
    """Return the JSON text of a result with its checksum, as `json_text`; also write it to ``path``.

    Arrays of `COMPACT_PARTS` are in the compact form of `files.packed`.
    """
    data = {name: packed(part) if name in COMPACT_PARTS else part for name, part in data.items()}
    return json_text(data | {CHECKSUM: _checksum(data)}, path)


def require_signed(data: dict[str, Any]) -> None:
    """Raise `InputError` where the values of a result file are not those that its checksum is of."""
    if data.get(CHECKSUM) != _checksum(data):
        raise InputError(
            "The file was changed after it was written: its checksum does not fit. Calibrate again, or restore the "
            "file. Notes are changed by uq-handeye update RESULT --about KEY=VALUE -o DIR."
        )


def _checksum(data: dict[str, Any]) -> str:
    """Return the checksum of all values but the checksum itself."""
    values = {name: value for name, value in data.items() if name != CHECKSUM}
    text = json.dumps(values, allow_nan=False, sort_keys=True, separators=(",", ":"))
    return f"{HASH}:{hashlib.new(HASH, text.encode()).hexdigest()}"


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"it holds {text:.40}, beyond any number")
    return number


def _refuse(constant: str) -> None:
    raise ValueError(f"it holds {constant}")
