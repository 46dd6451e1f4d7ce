"""A plan of further poses: what they would bring and where they are, also in words, units on every number."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.files.csv_text import csv_text
from ...core.files.records import attributes
from ...core.geometry.conventions import CONVENTION
from ...core.geometry.frames import SETUPS
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.presentation.document import Document, Paragraph, Table, document_of
from ...core.presentation.shown import Shown
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...formats.controllers.forms import CONTROLLERS
from ...formats.controllers.written import SINGLE, WRITTEN, columns, in_form, written_poses
from ...model.noise.models import PoseNoise
from ...read import pose_text, write_atomically
from .weak_prior import PRIOR

# Formats in which several poses can be written.
FORMS = tuple(name for name in WRITTEN if name not in SINGLE)


@dataclass(frozen=True, eq=False)
class Plan(ReadOnlyArrays, Shown):
    """The next k poses in the order in which to take them, and the covariance of X predicted after each.

    Predicted to first order, for the noise and the shared errors that are named; nothing else that is systematic.
    """

    chosen: NDArray[np.intp]  # (k,) rows of the candidates, from 0
    robot: Array  # (k, 4, 4) base_T_gripper
    camera: Array  # (k, 4, 4) camera_T_target that the camera should see there
    covariance_before: Array  # (6, 6) of X from the poses so far
    covariances: Array  # (k, 6, 6) of X after each
    criterion: str
    criterion_before: float
    criterion_values: Array  # (k,) after each: m^2, or the logarithm of rad^6 m^6
    length: float | None  # m, of criterion trace
    point: Array | None  # (3,) m, camera coordinates, of criterion point
    X: Array  # (4, 4) from the poses so far
    W: Array  # (4, 4)
    setup: str
    n_poses: int  # so far
    n_candidates: int
    sampled: bool  # the candidates were drawn, not given
    noise: PoseNoise  # 6x6, of each new pose
    noise_estimated: bool  # from the poses so far
    open_directions: Array  # (r, 6) unit vectors of xi_X/prior that the poses so far leave to the weak prior
    shared: tuple[str, ...] = ()  # errors that all poses share, also the new ones, by name
    joints: Array | None = None  # (k, L) rad, m, where the plan is one of joints
    joint_names: tuple[str, ...] = ()  # (L)
    joint_units: tuple[str, ...] = ()  # (L) rad or m
    joint_noise: float = 0.0  # rad, of each joint of each new pose
    task: Array | None = None  # (t, L) joints at which predictions are to be good, of criterion prediction
    task_given: bool = False  # or spread over the joint limits
    form: str | None = None  # a name of `FORMS`: how the robot's poses are written; None: m and quaternion

    @property
    def frame(self) -> str:
        """``gripper_T_camera`` or ``base_T_camera``."""
        return SETUPS[self.setup]

    @property
    def std(self) -> Array:
        """Standard deviations (k + 1, 6) of (theta, tau), rad and m: before, and after each pose."""
        return np.sqrt(np.diagonal(self._all(), axis1=-2, axis2=-1))

    @property
    def worst(self) -> Array:
        """Standard deviations (k + 1, 2) of rotation (rad) and translation (m) along their worst axes."""
        blocks = self._all()
        largest = [np.linalg.eigvalsh(part)[:, -1] for part in (blocks[:, :3, :3], blocks[:, 3:, 3:])]
        return np.sqrt(np.stack(largest, axis=1))

    def _all(self) -> Array:
        return np.concatenate([self.covariance_before[None], self.covariances])

    def __repr__(self) -> str:
        return f"Plan({len(self.chosen)} poses after {self.n_poses}, criterion {self.criterion})"

    @property
    def unfolded(self) -> int:
        """The sentence and the table."""
        return 2

    @property
    def prior_std(self) -> float | None:
        """Standard deviation (rad, m) of the weak prior, where there is one."""
        return PRIOR if len(self.open_directions) else None

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, lists and text."""
        named = attributes(
            self,
            "frame setup n_poses n_candidates sampled noise noise_estimated shared X W criterion length point "
            "prior_std open_directions",
        )
        if self.joints is not None:
            named |= attributes(self, "joint_names joint_units joint_noise")
            named["task"] = self.task.tolist() if self.task is not None and self.task_given else None
        where = [
            {"candidate": row, **({} if self.joints is None else {"joints": self.joints[k].tolist()})}
            | {"robot": self.robot[k].tolist(), "camera": self.camera[k].tolist()}
            for k, row in enumerate(self.chosen.tolist())
        ]
        after = [
            {
                "covariance": S.tolist(), "std": std.tolist(), "worst_rotation": float(worst[0]),
                "worst_translation": float(worst[1]), "criterion": float(value),
            }
            for S, std, worst, value in zip(
                self._all(), self.std, self.worst, [self.criterion_before, *self.criterion_values], strict=True
            )
        ]  # fmt: skip
        steps = [place | numbers for place, numbers in zip(where, after[1:], strict=True)]
        about = {"format": "uq-handeye plan 1", "convention": CONVENTION,
                 "units": {"rotation": "rad", "translation": "m"}}  # fmt: skip
        return about | named | {"before": after[0], "steps": steps}

    def to_csv(self, path: str | Path | None = None) -> str:
        """The robot poses as a pose file (m), in order, numbered 0, 1, ...; also written to ``path``.

        A plan of joints is a file of joints (rad, m) under their names, as `kinematics.joints_file` reads.
        """
        if self.joints is None:
            text = pose_text(self.robot)
        else:
            head = [f"{name} [{unit}]" for name, unit in zip(self.joint_names, self.joint_units, strict=True)]
            text = csv_text([head, *([f"{value:.9g}" for value in q] for q in self.joints)])
        if path is not None:
            write_atomically(path, text)
        return text

    def to_controller(self, path: str | Path | None = None) -> str:
        """The robot poses as the controller of `form` writes them (P1, P2, ...), or as matrices; also to ``path``.

        Raises `InputError` without a form.
        """
        if self.form is None:
            raise InputError("The plan has no form of a controller. Read the poses by `format`, or name one (--as).")
        maker = CONTROLLERS.get(self.form)
        writer = f"as {maker.maker} writes them" if maker is not None else f"in the format {self.form}"
        comment = f"The next poses of the robot (base_T_gripper) in order, {writer}."
        names = [f"P{k}" for k in range(1, len(self.robot) + 1)]
        text = written_poses(self.robot, self.form, names, [comment])
        if path is not None:
            write_atomically(path, text)
        return text


