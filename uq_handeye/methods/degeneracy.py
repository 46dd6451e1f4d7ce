"""Motions that do not determine X: the test, the reason, and the directions of X that are not observable.

Model: the rotation of X is that of ``H = sum u v^T = U S V^T`` (u, v from the rotations of A and B, or their rotation
vectors), S with the sign of ``det(U V^T)`` in its last value. ``M = tr(H R^T) I - H R^T`` has the eigenvalues
``(s2 + s3, s1 + s3, s1 + s2)``, ascending, in the basis U. X is determined where M is regular; an eigenvector of an
eigenvalue zero is an axis about which, and along which, X is not observable.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..core.rounding import PRODUCT_ROUNDING
from ..errors import DegenerateMotionError

# Smallest ratio of the eigenvalues of M, the squared spread of the rotation axes in rad^2, that is not rounding of the
# data: axes must differ by 1e-5 rad.
MIN_SPREAD_RATIO = 1e-10
# Total weight 4 sum |u| |v| below which there is no rotation at all (rad^2 per pair).
NO_ROTATION = PRODUCT_ROUNDING


def are_determined(smallest: Array, largest: Array, N: int) -> NDArray[np.bool_]:
    """Return whether M of N pairs is regular, from its smallest and largest eigenvalue (...)."""
    return np.asarray((largest > NO_ROTATION * N) & (smallest > MIN_SPREAD_RATIO * largest))


def raise_undetermined(
    U: Array, s: Array, eigenvalues: Array, N: int, index: tuple[int, ...], half_turns_count: bool
) -> NoReturn:
    """Raise the `DegenerateMotionError` of one problem that says why, and which directions of X stay open.

    Parameters
    ----------
    U, s, eigenvalues : (3, 3), (3,), (3,)
        Of the module.
    N : int
        Number of pairs.
    index : tuple
        Of the problem among several; empty for one alone.
    half_turns_count : bool
        Whether a motion by 180 degrees tells something, up to the sign of its axis.
    """
    start = f"The motions do not determine X{f' (problem {index})' if index else ''}: "
    largest = eigenvalues[2]
    if not largest > NO_ROTATION * N:
        raise DegenerateMotionError(
            f"{start}none of them rotates{'' if half_turns_count else ' by an angle other than 0 or 180 degrees'}. "
            "Neither the rotation nor the translation of X is observable. Move the robot so that it rotates about at "
            "least two different axes, by 30 to 150 degrees.",
            np.eye(6),
        )
    lost = U.T[eigenvalues <= MIN_SPREAD_RATIO * largest]
    axes = " and ".join(name_axis(axis) for axis in lost)
    if s[1] <= MIN_SPREAD_RATIO * s[0]:
        reason = (
            f"all rotation axes are parallel to {axes} in the frame of `A`. They show neither the rotation of X about "
            "this axis nor its translation along it, and the rest of the translation follows that rotation. Add "
            "motions that rotate about another axis."
        )
    else:
        half_turns = ", or the signs of the axes of half turns are lost" if half_turns_count else ""
        reason = (
            f"the rotation axes of `A` are those of `B` mirrored{half_turns}: no rotation about {axes} fits better "
            "than another. One of the two is left-handed or inverted."
        )
    raise DegenerateMotionError(start + reason, infinite_directions(lost))


def infinite_directions(axes: Array) -> Array:
    """Rotation about and translation along each axis (k, 3), as unit vectors (2k, 6) of (theta, tau)."""
    zero = np.zeros_like(axes)
    return np.vstack([np.hstack([axes, zero]), np.hstack([zero, axes])])


def name_axis(axis: Array) -> str:
    """An axis (3,) as text, of the sign that makes its largest component positive."""
    sign = -1.0 if axis[np.argmax(np.abs(axis))] < 0 else 1.0
    return "(" + ", ".join(f"{x:.3f}" for x in np.round(sign * axis, 3) + 0.0) + ")"
