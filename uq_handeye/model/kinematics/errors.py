r"""The numbers e by which an arm differs from its nominal kinematics, and the functions of the joints among them.

    T(q; e) = O_1 E_1 M_1(q'_1)  O_2 E_2 M_2(q'_2)  ..  O_L E_L M_L(q'_L)  O_tip,      E_k = (exp [a_k]x, l_k)
    q'_k = q_k + s1_k sin q_k + c1_k cos q_k + s2_k sin 2q_k + c2_k cos 2q_k + kappa_k g_k(q)

a_k and l_k are in the frame of joint k whose z is its axis. Groups, in this order, joint by joint within each:

| group | revolute | prismatic | unit |
|---|---|---|---|
| joint offsets | a_z | - | rad |
| joint tilts | a_x, a_y | a_x, a_y, a_z | rad |
| link lengths | l_x, l_y, l_z | l_x, l_y, l_z | m |
| transmission | s1, c1, s2, c2 | - | rad |
| sag | kappa | kappa | rad; m |

*Gauge* (K2). A constant factor left of T is in W (eye-in-hand) or X (eye-to-hand), and so are all six geometric errors
of the first joint. A constant factor on the right is in the other of the two: of the last joint the motions that
commute with it, rotate about and shift along its axis (revolute), rotate about it and all shifts (prismatic).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.checks import as_numbers
from ...core.geometry.se3 import Array
from ...errors import InputError
from ..errors.key import ErrorKey, Kind
from ..errors.keys import ARM
from .joint import Joint

OFFSETS, TILTS, LENGTHS, TRANSMISSION, SAG = GROUPS = tuple(key.kind for key in ARM)
HARMONICS = ("sin q", "cos q", "sin 2q", "cos 2q")


class MoreDeviations(TypedDict, total=False):
    """Standard deviations that `Kinematics.covariance` takes by name."""

    offset_sd: float | str | None
    tilt_sd: float | str | None
    transmission_sd: float | str
    sag_sd: float | str


def checked_sd(value: Any, name: str, parse: Callable[[Any, str], float]) -> Any:
    """A standard deviation, or an array of them, finite and not negative."""
    sd = as_numbers(value, name) if np.ndim(value) else parse(value, f"`{name}`")
    if not np.all((np.asarray(sd) >= 0) & np.isfinite(sd)):
        raise InputError(f"Expected `{name}` to be finite and >= 0, got {value!r:.80}.")
    return sd


class ErrorParameter(NamedTuple):
    """One number of e: its key, name of its joint, unit (rad or m), and whether X and W absorb it (``gauge``)."""

    key: ErrorKey
    joint: str
    unit: str
    gauge: bool

    @property
    def name(self) -> str:
        """The number in words."""
        return str(self.key)

    @property
    def group(self) -> Kind:
        """The error that it is a number of."""
        return self.key.kind


class ErrorLayout(NamedTuple):
    """Places of the numbers of e: columns, joints and components of rotations, shifts, harmonics and sag."""

    parameters: tuple[ErrorParameter, ...]
    joint: NDArray[np.int64]  # (m,)
    part: NDArray[np.int64]  # (m,) component x, y, z, or number of the harmonic
    turns: NDArray[np.int64]  # columns of offsets and tilts
    shifts: NDArray[np.int64]
    harmonics: NDArray[np.int64]
    sags: NDArray[np.int64]

    def spread(self, e: Array, columns: NDArray[np.int64], parts: int) -> Array:
        """(..., L, parts) the numbers of these columns, 0 where there is none."""
        found = np.zeros((*e.shape[:-1], int(self.joint.max()) + 1, parts))
        found[..., self.joint[columns], self.part[columns]] = e[..., columns]
        return found


def error_layout(joints: Sequence[Joint]) -> ErrorLayout:
    """The layout for a chain of these joints."""
    parameters, index, part = [], [], []
    for error in ARM:
        group = error.kind
        for k, joint in enumerate(joints):
            for number, suffix, unit in _of_joint(group, joint):
                gauge = group in (OFFSETS, TILTS, LENGTHS) and (
                    k == 0 or (k == len(joints) - 1 and _commutes(group, number, joint))
                )
                parameters.append(ErrorParameter(error.number(f"{joint.name}{suffix}"), joint.name, unit, gauge))
                index.append(k)
                part.append(number)
    groups = np.array([parameter.group for parameter in parameters])
    return ErrorLayout(
        tuple(parameters),
        np.array(index),
        np.array(part),
        np.flatnonzero((groups == OFFSETS) | (groups == TILTS)),
        np.flatnonzero(groups == LENGTHS),
        np.flatnonzero(groups == TRANSMISSION),
        np.flatnonzero(groups == SAG),
    )


def _of_joint(group: Kind, joint: Joint) -> list[tuple[int, str, str]]:
    """Number, suffix of the name and unit of the parameters of a group that a joint has."""
    if group == OFFSETS:
        return [(2, "", "rad")] if joint.is_revolute else []
    if group == TILTS:
        return [(i, f" {axis}", "rad") for i, axis in enumerate("xy" if joint.is_revolute else "xyz")]
    if group == LENGTHS:
        return [(i, f" {axis}", "m") for i, axis in enumerate("xyz")]
    if group == TRANSMISSION:
        return [(i, f" {name}", "rad") for i, name in enumerate(HARMONICS)] if joint.is_revolute else []
    return [(0, "", joint.unit)]


def _commutes(group: Kind, number: int, joint: Joint) -> bool:
    """Return whether a geometric error commutes with the motion of the joint."""
    return number == 2 or (group == LENGTHS and not joint.is_revolute)


def harmonics(q: Array) -> Array:
    """(..., 4) sin q, cos q, sin 2q, cos 2q."""
    sine, cosine = np.sin(q), np.cos(q)
    return np.stack([sine, cosine, 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine], axis=-1)


def harmonic_rates(q: Array) -> Array:
    """(..., 4) derivatives of `harmonics` by q."""
    sine, cosine = np.sin(q), np.cos(q)
    return np.stack([cosine, -sine, 2.0 - 4.0 * sine * sine, -4.0 * sine * cosine], axis=-1)
