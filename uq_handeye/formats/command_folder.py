"""A folder that one command wrote with ``-o``: the files it has, its description and its arrays."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ..core.files.one_line import short
from ..core.files.open import StrPath, as_path, opened, shown
from ..core.files.tree_values import fields_of, got
from ..core.files.trees import parse_tree
from ..core.limits import MAX_DESCRIPTION_BYTES, MAX_TABLE_BYTES
from ..errors import InputError
from .numpy_poses import unpacked


def folder_of_command(folder: StrPath, command: str, files: Sequence[str]) -> Path:
    """Return the path of a folder with these files; raises `InputError` for one that is none, or lacks some."""
    path = as_path(folder)
    if not path.is_dir():
        raise InputError(f"Cannot read {shown(path)}: expected the folder of uq-handeye {command} -o, got none.")
    if lacking := [file for file in files if not (path / file).exists()]:
        raise InputError(
            f"{shown(path)} lacks {', '.join(lacking)}: expected the folder that uq-handeye {command} -o wrote; write "
            "it again."
        )
    return path


def description_in(path: Path, format_name: str) -> dict[str, Any]:
    """Return the fields of a description, JSON or YAML; raises `InputError` for another format than is named."""
    with opened(path, MAX_DESCRIPTION_BYTES) as file:
        return fields_of_format(parse_tree(file.read(), shown(path)), format_name, shown(path))


def fields_of_format(tree: Any, format_name: str, where: str) -> dict[str, Any]:
    """Return the fields of a tree; raises `InputError` for another format than is named."""
    fields = fields_of(tree)
    if fields.get("format") != format_name:
        came = short(str(fields["format"])) if "format" in fields else got(tree)
        raise InputError(f"{where}: expected the format {format_name!r}, got {came}.")
    return fields


def arrays_in(path: Path) -> dict[str, NDArray[Any]]:
    """Return the arrays of an archive, by name; raises `InputError` for a damaged one."""
    with opened(path, MAX_TABLE_BYTES) as file:
        return unpacked(file.read(), shown(path))
