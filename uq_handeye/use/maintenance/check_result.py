r"""Result of `check` and its text: whether a calibration still holds, and if not, what has changed.

*The smallest change that would have shown*: power of the chi-square test of the posterior (`posterior.rows`). A change
a of columns C, ``E r = C a``, has the noncentrality ``a^T I a``, ``I = C^T Sigma^-1 C``. With lambda the noncentrality
that is detected with probability 95 %, the smallest shift (or rotation by itself) that shows in every direction is
``sqrt(lambda / min eigenvalue of I)`` of its block of I.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...core.files.records import Record
from ...core.formatting.numbers import concise, digits, plus_minus, probability
from ...core.geometry.se3 import Array
from ...core.numbers.levels import POWER
from ...core.presentation.document import COLUMNS, Answer, Block, Paragraph, document_of
from ...core.presentation.shown import Shown
from ...findings import Finding
from ...model.posterior.rows import PredictiveReference, smallest_change
from .causes import CAMERA_MOVED, FOCAL_LENGTH, IMAGE_CENTRE, ONE_POSE, TARGET_MOVED, TARGET_SIZE, Cause, Causes
from .misread import MISREAD

UNCHANGED, CHANGED, CANNOT_TELL = "unchanged", "changed", "cannot tell"


@dataclass(frozen=True, eq=False)
class ChangeCheck(Record, Shown):
    """The answer of `check`. ``str(check)`` is its text.

    Attributes
    ----------
    status : "unchanged", "changed" or "cannot tell"
    p_value : float
        Probability of poses that contradict the calibration at least as much, if nothing has changed.
    d2, dof : float and int
        Squared distance of the new poses from the calibration, of ``dof`` numbers.
    noise_dof : float or None
        Degrees of freedom of the noise, where the calibration estimated it; None: given.
    detectable : Detectable
        Smallest change that these poses would have shown with 95 % probability.
    causes : Causes
        Each cause by itself, with its estimate, and which of them can be separated.
    shift : (6,)
        How X moved (W, where `shift_of` is "W"): (theta, tau) of the new pose relative to the old one, rad and m, left
        rotation and additive translation in its parent frame.
    covariance : (6, 6)
        Of `shift`, with the uncertainty of the calibration.
    shift_of : "X" or "W"
    distances : (m,)
        Squared distance of each pose from what the others and the calibration predict; 6 on average.
    findings : tuple of Finding
    level : float
        Probability of a false alarm.
    n_poses, n_calibrated : int
        New poses, and those of the calibration (None: not stored).
    tolerance : str or None
        Change that matters, as given.
    focal_length_px : float or None
        In which an image centre is printed.
    """

    columns = COLUMNS
    _in_file: ClassVar[str] = (
        "format status changed p_value d2 dof noise_dof level setup n_poses n_calibrated tolerance detectable cause "
        "candidates causes=causes.all shift_of shift covariance distances findings sentences"
    )
    format: ClassVar[str] = "uq-handeye check 1"

    status: str
    p_value: float
    d2: float
    dof: int
    noise_dof: float | None
    level: float
    detectable: Detectable
    causes: Causes
    shift: Array
    covariance: Array
    shift_of: str
    distances: Array
    findings: tuple[Finding, ...]
    setup: str
    n_poses: int
    n_calibrated: int | None
    tolerance: str | None = None
    focal_length_px: float | None = None

    @property
    def changed(self) -> bool:
        """True if something has changed."""
        return self.status == CHANGED

    @property
    def cause(self) -> str | None:
        """Name of the cause, where it can be separated: "X", "target", "focal length" or "target size"; else None.

        "X" and "target" each stand for two things that no pose can separate: see `causes`. The image centre is the
        same as a camera that rotated, and only among `candidates`.
        """
        named = self.causes.named
        return named.name if self.changed and named is not None else None

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of the causes that cannot be separated from the most probable one, with it; empty if unchanged."""
        if not self.changed or not self.causes.explained:
            return ()
        return tuple(cause.name for cause in self.causes.candidates)

    @property
    def std(self) -> Array:
        """(6,) standard deviations of `shift`, rad and m."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def sentences(self) -> list[str]:
        """The findings in words."""
        return [str(finding) for finding in self.findings]

    __str__ = Shown.summary


@dataclass(frozen=True)
class Detectable(Record):
    """Smallest shifts (m) and rotations (rad) of X and of W that show in every direction with probability ``power``.

    Rotations are about the origin of the pose. Infinite: not at all.
    """

    X_translation: float
    X_rotation: float
    W_translation: float
    W_rotation: float
    power: float
    level: float


def detectable_changes(of_X: Array, of_W: Array, reference: PredictiveReference, level: float) -> Detectable:
    """Build it from the information (6, 6) of changes of X and of W."""
    noncentrality = reference.noncentrality(POWER.probability, level)
    return Detectable(
        *smallest_change(of_X, noncentrality),
        *smallest_change(of_W, noncentrality),
        power=POWER.probability,
        level=level,
    )


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
    if result.changed:
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
    if {cause.name for cause in result.causes.candidates} & set(_WAYS):
        return "measure the target; if it is as large as before, calibrate the camera again, then X."
    return None if result.n_poses < 3 else "calibrate again."
