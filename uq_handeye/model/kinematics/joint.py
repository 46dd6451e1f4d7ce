"""The joints of a serial chain as a file describes them, and the check of joint values against their limits.

Joint values far outside the limits are refused, with a hint at the unit that they may be in.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.files.json_values import JsonObject
from ...core.files.records import array_of, plain
from ...core.files.tree_values import is_list, is_map
from ...core.geometry.checks import as_numbers, as_transforms
from ...core.geometry.se3 import Array
from ...core.limits import MAX_NAME_CHARACTERS
from ...core.presentation.units import ANGLE_UNITS, LENGTH_UNITS
from ...core.read_only import ReadOnlyArrays
from ...core.rounding import CHAIN_ROUNDING, PRODUCT_ROUNDING
from ...errors import InputError, InputWarning

REVOLUTE, PRISMATIC = "revolute", "prismatic"
MAX_JOINTS = 64
# Longest origin of a joint; a longer one is in millimetres, or damaged.
MAX_ORIGIN_M = 100.0
# Distance (rad, m) beyond a limit that a real joint may have by its zero and its reading, with a warning.
LIMIT_TOLERANCE = {REVOLUTE: np.deg2rad(3.0), PRISMATIC: 0.01}
# Largest value (rad, m) of a joint without limits whose unit was not given.
MAX_VALUE_WITHOUT_UNIT = {REVOLUTE: 4 * np.pi, PRISMATIC: 20.0}
DEGREE, MILLIMETRE = ANGLE_UNITS["deg"], LENGTH_UNITS["mm"]


@dataclass(frozen=True, eq=False)
class Joint(ReadOnlyArrays):
    """A revolute or prismatic joint; one that rotates without end is revolute without limits.

    Parameters
    ----------
    name : str
    kind : "revolute" or "prismatic"
    origin : (4, 4) m
        O_k, the frame of this joint before it moves, in the frame of the previous joint after that has moved (in the
        base for the first joint).
    axis : (3,)
        Direction of the axis in the frame of the joint; made a unit vector.
    lower, upper : float
        Limits (rad; m for a prismatic joint); -inf and inf where there are none.
    """

    name: str
    kind: str
    origin: Array
    axis: Array
    lower: float = -np.inf
    upper: float = np.inf

    def __post_init__(self) -> None:
        require_name(self.name, "the name of a joint")
        if self.kind not in (REVOLUTE, PRISMATIC):
            raise InputError(f"Expected the kind of joint {self.name} to be revolute or prismatic, got {self.kind!r}.")
        axis = as_numbers(self.axis, f"the axis of joint {self.name}")
        if axis.shape != (3,) or not np.isfinite(axis).all():
            raise InputError(
                f"Expected the axis of joint {self.name} to be 3 finite numbers, got {axis.tolist()!r:.80}."
            )
        largest = float(np.abs(axis).max())
        if not 1e-9 < largest < 1e9:
            raise InputError(f"Expected the axis of joint {self.name} to be a direction, got {axis.tolist()}.")
        if abs(np.linalg.norm(axis) - 1.0) > PRODUCT_ROUNDING:
            axis = axis / largest / np.linalg.norm(axis / largest)
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "origin", checked_origin(self.origin, f"the origin of joint {self.name}"))
        lower, upper = (float(as_numbers(limit, f"a limit of joint {self.name}")) for limit in (self.lower, self.upper))
        if not lower < upper:  # NaN neither
            raise InputError(f"Expected the lower limit of joint {self.name} below the upper, got {lower} and {upper}.")
        object.__setattr__(self, "lower", lower)
        object.__setattr__(self, "upper", upper)
        super().__post_init__()

    @property
    def is_revolute(self) -> bool:
        return self.kind == REVOLUTE

    @property
    def unit(self) -> str:
        """The unit of its values, rad or m."""
        return "rad" if self.is_revolute else "m"


class ChainParts(NamedTuple):
    """Findings of a reader: the arguments of `Kinematics`."""

    name: str
    base: str
    tip: str
    joints: tuple[Joint, ...]
    end: Array  # (4, 4) the tip in the frame of the last joint after it has moved
    up: Array | None = None  # (3,) direction against gravity in the base, where it is said


def require_name(name: str, what: str) -> None:
    """Raise `InputError` unless it is a printable text of reasonable length."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable() or len(name) > MAX_NAME_CHARACTERS:
        raise InputError(
            f"Expected {what} to be text of 1 to {MAX_NAME_CHARACTERS} printable characters, got {name!a:.80}."
        )


def checked_origin(value: ArrayLike, what: str) -> Array:
    """A (4, 4) transform whose translation may be that of a robot in metres."""
    T = as_transforms(value, what, stack=False)
    if T.shape != (4, 4):
        raise InputError(f"Expected {what} to have shape (4, 4), got {T.shape}.")
    if (longest := float(np.abs(T[:3, 3]).max())) > MAX_ORIGIN_M:
        raise InputError(f"Expected {what} to be below {MAX_ORIGIN_M:g} m, got {longest:g} m; is it in millimetres?")
    return T


