"""Test whether the stored result of a rig still holds, by new views.

The p-value is that of the residuals of the new views, with their covariance if nothing has changed
(`calibration.evidence.new_views`). All new rows are tested together (`posterior.rows`), and a move of each pose by its
own chi-square: that of a single pose is lost among the residuals of many views. Each of the two tests has half of the
probability of a false alarm, that of the moves divided by their number (Bonferroni). Where the views contradict the
result, every camera, target and base is tried as the one that moved, every camera as one whose focal length or image
centre changed, every target as one of another size, and the view that fits least as the only wrong one. Their
probabilities are those of a lab (`causes`). Whatever the answer, the smallest change of each pose that these views
would have shown is given.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from ...calibration.estimate.rig_poses import RigPoses
from ...calibration.evidence.new_views import RigEvidence, evidence_of_views
from ...core.files.records import Record
from ...core.formatting.numbers import concise, digits, probability
from ...core.geometry.se3 import Array
from ...core.numbers.levels import POWER
from ...core.numbers.limits import VISIBLE_CHANGE
from ...core.presentation.document import Answer, Block, Document, Paragraph, Points, Table, document_of
from ...core.presentation.shown import Shown
from ...errors import InputError
from ...model.poses.pose_pairs import PosePairs
from ...model.posterior.rows import PredictiveReference, smallest_change
from ...model.rig.description import Rig
from ...model.shared_errors.shared_error import SharedError
from .causes import (
    CAMERA_MOVED,
    FOCAL_LENGTH,
    IMAGE_CENTRE,
    ONE_POSE,
    TARGET_MOVED,
    TARGET_SIZE,
    Candidate,
    Cause,
    Causes,
    compare_candidates,
)

UNCHANGED, MOVED, CHANGED, CANNOT_TELL = "unchanged", "moved", "changed", "cannot tell"
_STATUS = {UNCHANGED: "ok", MOVED: "failed", CHANGED: "failed", CANNOT_TELL: "caution"}
FORMAT = "uq-handeye rig check 1"


@dataclass(frozen=True, eq=False)
class RigMove(Record):
    """One pose that may have moved: its chi-square, size (rad, m) and the probability of it if nothing moved."""

    name: str
    chi_square: float
    angle: float
    shift: float
    p: float
    left: float  # p-value of the rest with this move
    least_angle: Annotated[float, ">= 0"]  # that shows in every direction (rad); infinite: none does
    least_shift: Annotated[float, ">= 0"]  # m
    estimate: tuple[float, ...] = ()  # (theta, tau) of the new pose against the old one, rad and m
    std: tuple[float, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}: by {digits(np.degrees(self.angle), 2)} deg and {digits(1e3 * self.shift, 2)} mm"


@dataclass(frozen=True, eq=False)
class RigCheck(Record, Shown):
    """Result of a check. ``str(check)`` is its text.

    Attributes
    ----------
    status : "unchanged", "moved", "changed" or "cannot tell"
        Moved: the move of one pose explains it, and is the most probable cause. Changed: another cause is, or none
        explains it. Cannot tell: the views agree, and would agree with a change of a camera that matters.
    p_value, d2 : float
        Of all new views, if nothing has changed.
    dof, count : int
        Degrees of freedom of d2; number of views.
    noise_dof : float or None
        Degrees of freedom of the noise, where it was estimated.
    moves : tuple of RigMove
        Every camera, target and base that was seen, that which explains most first; with the smallest change of it that
        shows with 95 % probability.
    causes : tuple of Cause
        Where the views contradict the result: each cause by itself, the most probable first; ``of`` names the part.
    views : dict
        p-value of the views of each pair of camera and target, by "camera, target".
    unseen : tuple of str
        Cameras and targets of the rig without a new view, which are not checked.
    limits : (translation (m), rotation (rad))
        Change of a camera that must show.
    """

    _in_file: ClassVar[str] = (
        "format=_format status changed p_value d2 dof count level noise_dof moves causes views unseen limits cause "
        "sentence"
    )

    status: str
    p_value: float
    d2: float
    dof: int
    count: int
    level: float
    moves: tuple[RigMove, ...]
    views: dict[str, float]
    unseen: tuple[str, ...] = ()
    limits: tuple[float | None, float | None] = (None, None)
    noise_dof: float | None = None
    causes: tuple[Cause, ...] = ()

    @property
    def _format(self) -> str:
        return FORMAT

    @property
    def changed(self) -> bool:
        """True if the new views contradict the result."""
        return self.status in (MOVED, CHANGED)

    @property
    def cause(self) -> str | None:
        """Name of the camera, target or base that moved, where the move of one pose explains the change."""
        return self.causes[0].of if self.status == MOVED else None

    @property
    def candidates(self) -> tuple[Cause, ...]:
        """The most probable cause with those that cannot be separated from it; empty where none explains the change."""
        found = Causes(self.causes) if self.causes else None
        return () if found is None or not found.explained else found.candidates

    @property
    def sentence(self) -> str:
        """The answer in one or two sentences."""
        said = f"chi-square {self.d2:.0f} of {self.dof}, {probability(self.p_value)}"
        agree = f"the {self.count} new views agree with the calibration ({said})"
        if self.status == UNCHANGED:
            return f"UNCHANGED: {agree}."
        if self.status == CANNOT_TELL:
            worst = max(self.moves, key=lambda one: one.least_shift)
            return f"CANNOT TELL: {agree}, but would miss a change of {worst.name} below {_least(worst)}."
        if self.status == MOVED:
            moved = next(one for one in self.moves if one.name == self.cause)
            by_move = f"chi-square {moved.chi_square:.0f} of 6, {probability(moved.p)}"
            return f"MOVED: {moved} ({by_move}). Calibrate it again."
        if self.candidates:
            return f"CHANGED: {cause_of_part(self.candidates[0])} ({said})."
        return f"CHANGED: the {self.count} new views contradict the calibration; no single cause explains it ({said})."

    __str__ = Shown.summary


@document_of.register
def check_document(check: RigCheck) -> Document:
    """Return the answer, the causes with the smallest change that shows, and the views."""
    head = ["moved", "chi-square", "rotation (deg)", "position (mm)", "rest", "shows from"]
    rows = [[one.name, f"{one.chi_square:.1f}", f"{np.degrees(one.angle):.4f}", f"{1e3 * one.shift:.3f}",
             probability(one.left), _least(one)] for one in check.moves]  # fmt: skip
    caption = (
        "Each pose as the one that moved; rest: probability of the other views; the smallest change that shows (95 %)."
    )
    pairs = Table("Views by themselves.", ["camera, target", "probability"],
                  [[pair, probability(p)] for pair, p in check.views.items()])  # fmt: skip
    unseen = [Paragraph(f"Not seen, so not checked: {', '.join(check.unseen)}.")] if check.unseen else []
    several = check.candidates if len(check.candidates) > 1 else ()
    causes: list[Block] = [Paragraph("Causes that these views cannot separate, with probabilities:")] if several else []
    causes += [Points([f"{100 * one.probability:.0f} %: {cause_of_part(one)}" for one in several])] if several else []
    return [[Answer(check.sentence, _STATUS[check.status]), *causes, *unseen],
            [Table(caption, head, rows, frozenset({5}))], [pairs]]  # fmt: skip


def cause_of_part(cause: Cause) -> str:
    """Return a cause of a rig in words, with its size."""
    of, size = cause.of, cause.estimate
    if cause.name == ONE_POSE:
        return f"only the view {of} is wrong"
    if cause.name == IMAGE_CENTRE:
        return f"the image centre of {of} changed (the same as a camera rotated about its own x and y axes)"
    if cause.name in (FOCAL_LENGTH, TARGET_SIZE):
        what, larger = (
            ("the focal length", ("shorter", "longer"))
            if cause.name == FOCAL_LENGTH
            else ("the size", ("smaller", "larger"))
        )
        sd = float(np.sqrt(cause.covariance[0, 0]))
        by = concise(100 * abs(float(size[0])), 100 * sd, "%")
        return f"{what} of {of} is {by} {larger[int(size[0] > 0)]}"
    shift, angle = (float(np.linalg.norm(part)) for part in (size[3:], size[:3]))
    return f"{of} moved by {digits(np.degrees(angle), 2)} deg and {digits(1e3 * shift, 2)} mm"


def _least(one: RigMove) -> str:
    shift = f"{digits(1e3 * one.least_shift, 2)} mm" if np.isfinite(one.least_shift) else "no translation"
    turn = f"{digits(float(np.degrees(one.least_angle)), 2)} deg" if np.isfinite(one.least_angle) else "no rotation"
    return f"{shift} or {turn}"


def check_rig(
    result: RigPoses,
    rig: Rig,
    *,
    level: float = 0.05,
    tolerance: tuple[float | None, float | None] | None = None,
    same: Iterable[str] | str | None = None,
) -> RigCheck:
    """Test whether a calibrated rig still holds.

    Parameters
    ----------
    result : RigCalibration
    rig : Rig
        New robot poses and views, with names and carriers of the calibrated rig; some of its parts may be missing.
    level : float
        Probability of a false alarm.
    tolerance : (translation (m), rotation (rad)) or None
        Change of a camera that must show; None: 1 % of the median distance of the targets, and 0.01 rad.
    same : names of arms, cameras and targets, or None
        Which of them are those of the calibration, so that their errors are the same; also robot, camera and target for
        all of a kind, or none. None: all.

    Raises
    ------
    InputError
        Names or carriers that the calibrated rig does not have, a level that is no probability.
    """
    if not 0 < level < 1:
        raise InputError(f"Expected `level` between 0 and 1, got {level!r}.")
    found = evidence_of_views(result, rig, same)
    limits = _limits(tolerance, rig)
    d2, reference = found.rows.d2, _reference(found, found.dof)
    p = reference.p_value(d2)
    names = _seen(found)
    of_all, of_move = level / 2, level / 2 / len(names)
    needed = min(
        reference.noncentrality(POWER.probability, of_all),
        _reference(found, 6).noncentrality(POWER.probability, of_move),
    )
    moves = sorted((_move(found, name, d2, needed) for name in names), key=lambda one: -one.chi_square)
    status, causes = UNCHANGED, tuple[Cause, ...]()
    if p < of_all or min(one.p for one in moves) < of_move:
        compared = compare_candidates(found.rows, _candidates(result, rig, found), reference, found.dof)
        causes, first = compared.all, compared.candidates[0]
        is_move = first.name in (CAMERA_MOVED, TARGET_MOVED)
        status = MOVED if is_move and first.explains else CHANGED
    elif any(
        limit is not None and not least <= limit
        for one in moves if one.name in result.rig.cameras
        for least, limit in zip((one.least_shift, one.least_angle), limits, strict=True)
    ):  # fmt: skip
        status = CANNOT_TELL
    pairs = dict.fromkeys((view.camera, view.target) for view in rig.views)
    views = {f"{camera}, {target}": _of_pair(found, rig, camera, target) for camera, target in pairs}
    seen = {one.name for one in moves}
    unseen = tuple(name for name in (*result.rig.cameras, *result.rig.targets) if name not in seen)
    nu = None if reference.noise_given else reference.noise_dof
    return RigCheck(status, p, d2, found.dof, found.graph.E, level, tuple(moves), views, unseen, limits, nu, causes)


def _candidates(result: RigPoses, rig: Rig, found: RigEvidence) -> list[Candidate]:
    """Return the causes of each camera, target and base that was seen, and the view that fits least as a wrong one."""
    graph, candidates = found.graph, list[Candidate]()
    pairs = PosePairs(np.broadcast_to(np.eye(4), graph.C.shape), graph.C, "eye-in-hand")
    F_focal, F_centre, F_size = (
        error.at(pairs)
        for error in (SharedError.focal_length(1.0), SharedError.principal_point(1.0), SharedError.target_scale(1.0))
    )
    for name in _seen(found):
        u = graph.names.index(name)
        axes, columns = result.poses[u][:3, :3], found.moved(name)
        if name in rig.cameras:
            of = np.equal(graph.X, u)[:, None, None]
            candidates += [
                Candidate(CAMERA_MOVED, columns, axes, of=name),
                Candidate(FOCAL_LENGTH, found.changed(F_focal * of), of=name),
                Candidate(IMAGE_CENTRE, found.changed(F_centre * of), of=name),
            ]
        else:
            candidates.append(Candidate(TARGET_MOVED, columns, axes, of=name))
            if name in rig.targets:
                size = found.changed(F_size * np.equal(graph.W, u)[:, None, None])
                candidates.append(Candidate(TARGET_SIZE, size, of=name))
    if graph.E >= 3:  # one wrong view can be separated from a change
        candidates.append(_wrong_view(rig, found))
    return candidates


def _wrong_view(rig: Rig, found: RigEvidence, tried: int = 12) -> Candidate:
    """Return the view that explains most as the only wrong one, of those ``tried`` whose residuals are largest."""
    graph = found.graph
    squares = np.bincount(found.edges, found.rows.r[:, 0] ** 2, graph.E)

    def columns(e: int) -> Array:
        F = np.zeros((graph.E, 6, 6))
        F[e] = np.eye(6)
        return found.changed(F)

    most = np.argsort(-squares)[:tried].tolist()
    worst = max(most, key=lambda e: found.rows.explained_by(columns(e)).gain)
    view = rig.views[graph.view[worst]]
    at = "" if view.at is None else f" at robot pose {view.at[graph.row[worst]]}"
    return Candidate(ONE_POSE, columns(worst), choices=graph.E, of=f"of {view.target} by {view.camera}{at}")


def _limits(tolerance: tuple[float | None, float | None] | None, rig: Rig) -> tuple[float | None, float | None]:
    if tolerance is None:
        distances = [np.linalg.norm(view.poses[:, :3, 3], axis=1) for view in rig.views]
        return VISIBLE_CHANGE * float(np.median(np.concatenate(distances))), VISIBLE_CHANGE
    translation, rotation = tolerance
    return translation, rotation


def _seen(found: RigEvidence) -> list[str]:
    """Names of the poses that the new views depend on."""
    graph = found.graph
    numbers = np.unique(np.concatenate([graph.X, graph.W, *graph.base]))
    return [graph.names[k] for k in numbers.tolist() if k < graph.m]


def _move(found: RigEvidence, name: str, d2: float, needed: float) -> RigMove:
    columns = found.moved(name)
    cause = found.rows.explained_by(columns)
    rank = int(np.linalg.matrix_rank(cause.covariance, hermitian=True)) if cause.gain > 0 else 0
    angle, shift = (float(np.linalg.norm(part)) for part in (cause.estimate[:3], cause.estimate[3:]))
    left = _reference(found, max(found.dof - rank, 1)).p_value(max(d2 - cause.gain, 0.0))
    p = _reference(found, max(rank, 1)).p_value(cause.gain)
    least_shift, least_angle = smallest_change(found.rows.information(columns), needed)
    std = np.sqrt(np.maximum(np.diag(cause.covariance), 0.0))
    return RigMove(name, cause.gain, angle, shift, p, left, least_angle, least_shift,
                   tuple(cause.estimate.tolist()), tuple(std.tolist()))  # fmt: skip


def _of_pair(found: RigEvidence, rig: Rig, camera: str, target: str) -> float:
    """p-value of the views of one pair by themselves."""
    views = [k for k, view in enumerate(rig.views) if (view.camera, view.target) == (camera, target)]
    of = np.isin(found.graph.view, views)[found.edges]
    some = found.rows.rows(of)
    return _reference(found, int(of.sum())).p_value(some.d2)


def _reference(found: RigEvidence, size: int) -> PredictiveReference:
    """Distribution of d^2 of ``size`` numbers, at the points of the sizes of the noise."""
    return PredictiveReference(size, found.weights, found.scales, np.full(len(found.scales), float(size)))
