"""The text about the robot arm of a calibration.

It states which flange X belongs to, which of the arm's errors the data determined, and how far the tool misses a point
that the camera sees.
"""

from __future__ import annotations

import numpy as np

from ...core.presentation.document import (
    Block,
    Heading,
    Paragraph,
)
from ...core.presentation.numbers import digits
from ...model.errors.keys import ROBOT_ACCURACY
from ...model.kinematics.kinematic_errors import DECLARED, ESTIMATE, EXACT, PHYSICAL
from ...model.kinematics.known_arms import about_flange
from ...model.kinematics.sentences import frame_size
from ..analysis import FittedKinematics
from ..result import Calibration

# The mean error of nominal poses is stated from this share of the 95 % radius on.
MIN_NOMINAL_SHARE = 0.05
_HOW = {
    ESTIMATE: "standard deviations estimated from the data and what such arms have",
    DECLARED: "standard deviations as declared",
    EXACT: "taken as exact",
}


def arm_blocks(result: Calibration) -> list[Block]:
    """The section about the arm with its heading; empty where the calibration has no joints."""
    sentences = arm_sentences(result)
    return [Heading("The arm:"), *map(Paragraph, sentences)] if sentences else []


def arm_sentences(result: Calibration) -> list[str]:
    """Describe the estimated errors of the arm, the meaning of X, and the accuracy of a prediction."""
    fitted = result.kinematics
    if fitted is None:
        return []
    chain = fitted.chain
    text = f"{chain.name}, {chain.n_joints} joints from {chain.base} to {chain.tip}; its errors: {_HOW[fitted.how]}."
    if fitted.joint_noise > 0:
        text += f" Joint noise {digits(np.degrees(fitted.joint_noise), 2)} deg."
    if told := told_words(fitted):
        text += f" {told}"
    meaning = [] if fitted.how == EXACT else [meaning_words(result, fitted)]
    if about := about_flange(chain.name):
        meaning.append(about)
    return [text, *meaning, *([said] if (said := prediction_words(result)) else [])]


def frame_words(result: Calibration) -> str:
    """State in one sentence which flange (or base) X belongs to, and frames of the controller that were found.

    Where the calibration has no kinematics: the scale of the camera poses, if it was not known; else empty.
    """
    fitted = result.kinematics
    if fitted is None:
        return " ".join(str(found) for found in result.findings if found.code == "calibration.camera_scale")
    frame = result.frame.split("_T_")[0]
    which = "machined" if fitted.flange == PHYSICAL and fitted.how != EXACT else "reported"
    text = f"X is in the {which} {frame} frame"
    found = {finding.code: finding.values for finding in result.findings}
    frames = found.get("kinematics.against_controller", {})
    own, other = ("tool", "base") if frame == "gripper" else ("base", "tool")
    if frames.get(own) is not None:
        text += f", {frame_size(frames[own])} from that of the model"
    text += "."
    if frames.get(other) is not None:
        text += (
            f" The reported {'base' if other == 'base' else 'tool'} is {frame_size(frames[other])} from the model's."
        )
    if found.get("kinematics.joint_3", {}).get("coupled"):
        text += " Joint 3 is read as FANUC's pendant shows it."
    return text


def reported_words(result: Calibration) -> str:
    """State which flange (or base) X belongs to where errors of an arm are assumed or declared without its kinematics.

    Empty where they are not.
    """
    if result.kinematics is not None or all(error.key.error != ROBOT_ACCURACY for error in result.shared):
        return ""
    frame = result.frame.split("_T_")[0]
    return (
        f"X belongs to the {frame} as the controller reports it, as it fits the whole workspace best. The machined "
        f"{frame} is off by the errors of the arm: do not compare X with drawings of the mount."
    )


def told_words(fitted: FittedKinematics) -> str:
    """State by how much the data reduced the prior variance of each group."""
    told = [f"{group} {100 * share:.0f} %" for group, share in fitted.told().items()]
    return f"Share of the assumed variance that the data resolved: {', '.join(told)}." if told else ""


def meaning_words(result: Calibration, fitted: FittedKinematics) -> str:
    """State which flange (or base) X belongs to, and the kinematics to use it with."""
    frame = result.frame.split("_T_")[0]
    if fitted.flange == PHYSICAL:
        return f"X is the camera in the machined {frame}; errors of the first and last joint are in its covariance."
    return (
        f"X is the camera in the {frame} frame of the controller: use it with the corrected kinematics "
        "(`result.predict`, `uq-handeye predict`), and do not compare it with drawings of the mount "
        '(`flange="physical"` is for that).'
    )


def prediction_words(result: Calibration) -> str:
    """State how far the tool misses a point that the camera sees, near the calibrated poses and over the workspace; and
    with nominal poses.
    """
    found = result.over_workspace
    if found is None:
        return ""
    at = f" from {found.distance:.2g} m away" if result.setup == "eye-in-hand" else ""
    text = f"A point that the camera sees{at}, and the flange brought to it: within {_mm(found.anywhere)} mm (95 %) "
    text += "anywhere in the workspace"
    text += "." if found.near is None else f", within {_mm(found.near)} mm near the calibrated poses."
    if found.nominal > MIN_NOMINAL_SHARE * found.anywhere:
        text += (
            f" With nominal poses in place of the corrected ones add {_mm(found.nominal)} mm (RMS): a mean error, "
            "which is not part of the covariance."
        )
    return text


def workspace_caption(result: Calibration) -> str:
    """Explain how to read the figure of the workspace."""
    reached = "the flange is brought to a point that the camera sees"
    if result.setup == "eye-in-hand" and result.over_workspace is not None:
        reached += f" {result.over_workspace.distance:.2g} m ahead"
    return (
        f"How far the tool misses where {reached}: 95 % radius, with errors of X and of the arm and the noise of the "
        "joints; the camera's own error of the point comes on top. Postures are drawn over the joint limits; "
        "obstacles and collisions are not looked at. Left by the place of the flange, as the mean about each; "
        "right by its distance from the nearest calibrated pose. The dashed line is the mean error of who goes on "
        "with the nominal poses; it is not in the radius."
    )


def _mm(length: float) -> str:
    return digits(1e3 * length, 2)
