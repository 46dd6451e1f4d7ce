"""The numbers of a certificate in the terms of ISO 9283, and what is no measurement of it.

Pose repeatability RP is the spread of attained poses about their mean, of one commanded pose approached from one
direction: ``RP_l = mean(l) + 3 S_l``, l the distances from the mean. Pose accuracy AP is the difference between a
commanded pose and the mean of those attained (ISO 9283, 7.2). A calibration sees neither: it sees what the reported
poses differ by from those of a rigid rig.
"""

from __future__ import annotations

import numpy as np

from ...calibration.result import Calibration
from ...calibration.statement.included import shared_groups, sizes_of
from ...core.formatting.numbers import digits
from ...model.kinematics.kinematic_errors import DECLARED_AS
from ...model.noise.joint_covariance import group_of
from ...model.shared_errors.sizes import ROBOT_ACCURACY
from .inputs import noise_per_axis


def robot_words(result: Calibration) -> list[str]:
    """Return what the numbers say of the robot in the terms of ISO 9283, and what they do not."""
    return [_repeatability(result), _accuracy(result), NOT_ISO_9283]


# RP_l = mean + 3 sd of the distance, for an isotropic Gaussian of standard deviation 1 per axis: the distance has the
# mean 2 sqrt(2 / pi) and the standard deviation sqrt(3 - 8 / pi).
RP_PER_SD = float(2 * np.sqrt(2 / np.pi) + 3 * np.sqrt(3 - 8 / np.pi))
NOT_ISO_9283 = (
    "No characteristic of ISO 9283 was measured: commanded poses, repeated cycles to the poses of the test cube, rated "
    "load and an external measuring system are not part of the data."
)


def _repeatability(result: Calibration) -> str:
    """Return how the noise of the robot poses relates to pose repeatability."""
    if result.kinematics is not None:
        sd = digits(float(np.degrees(result.kinematics.joint_noise)), 2)
        return (
            f"Pose repeatability (RP): the joint noise, {sd} deg per joint, is related to it; it also holds encoder "
            "errors and what no model of the arm explains."
        )
    sizes = _robot_noise(result)
    missing = [name for name, size in sizes.items() if size is None]
    known = [f"{digits(size, 2)} {'deg' if name == 'rotation' else 'mm'}" for name, size in sizes.items() if size]
    if result.setup is None:
        return "Pose repeatability (RP): no value here is related to it; the data are motions, not poses."
    if not known:
        return (
            "Pose repeatability (RP): no value here is related to it; the data do not separate the noise of the robot "
            "poses from that of the camera poses."
        )
    text = (
        f"Pose repeatability (RP): the noise of the robot poses, {' and '.join(known)} (1 sigma per axis), is related "
        "to it; it also holds errors of the reported pose and of its timing, over different poses and directions."
    )
    if missing:
        text += f" Its {missing[0]} is not identifiable."
    if move := sizes["translation"]:
        text += (
            f" Isotropic noise of this size would have RP_l = {RP_PER_SD:.1f} sigma = {digits(RP_PER_SD * move, 2)} mm."
        )
    return text


def _robot_noise(result: Calibration) -> dict[str, float | None]:
    """Return rotation (deg) and translation (mm) noise of the robot poses, where it is known by itself."""
    factors = {"rotation": 180 / np.pi, "translation": 1e3}
    estimate = result.noise_estimate
    found: dict[str, float | None] = dict.fromkeys(factors)
    if estimate is not None:
        for part in estimate.components:
            side, _, kind = part.name.partition(" ")
            if side == "robot" and kind in found and part.status not in ("not told apart", "exact", "zero"):
                found[kind] = factors[kind] * part.value
        return found
    S = getattr(result.noise, "robot", None)
    if S is not None:
        for kind, size in zip(found, noise_per_axis(S), strict=True):
            found[kind] = factors[kind] * float(size) or None
    return found


def _accuracy(result: Calibration) -> str:
    """Return how what is declared or assumed of the robot relates to pose accuracy."""
    groups = [group for group in shared_groups(result) if group.parts[0].error == ROBOT_ACCURACY]
    if groups:
        how = "assumed, not declared" if groups[0].default else "declared"
        return (
            f"Pose accuracy (AP): the robot accuracy of the budget, {sizes_of(groups[0])} ({how}), is related to it. "
            "It is read as the RMS over the workspace of the difference between reported and actual pose, base and "
            "tool frame aligned; AP of a data sheet is per commanded pose."
        )
    names = {group_of(error.name) for error in result.shared} & set(DECLARED_AS)
    if names:
        return (
            "Pose accuracy (AP): the errors of the arm in the budget, "
            f"{', '.join(name for name in DECLARED_AS if name in names)}, are related to it."
        )
    return "Pose accuracy (AP): no robot accuracy is declared or assumed; its effect on X is not in the budget."
