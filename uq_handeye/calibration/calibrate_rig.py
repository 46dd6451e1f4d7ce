"""Calibration of a rig: check that its poses are connected, then start, noise, weights, fit and result."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.files.source import versions
from ..core.geometry.se3 import Array
from ..core.memory import FEWER_POSES, require_memory
from ..core.threads import one_thread
from ..errors import InputError, NotConvergedError, require_one_of, require_type
from ..findings import Finding
from ..fit.diagnostics.optimality import Optimality, better_start, prove
from ..fit.diagnostics.paths import judged_paths, named_error
from ..fit.diagnostics.prior_check import prior_findings
from ..fit.diagnostics.sandwich import Influence
from ..fit.diagnostics.scales import wrong_size
from ..fit.graph.constraint import MIN_RESOLVED_SHARE
from ..fit.graph.declared import declared_of, request_to_dict
from ..fit.graph.drifts import DRIFT_KINDS, MAX_REMAINING_BESIDE_DRIFT, motion_in_session, with_usual_drift
from ..fit.graph.fit import MAX_NOISE_RAD, RigFit, Shared, Task, Weights, fit, onto_closed, prior_at, rig_units
from ..fit.graph.noise import RigNoise, given_noise
from ..fit.graph.posterior import Posterior
from ..fit.graph.reference import Reference
from ..fit.graph.request import Request
from ..fit.graph.sizes import SHARED, Found, components_of, find_sizes, width_of_targets
from ..fit.graph.start import agreeing, start_of
from ..fit.graph.weights import Distances, distances, fit_robustly
from ..model.errors.key import ErrorKey, Kind
from ..model.errors.term import ErrorTerm
from ..model.poses.pose_data import sha256_of
from ..model.rig.description import Rig
from ..model.rig.noise_by_name import NoiseByName, plain_noise
from ..model.rig.tied import require_tied
from ..model.shared_errors.shared_error import SharedError
from .contradictions import findings_of_views
from .moves import MOVED
from .parts import Provenance
from .rig_result import RigCalibration
from .rig_statement import MIN_REFUTED_RATIO

# The sizes have converged where a smaller share of the views changes between kept and rejected in a round.
MAX_FLICKERING_SHARE = 0.01
# Minima that are tried before the best of them is taken.
MAX_MINIMA = 3
# A camera whose noise, in rotation and in translation, is this many times that of another is named.
MAX_NOISE_RATIO = 10.0
METHODS = ("efficient", "ml")
# Fields of `Request` that a rig has, in addition to noise and shared errors.
OPTIONS = ("method", "robust", "seed", "covariance", "sizes", "prior", "correlation")
# Memory for one number of the rows of a rig, by its peak with 2 cameras and 10,000 or 100,000 poses; and
# numbers of shared errors that are assumed of an arm and of each camera.
BYTES_PER_NUMBER, ERRORS_OF_ARM, ERRORS_OF_CAMERA = 20, 50, 4


def calibrate_rig(
    rig: Rig,
    noise: NoiseByName | None = None,
    *,
    shared: bool | Collection[str] | Sequence[SharedError] | None = True,
    **asked: Any,
) -> RigCalibration:
    """Estimate all poses of a rig with their joint covariance.

    Parameters
    ----------
    rig : Rig
    noise : mapping, PoseNoise or None
        By the names of arms and cameras: (rotation, translation) standard deviations such as ``("0.5mrad", "0.3mm")``,
        covariances (6, 6), of arms also (n, 6, 6), or "exact". None: estimated from the views.
    shared : bool, names, or sequence of SharedError
        Where the noise is estimated, whether errors that poses share are included, or which: "accuracy" of each arm,
        "focal length", "principal point" and, with one camera, "lens distortion", "target outline" and "view" of each
        camera, "scale" of each target, and with times the drifts of cameras and targets. The others are taken as exact,
        such as the intrinsics of rendered pictures. Or errors as they were declared, in place of the defaults of their
        names (`declared`).
    **asked
        Further fields of `Request` (`OPTIONS`).

    Raises
    ------
    InputError
        Parts that no view connects, noise that is missing, views that do not agree.
    DegenerateMotionError
        The robot poses determine nothing.
    """
    require_type("rig", rig, Rig, "a Rig")
    if unknown := sorted(set(asked) - set(OPTIONS)):
        raise TypeError(f"calibrate_rig() got an unexpected keyword argument {unknown[0]!r}")
    kinds, errors = _kinds_and_errors(shared)
    request = Request(shared=errors, **asked)
    require_one_of("method", request.taken_method, METHODS)
    require_tied(rig)
    plain = {"noise": plain_noise(rig, noise), "shared": kinds, **request_to_dict(request)}
    with one_thread():  # many small matrices
        found = _calibrated(Task.of(rig, request, kinds), noise)
    taken = sha256_of(*(arm.poses for arm in rig.arms.values()), *(view.poses for view in rig.views))
    return replace(found, provenance=Provenance(taken, {"method": found.method}, dict(versions()), request=plain))


def _kinds_and_errors(shared: Any) -> tuple[Shared, tuple[SharedError, ...] | None]:
    """Return the kinds of the errors that are included, and the errors that were declared."""
    if shared is None or isinstance(shared, bool):
        return shared is not False, None
    listed = tuple(np.atleast_1d(np.array(shared, dtype=object)).tolist())
    if not listed:
        return False, None
    if all(isinstance(one, SharedError) for one in listed):
        off = {error.key.kind for error in listed if error.default and error.is_exact}
        declared = tuple(error for error in listed if not error.default)
        return (tuple(kind for kind in SHARED if kind not in off) if off else True), declared or None
    if unknown := [name for name in listed if name not in SHARED]:
        raise InputError(
            f"Expected `shared` to be True, False, SharedError or some of {', '.join(SHARED)}, got {unknown[0]!r}."
        )
    return tuple(map(Kind, listed)), None


def _require_memory(task: Task) -> None:
    graph = task.graph
    errors = ERRORS_OF_ARM * len(task.rig.arms) + ERRORS_OF_CAMERA * len(task.rig.cameras) if task.shared else 0
    needed = BYTES_PER_NUMBER * 6.0 * graph.E * (graph.p + errors)
    require_memory(needed, f"A rig of {graph.E:,} views", FEWER_POSES)


def _calibrated(task: Task, noise: NoiseByName | None) -> RigCalibration:
    _require_memory(task)
    start, kept = start_of(task.graph, int(task.request.seed))
    of_all = None if noise is None else _with_declared(task, given_noise(task.rig, task.graph, noise))

    def estimated(start: Array, kept: NDArray[np.bool_]) -> Estimated:
        return _with_sizes(task, start, kept) if of_all is None else Estimated(*_fitted(task, of_all, start, kept))

    return _assembled(task, *_at_global_minimum(task, estimated, start, kept))


def _with_declared(task: Task, noise: RigNoise) -> RigNoise:
    """Return noise that was given, with the columns of the errors that were declared beside it."""
    if not task.request.shared:
        return noise
    parts = components_of(task.rig, task.graph, True, request=task.request)
    return noise.with_columns(part for part in parts if declared_of(task.request.shared, part.key) is not None)


class Estimated(NamedTuple):
    """A fit, the distances of its views, the part of its covariance from uncertain sizes, and a line per component."""

    found: RigFit
    far: Distances
    spread: Array | None = None
    components: tuple[dict[str, Any], ...] = ()
    size_weights: Array | None = None


def _at_global_minimum(
    task: Task, estimated: Callable[[Array, NDArray[np.bool_]], Estimated], start: Array, kept: NDArray[np.bool_]
) -> tuple[Estimated, Optimality]:
    """Estimate from a start, and from the next one where the dual bound rejects its minimum."""
    for rejected in range(MAX_MINIMA):
        try:
            one = estimated(start, kept)
        except (InputError, NotConvergedError):
            better = better_start(task.rig, task.graph, start, kept)
            if better is None or rejected:
                raise
        else:
            optimality, better = prove(task.rig, one.found, task.prior)
            if better is None or rejected == MAX_MINIMA - 1:
                break
        start, kept = better, agreeing(task.graph, better)
    return one, replace(optimality, rejected=rejected)


def _fitted(task: Task, noise: RigNoise, at: Array, kept: NDArray[np.bool_] | Weights) -> tuple[RigFit, Distances]:
    """Fit, with robust weights on request, which start with the views ``kept`` or with those of a fit.

    Its errors name the pose that moved, if one explains them.
    """
    graph = task.graph
    try:
        if task.robust:
            return fit_robustly(graph, noise, at, task.method, task.prior, kept)
        found = fit(graph, noise, at, task.method, prior=task.prior)
        return found, distances(found)
    except (InputError, NotConvergedError) as error:
        if not task.robust:
            raise
        raise named_error(task, noise, at, error) from error


def _with_sizes(task: Task, start: Array, kept: NDArray[np.bool_]) -> Estimated:
    """Sizes of the errors and weights in turn, until the same views count."""
    graph, width = task.graph, 1.0
    if 6 * int(kept.sum()) <= graph.p:
        raise InputError(
            f"Expected more views to estimate the noise from, got {graph.E} for {graph.m} unknown poses. Give more, or "
            "the noise."
        )
    at, count, theta = start, kept if task.robust else np.ones(graph.E, dtype=bool), None
    begin: NDArray[np.bool_] | Weights = count
    parts = components_of(task.rig, graph, task.shared, width=width, request=task.request)
    for done in range(6):
        theta, at, begin = _in_turn(task, find_sizes(task, parts, at, count, width, theta, whole=False), at, begin)
        # a view at the edge must not come and go: from the third round on none comes back
        again = (begin.of_views(graph) > 0.5) & (count | (done < 2))
        before, width = width, width if done else width_of_targets(task, at, again)
        settled = int((again != count).sum()) <= MAX_FLICKERING_SHARE * graph.E and width == before
        count = again
        if width != before:
            del parts
            parts = components_of(task.rig, graph, task.shared, width=width, request=task.request)
        if settled:
            break
    sizes = find_sizes(task, parts, at, count, width, theta)
    del parts
    return _estimated(*_fitted(task, sizes.noise, at, begin), sizes)


def _in_turn(
    task: Task, sizes: Found, at: Array, begin: NDArray[np.bool_] | Weights
) -> tuple[Array | None, Array, Weights]:
    """Sizes to go on from, unknowns and weights by the noise of these sizes; the rows of the fit are not kept."""
    found = _fitted(task, sizes.noise, at, begin)[0]
    return sizes.theta, found.at, found.weights


def _estimated(found: RigFit, far: Distances, sizes: Found) -> Estimated:
    graph = found.graph
    closed = onto_closed(found.open, rig_units(graph, found.lever))
    spread = closed @ (sizes.spread + motion_in_session(found)) @ closed.T
    spread = np.pad(spread, (0, len(found.whole) - graph.p))
    return Estimated(found, far, spread, sizes.lines, sizes.weights)


def _assembled(task: Task, one: Estimated, optimality: Optimality) -> RigCalibration:
    """Return the result of a fit."""
    found, far, spread, components, weights = one
    rig, graph, noise = task.rig, found.graph, found.noise
    paths, findings = judged_paths(task, found)
    if (size := wrong_size(found)) is not None:
        findings = _beside_size(task, found, *size)
    elif not findings:
        findings = _beside_drift(task, found, components)
    findings = (*findings, *_of_priors(task, found))
    covariance, reference, kind = found.covariance, Reference(), task.request.covariance
    if kind != "model":
        covariance, reference = of_residuals(task, found, kind)
    elif spread is not None:
        covariance = covariance + spread[: graph.p, : graph.p]
    if spread is not None:
        found = replace(found, whole=found.whole + spread)
    arms, cameras = list(rig.arms), list(rig.cameras)
    names = tuple((arms[a], rig.arms[arms[a]].names[k]) for a, k in zip(graph.arm, graph.pose, strict=True))
    own = [("robot", name, noise.robot[graph.arm == k]) for k, name in enumerate(arms)]
    own += [("camera", name, noise.camera[k == graph.X]) for k, name in enumerate(cameras)]
    fresh = tuple(ErrorTerm.given(side, S.mean(axis=0), name) for side, name, S in own if len(S))
    if spread is not None:  # the noise was estimated
        robots, seen = ({name: _sizes(S) for at, name, S in own if at == side} for side in ("robot", "camera"))
        findings = (*findings, *_noisy(seen), *_noisy_robots(robots))
    posterior = Posterior(noise.keys, -found.z, found.whole, graph.names, noise=fresh)
    findings = (*findings, *findings_of_views(graph, posterior, noise, task.request.shared or ()))
    return RigCalibration(
        rig, graph.names, found.at, covariance, found.open, found.lever, found.chi_square, float(found.dof),
        task.method, found.edge_weights, far.edges, found.pose_weights, names,
        {name: _sizes(S) for _, name, S in own}, components=components,
        size_weights=np.zeros(0) if weights is None else weights, paths=paths, optimality=optimality,
        reference=reference, findings=findings,
        posterior=posterior,
    )  # fmt: skip


def _beside_size(task: Task, found: RigFit, finding: Finding, error: ErrorTerm) -> tuple[Finding, ...]:
    """Return the finding of a target of another size, or of a pose that moved or drifts with that size estimated.

    Either one looks like the other in some views: a move is none that goes away with the size, and the size is not
    said where a move is left.
    """
    opened = fit(task.graph, found.noise.with_columns([error]), found.at, "efficient", found.weights, task.prior)
    moved = tuple(one for one in judged_paths(task, opened)[1] if one.severity == "failure")
    return moved or (finding,)


def _beside_drift(task: Task, found: RigFit, components: Sequence[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Return the finding of a pose that moved in one step, where the drift that was estimated explains the step."""
    keys = [(ErrorKey.from_dict(line["key"]), float(line["size"])) for line in components]
    noise = with_usual_drift(found.noise, [(key.name, size) for key, size in keys if key.kind in DRIFT_KINDS])
    if noise is None:
        return ()
    again = fit(task.graph, noise, found.at, "efficient", found.weights, task.prior)
    findings = judged_paths(task, again, MAX_REMAINING_BESIDE_DRIFT)[1]
    return tuple(one for one in findings if one.code == MOVED)