# Letters of the longest name of a joint that heads a column; columns of a pose.
WIDEST, _POSE = 8, ("x", "y", "z", "qx", "qy", "qz", "qw")


@document_of.register(Plan)
def plan_document(plan: Plan) -> Document:
    """A sentence, a table, and what the numbers mean."""
    return [Paragraph(headline(plan)), _table(plan), [Paragraph(note) for note in _notes(plan)]]


def headline(plan: Plan) -> str:
    """State in one sentence or two what the poses would bring."""
    k = len(plan.chosen)
    before, after = plan.worst[0], plan.worst[-1]
    poses = f"{k} more {'pose' if k == 1 else 'poses'} would bring"
    if len(plan.open_directions):
        parent = plan.frame.split("_T_")[0]
        what = " and ".join(_direction(a) for a in plan.open_directions)
        return (
            f"The {plan.n_poses} poses so far leave {plan.frame} open: {what} of the {parent} frame. {poses} its "
            f"translation to {_mm(after[1])} mm, its rotation to {_deg(after[0])} deg (standard deviation, worst axis)."
        )
    return (
        f"{poses} the translation of {plan.frame} from {_mm(before[1])} to {_mm(after[1])} mm and its rotation from "
        f"{_deg(before[0])} to {_deg(after[0])} deg (standard deviation, worst axis)."
    )


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
    """Columns of the poses or joints: names, units, texts; joints are q1, q2, ... where their names are too long."""
    if plan.joints is not None:
        short = max(map(len, plan.joint_names)) <= WIDEST
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
        names, units, digits = list(_POSE), ["mm"] * 3 + [""] * 4, [1] * 3 + [4] * 4
        quaternions = Rotation.from_matrix(plan.robot[:, :3, :3]).as_quat(canonical=True)
        values = np.concatenate([1e3 * plan.robot[:, :3, 3], quaternions], axis=1)
    rows = [[f"{x:.{k}f}" for x, k in zip(row, digits, strict=True)] for row in values.tolist()]
    return names, units, rows


def _numbers(plan: Plan, worst: Array, value: float) -> list[str]:
    return [_deg(worst[0]), _mm(worst[1]), f"{value:.2f}" if plan.criterion == "logdet" else _mm(float(np.sqrt(value)))]


def _notes(plan: Plan) -> list[str]:
    origin = "drawn around the target" if plan.sampled else "given"
    form, (names, *_) = CONTROLLERS.get(plan.form or ""), _places(plan)
    what = f"{names[0]} to {names[-1]}: "
    if plan.joints is not None:
        what += f"joints {', '.join(plan.joint_names)}"
    else:
        what += "base_T_gripper" if form is None else f"base_T_gripper as {form.maker} writes it"
    notes = [
        f"candidate: row among the {plan.n_candidates} candidates {origin}, from 0. {what}. sd: "
        "standard deviation of X along its worst axis, once the pose is taken too. " + _criterion(plan),
    ]
    if len(plan.open_directions):
        notes.append(
            "CAUTION: where X is open, a weak prior stands in for what is not known (standard deviation "
            f"{PRIOR:g} rad, {PRIOR:g} m), and the camera may miss the target. Take the first pose, see that the "
            "target is in the image, and plan again."
        )
    whose = "estimated from the poses so far" if plan.noise_estimated else "given"
    included = f", and for what all poses share of {', '.join(plan.shared)}" if plan.shared else ""
    if plan.joints is None:
        limits = (
            "Other systematic errors (such as those of the robot's kinematics) are not covered. Reach and obstacles "
            "are not known: look at each pose before you drive there."
        )
    else:
        limits = (
            "The joints are inside their limits. Obstacles, and the arm itself in its way, are not known; branches of "
            "elbow and wrist may change between poses: look at each pose before you drive there."
        )
    notes.append(f"Predicted to first order, for the noise {whose}{included}. {limits}")
    return notes


def _criterion(plan: Plan) -> str:
    if plan.length is not None:
        what = f"of points {_mm(plan.length)} mm from the camera, in all directions"
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
