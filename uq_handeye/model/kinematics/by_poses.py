"""Joint values of robot poses by inverse kinematics."""

from __future__ import annotations

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.numbers import digits
from ...errors import InputError
from .chain import Kinematics
from .newton import postures_at

# Other branches of the inverse kinematics are tried where one branch reaches at least this share of the poses.
MIN_REACHED_SHARE = 0.6


def joints_by_poses(kinematics: Kinematics, robot: Array) -> Array:
    """Return joint values (n, L) of robot poses (n, 4, 4) by inverse kinematics, in the branch that they share.

    Raises `InputError` where the arm does not reach the poses.
    """
    from .postures import postures_by_branch  # its table of arms takes a while

    found = postures_by_branch(kinematics, robot)
    if found.reached.mean() >= MIN_REACHED_SHARE:  # another branch for the others: their errors are much the same
        for start in kinematics.spread(60):
            left = ~found.reached
            if not left.any():
                break
            again = postures_at(kinematics, robot[left], np.tile(start, (int(left.sum()), 1)))
            found.q[left], found.reached[left] = again.q, again.reached
    if not found.reached.all():
        off = np.linalg.norm(kinematics.poses(found.q)[:, :3, 3] - robot[:, :3, 3], axis=-1)
        if (axes := kinematics.n_joints) < 6:  # six axes reach any pose nearby
            raise InputError(
                f"The arm {kinematics.name} has {axes} axes, which reach rounded or measured poses only nearly "
                f"({int((~found.reached).sum())} of {len(robot)} are missed). Give its joints (--joints)."
            )
        raise InputError(
            f"The arm {kinematics.name} does not reach {int((~found.reached).sum())} of {len(robot)} robot poses: it "
            f"ends up to {digits(1e3 * off.max(), 3)} mm away. Give the chain up to the frame whose poses these are "
            "(--base, --tip), with the tool that the controller had; or joints (--joints)."
        )
    return found.q