def _noisy(sizes: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """Return a finding for each camera whose noise, per axis (rad, m), is none of poses of a target."""
    found = []
    for name, (rotation, translation) in sizes.items():
        others = [of for other, of in sizes.items() if other != name]
        ratios = [min(one / least for one, least in zip((rotation, translation), of, strict=True)) for of in others
                  if min(of) > 0]  # fmt: skip
        ratio = max(ratios, default=None)
        wrong = rotation > MAX_NOISE_RAD
        if wrong or (ratio is not None and ratio > MAX_NOISE_RATIO):
            values = {"name": name, "rotation": rotation, "translation": translation, "ratio": ratio}
            found.append(Finding("rig.noisy_camera", "failure" if wrong else "caution", values))
    return found


def _noisy_robots(sizes: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """Return a finding for each arm whose noise, per axis (rad, m), is none of a robot."""
    return [
        Finding("rig.noisy_robot", "failure", {"name": name, "rotation": rotation, "translation": translation})
        for name, (rotation, translation) in sizes.items()
        if rotation > MAX_NOISE_RAD
    ]


def noise_of_views(rig: Rig, result: RigCalibration, **options: Any) -> list[Finding]:
    """Return a finding with the noise that the views show, where they contradict the noise that was given."""
    try:
        own = calibrate_rig(rig, None, **options).noise
    except (InputError, NotConvergedError):
        return []
    larger: list[dict[str, Any]] = []
    for name, (rotation, translation) in own.items():
        pairs = zip((rotation, translation), result.noise[name], strict=True)
        times = max((one / given for one, given in pairs if given > 0), default=None)
        if times is None or times > MIN_REFUTED_RATIO:
            larger.append({"name": name, "rotation": rotation, "translation": translation, "times": times})
    if not larger:
        return []
    larger.sort(key=lambda one: -(one["times"] or np.inf))
    ratio = float(np.sqrt(result.chi_square / result.dof)) if result.noise_refuted else None
    return [Finding("rig.noise_too_small", "failure", {"ratio": ratio, "larger": larger})]


def _of_priors(task: Task, found: RigFit) -> list[Finding]:
    """Return a finding for each pose that is known beforehand: whether the data agree with it."""
    findings = []
    for name, known in (task.rig.known or {}).items():
        k = found.graph.names.index(name)
        information, pull, _ = known.normal_equations(found.at[k], None)
        of = slice(6 * k, 6 * k + 6)
        findings += prior_findings(information, pull, found.covariance[of, of], name)
    return findings


def of_residuals(task: Task, found: RigFit, kind: str) -> tuple[Array, Reference]:
    """Return the covariance (p, p) of all poses from the residuals of the groups, and the distribution of its errors.

    As with one camera (`fit.diagnostics.sandwich`), with groups of views that share robot poses in place of
    poses; what the priors of known poses and of shared errors add is that of the model.
    """
    graph = found.graph
    if len(found.open):
        raise InputError(
            f"The motions leave a part of the rig open, for which only covariance='model' is available, got {kind!r}."
        )
    size, p = max(part.residual.shape[1] for part in found.rows), graph.p
    residual, J = [], []
    for part in found.rows:
        kept = found.view_weights[part.batch.edges].max(axis=1) > 0
        pad = size - part.residual.shape[1]
        residual.append(np.pad((part.half @ part.residual[..., None])[kept][..., 0], [(0, 0), (0, pad)]))
        J.append(np.pad((part.half @ part.A)[kept], [(0, 0), (0, pad), (0, 0)]))
    share, axes = np.linalg.eigh(found.whole[p:, p:])  # of the shared errors those of which the data tell something
    axes = axes[:, share * (1.0 + MIN_RESOLVED_SHARE) < 1.0]
    onto = np.zeros((len(found.whole), p + axes.shape[1]))
    onto[:p, :p], onto[p:, p:] = np.eye(p), axes
    known = np.eye(onto.shape[1])
    known[:p, :p] = prior_at(graph, found.at, task.prior).information
    rows, M = np.concatenate(J) @ onto, onto.T @ found.whole @ onto
    influence = Influence(np.concatenate(residual), rows, (rows @ -M).mT, known)
    S = influence.sandwich() if kind == "sandwich" else influence.bootstrap(seed=int(task.request.seed))
    response = found.whole[:p, p:]
    S = S[:p, :p] + M[:p, :p] @ known[:p, :p] @ M[:p, :p] + response @ response.T
    freedom = []
    for k in range(len(task.rig.cameras)):  # of each camera, as the first of the unknowns
        order = np.roll(np.arange(rows.shape[-1]), -6 * k)
        one = replace(influence, J=rows[..., order], B=influence.B[:, order], known=known[np.ix_(order, order)])
        freedom.append(float(one.freedom))
    return S, Reference("Hotelling", min(freedom))


def _sizes(S: Array) -> tuple[float, float]:
    """Standard deviations per axis (rad, m), root mean square over the poses."""
    if not len(S):
        return 0.0, 0.0
    mean = np.sqrt(np.diagonal(S, axis1=-2, axis2=-1).mean(axis=0).reshape(2, 3).mean(axis=1))
    return float(mean[0]), float(mean[1])


# ------------------------------------------------------------------------------------------- with new views
