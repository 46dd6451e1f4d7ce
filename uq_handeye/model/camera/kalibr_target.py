"""Kalibr's file of a calibration target, ``target.yaml``: an aprilgrid or a chessboard.

Kalibr documents it on its page of calibration targets: ``target_type``, ``tagCols``, ``tagRows``, ``tagSize`` (m, with
the black border), ``tagSpacing`` (gap over ``tagSize``); of a checkerboard ``targetCols``, ``targetRows`` (inner
corners), ``rowSpacingMeters`` and ``colSpacingMeters``.
"""

from __future__ import annotations

from ...core.files.json_values import JsonObject
from ...core.files.one_line import short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.tree_values import is_map, number
from ...core.files.trees import parse_tree
from ...core.limits import MAX_DESCRIPTION_BYTES
from ...errors import InputError
from .description import Board

EXAMPLE = "target_type: aprilgrid, tagCols, tagRows, tagSize and tagSpacing, or target_type: checkerboard"


def read_target(path: StrPath) -> Board:
    """Return the board of a ``target.yaml`` of Kalibr; raises `InputError` for other files."""
    location = as_path(path)
    name = shown(location)
    with opened(location, MAX_DESCRIPTION_BYTES) as file:
        tree = parse_tree(file.read(), name)
    if not is_map(tree):
        raise InputError(f"{name}: expected a target of Kalibr, {EXAMPLE}, got no such names.")
    kind = str(tree.get("target_type", "")).lower()
    if kind == "aprilgrid":
        columns, rows = (_count(tree, key, name) for key in ("tagCols", "tagRows"))
        first = _count(tree, "startId", name) if "startId" in tree else None
        spacing = _number(tree, "tagSpacing", name)
        return Board(columns, rows, _number(tree, "tagSize", name), "aprilgrid", spacing=spacing, first_id=first)
    if kind == "checkerboard":
        columns, rows = (_count(tree, key, name) for key in ("targetCols", "targetRows"))
        x, y = _number(tree, "colSpacingMeters", name), _number(tree, "rowSpacingMeters", name)
        if x != y:
            raise InputError(f"{name}: expected squares, got colSpacingMeters {x:g} and rowSpacingMeters {y:g}.")
        return Board(columns, rows, x)
    raise InputError(f"{name}: expected a target of Kalibr, {EXAMPLE}, got target_type {short(kind) or 'none'}.")


def _number(tree: JsonObject, key: str, name: str) -> float:
    if key not in tree:
        raise InputError(f"{name}: expected {key} of a {tree['target_type']}, got none.")
    return number(tree[key], f"{name}, {key}")


def _count(tree: JsonObject, key: str, name: str) -> int:
    value = _number(tree, key, name)
    if value != int(value):
        raise InputError(f"{name}, {key}: expected a whole number, got {value:g}.")
    return int(value)
