"""Text of a plan: the gain by the poses, a table of them, and the meaning of its numbers."""

from __future__ import annotations

import numpy as np

from ...calibration.stored_result import NOT_USABLE
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.presentation.document import Answer, Document, Paragraph, Table, document_of
from ...formats.controllers.forms import CONTROLLERS
from ...formats.controllers.written import columns, in_form
from ...model.errors.keys import (
    FOCAL_LENGTH,
    INTRINSICS,
    LENS,
    PRINCIPAL_POINT,
    ROBOT_ACCURACY,
    ROBOT_SCALE,
    TARGET_SCALE,
)
from .by_posterior import MAX_POSES_TO_PASS
from .result import Plan
from .weak_prior import WEAK_PRIOR_SD

# What makes the errors smaller that all poses share.
REMEDIES = {
    "measure the target": (TARGET_SCALE,),
    "give the intrinsics": (FOCAL_LENGTH, PRINCIPAL_POINT, LENS, INTRINSICS),
    "give the arm": (ROBOT_ACCURACY, ROBOT_SCALE),
}


@document_of.register(Plan)
def plan_document(plan: Plan) -> Document:
    """A sentence, a table, and what the numbers mean."""
    until = [] if plan.tolerance is None else [Paragraph(_until_pass(plan))]
    refuted = [Answer(f"{NOT_USABLE}: {one.rstrip('.')}.", "failed") for one in plan.contradictions[:1]]
    first = [*refuted, Paragraph(headline(plan)), *until]
    return [first, _table(plan), [Paragraph(note) for note in _notes(plan)]]


def headline(plan: Plan) -> str:
    """State in one sentence or two what the poses would bring."""
    k = len(plan.chosen)
    before, after = plan.worst[0], plan.worst[-1]
    poses = f"{k} more {_noun(plan)}{'s'[: k != 1]} would bring"
    worst = "worst camera and axis" if len(plan.cameras) > 1 else "worst axis"
    if len(plan.open_directions):
        so_far = f"The {plan.n_poses} {_noun(plan)}s so far leave"
        bring = (
            f"translation to {_mm(after[1])} mm, its rotation to {_deg(after[0])} deg (standard deviation, {worst})."
        )
        if plan.setup is None:  # each camera has directions of its own
            return f"{so_far} directions of {plan.frame} open. {poses} the {bring.replace('its', 'the')}"
        what = " and ".join(_direction(a) for a in plan.open_directions)
        return f"{so_far} {plan.frame} open: {what} of the {plan.frame.split('_T_')[0]} frame. {poses} its {bring}"
    return (
        f"{poses} the translation of {plan.frame} from {_mm(before[1])} to {_mm(after[1])} mm and its rotation from "
        f"{_deg(before[0])} to {_deg(after[0])} deg (standard deviation, {worst})."
    )


def _noun(plan: Plan) -> str:
    return "pose" if plan.setup is not None else "view"


def _until_pass(plan: Plan) -> str:
    """State how many poses are needed until X meets the tolerance."""
    if len(plan.open_directions):
        return f"How many poses {plan.tolerance} needs is not known while X is open."
    if plan.needed is None:
        why = "errors that all poses share limit X" if plan.shared else f"{MAX_POSES_TO_PASS} more do not"
        return f"More poses will not reach {plan.tolerance}: {why}. {_remedies(plan)}."
    if plan.needed == 0:
        return f"{plan.tolerance} is met by the {_noun(plan)}s so far: PASS needs no more."
    poses = f"{plan.needed} more {_noun(plan)}{'s'[: plan.needed != 1]} like these"
    return f"PASS for {plan.tolerance} after {poses}, {plan.n_poses + plan.needed} in all, if the checks stay ok."


def _remedies(plan: Plan) -> str:
    """Return what makes the errors smaller that all poses share, of those that the plan includes."""
    found = [words for words, of in REMEDIES.items() if set(map(str, of)) & set(plan.shared)]
    words = f"{', '.join(found)}{',' if len(found) > 1 else ''} or " if found else ""
    words += "accept a larger tolerance"
    return f"{words[0].upper()}{words[1:]}"


def _table(plan: Plan) -> Table:
    name, unit = {"logdet": ("log", "det")}.get(plan.criterion, ("error", "mm"))
    named, in_units, places = _places(plan)
    head = ["step", "candidate", *named, "rotation", "translation", name]
    units = ["", "", *in_units, "sd, deg", "sd, mm", unit]
    rows = [["so far", *[""] * (1 + len(named)), *_numbers(plan, plan.worst[0], plan.criterion_before)]]
    for step, (row, place, worst, value) in enumerate(
        zip(plan.chosen, places, plan.worst[1:], plan.criterion_values, strict=True), start=1
    ):
        rows.append([str(step), str(row), *place, *_numbers(plan, worst, float(value))])
    return Table("", head, rows, units=units, named=False)


