"""Joint values against the limits of the joints: what is far outside is refused, in the unit that it may be in."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.formatting.units import ANGLE_UNITS, LENGTH_UNITS
from ...core.geometry.se3 import Array
from ...errors import InputError, InputWarning
from .joint import PRISMATIC, REVOLUTE

# Beyond a limit by no more than this (rad, m) is within the zero and the reading of a real joint, and is warned of.
NEAR_LIMIT = {REVOLUTE: np.deg2rad(3.0), PRISMATIC: 0.01}
# Joints without limits stay within this (rad, m), unless somebody says the unit.
USUAL = {REVOLUTE: 4 * np.pi, PRISMATIC: 20.0}
DEGREE, MILLIMETRE = ANGLE_UNITS["deg"], LENGTH_UNITS["mm"]


def require_within_limits(
    q: Array,
    names: Sequence[str],
    kinds: Sequence[str],
    limits: Array | None,
    told: NDArray[np.bool_],
    at: Callable[[int], str],
    remedy: str = "Give --joint-units {unit}.",
) -> None:
    """Refuse values (n, L) far outside the limits (L, 2), naming a unit that would fit; warn of those a little outside.

    ``told`` (L,): the unit was given; ``at`` names a row, ``remedy`` what to do where another unit would fit.
    """
    usual = np.array([(-USUAL[kind], USUAL[kind]) for kind in kinds])
    limits = np.full((len(kinds), 2), [-np.inf, np.inf]) if limits is None else limits
    checked = np.where(np.isfinite(limits) | told[:, None], limits, usual)
    near = np.array([NEAR_LIMIT[kind] for kind in kinds])
    beyond = np.maximum(checked[:, 0] - q, q - checked[:, 1])
    if (beyond > near).any():
        row, k = (int(i) for i in np.argwhere(beyond > near)[0])
        revolute = kinds[k] == REVOLUTE
        same = np.array([kind == kinds[k] for kind in kinds])
        smaller = DEGREE if revolute else MILLIMETRE
        other, flag = None, None
        if _inside(q * smaller, checked, near, same) and not told[k]:
            other, flag = ("degrees", "deg") if revolute else ("millimetres", "mm")
        elif _inside(q / smaller, checked, near, same) and told[k]:
            other, flag = ("radians", "rad") if revolute else ("metres", "m")
        hint = (
            f"in {other}? {remedy.format(unit=flag)}"
            if other
            else "is this the arm of the URDF? Correct the limits there if the joint may stand so."
        )
        raise InputError(f"{at(row)}, joint {names[k]}: {_outside(q[row, k], checked[k], revolute)}; {hint}")
    if (beyond > 1e-9).any():
        row, k = (int(i) for i in np.argwhere(beyond > 1e-9)[0])
        more = int((beyond > 1e-9).any(axis=1).sum()) - 1
        rows = f" (and {more} more rows)" if more else ""
        text = _outside(q[row, k], checked[k], kinds[k] == REVOLUTE)
        warnings.warn(f"{at(row)}, joint {names[k]}{rows}: {text}.", InputWarning, stacklevel=4)
    turning = np.array([kind == REVOLUTE for kind in kinds]) & told
    if len(q) > 2 and turning.any() and 0 < np.abs(q[:, turning]).max() <= 2 * np.pi * DEGREE:
        warnings.warn(
            f"{at(0).rpartition(', ')[0]}: all joints stay within {np.rad2deg(np.abs(q[:, turning]).max()):.2g} deg of "
            "zero. Are the values radians?",
            InputWarning,
            stacklevel=4,
        )


def _inside(q: Array, limits: Array, near: Array, same: NDArray[np.bool_]) -> bool:
    return bool(((q >= limits[:, 0] - near) & (q <= limits[:, 1] + near))[:, same].all())


def _outside(value: float, limits: Array, revolute: bool) -> str:
    lower, upper = limits
    if revolute:
        return (
            f"{value:.4g} rad ({np.rad2deg(value):.4g} deg) is outside {lower:.4g} to {upper:.4g} rad "
            f"({np.rad2deg(lower):.4g} to {np.rad2deg(upper):.4g} deg)"
        )
    return f"{value:.4g} m is outside {lower:.4g} to {upper:.4g} m"
