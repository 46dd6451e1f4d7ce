"""Text of a check: the answer, the causes with their sizes, what would have shown, and what to do next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.geometry.se3 import Array
from ...core.levels import POWER
from ...core.presentation.document import Answer, Block, Document, Paragraph, Table, document_of
from ...core.presentation.numbers import concise, digits, plus_minus, probability
from ...errors import InputError
from .causes import CAMERA_MOVED, FOCAL_LENGTH, IMAGE_CENTRE, ONE_POSE, TARGET_MOVED, TARGET_SIZE, Cause
from .check_result import CANNOT_TELL, CHANGED, UNCHANGED, ChangeCheck, Move
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
def check_document(result: ChangeCheck) -> Document:
    """Return the answer, what has changed, what these poses would have shown; of several cameras also tables."""
    blocks: list[Block] = [Answer(headline(result), _STATUS[result.status])]
    if result.changed and result.moved_since is None:  # causes are those of a change before all new poses
        blocks += [Paragraph(line, hang="  ") for line in _causes(result)]
    blocks += [Paragraph(str(finding), hang="  ") for finding in result.findings]
    tables = []
    if len(result.views) > 1:
        tables = [[_moves(result)], [_views(result)]]
    elif not any(finding.code in MISREAD for finding in result.findings):  # or the numbers would mean nothing
        blocks.append(Paragraph(_shown(result), hang="  "))
    if result.unseen:
        blocks.append(Paragraph(f"Not seen, so not checked: {', '.join(result.unseen)}.", hang="  "))
    if (step := _next(result)) is not None:
        blocks.append(Paragraph(f"Next: {step}", hang="  "))
    return [blocks, *tables]


def headline(result: ChangeCheck) -> str:
    """Return the answer in one sentence."""
    return f"{result.status.upper()}: {_answer(result)}"


def refusal_of_update(result: ChangeCheck) -> InputError:
    """Return the error of an update by poses that contradict the result; what moved among them is its finding."""
    p, moved = probability(result.p_value), result.moved_since
    cause = "" if moved is not None or result.cause is None else f", probably {result.cause}"
    error = InputError(
        f"The new poses contradict the result ({p}): something has changed{cause}. Look at uq-handeye check, and "
        "calibrate again; or update all the same (--although-changed)."
    )
    if moved is not None:
        error.findings = (replace(moved, severity="failure"),)
    return error


def cause_in_words(cause: Cause, setup: str | None) -> str:
    """Return a cause as a clause, of one camera with what is exactly the same; of a rig with its part."""
    name, of = cause.name, f" of {cause.of}" if cause.of else ""
    if cause.of and name in (CAMERA_MOVED, TARGET_MOVED):
        return f"{cause.of} moved"
    if setup is not None and (setup, name) in _MOVED:
        one, other = _MOVED[setup, name]
        return f"{one}, or {other} (poses cannot separate these two)"
    return {
        FOCAL_LENGTH: f"the focal length{of} changed",
        TARGET_SIZE: f"{cause.of or 'the target'} is not of the size that was given",
        IMAGE_CENTRE: f"the image centre{of} changed (the same as a camera rotated about its own x and y axes)",
        ONE_POSE: f"only the view {cause.of} is wrong" if of else "one pose is wrong",
    }[name]


def _moves(result: ChangeCheck) -> Table:
    head = ["moved", "chi-square", "rotation (deg)", "position (mm)", "rest", "shows from"]
    rows = [[one.name, f"{one.chi_square:.1f}", f"{np.degrees(one.angle):.4f}", f"{1e3 * one.shift:.3f}",
             probability(one.left), _least(one)] for one in result.moves]  # fmt: skip
    caption = (
        "Each pose as the one that moved; rest: probability of the other views; the smallest change that shows "
        f"({100 * POWER.probability:.0f} %)."
    )
    return Table(caption, head, rows, frozenset({5}))


def _views(result: ChangeCheck) -> Table:
    rows = [[pair, probability(p)] for pair, p in result.views.items()]
    return Table("Views by themselves.", ["camera, target", "probability"], rows)


def _shown(result: ChangeCheck) -> str:
    """Return the smallest changes that would have shown, of X or the first one and of the others."""
    first, *others = sorted(result.moves, key=lambda one: one.name != CAMERA_MOVED)
    share = f"{100 * POWER.probability:.0f} %"
    text = (
        f"Smallest change of {first.name} that shows with {share} probability, in the worst direction: {_least(first)}"
    )
    more = "".join(f"; of {'W' if one.name == TARGET_MOVED else one.name}: {_least(one)}" for one in others)
    return f"{text}{more}."


def _answer(result: ChangeCheck) -> str:
    one, noun = result.n_poses == 1, "view" if len(result.views) > 1 else "pose"
    new = f"1 new {noun}" if one else f"{result.n_poses} new {noun}s"
    old = "" if result.n_calibrated is None else f" of {result.n_calibrated} {noun}s"
    p = probability(result.p_value, 2)
    noise = "noise given" if result.noise_dof is None else "noise estimated"
    by_one = result.p_value >= result.level / 2  # a move shows where the whole does not
    if result.changed or result.p_value < result.level / 2:
        verb = "contradicts" if one else "contradict"
        if by_one:
            p += f" of all; {probability(result.moves[0].p, 2)} of a move of {result.moves[0].name}"
    else:
        verb = "agrees with" if one else "agree with"
    return f"{new} {verb} the calibration{old} ({p}; {noise})."


def _causes(result: ChangeCheck) -> list[str]:
    causes, setup = result.causes, result.setup
    if causes.named is not None:
        return [f"Cause: {cause_in_words(causes.named, setup)}.", f"By: {_short(causes.named, result)}."]
    if not causes.explained:
        return []
    found = [cause for cause in causes.candidates if cause.explains] or list(causes.candidates)
    shares = np.diff(np.round(100.0 * np.cumsum([cause.probability for cause in found])), prepend=0.0)
    lines = ["Cause: one of the following, which these poses cannot separate (with probabilities):"]
    lines += [
        f"- {share:.0f} %: {cause_in_words(cause, setup)}{f': {size}' if (size := _short(cause, result)) else ''}"
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
    return "" if cause.row is None else f"pose {cause.row}"


def move_in_words(estimate: Array, covariance: Array) -> str:
    """Return the translation and the rotation of a pose (theta, tau) by axis, with one standard deviation."""
    sd = np.sqrt(np.diag(covariance))
    move, turn = (
        ", ".join(plus_minus(float(unit * estimate[k]), float(unit * sd[k])) for k in part)
        for part, unit in ((range(3, 6), 1e3), (range(3), float(np.degrees(1.0))))
    )
    return f"translation x, y, z {move} mm; rotation {turn} deg"


def _least(one: Move) -> str:
    """Return the smallest shift and rotation of a pose that show."""
    shift = f"{digits(1e3 * one.least_shift, 2)} mm" if np.isfinite(one.least_shift) else "no translation"
    turn = f"{digits(float(np.degrees(one.least_angle)), 2)} deg" if np.isfinite(one.least_angle) else "no rotation"
    return f"{shift} or {turn}"


def _next(result: ChangeCheck) -> str | None:
    if not result.changed:
        return None
    if result.moved_since is None and result.cause == TARGET_MOVED and result.setup == "eye-in-hand":
        return "X still holds if it was the target; if it was the base, so do X and the target, in the new base."
    if result.causes.all[0].name in _WAYS:
        return "measure the target; if it is as large as before, calibrate the camera again, then X."
    return None if result.n_poses < 3 or result.moved_since is not None else "calibrate again."