def _places(plan: Plan) -> tuple[list[str], list[str], list[list[str]]]:
    """Columns of the poses or joints: names, units, texts; joints are q1, q2, ... where their names are too long.

    Of a rig camera and target, whose robot poses are in the files.
    """
    if plan.setup is None:
        return ["camera", "target"], ["", ""], [list(pair) for pair in plan.views]
    if plan.joints is not None:
        short = max(map(len, plan.joint_names)) <= 8  # letters
        names = list(plan.joint_names) if short else [f"q{k}" for k in range(1, len(plan.joint_names) + 1)]
        units = ["deg" if unit == "rad" else "mm" for unit in plan.joint_units]
        values, digits = plan.joints * [180.0 / np.pi if unit == "deg" else 1e3 for unit in units], [2] * len(units)
    elif (form := CONTROLLERS.get(plan.form or "")) is not None:
        names, units = columns(form)
        values, digits = (
            in_form(plan.robot, form),
            [4 if u in ("m", "rad", "") else 3 if u == "deg" else 1 for u in units],
        )
    else:
        names, units, digits = ["x", "y", "z", "qx", "qy", "qz", "qw"], ["mm"] * 3 + [""] * 4, [1] * 3 + [4] * 4
        quaternions = Rotation.from_matrix(plan.robot[:, :3, :3]).as_quat(canonical=True)
        values = np.concatenate([1e3 * plan.robot[:, :3, 3], quaternions], axis=1)
    rows = [[f"{x:.{k}f}" for x, k in zip(row, digits, strict=True)] for row in values.tolist()]
    return names, units, rows


def _numbers(plan: Plan, worst: Array, value: float) -> list[str]:
    return [_deg(worst[0]), _mm(worst[1]), f"{value:.2f}" if plan.criterion == "logdet" else _mm(float(np.sqrt(value)))]


def _notes(plan: Plan) -> list[str]:
    where = "around the target" if plan.setup is not None else "near the poses so far"
    origin = f"drawn {where}" if plan.sampled else "given"
    form, (names, *_) = CONTROLLERS.get(plan.form or ""), _places(plan)
    what = f"{names[0]} to {names[-1]}: "
    if plan.setup is None:
        what = "camera, target: of the view"
    elif plan.joints is not None:
        what += f"joints {', '.join(plan.joint_names)}"
    else:
        what += "base_T_gripper" if form is None else f"base_T_gripper as {form.maker} writes it"
    notes = [
        f"candidate: row among the {plan.n_candidates} candidates {origin}, from 0. {what}. sd: "
        f"standard deviation of {'X' if plan.setup is not None else 'the worst camera'} along its worst axis, once the "
        f"{_noun(plan)} is taken too. " + _criterion(plan),
    ]
    if len(plan.open_directions):
        notes.append(
            "CAUTION: where X is open, a weak prior stands in for what is not known (standard deviation "
            f"{WEAK_PRIOR_SD:g} rad, {WEAK_PRIOR_SD:g} m), and the camera may miss the target. Take the first pose, "
            "see that the target is in the image, and plan again."
        )
    whose = f"estimated from the {_noun(plan)}s so far" if plan.noise_estimated else "given"
    included = f", and for what all poses share of {', '.join(plan.shared)}" if plan.shared else ""
    if plan.joints is None:
        limits = (
            "Other systematic errors (such as those of the robot's kinematics) are not covered. Reach and obstacles "
            "are not known: look at each pose before you drive there."
        )
    else:
        limits = (
            "The joints are inside their limits and within 180 deg of the joints so far. Obstacles, and the arm itself "
            "in its way, are not known; branches of elbow and wrist may change between poses: look at each pose before "
            "you drive there."
        )
    notes.append(f"Predicted to first order, for the noise {whose}{included}. {limits}")
    return notes


def _criterion(plan: Plan) -> str:
    if plan.length is not None:
        of = "the camera" if len(plan.cameras) == 1 else "each camera"
        what = f"of points {_mm(plan.length)} mm from {of}, in all directions"
    elif plan.point is not None:
        point = ", ".join(f"{1e3 * x:g}" for x in plan.point)
        what = f"of the point ({point}) mm in camera coordinates, in the {plan.frame.split('_T_')[0]} frame"
    elif plan.task is not None:
        where = f"the {len(plan.task)} {'given' if plan.task_given else 'ones spread over the joint limits'}"
        what = f"of where the camera would see the target, at task postures ({where})"
    else:
        return "log det: of the covariance of X (rad, m), which the poses were chosen to make small."
    return f"error: root mean square error {what}, which the poses were chosen to make small."


def _direction(a: Array) -> str:
    turn, shift = np.linalg.norm(a[:3]), np.linalg.norm(a[3:])
    part, what = (a[:3], "rotation about") if turn > shift else (a[3:], "translation along")
    part = part / max(turn, shift)
    part = part if part[np.argmax(np.abs(part))] > 0 else -part
    return f"{what} ({', '.join(f'{x + 0.0:+.2f}' for x in part)})"


def _mm(metres: float) -> str:
    return f"{1e3 * metres:.2f}" if metres < 0.1 else f"{1e3 * metres:.0f}"


def _deg(radians: float) -> str:
    return f"{np.degrees(radians):.3f}" if radians < 0.1 else f"{np.degrees(radians):.0f}"
