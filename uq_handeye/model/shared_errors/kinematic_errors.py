"""The errors of an arm's kinematics as errors that all poses share: one `SharedError` for each group of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ...core.geometry.se3 import Array
from ..kinematics.errors import LENGTHS
from ..kinematics.kinematic_errors import DECLARED_AS, JOINT_NOISE, KinematicColumns
from ..noise.joint_covariance import JointCovariance
from ..poses.pose_pairs import PosePairs
from .shared_error import SharedError


def errors_of_arm(columns: KinematicColumns, deviations: Mapping[str, float]) -> tuple[SharedError, ...]:
    """The groups with one standard deviation each (rad or m), by name; their parts are named ``group: joint``.

    An estimate is that of the arm, ``true - model``: measured poses have the opposite error, which is in the columns.
    """
    found = []
    for group in DECLARED_AS:
        of = np.array([name == group for name in columns.groups], dtype=bool)
        if of.any():
            F = columns.F[..., of]
            parts = tuple(name for name, is_of in zip(columns.names, of, strict=True) if is_of)
            sd = np.full(len(parts), deviations[group])
            unit = "m" if group == LENGTHS else "rad"
            found.append(SharedError(group, unit, "robot", sd, parts, _constant(F)))
    return tuple(found)


def _constant(F: Array) -> Callable[[PosePairs], Array]:
    """Effects that are those at the joints, whatever the poses."""
    return lambda poses: F


def kinematic_covariance(columns: KinematicColumns, deviations: Mapping[str, float]) -> JointCovariance:
    """Return the covariance of the robot poses by joint noise and the errors of all groups, with these standard
    deviations by name.
    """
    noise = deviations.get(JOINT_NOISE, 0.0) ** 2 * columns.J @ columns.J.mT
    sd = np.array([deviations[group] for group in columns.groups])
    return JointCovariance(noise, columns.F * sd, columns.names)
