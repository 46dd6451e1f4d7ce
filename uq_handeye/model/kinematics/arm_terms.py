"""Errors of an arm's kinematics as components: one of each group, and the noise of the joints."""

from __future__ import annotations

from itertools import compress

from ..errors.key import ErrorKey, Owner
from ..errors.keys import JOINT_NOISE
from ..errors.sizes import SIZES, Size
from ..errors.term import ErrorTerm
from .errors import LENGTHS
from .kinematic_errors import DECLARED, KinematicColumns


def terms_of_arm(arm: KinematicColumns) -> list[ErrorTerm]:
    """Return the components of n measured poses by the columns of their arm."""
    given, found = arm.given, []
    for group, sd in given.standard_deviations.items():
        of = arm.of(group)
        if not of.any() or not sd:
            continue
        size = Size(sd, 1.0 if given.how == DECLARED else given.population.factor, "m" if group == LENGTHS else "rad")
        key, keys = ErrorKey(Owner.ROBOT, group), tuple(compress(arm.keys, of))
        block = None if arm.elbow is None else arm.elbow[..., of[: arm.elbow.shape[-1]]]
        found.append(ErrorTerm(key, "robot", size, columns=arm.F[..., of], block=block, keys=keys))
    joint_sd = given.joint_sd
    size = SIZES[JOINT_NOISE] if joint_sd is None else Size(float(joint_sd), 1.0, "rad", "declared")
    if size.median > 0:
        found.append(ErrorTerm(JOINT_NOISE, "robot", size, block=arm.J))
    return found
