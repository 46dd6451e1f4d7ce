"""Known values of X and W as people write them, such as ``target z = 120mm +- 1mm``."""

from __future__ import annotations

import re
from typing import TypedDict

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.units import ANGLE_UNITS, parse_length
from ...errors import InputError

# The pose that a thing is, by the setup-independent names of the text: the camera is X, the target W.
_POSES = {"camera": "prior_X", "target": "prior_W"}
_STATEMENT = re.compile(r"\s*(\w+)\s+(\w+)\s*=\s*(.+?)\s*(?:\+-|\+/-|±)\s*(.+?)\s*")
_ANGLES = ("roll", "pitch", "yaw", "rx", "ry", "rz", "theta")


class Known(TypedDict, total=False):
    """Arguments of `calibrate`, each a pose (4, 4) and a covariance (6, 6)."""

    prior_X: tuple[Array, Array]
    prior_W: tuple[Array, Array]


def parse_known_values(*statements: str) -> Known:
    """Parse what a tape measure or a drawing says, into priors as arguments of `calibrate`.

    Parameters
    ----------
    statements : str
        ``camera x = 35mm +- 0.5mm``: the translation of X along x (y, z) of its parent frame, the gripper for
        eye-in-hand and the base for eye-to-hand. ``target z = 120mm +- 1mm``: that of W, of the target in the base
        frame, or in the gripper frame for eye-to-hand. One standard deviation, above 0, behind +- (or +/-, ±).

    Raises
    ------
    InputError
        Text that is none of these, with what was expected; a component that is given twice.

    Examples
    --------
    >>> from uq_handeye import parse_known_values
    >>> pose, covariance = parse_known_values("target z = 120mm +- 1mm")["prior_W"]
    >>> float(pose[2, 3]), float(covariance[5, 5])
    (0.12, 1e-06)
    """
    if not statements:
        raise InputError("Expected what is known, such as 'target z = 120mm +- 1mm', got nothing.")
    found: Known = {}
    for text in statements:
        name, axis, value, deviation = _parse(text)
        pose, covariance = found.setdefault(name, (np.eye(4), np.diag(np.full(6, np.inf))))  # type: ignore[misc]
        if np.isfinite(covariance[3 + axis, 3 + axis]):
            raise InputError(f"Expected each component once, got {text!r} beside another value of the same.")
        pose[axis, 3], covariance[3 + axis, 3 + axis] = value, deviation**2
    return found


def _parse(text: str) -> tuple[str, int, float, float]:
    """Argument, axis, value and standard deviation (m)."""
    example = "such as 'target z = 120mm +- 1mm'"
    match = _STATEMENT.fullmatch(str(text))
    if match is None:
        raise InputError(f"Expected what is known as 'NAME AXIS = VALUE +- DEVIATION', {example}, got {text!r}.")
    name, axis, value, deviation = match.groups()
    if name not in _POSES:
        raise InputError(f"Expected 'camera' or 'target' in {text!r}, got {name!r}.")
    if axis in _ANGLES or any(value.endswith(unit) for unit in ANGLE_UNITS if unit != "m"):
        raise InputError(
            f"{text!r}: angles cannot be known one by one. Give a pose with its covariance: --prior-x, --prior-w, or "
            "prior_X, prior_W in Python."
        )
    if axis not in ("x", "y", "z"):
        raise InputError(f"Expected x, y or z in {text!r}, got {axis!r}.")
    mean, sd = (
        parse_length(value, f"the value in {text!r}"),
        parse_length(deviation, f"the standard deviation in {text!r}"),
    )
    if sd <= 0:
        raise InputError(f"Expected a standard deviation above 0 in {text!r}, got {deviation!r}.")
    return _POSES[name], "xyz".index(axis), mean, sd
