r"""Test whether the stored result of a rig still holds, by new views.

The p-value is that of the residuals of the new views, with their covariance if nothing has changed. At the estimates,
with poses corrected by the estimates of the shared errors, the rows of a group (`graph`) are

    rho = J xi + D K (e - estimate) + D eta

xi and e those of the posterior, eta the noise of the new poses, correlated within a group by its robot poses. Rows are
whitened by ``Cov(D eta) = L L^T`` of their group, so that they are independent (`posterior.rows.NewRows`). Directions
that the calibration did not determine are free parameters: their columns are projected out.

All new rows are tested together (`posterior.rows`). Where they contradict the result, each camera and each target is
tried as the one that moved: the move that explains most, if it explains the contradiction, is named with its size.
Whatever the answer, ``detectable`` gives the smallest change of each pose that these views would have shown.

Where the noise was estimated, d^2 is uncertain by a factor that depends on the sizes of all noise: its distribution is
a mixture over their posterior (`evidence`), with 2 / nu the variance of the logarithm of the factor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray

from ...core.files.records import Record
from ...core.formatting.numbers import digits, probability
from ...core.geometry.se3 import Array, perturb
from ...core.numbers.levels import POWER
from ...core.numbers.limits import VISIBLE_CHANGE
from ...core.presentation.document import Answer, Document, Paragraph, Table, document_of
from ...core.presentation.shown import Shown
from ...core.runtime.read_only import ReadOnlyArrays
from ...errors import InputError
from ...fit.one_model.request import Request
from ...model.error_terms.key import ErrorKey
from ...model.error_terms.keys import CLOCK_OFFSET
from ...model.error_terms.sizes import Size
from ...model.error_terms.term import ErrorTerm
from ...model.posterior.posterior import Posterior
from ...model.posterior.rows import NewRows, PredictiveReference, smallest_change
from ...model.shared_errors.view import HALF_WIDTH
from ..declared import request_from_dict
from ..description import ArmPoses, Rig
from ..fit import whitened
from ..graph import Graph
from ..noise import RigNoise, given_covariances, given_key
from ..poses import RigPoses
from ..sizes import ALL_TARGETS, WIDTH, components_of, model_of
from .paths import AS_GOOD_CHI_SQUARE


@dataclass(frozen=True, eq=False)
class RigEvidence(ReadOnlyArrays):
    """New views compared with a calibrated rig: whitened rows, and the columns of the causes."""

    graph: Graph
    rows: NewRows  # (M, 1): one number each, of variance 1
    J: Array  # (M, p) whitened derivatives by the errors of the poses
    edges: NDArray[np.intp]  # (M,) view of each row
    free: Array  # (M, k) whitened columns of what the calibration left open
    weights: Array  # (t,) of points of the open sizes
    scales: Array  # (t,) of d^2 at them

    @property
    def dof(self) -> int:
        """Number of residuals minus that of the open directions."""
        return int(len(self.J) - np.linalg.matrix_rank(self.free)) if self.free.size else len(self.J)

    def moved(self, name: str, of: NDArray[np.bool_] | None = None) -> Array:
        """(M, 1, 6) columns of a move of one unknown pose, in the views ``of`` (E,)."""
        u = self.graph.names.index(name)
        columns = -self.J[:, 6 * u : 6 * u + 6]
        if of is not None:
            columns = columns * of[self.edges][:, None]
        return _without(columns, self.free)[:, None, :]


def like(result: RigPoses, rig: Rig) -> Rig:
    """Return new poses and views as a rig like the calibrated one; raises `InputError` for names it does not have."""
    if not isinstance(rig, Rig):
        raise InputError(f"Expected new views of a rig as a Rig (uq.Rig, uq.read_rig), got {type(rig).__name__}.")
    old = result.rig
    for what in ("cameras", "targets"):
        for name, place in getattr(rig, what).items():
            has = getattr(old, what)
            if name not in has:
                raise InputError(f"The new views name {name!r}; the calibrated rig has {', '.join(has)}.")
            if has[name] != place:
                raise InputError(f"{name!r} is on {place!r} in the new views and was on {has[name]!r} before.")
    if unknown := [name for name in rig.arms if name not in old.arms]:
        raise InputError(f"The new poses are of the arm {unknown[0]!r}; the rig has {', '.join(old.arms)}.")
    arms = {name: arm.like(rig.arms[name]) if name in rig.arms else arm for name, arm in old.arms.items()}
    return Rig(arms, old.cameras, old.targets, rig.views)


def posterior_of(result: RigPoses) -> Posterior:
    """Return the posterior of a result; raises `InputError` where it has none."""
    if result.posterior is None:
        raise InputError("Expected the result of a rig with its posterior. Calibrate again.")
    return result.posterior


def new_noise(result: RigPoses, rig: Rig, graph: Graph) -> RigNoise:
    """Return the noise of new poses and the columns of the shared errors.

    The noise is that of the estimated components at each new pose; where it was given, the mean of each arm and camera.
    """
    posterior = posterior_of(result)
    mean = {one.key: one.covariance for one in posterior.noise}
    own = {"robot": np.zeros((graph.P, 6, 6)), "camera": np.zeros((graph.E, 6, 6))}
    K = {side: np.zeros((*S.shape[:2], len(posterior.keys))) for side, S in own.items()}
    for part in parts_of(result, rig, graph):
        if part.columns is not None and set(part.keys) <= posterior.place.keys():
            K[part.side][:, :, [posterior.place[key] for key in part.keys]] = part.size.median * part.columns
        if part.block is not None and result.components:
            own[part.side] += part.size.median**2 * part.block @ part.block.mT
    for k, name in enumerate([] if result.components else rig.arms):
        own["robot"][graph.arm == k] = mean.get(given_key("robot", name), np.zeros((6, 6)))
    for k, name in enumerate([] if result.components else rig.cameras):
        own["camera"][k == graph.X] = mean.get(given_key("camera", name), 0.0)
    given, some = given_covariances(rig, graph)
    own["camera"][some] = given[some]
    return RigNoise(own["robot"], own["camera"], K["robot"], K["camera"], posterior.keys)


def parts_of(result: RigPoses, rig: Rig, graph: Graph) -> tuple[ErrorTerm, ...]:
    """Return the components of new poses, with the estimated sizes as known ones."""
    lines = {ErrorKey.from_dict(part["key"]): part["size"] for part in result.components}
    keys = posterior_of(result).place.keys()
    if not (lines or keys):
        return ()
    before = result.rig, Graph.of(result.rig)
    request = Request() if result.provenance is None else request_from_dict(result.provenance["request"])
    request = replace(request, shared=[error for error in request.shared or () if error.key.of("") != CLOCK_OFFSET])
    width = lines.get(WIDTH, HALF_WIDTH) / HALF_WIDTH
    found = components_of(rig, graph, True, before, width, request=replace(request, sizes=None, prior=None))
    known = [one for one in found if one.key in lines or set(one.keys) <= keys]
    return tuple(replace(one, size=Size(lines.get(one.key, one.size.median))) for one in known)


def others_of(result: RigPoses, same: Iterable[str] | str | None) -> NDArray[np.bool_]:
    """(q,) shared errors of arms, cameras and targets that are not ``same``: names, or robot, camera, target, none."""
    rig, keys = result.rig, posterior_of(result).keys
    kinds = {"robot": list(rig.arms), "camera": list(rig.cameras), "target": list(rig.targets)}
    things = [name for of in kinds.values() for name in of]
    if same is None:
        return np.zeros(len(keys), dtype=bool)
    given = [part.strip() for part in same.split(",")] if isinstance(same, str) else list(same)
    if given == ["none"]:
        given = []
    kept = {name for part in given for name in kinds.get(part, [part])}
    if unknown := sorted(kept - set(things)):
        listed = ", ".join([*kinds, *things])
        raise InputError(f"Expected `same` (--same) to be names out of {listed}, got {unknown[0]!r}.")
    kept |= {ALL_TARGETS} if set(rig.targets) <= kept else set()
    return np.array([(key.name or key.owner) not in kept for key in keys], dtype=bool)


def evidence_of_views(result: RigPoses, rig: Rig, same: Iterable[str] | str | None = None) -> RigEvidence:
    """Compare new views with the result of a rig; raises `InputError` for views of another rig.

    Errors of arms, cameras and targets that are not the ``same`` are independent, with the estimated size.
    """
    rig = like(result, rig)
    graph = Graph.of(rig)
    noise = new_noise(result, rig, graph)
    posterior = posterior_of(result)
    others = others_of(result, same)
    e = np.where(others, 0.0, posterior.estimate)[:, None]
    robot, C = perturb(graph.robot, -(noise.K_robot @ e)[..., 0]), perturb(graph.C, -(noise.K_camera @ e)[..., 0])
    sides = graph.linearise(result.poses, robot, C)
    ones = np.ones(graph.E), np.ones(graph.P)
    white, edges, halves = [], [], []
    for batch in graph.batches:
        part = whitened(graph, batch, sides, noise, *ones, None)
        halves.append(part.half)
        white.append(part.white.reshape(-1, part.white.shape[-1]))
        edges.append(np.repeat(batch.edges.reshape(-1), 6))
    flat = np.concatenate(white)
    J = flat[:, : graph.p]
    free = J @ result.open.T
    kept = _without(flat, free)
    by_state = kept[:, :-1]
    anew = by_state[:, graph.p :][:, others]
    by_state[:, graph.p + np.flatnonzero(others)] = 0.0
    by_unit = np.concatenate([by_state @ posterior.A, anew], axis=1)
    rows = NewRows(kept[:, -1:], by_unit[:, None], np.ones((len(kept), 1, 1)), posterior)
    scales = _scales(result, rig, graph, halves, by_unit)
    weights = result.size_weights if len(scales) > 1 else np.ones(1)
    return RigEvidence(graph, rows, J, np.concatenate(edges), free, weights, scales)


def _scales(result: RigPoses, rig: Rig, graph: Graph, halves: list[Array], V: Array) -> Array:
    """Mean of d^2 over its k numbers at each point of the uncertain sizes; it is 1 at the sizes of the noise used.

    With ``Sigma = 1 + V V^T`` of the whitened rows and T_c the part of component c in the 1, it is ``1 + sum_c
    (exp(2 delta_c) - 1) tr(Sigma^-1 T_c) / k``, delta_c the logarithm of the size of c at the point minus the one used.
    """
    lines = {ErrorKey.from_dict(part["key"]): part["logs"] for part in result.components if "logs" in part}
    parts = tuple(one for one in parts_of(result, rig, graph) if one.block is not None and one.key in lines)
    if not parts:
        return np.ones(1)
    M = np.linalg.inv(np.eye(V.shape[1]) + V.T @ V)
    g, start = np.zeros(len(parts)), 0
    for rows, half in zip(model_of(rig, graph, parts, result.poses, None).groups, halves, strict=True):
        b, d = rows.r.shape
        V_i = V[start : start + b * d].reshape(b, d, -1)
        start += b * d
        for c, B in rows.blocks.items():
            T = parts[c].size.median ** 2 * (half @ B @ half.mT)
            g[c] += float(np.einsum("bii->", T) - np.einsum("bki,ij,bkj->", T @ V_i, M, V_i, optimize=True))
    return np.asarray(1.0 + g / len(V) @ np.expm1(2.0 * np.array([lines[one.key] for one in parts])))


def joined(old: Rig, new: Rig) -> Rig:
    """Return a rig with the views of both; robot poses of one name must be the same."""
    arms = {name: _joined(arm, new.arms[name]) for name, arm in old.arms.items()}
    return replace(old, arms=arms, views=(*old.views, *new.views))


def _joined(one: ArmPoses, two: ArmPoses) -> ArmPoses:
    return one if two is one else one.joined(two)


def _without(columns: Array, free: Array) -> Array:
    """Columns (M, c) with what lies in the span of others (M, k) taken away."""
    if not free.shape[1]:
        return columns
    Q, R = np.linalg.qr(free)
    Q = Q[:, np.abs(np.diag(R)) > 1e-9 * max(float(np.abs(R).max(initial=0.0)), 1e-300)]
    return np.asarray(columns - Q @ (Q.T @ columns))


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
        Moved: one pose explains it. Changed: no single pose does. Cannot tell: the views agree, and would agree with a
        change of a camera that matters.
    p_value, d2 : float
        Of all new views, if nothing has changed.
    dof, count : int
        Degrees of freedom of d2; number of views.
    noise_dof : float or None
        Degrees of freedom of the noise, where it was estimated.
    moves : tuple of RigMove
        Every camera, target and base that was seen, that which explains most first; with the smallest change of it that
        shows with 95 % probability.
    views : dict
        p-value of the views of each pair of camera and target, by "camera, target".
    unseen : tuple of str
        Cameras and targets of the rig without a new view, which are not checked.
    limits : (translation (m), rotation (rad))
        Change of a camera that must show.
    """

    _in_file: ClassVar[str] = (
        "format=_format status changed p_value d2 dof count level noise_dof moves views unseen limits cause sentence"
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

    @property
    def _format(self) -> str:
        return FORMAT

    @property
    def changed(self) -> bool:
        """True if the new views contradict the result."""
        return self.status in (MOVED, CHANGED)

    @property
    def cause(self) -> str | None:
        """Name of the camera, target or base that moved, where one pose explains the change."""
        return self.moves[0].name if self.status == MOVED else None

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
            near = [
                one.name for one in self.moves[1:] if one.chi_square > self.moves[0].chi_square - AS_GOOD_CHI_SQUARE
            ]
            others = f" As likely: {', '.join(near)}." if near else ""
            return f"MOVED: {self.moves[0]} ({said}).{others} Calibrate it again."
        return f"CHANGED: the {self.count} new views contradict the calibration; no single move explains it ({said})."

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
    return [[Answer(check.sentence, _STATUS[check.status]), *unseen],
            [Table(caption, head, rows, frozenset({5}))], [pairs]]  # fmt: skip


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
    needed = reference.noncentrality(POWER.probability, level)
    moves = sorted((_move(found, name, d2, needed) for name in _seen(found)), key=lambda one: -one.chi_square)
    status = UNCHANGED
    if p < level:
        status = MOVED if moves and moves[0].p * len(moves) < level and moves[0].left > 0.01 * level else CHANGED
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
    return RigCheck(status, p, d2, found.dof, found.graph.E, level, tuple(moves), views, unseen, limits, nu)


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
