"""Joint values of the robot that go with its poses."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.checks import as_numbers
from ..geometry.se3 import Array


def as_joint_values(value: Any, n: int) -> Array:
    """Return the joint values of n poses as a read-only array (n, L); raise `InputError` for anything else."""
    joints = np.array(as_numbers(value, "joints"))
    if joints.ndim != 2 or len(joints) != n or joints.shape[1] == 0:
        raise InputError(
            f"Expected `joints` to have shape ({n}, L), a row of joint values for each pose, got {joints.shape}."
        )
    if not np.isfinite(joints).all():
        row, column = (int(k) for k in np.argwhere(~np.isfinite(joints))[0])
        raise InputError(f"Expected finite `joints`, got {joints[row, column]} in pose {row}, joint {column}.")
    joints.flags.writeable = False
    return joints


def joint_values_at(times: Array, joints: Array, wanted: Array) -> Array:
    """Interpolate joint values (n, L) at increasing ``times`` (n,) linearly: (m, L) at the times ``wanted`` (m,).

    A step of a joint by more than half a turn is taken as it stands in the data, not the short way round: joint values
    count turns.
    """
    return np.stack([np.interp(wanted, times, column) for column in joints.T], axis=-1)