_OF_CHAIN = ("name", "base", "tip", "end", "up")
_OF_JOINT = ("name", "kind", "origin", "axis", "lower", "upper")


def parts_to_dict(parts: ChainParts) -> JsonObject:
    """Plain text and numbers, for files; None is an infinite limit."""
    joints = [plain({name: getattr(joint, name) for name in _OF_JOINT}) for joint in parts.joints]
    return {**plain({name: getattr(parts, name) for name in _OF_CHAIN}), "joints": joints}


def parts_from_dict(data: Any) -> ChainParts:
    """Return what `parts_to_dict` wrote; raise `InputError` for anything else."""
    what = "the kinematics"
    parts = _fields(data, (*_OF_CHAIN, "joints"), what)
    if not is_list(parts["joints"]):
        raise InputError(f"Expected the joints of {what} to be a list.")
    joints = []
    for k, value in enumerate(parts["joints"][: MAX_JOINTS + 1]):
        at = f"joint {k} of {what}"
        of_joint = _fields(value, _OF_JOINT, at)
        lower, upper = (
            infinite if of_joint[name] is None else float(array_of(of_joint[name], (), f"a limit of {at}"))
            for name, infinite in (("lower", -np.inf), ("upper", np.inf))
        )
        origin, axis = array_of(of_joint["origin"], (4, 4), at), array_of(of_joint["axis"], (3,), at)
        joints.append(Joint(of_joint["name"], of_joint["kind"], origin, axis, lower, upper))
    end, up = array_of(parts["end"], (4, 4), what), array_of(parts["up"], (3,), what)
    return ChainParts(parts["name"], parts["base"], parts["tip"], tuple(joints), end, up)


def _fields(data: Any, names: tuple[str, ...], what: str) -> dict[str, Any]:
    if not is_map(data) or any(name not in data for name in names):
        raise InputError(f"Expected {what} to have the fields {', '.join(names)}.")
    return data


def require_within_limits(
    q: Array,
    names: Sequence[str],
    kinds: Sequence[str],
    limits: Array | None,
    with_unit: NDArray[np.bool_],
    at: Callable[[int], str],
    remedy: str = "Give --joint-units {unit}.",
) -> None:
    """Refuse values (n, L) far outside the limits (L, 2), naming a unit that would fit; warn of those a little outside.

    ``with_unit`` (L,): the unit was given; ``at`` names a row, ``remedy`` what to do where another unit would fit.
    """
    usual = np.array([(-MAX_VALUE_WITHOUT_UNIT[kind], MAX_VALUE_WITHOUT_UNIT[kind]) for kind in kinds])
    limits = np.full((len(kinds), 2), [-np.inf, np.inf]) if limits is None else limits
    checked = np.where(np.isfinite(limits) | with_unit[:, None], limits, usual)
    near = np.array([LIMIT_TOLERANCE[kind] for kind in kinds])
    beyond = np.maximum(checked[:, 0] - q, q - checked[:, 1])
    if (beyond > near).any():
        row, k = (int(i) for i in np.argwhere(beyond > near)[0])
        revolute = kinds[k] == REVOLUTE
        same = np.array([kind == kinds[k] for kind in kinds])
        smaller = DEGREE if revolute else MILLIMETRE
        other, flag = None, None
        large = np.abs(q).max(axis=0) > (2 * np.pi if revolute else 0.0)  # no angle in radians is
        if _inside(q * smaller, checked, near, same) and not with_unit[k] and large[same].any():
            other, flag = ("degrees", "deg") if revolute else ("millimetres", "mm")
        elif _inside(q / smaller, checked, near, same) and with_unit[k]:
            other, flag = ("radians", "rad") if revolute else ("metres", "m")
        alone = np.arange(len(kinds)) == k
        if revolute and large[k] and large.sum() == 1 and same.sum() > 2 and _inside(q * DEGREE, checked, near, alone):
            hint = f"is its column in degrees and the others in radians? Or all: {remedy.format(unit='deg')}"
        elif other:
            hint = f"in {other}? {remedy.format(unit=flag)}"
        elif _inside(-q, checked, near, alone):
            hint = "has its column the other sign, or is this another arm?"
        else:
            hint = "is this the arm of the URDF? Correct the limits there if the joint may stand so."
        raise InputError(f"{at(row)}, joint {names[k]}: {_outside(q[row, k], checked[k], revolute)}; {hint}")
    if (beyond > CHAIN_ROUNDING).any():
        row, k = (int(i) for i in np.argwhere(beyond > CHAIN_ROUNDING)[0])
        more = int((beyond > CHAIN_ROUNDING).any(axis=1).sum()) - 1
        rows = f" (and {more} more rows)" if more else ""
        text = _outside(q[row, k], checked[k], kinds[k] == REVOLUTE)
        warnings.warn(f"{at(row)}, joint {names[k]}{rows}: {text}.", InputWarning, stacklevel=4)
    turning = np.array([kind == REVOLUTE for kind in kinds]) & with_unit
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
