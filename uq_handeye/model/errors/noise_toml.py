"""Noise files in TOML: the covariances of the robot's and the camera's poses, or of their motions.

    # covariance of xi = (theta, tau): left rotation in rad, additive translation in m
    [robot]                      # or [A] and [B]: noise on the relative motions
    rotation = "0.02deg"         # standard deviations per axis; numbers without unit are rad and m
    translation = "0.05mm"
    [camera]
    covariance = [[...], ...]    # 6 x 6, or n x 6 x 6: one per pose; [robot] and [camera] also 6n x 6n: joint

Beside ``covariance`` of [robot] and [camera] may stand how its numbers are read (`core.geometry.conventions`):

    convention = "gtsam"         # default: "toolkit"
    information = true           # the inverse of a covariance
    of = "inverse"               # of the inverse poses, target_T_camera
    pixel_sd = 0.2               # px, where the numbers are of a pixel noise of 1

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
from ...core.geometry.checks import checked_covariance
from ...core.geometry.conventions import OF_POSE, CovarianceReading
from ...core.geometry.se3 import Array
from ...core.presentation.units import parse_deviations
from ...errors import InputError, require_one_of
from .models import PairNoise, PoseNoise
from .stated_noise import Pairs, StatedNoise

POSES, MOTIONS = ("robot", "camera"), ("A", "B")
SHARED = "shared"
KEYS = ("rotation", "translation", "covariance")
# Keys beside a covariance that say how its numbers are read.
READING = ("convention", "information", "of", "pixel_sd")
EXPECTED = "expected rotation and translation, or covariance"


def read_noise_file(path: StrPath, poses: Pairs | None = None) -> PoseNoise | PairNoise | None:
    """The noise model in a TOML file: `PoseNoise` from [robot], [camera]; `PairNoise` from [A], [B].

    None for a file with [shared] only, which `read_shared_errors` reads: the noise is then to be estimated.
    ``poses``: needed where covariances are in a convention of another library, which depends on the poses.

    Raises
    ------
    InputError
        One line that names the file and the key: a file that cannot be read or is not TOML, unknown tables
        or keys, [robot] or [camera] together with [A] or [B], standard deviations without unit or below zero,
        covariances of the wrong shape, not finite, not symmetric or not positive semidefinite; an unknown convention,
        an information matrix that is singular, ``pixel_sd`` beside a convention that has a factor of its own.
    """
    noise = read_stated_noise(path)
    if not isinstance(noise, StatedNoise):
        return noise
    if poses is None:
        raise InputError(
            f"{shown(as_path(path))}: the convention of a covariance depends on the poses. Give "
            "read_noise_file(path, poses=...)."
        )
    return noise.at(poses)


def read_stated_noise(
    path: StrPath, reading: CovarianceReading | None = None
) -> PoseNoise | PairNoise | StatedNoise | None:
    """Return the noise of a file; as it is stated where it depends on the poses.

    ``reading``: of every covariance of poses, in place of what the file says.
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
    readings = {table: found for table, content in tables.items() if (found := _reading(table, content, name, reading))}
    covariances = {table: _covariance(table, content, name, table in readings) for table, content in tables.items()}
    if readings:
        return StatedNoise(covariances.get("robot"), covariances.get("camera"), readings)
    if on_poses:
        return PoseNoise(covariances.get("robot"), covariances.get("camera"))
    return PairNoise(covariances.get("A"), covariances.get("B"))


def _reading(table: str, content: Any, name: str, instead: CovarianceReading | None) -> CovarianceReading | None:
    """Return how the covariance of a table is read; None: as the toolkit has it."""
    if not is_map(content) or "covariance" not in content or table not in POSES:
        return None
    if instead is not None:
        return instead
    if not (stated := {key: content[key] for key in READING if key in content}):
        return None
    where = f"{name}, [{table}]"
    for key, kind, expected in (
        ("convention", str, "the name of a convention"),
        ("information", bool, "true or false"),
        ("of", str, "pose or inverse"),
        ("pixel_sd", int | float, "a number of pixels"),
    ):
        value = stated.get(key)
        if value is not None and (not isinstance(value, kind) or (key == "pixel_sd" and isinstance(value, bool))):
            raise InputError(f"{where}: expected {key} to be {expected}, got {_short(value)}.")
    try:
        require_one_of("of", stated.get("of", "pose"), OF_POSE)
        return CovarianceReading(
            stated.get("convention", "toolkit"),
            stated.get("of") == "inverse",
            stated.get("information", False),
            stated.get("pixel_sd"),
        )
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _covariance(table: str, content: Any, name: str, is_stated: bool) -> Array:
    """The covariance that one table describes; as numbers that are checked later where its reading is stated."""
    where = f"{name}, [{table}]"
    if not is_map(content):
        raise InputError(f"{where}: this must be a table; {EXPECTED}, got {_short(content)}.")
    for key in content:
        if key in READING and (table not in POSES or "covariance" not in content):
            raise InputError(f"{where}: {key} is for a covariance of [robot] or [camera]. Remove it.")
        if key not in KEYS and key not in READING:
            raise InputError(f"{where}: unknown key {key!a}; {EXPECTED}.")
    try:
        if "covariance" in content:
            if "rotation" in content or "translation" in content:
                raise InputError("Expected either covariance, or rotation and translation, got both.")
            _require_numbers(content["covariance"], "covariance to hold numbers (rad^2, rad m, m^2)")
            if is_stated:
                return _square(content["covariance"], table)
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


def _square(value: Any, table: str) -> Array:
    """Return numbers (6, 6), (n, 6, 6) or (6n, 6n); raise `InputError` for others."""
    try:
        S = np.array(value, dtype=float)
    except ValueError:
        S = np.array(0.0)
    whole = S.ndim == 2 and S.shape[0] == S.shape[1] and S.shape[0] % 6 == 0 and S.size > 0
    if not whole and not (S.ndim == 3 and S.shape[1:] == (6, 6)):
        got = S.shape or "rows of different lengths"
        raise InputError(f"Expected the covariance `{table}` to have shape (6, 6), (n, 6, 6) or (6n, 6n), got {got}.")
    return S


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
