"""Shared errors in TOML: the table ``[shared]`` of a noise file.

[shared]
focal_length = "0.1%"        # relative standard deviation; "none" or "exact" switch an error off
principal_point = "1mrad"    # of each coordinate over the focal length, or "1px" where that is known
target_scale = "0.02%"
robot_scale = "0.01%"
clock_offset = "1ms"
robot_accuracy = "0.5mm,0.05deg"  # of its data sheet: translation and rotation

[[shared.columns]]           # an error of the user's own
name = "thermal drift"
file = "thermal.csv"         # in the folder of this file: .csv, n rows of 6 k numbers; .npy or .npz, (n, 6, k)
sd = 1.0                     # one number, or k
side = "robot"               # or "camera"
unit = "K"                   # may be left out
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...core.files.one_line import one_line, short
from ...core.files.open import StrPath, as_path, opened, shown
from ...core.files.tree_values import is_list, is_map
from ...core.files.trees import parse_toml
from ...core.geometry.se3 import Array
from ...core.limits import MAX_TABLE_BYTES
from ...errors import InputError
from ...formats.numpy_poses import read_one_array
from ..errors.noise_toml import SHARED
from .shared_error import SharedError

KEYS = ("focal_length", "principal_point", "target_scale", "robot_scale", "clock_offset", "robot_accuracy")
OF_COLUMNS = ("name", "file", "sd", "side", "unit")


def read_shared_errors(path: StrPath, *, focal_length_px: float | None = None) -> tuple[SharedError, ...]:
    """The errors in the table ``[shared]`` of a noise file; none if it has no such table.

    ``focal_length_px`` is needed for a principal point in pixels. An error that the file switches off comes with a
    standard deviation of 0.

    Raises
    ------
    InputError
        One line that names the file and the key: a file that cannot be read or is not TOML, unknown keys, standard
        deviations without unit or below zero, columns that do not have the shape (n, 6, k).
    """
    path = as_path(path)
    table = parse_toml(path).get(SHARED, {})
    where = f"{shown(path)}, [{SHARED}]"
    if not is_map(table):
        raise InputError(
            f"{where}: this must be a table; expected {', '.join(KEYS)} or columns, got {short(str(table))}."
        )
    found = []
    for key, value in table.items():
        try:
            if key == "columns":
                found += [_columns(entry, path.parent) for entry in _list(value)]
            elif key not in KEYS:
                raise InputError(f"unknown key {key!a}; expected {', '.join(KEYS)} or columns.")
            elif key == "principal_point":
                found.append(SharedError.principal_point(value, focal_length_px=focal_length_px))
            else:
                found.append(getattr(SharedError, key)(value))
        except InputError as error:
            raise InputError(f"{where}: {' '.join(str(error).split())}") from error
    return tuple(found)


def _list(value: Any) -> list[dict[str, Any]]:
    if not is_list(value) or not all(map(is_map, value)):
        raise InputError(f"columns must be tables [[{SHARED}.columns]], got {short(str(value))}.")
    return value


def _columns(entry: dict[str, Any], folder: Path) -> SharedError:
    for key in entry:
        if key not in OF_COLUMNS:
            raise InputError(f"unknown key {key!a} of columns; expected {', '.join(OF_COLUMNS)}.")
    for key in OF_COLUMNS[:-1]:
        if key not in entry:
            raise InputError(f"The key {key} of columns is missing; expected {', '.join(OF_COLUMNS)}.")
    if not isinstance(entry["file"], str):
        raise InputError(f"Expected file of columns to be text, got {short(str(entry['file']))}.")
    options = {"unit": entry["unit"]} if "unit" in entry else {}
    return SharedError.columns(
        entry["name"], _read_columns(as_path(folder / entry["file"])), entry["sd"], entry["side"], **options
    )


def _read_columns(path: Path) -> Array:
    """(n, 6, k); a row of a CSV file holds (theta, tau) of the first number, then of the second."""
    with opened(path, MAX_TABLE_BYTES) as file:
        data = file.read()
    name = shown(path)
    if data.startswith((b"\x93NUMPY", b"PK")):
        return read_one_array(data, name)
    expected = "expected rows of 6 k numbers with commas, # before comments"
    try:
        text = data.decode("utf-8-sig")
        lines = [line for line in text.splitlines() if line.partition("#")[0].strip()]
        if not lines:
            raise InputError(f"{name}: {expected}, got none.")
        rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    except ValueError as error:
        raise InputError(f"{name}: {expected}: {one_line(str(error)).removesuffix('.')}.") from error
    if rows.shape[1] % 6:
        raise InputError(f"{name}: {expected}, got rows of {rows.shape[1]}.")
    return rows.reshape(len(rows), -1, 6).mT
