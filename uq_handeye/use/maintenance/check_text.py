"""Text of a check: the answer, the causes with their sizes, what would have shown, and what to do next."""

from __future__ import annotations

import numpy as np

from ...core.formatting.numbers import concise, digits, plus_minus, probability
from ...core.geometry.se3 import Array
from ...core.presentation.document import Answer, Block, Paragraph, document_of
from .causes import CAMERA_MOVED, FOCAL_LENGTH, IMAGE_CENTRE, ONE_POSE, TARGET_MOVED, TARGET_SIZE, Cause
from .check_result import CANNOT_TELL, CHANGED, UNCHANGED, ChangeCheck, Detectable
from .misread import MISREAD

# What X and W are, and what else moves with them: no pose can separate the two.
_MOVED = {
    ("eye-in-hand", CAMERA_MOVED): ("the camera moved on the gripper", "the robot's tool frame was changed"),
    ("eye-in-hand", TARGET_MOVED): ("the target moved", "the robot's base did"),
    ("eye-to-hand", CAMERA_MOVED): ("the camera moved in the cell", "the robot's base did"),
    ("eye-to-hand", TARGET_MOVED): ("the target moved on the gripper", "the robot's tool frame was changed"),
}
# Words for an increase and a decrease of a cause that is a ratio.
_WAYS = {FOCAL_LENGTH: ("longer", "shorter"), TARGET_SIZE: ("larger", "smaller")}
_STATUS = {UNCHANGED: "ok", CHANGED: "failed", CANNOT_TELL: "caution"}


@document_of.register
def check_document(result: ChangeCheck) -> list[list[Block]]:
    """Return the answer, what these poses would have shown, and what has changed."""
    blocks: list[Block] = [Answer(f"{result.status.upper()}: {_answer(result)}", _STATUS[result.status])]
    later = any(finding.code == "maintenance.moved_since" for finding in result.findings)
    if result.changed and not later:  # causes are those of a change before all new poses
        blocks += [Paragraph(line, hang="  ") for line in _causes(result)]
    blocks += [Paragraph(str(finding), hang="  ") for finding in result.findings]
    if not any(finding.code in MISREAD for finding in result.findings):  # or the numbers would mean nothing
        blocks.append(Paragraph(shown_line(result.detectable), hang="  "))
    if (step := _next(result)) is not None:
        blocks.append(Paragraph(f"Next: {step}", hang="  "))
    return [blocks]


def cause_in_words(name: str, setup: str) -> str:
    """Return a cause as a clause, with what is exactly the same."""
    if (setup, name) in _MOVED:
        one, other = _MOVED[setup, name]
        return f"{one}, or {other} (poses cannot separate these two)"
    return {
        FOCAL_LENGTH: "the focal length changed",
        TARGET_SIZE: "the target is not of the size that was given",
        IMAGE_CENTRE: "the image centre changed (the same as a camera rotated about its own x and y axes)",
        ONE_POSE: "one pose is wrong",
    }[name]


def shown_line(detectable: Detectable) -> str:
    """Return the smallest changes that would have shown."""
    X = _size(detectable.X_translation, detectable.X_rotation)
    W = _size(detectable.W_translation, detectable.W_rotation)
    share = f"{100 * detectable.power:.0f} %"
    return f"Smallest change of X that shows with {share} probability, in the worst direction: {X}; of W: {W}."


def _answer(result: ChangeCheck) -> str:
    new = "1 new pose" if result.n_poses == 1 else f"{result.n_poses} new poses"
    one = result.n_poses == 1
    old = "" if result.n_calibrated is None else f" of {result.n_calibrated} poses"
    p = probability(result.p_value, 2)
    noise = "noise given" if result.noise_dof is None else "noise estimated"
    if result.p_value < result.level:
        verb = "contradicts" if one else "contradict"
    else:
        verb = "agrees with" if one else "agree with"
    return f"{new} {verb} the calibration{old} ({p}; {noise})."


def _causes(result: ChangeCheck) -> list[str]:
    causes, setup = result.causes, result.setup
    if causes.named is not None:
        return [f"Cause: {cause_in_words(causes.named.name, setup)}.", f"By: {_short(causes.named, result)}."]
    if not causes.explained:
        return []
    found = [cause for cause in causes.candidates if cause.explains] or list(causes.candidates)
    shares = np.diff(np.round(100.0 * np.cumsum([cause.probability for cause in found])), prepend=0.0)
    lines = ["Cause: one of the following, which these poses cannot separate (with probabilities):"]
    lines += [
        f"- {share:.0f} %: {cause_in_words(cause.name, setup)}: {_short(cause, result)}"
        for cause, share in zip(found, shares, strict=True)
    ]
    return lines if shares.sum() >= 100 else [*lines, f"- {100 - shares.sum():.0f} %: another of the causes compared"]


def _short(cause: Cause, result: ChangeCheck) -> str:
    """The size of a change with its uncertainty (one standard deviation)."""
    sd = np.sqrt(np.diag(cause.covariance))
    if cause.name in (CAMERA_MOVED, TARGET_MOVED):
        return move_in_words(cause.estimate, cause.covariance)
    if cause.name in _WAYS:
        value = float(cause.estimate[0])
        way = _WAYS[cause.name][value < 0]
        return f"{concise(100 * abs(value), 100 * float(sd[0]), '%')} {way}"
    if cause.name == IMAGE_CENTRE:
        f = result.focal_length_px
        scale, unit = (1e3, "mrad") if f is None else (f, "px")
        x, y = (concise(float(scale * v), float(scale * s)) for v, s in zip(cause.estimate, sd, strict=True))
        return f"x {x}, y {y} {unit}"
    return f"pose {cause.row}"


def move_in_words(estimate: Array, covariance: Array) -> str:
    """Return the translation and the rotation of a pose (theta, tau) by axis, with one standard deviation."""
    sd = np.sqrt(np.diag(covariance))
    move, turn = (
        ", ".join(plus_minus(float(unit * estimate[k]), float(unit * sd[k])) for k in part)
        for part, unit in ((range(3, 6), 1e3), (range(3), float(np.degrees(1.0))))
    )
    return f"translation x, y, z {move} mm; rotation {turn} deg"


def _size(translation: float, rotation: float) -> str:
    move = f"{digits(1e3 * translation, 2)} mm" if np.isfinite(translation) else "no translation"
    turn = f"{digits(float(np.degrees(rotation)), 2)} deg" if np.isfinite(rotation) else "no rotation"
    return f"{move} or {turn}"


def _next(result: ChangeCheck) -> str | None:
    if not result.changed:
        return None
    if result.cause == TARGET_MOVED and result.setup == "eye-in-hand":
        return "X still holds if it was the target; if it was the base, so do X and the target, in the new base."
    if result.causes.all[0].name in _WAYS:
        return "measure the target; if it is as large as before, calibrate the camera again, then X."
    return None if result.n_poses < 3 else "calibrate again."
