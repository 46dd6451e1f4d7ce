"""Noise files in TOML: the covariances of the robot's and the camera's poses, or of their motions.

    # covariance of xi = (theta, tau): left rotation in rad, additive translation in m
    [robot]                      # or [A] and [B]: noise on the relative motions
    rotation = "0.02deg"         # standard deviations per axis; numbers without unit are rad and m
    translation = "0.05mm"
    [camera]
    covariance = [[...], ...]    # 6 x 6, or n x 6 x 6: one per pose; [robot] and [camera] also 6n x 6n: joint

A table that is left out means that the quantity is exact. Frames as in `models`. The table [shared]
holds errors that all poses share and is read by `uq_handeye.model.shared_errors.shared_toml`; where it is the only
table, the noise is to be estimated.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.files.open import StrPath, as_path, shown
from ...core.files.tree_values import is_list, is_map
from ...core.files.trees import parse_toml
from ...core.formatting.units import parse_deviations
from ...core.geometry.checks import checked_covariance
from ...core.geometry.se3 import Array
from ...errors import InputError
from .models import PairNoise, PoseNoise

POSES, MOTIONS = ("robot", "camera"), ("A", "B")
SHARED = "shared"
KEYS = ("rotation", "translation", "covariance")
EXPECTED = "expected rotation and translation, or covariance"


def read_noise_file(path: StrPath) -> PoseNoise | PairNoise | None:
    """The noise model in a TOML file: `PoseNoise` from [robot], [camera]; `PairNoise` from [A], [B].

    None for a file with [shared] only, which `read_shared_errors` reads: the noise is then to be estimated.

    Raises
    ------
    InputError
        One line that names the file and the key: a file that cannot be read or is not TOML, unknown tables
        or keys, [robot] or [camera] together with [A] or [B], standard deviations without unit or below zero,
        covariances of the wrong shape, not finite, not symmetric or not positive semidefinite.
    """
    path = as_path(path)
    tables = parse_toml(path)
    name, expected = shown(path), "the tables [robot] and [camera], or [A] and [B]"
    if tables.pop(SHARED, None) is not None and not tables:
        return None
    for table in tables:
        if table not in (*POSES, *MOTIONS):
            raise InputError(f"{name}: unknown table {table!a}; expected {expected}.")
    if not tables:
        raise InputError(f"{name}: no noise given; expected {expected}.")
    on_poses = [table for table in tables if table in POSES]
    if on_poses and len(on_poses) < len(tables):
        raise InputError(
            f"{name}: noise on poses ([robot], [camera]) and on motions ([A], [B]) cannot be mixed; "
            f"got {', '.join(f'[{table}]' for table in tables)}."
        )
    covariances = {table: _covariance(table, content, name) for table, content in tables.items()}
    if on_poses:
        return PoseNoise(covariances.get("robot"), covariances.get("camera"))
    return PairNoise(covariances.get("A"), covariances.get("B"))


def _covariance(table: str, content: Any, name: str) -> Array:
    """The covariance that one table describes."""
    where = f"{name}, [{table}]"
    if not is_map(content):
        raise InputError(f"{where}: this must be a table; {EXPECTED}, got {_short(content)}.")
    for key in content:
        if key not in KEYS:
            raise InputError(f"{where}: unknown key {key!a}; {EXPECTED}.")
    try:
        if "covariance" in content:
            if len(content) > 1:
                raise InputError("Expected either covariance, or rotation and translation, got both.")
            _require_numbers(content["covariance"], "covariance to hold numbers (rad^2, rad m, m^2)")
            return checked_covariance(content["covariance"], table, joint=table in POSES)
        for key in ("rotation", "translation"):
            if key not in content:
                raise InputError(f"The key {key} is missing; {EXPECTED}.")
            if not isinstance(content[key], str):
                _require_numbers(content[key], f"{key} to be text with a unit, or a number")
        rotation, translation = parse_deviations((content["rotation"], content["translation"]), f"[{table}]")
    except InputError as error:
        raise InputError(f"{where}: {' '.join(str(error).split())}") from error
    return np.diag([rotation**2] * 3 + [translation**2] * 3)


def _require_numbers(value: Any, what: str) -> None:
    """Raise for what NumPy would quietly turn into numbers, text and booleans, and for what is none of a float."""
    if is_list(value):
        for item in value:
            _require_numbers(item, what)
    elif isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"Expected {what}, got {_short(value)}.")
    elif 1e308 < abs(value) < np.inf:
        raise InputError("Expected numbers below 1e308, got a larger one.")


def _short(value: Any) -> str:
    return f"{value!a:.40}"
