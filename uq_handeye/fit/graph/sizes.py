r"""Noise of a rig, estimated from its own views: components with owners, whose sizes are found jointly (`search`).

An arm owns rotation and translation noise of its poses, and its accuracy; a camera rotation and translation noise,
noise that depends on the view and of the depth, focal length and image centre; a target its scale. The column of an
owner is zero in the rows of the others. With one camera these are the components of `calibrate`, in their order; the
data then cannot separate the distortion of the lens from the errors by the view, and the size of the intrinsics is that
of the table. Several cameras determine that size: it is free, and the sizes of all cameras share a prior, log-normal
about a median that is itself log-normal, so that a camera with few views borrows from the others. Targets of one
printer are wrong by one factor: in addition to the scale of each, several targets share one. The ratio of the targets'
width to their distance decides the shape of the noise by the view and the effect of the intrinsics; several cameras
determine that ratio as well (`width_of_targets`).

Rows of one robot pose form one block (`engine.Rows`): views at one moment show the robot's noise directly, by the
correlation of their residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array, perturb
from ...model.errors.columns import some_rows
from ...model.errors.key import ErrorKey, Kind, Owner
from ...model.errors.keys import FOCAL_LENGTH, LENS, PRINCIPAL_POINT, ROBOT_ACCURACY, TARGET_SCALE
from ...model.errors.sizes import SIZES, Size
from ...model.errors.term import ErrorTerm
from ...model.poses.pose_pairs import PosePairs
from ...model.rig.description import ArmPoses, Rig
from ...model.shared_errors.assumed import assumed_accuracy, assumed_lens, assumed_outline, assumed_view
from ...model.shared_errors.shared_error import SharedError
from ...model.shared_errors.view import (
    HALF_WIDTH,
    LENS_SHARES,
    intrinsics_columns,
    lines_of_sight,
    median_distance,
    target_centre,
    view_block,
)
from .declared import Errors, declared_of, further_errors, with_declared
from .drifts import DRIFT_KINDS, drifts_of, times_of
from .engine import LatentModel, Rows
from .fit import Prior, Shared, Task, closed_by_residuals, prior_at
from .graph import Graph, noise_of_cameras, noise_of_robots
from .integration import Mixture, integrate
from .mode import GAIN, ROUGH_GAIN, find_mode
from .noise import RigNoise, calibrated_intrinsics, given_covariances, kinematic_components, of_owner, scene_components
from .reduced_rows import Reduced
from .request import Request
from .search import Linear, search

# Cameras differ from their common median by this factor (1 sigma of the logarithm).
CAMERA_SPREAD_FACTOR = 2.0
# Factor by which the sizes of focal length and image centre are uncertain in a rig.
SPREAD_IN_RIG = 3.0
# These widths of the targets are tried, in units of the usual one.
WIDTHS = tuple(0.5**k for k in range(6))
# Another width than the usual one is taken where the logarithm of its evidence is larger by this.
MIN_WIDTH_EVIDENCE = 3.0
# The line of the width has this key; it states half of the width over the distance.
WIDTH = ErrorKey(Owner.TARGETS, Kind.WIDTH)
# The sizes are found from at most this many views, in whole groups.
MAX_VIEWS_FOR_SIZES = 600
# Owner of the error of size that all targets of a rig have in common: they come from one printer.
ALL_TARGETS = Owner.TARGETS
# Kinds of the errors that all poses of an arm, a camera or a target share.
SHARED = (
    Kind.ACCURACY, Kind.FOCAL_LENGTH, Kind.PRINCIPAL_POINT, Kind.SCALE, Kind.LENS, Kind.OUTLINE, Kind.VIEW,
    *DRIFT_KINDS,
)  # fmt: skip
# Keys of the numbers of the errors of intrinsics.
NUMBERS = {
    error.key: error.keys for error in (SharedError.focal_length(), SharedError.principal_point(), assumed_lens())
}
OF_EACH_CAMERA = (
    Kind.ROTATION, Kind.TRANSLATION, Kind.BY_VIEW, Kind.DEPTH, Kind.FOCAL_LENGTH, Kind.PRINCIPAL_POINT
)  # fmt: skip
_PARTS = ((Kind.ROTATION, np.eye(6)[:, :3]), (Kind.TRANSLATION, np.eye(6)[:, 3:]))


@dataclass(frozen=True, eq=False)
class Found:
    """Noise with the estimated sizes, the effect of their uncertainty on the covariance, and a line per component."""

    noise: RigNoise
    spread: Array  # (p, p)
    lines: tuple[dict[str, object], ...]
    weights: Array  # (d,) of the points of the sizes
    theta: Array | None = None  # (k,) the most probable ones, to go on from


def components_of(
    rig: Rig,
    graph: Graph,
    shared: Shared,
    bound: tuple[Rig, Graph] | None = None,
    width: float = 1.0,
    views: NDArray[np.intp] | None = None,
    request: Request | None = None,
) -> tuple[ErrorTerm, ...]:
    """Return all components of the poses of a graph: columns (P, 6, m) of the robot, (E, 6, m) of the cameras.

    ``shared``: with the errors that all poses of an owner share (`SHARED`), or some of them; else only noise of each
    pose. ``bound``: the rig and the graph whose poses the shared errors belong to; None: this one. ``width`` of the
    targets, in units of the usual one (`view`). ``views``: the only ones whose noise by the view is asked for.
    ``request``: what was declared of the errors.
    """
    request = Request() if request is None else request
    both = ((rig, graph), (rig, graph) if bound is None else bound)
    before = both[1][1]
    arms = _seen(rig.arms, lambda name: [one.arm == np.intp(_place(name, list(of.arms))) for of, one in both])
    cameras = _seen(rig.cameras, lambda name: [np.intp(_place(name, one.names)) == one.X for _, one in both])
    targets = _seen(rig.targets, lambda name: [np.intp(_place(name, one.names)) == one.W for _, one in both])
    _, given = given_covariances(rig, graph)
    by_view, found = _by_view(before if both[1][0] is rig else graph, width, views), []  # those measured, if corrected
    depths = lines_of_sight((before if both[1][0] is rig else graph).C)
    for name, (of, _) in arms.items():
        for what, B in _PARTS:
            key = ErrorKey(Owner.ROBOT, what)
            found.append(ErrorTerm(key.of(name), "robot", SIZES[key], block=_of(of, B)))
    for name, (of, _) in cameras.items():
        of_views = (Kind.BY_VIEW, by_view), (Kind.DEPTH, depths)
        blocks = (*_PARTS, *of_views) if (own := of & ~given).any() else ()
        for what, B in blocks:
            key = ErrorKey(Owner.CAMERA, what)
            found.append(ErrorTerm(key.of(name), "camera", SIZES[key], block=_of(own, B)))
    calibrated = {name: part for name, part in calibrated_intrinsics(rig, graph).items() if name in cameras}
    found += [part for part in calibrated.values() if part.count]
    scenes = {view.target for view in rig.views if view.scene}
    found += [part for part in scene_components(rig, graph) if part.key.name in targets]
    chains = [part for name in arms if rig.arms[name].kinematics is not None
              for part in kinematic_components(rig, graph, name)]  # fmt: skip
    noise, found = found, []
    of_scene = {view.camera for view in rig.views if view.scene}
    finished = {name: of for name, of in cameras.items() if name not in calibrated and name not in of_scene}
    of_board = {name: of for name, of in targets.items() if name not in scenes}
    if shared:
        found = _assumed(both[1][0], graph, before, (arms, finished, of_board), width, request.shared or ())
        times, walked = (times_of(*one) for one in both)
        drifts = request.correlation == "auto" and request.covariance == "model"
        if drifts and times is not None and walked is not None:
            rows = ({name: of for name, (of, _) in owned.items()} for owned in (cameras, targets))
            found += drifts_of(graph, times, np.unique(walked), *rows)
    asked = SHARED if shared is True else shared or ()
    found = [part for part in found if part.key.kind in asked]
    owners = {"robot": arms, "camera": finished, "target": of_board}
    for error in further_errors(request, found):
        for name, seen in owners[error.key.owner].items():
            if error.key.name in ("", name):
                found.append(_shared(graph, before, name, seen, error, rig.arms.get(name)))
    return with_declared((*noise, *found, *chains), request)


def _assumed(
    rig: Rig, graph: Graph, before: Graph, owners: tuple[dict[str, Owned], ...], width: float, declared: Errors
) -> list[ErrorTerm]:
    """Errors that all poses of an arm, a camera or a target share, by default; see `components_of`.

    ``owners``: rows of the arms, of the cameras with finished poses, and of the targets.
    """
    found: list[ErrorTerm] = []
    arms, finished, targets = owners
    alone, by_intrinsics = len(rig.cameras) == 1, _by_intrinsics(graph, before, width)
    for name, (of, _) in finished.items():
        for error, columns in ((FOCAL_LENGTH, slice(0, 1)), (PRINCIPAL_POINT, slice(1, 3))):
            size = SIZES[error] if alone else replace(SIZES[error], factor=SPREAD_IN_RIG)
            found.append(
                ErrorTerm(
                    error.of(name), "camera", size, columns=_of(of, by_intrinsics[..., columns]),
                    keys=tuple(key.of(name) for key in NUMBERS[error]),
                )
            )  # fmt: skip
    scale = np.pad(graph.C[:, :3, 3:], [(0, 0), (3, 0), (0, 0)])
    scales = {TARGET_SCALE.of(name): _of(seen, scale) for name, (seen, _) in targets.items()}
    if len(rig.targets) - len({view.target for view in rig.views if view.scene}) > 1:
        scales[ErrorKey(ALL_TARGETS, Kind.SCALE)] = scale
    found += [ErrorTerm(key, "camera", SIZES[TARGET_SCALE], columns=K) for key, K in scales.items()]
    for name, seen in arms.items():
        if rig.arms[name].kinematics is None:
            accuracy = declared_of(declared, ROBOT_ACCURACY.of(name))
            accuracy = assumed_accuracy() if accuracy is None or accuracy.is_exact else accuracy
            found.append(_shared(graph, before, name, seen, accuracy))
    for name, both_of in finished.items() if alone else ():
        lens = _of(both_of[0], by_intrinsics[..., 3:] * LENS_SHARES)
        keys = tuple(key.of(name) for key in NUMBERS[LENS])
        found.append(ErrorTerm(LENS.of(name), "camera", SIZES[LENS], columns=lens, keys=keys))
        found += [_shared(graph, before, name, both_of, error) for error in (assumed_outline(), assumed_view())]
    return found


Owned = list[NDArray[np.bool_]]  # rows of an owner in the graph, and in the one that is bound


def _place(name: str, among: Sequence[str]) -> int:
    return among.index(name) if name in among else -1


def _seen(names: Iterable[str], rows: Callable[[str], Owned]) -> dict[str, Owned]:
    """Rows of the owners that have some in both graphs."""
    found = {name: rows(name) for name in names}
    return {name: of for name, of in found.items() if of[0].any() and of[1].any()}


def _of(of: NDArray[np.bool_], B: Array) -> Array:
    """(n, 6, b) blocks of the rows of an owner."""
    return np.broadcast_to(B, (len(of), *B.shape[-2:])) if of.all() else np.asarray(of[:, None, None] * B)


def _shared(
    graph: Graph, bound: Graph, owner: str, of: Owned, error: SharedError, arm: ArmPoses | None = None
) -> ErrorTerm:
    """Component of an error that all poses of an owner share; ``arm``: whose poses have times."""
    error, poses = error.bound(_alone(bound, of[1], error.side)), _alone(graph, of[0], error.side)
    if arm is not None and (arm.timed or {*map(type, arm.names)} == {float}):
        poses = replace(poses, timestamps=np.array(arm.names, dtype=float)[graph.pose[of[0]]])
    return of_owner(error.term(poses), of[0], owner)


def _alone(graph: Graph, of: NDArray[np.bool_], side: str) -> PosePairs:
    """Poses of one side as those of a camera and a robot."""
    T = (graph.robot if side == "robot" else graph.C)[of]
    return PosePairs(T, T)


def _by_view(graph: Graph, width: float, views: NDArray[np.intp] | None = None) -> Array:
    """(E, 6, 6) square roots of the shape that the corners of each target give (`shared_errors.view`).

    ``views``: those for which it is asked, 0 for others; None: all.
    """
    found, asked = np.zeros((graph.E, 6, 6)), np.ones(graph.E, dtype=bool)
    if views is not None:
        asked = np.isin(np.arange(graph.E), views)
    for target in np.unique(graph.W):
        of = target == graph.W
        if (some := of & asked).any():
            found[some] = view_block(graph.C[some], *_place_of(graph.C[of], graph.X[of], width))
    return found


def _by_intrinsics(graph: Graph, bound: Graph, width: float) -> Array:
    """(E, 6, 8) effects of the intrinsics, with targets as the poses of ``bound`` say."""
    found = np.zeros((graph.E, 6, 8))
    for target in np.unique(graph.W).tolist():
        of = target == graph.W
        seen = np.asarray(_place(graph.names[target], bound.names) == bound.W)
        known, by = (bound, seen) if seen.any() else (graph, of)
        found[of] = intrinsics_columns(graph.C[of], *_place_of(known.C[by], known.X[by], width))
    return found


def _place_of(C: Array, cameras: Array, width: float) -> tuple[float, Array]:
    """Distance of a target at poses C (n, 4, 4) that gives its width, and its centre (3,): the mean by the cameras."""
    distance = width * median_distance(C)
    centres = [target_centre(C[cameras == one], distance) * np.mean(cameras == one) for one in np.unique(cameras)]
    return distance, np.sum(centres, axis=0)


def width_of_targets(task: Task, at: Array, kept: NDArray[np.bool_]) -> float:
    """Return the width of the targets, in units of the usual one (`view`), by the noise of the views ``kept`` (E,).

    Poses of a small target far away are noisier in tilt and distance than sideways. The width is that of
    the largest evidence, with noise of each pose only, between a few: the top of the parabola through the best three.
    """
    rig, graph = task.rig, task.graph
    views = _spread_over(graph, np.flatnonzero(kept), MAX_VIEWS_FOR_SIZES // 3)
    used = graph.of_edges(views)
    place, theta, logs = _places(graph, used), None, []
    for width in WIDTHS:
        parts = tuple(_rows_of(part, *place) for part in components_of(rig, graph, False, width=width, views=views))
        mode = find_mode(model_of(rig, used, parts, at, task.prior), theta, 0.3)
        theta = mode.theta
        logs.append(mode.log_evidence)
        if max(logs) > logs[-1] + 2.0 * MIN_WIDTH_EVIDENCE:
            break
    best = int(np.argmax(logs))
    if logs[best] < logs[0] + MIN_WIDTH_EVIDENCE:
        return 1.0
    if best == len(logs) - 1:
        return WIDTHS[best]
    before, top, after = logs[best - 1 : best + 2]
    return float(WIDTHS[best] * (WIDTHS[1] / WIDTHS[0]) ** (0.5 * (before - after) / (before - 2.0 * top + after)))


def find_sizes(
    task: Task,
    parts: tuple[ErrorTerm, ...],
    at: Array,
    kept: NDArray[np.bool_],
    width: float = 1.0,
    theta: Array | None = None,
    whole: bool = True,
) -> Found:
    """Find the sizes of components near the poses ``at`` (m, 4, 4), from the views ``kept`` (E,).

    ``parts``: the components, for targets of that width. ``theta`` (k,): logarithms to begin with. ``whole``: integrate
    over the uncertainty of the sizes instead of taking the most probable ones only.

    Raises `NotConvergedError` where poses or sizes do not converge (`search`).
    """
    rig, graph = task.rig, task.graph
    used = graph.of_edges(
        _spread_over(graph, np.flatnonzero(kept), MAX_VIEWS_FOR_SIZES if whole else MAX_VIEWS_FOR_SIZES // 2)
    )
    place = _places(graph, used)
    own = tuple(_rows_of(part, *place) for part in parts)
    basis = closed_by_residuals(used, at, task.prior)

    def linear_at(at: Array) -> Linear:
        model = model_of(rig, used, own, at, task.prior, basis)
        return Linear(model, Reduced(model.J, basis, None))

    def moved(at: Array, step: Array) -> Array:
        return np.asarray(perturb(at, step.reshape(-1, 6)))

    found = search(linear_at, moved, at, theta, GAIN if whole else ROUGH_GAIN)
    model, theta = found.linear.model, found.mode.theta
    if not whole:
        one = model.of_poses(theta)
        point = Mixture(np.ones(1), theta[None], one.mean[None], one.covariance[None], np.ones(1), np.zeros(1))
        return replace(found_of(rig, graph, parts, point, np.zeros((graph.p, graph.p)), width), theta=theta)
    mixture = integrate(model, [found.mode, *found.others])
    centre = model.of_poses(mixture.mean_theta)
    spread = mixture.about(centre.mean) - centre.covariance
    values, vectors = np.linalg.eigh(0.5 * (spread + spread.T))
    vectors = vectors if basis is None else basis @ vectors
    return found_of(rig, graph, parts, mixture, (vectors * np.maximum(values, 0.0)) @ vectors.T, width)


def found_of(
    rig: Rig, graph: Graph, parts: tuple[ErrorTerm, ...], mixture: Mixture, spread: Array, width: float = 1.0
) -> Found:
    """Return the noise of the components of a graph with the estimated sizes, and their lines.

    ``logs`` of a line: difference of the logarithm of its size at each point of the sizes.
    """
    free = np.array([not part.size.is_known for part in parts], dtype=bool)
    sizes, logs = np.array([part.size.median for part in parts]), np.zeros((len(parts), len(mixture.weights)))
    sizes[free], logs[free] = np.exp(mixture.mean_theta), (mixture.theta - mixture.mean_theta).T
    sd = np.sqrt(logs**2 @ mixture.weights)
    lines = tuple(
        {"name": part.name, "key": part.key.to_dict(), "size": float(s),
         "low": float(s * np.exp(-1.96 * d)), "high": float(s * np.exp(1.96 * d)),
         "unit": part.size.unit, "logs": at.tolist()}
        for part, s, d, at in zip(parts, sizes.tolist(), sd.tolist(), logs, strict=True)
    )  # fmt: skip
    half = width * HALF_WIDTH
    of_targets = (
        ()
        if width == 1
        else ({"name": str(WIDTH), "key": WIDTH.to_dict(), "size": half, "low": half, "high": half, "unit": ""},)
    )
    sized = [replace(part, size=Size(s)) for part, s in zip(parts, sizes.tolist(), strict=True)]
    noise = replace(RigNoise.of_own(np.zeros((graph.P, 6, 6)), given_covariances(rig, graph)[0]), split_known=False)
    return Found(noise.with_blocks(sized).with_columns(sized), spread, (*lines, *of_targets), mixture.weights)


def _spread_over(graph: Graph, kept: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Return a limited number of edges in whole groups, spread over all groups."""
    if len(kept) <= most:
        return kept
    groups = np.unique(graph.group[kept])
    count = max(2, int(len(groups) * most / len(kept)))
    some = groups[np.unique(np.linspace(0, len(groups) - 1, count).round().astype(int))]
    chosen = kept[np.isin(graph.group[kept], some)]
    everything = len(np.unique(np.r_[graph.X[kept], graph.W[kept] + graph.m]))
    return chosen if len(np.unique(np.r_[graph.X[chosen], graph.W[chosen] + graph.m])) == everything else kept


def _places(graph: Graph, used: Graph) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Numbers in the graph of the edges and robot poses of a part of it."""
    row_of = {key: k for k, key in enumerate(zip(graph.view.tolist(), graph.row.tolist(), strict=True))}
    pose_of = {key: k for k, key in enumerate(zip(graph.arm.tolist(), graph.pose.tolist(), strict=True))}
    edges = [row_of[key] for key in zip(used.view.tolist(), used.row.tolist(), strict=True)]
    poses = [pose_of[key] for key in zip(used.arm.tolist(), used.pose.tolist(), strict=True)]
    return np.array(edges, dtype=np.intp), np.array(poses, dtype=np.intp)


def _rows_of(part: ErrorTerm, edges: NDArray[np.intp], poses: NDArray[np.intp]) -> ErrorTerm:
    return part.rows(poses if part.side == "robot" else edges)


def model_of(
    rig: Rig, graph: Graph, parts: tuple[ErrorTerm, ...], at: Array, prior: Prior | None, basis: Array | None = None
) -> LatentModel:
    """Return the model of components near the poses ``at`` (m, 4, 4), with the batches of the graph in their order.

    ``basis`` (p, q): the directions of the unknowns that are determined; None: all.
    """
    given, some = given_covariances(rig, graph)
    groups = []
    for batch in graph.batches:
        (b, e), q = batch.edges.shape, batch.robots.shape[1]
        sides = graph.linearise(at, edges=(edges := batch.edges.reshape(-1)))
        D_R, D_C = graph.by_robots(batch, sides), sides.camera.reshape(b, e, 6, 6)
        blocks, shared = {}, [np.zeros((b, 6 * e, 0))]
        for k, part in enumerate(parts):
            of_robot = part.side == "robot"
            if part.columns is not None:
                m = part.count
                if of_robot:
                    shared.append(D_R @ some_rows(part.columns, batch.robots).reshape(b, 6 * q, m))
                else:
                    shared.append((D_C @ some_rows(part.columns, batch.edges)).reshape(b, 6 * e, m))
            if part.block is not None:
                S = part.block @ part.block.mT
                blocks[k] = noise_of_robots(D_R, S[batch.robots]) if of_robot else noise_of_cameras(D_C, S[batch.edges])
        known = noise_of_cameras(D_C, given[batch.edges]) if some.any() else None
        J = graph.by_unknowns(sides, edges).reshape(b, 6 * e, graph.p)
        J = J if basis is None else J @ basis
        groups.append(Rows(J, sides.r.reshape(b, -1), np.concatenate(shared, axis=-1), blocks, known))
    known_poses = None
    if prior:
        of, Q = prior_at(graph, at, prior), np.eye(graph.p) if basis is None else basis
        pull = Q.T @ of.gradient
        known_poses = np.block([[Q.T @ of.information @ Q, pull[:, None]], [pull[None], np.array([[of.square]])]])
    first, *others = groups
    return LatentModel(
        first.J, first.r, parts, first.shared, first.blocks, first.known, known_poses, tuple(others),
        _covariance_of_sizes(parts),
    )  # fmt: skip


def _covariance_of_sizes(parts: tuple[ErrorTerm, ...]) -> Array:
    """Prior covariance of the logarithms of the free sizes: those of one kind of noise of all cameras have a median in
    common.
    """
    free = [part for part in parts if not part.size.is_known]
    C = np.diag([np.log(part.size.factor) ** 2 for part in free])
    for what in OF_EACH_CAMERA:
        of = np.flatnonzero([part.key.kind == what and part.side == "camera" for part in free])
        for i in of:
            for j in of[of != i]:
                C[i, j] = np.log(free[i].size.factor) ** 2 - np.log(CAMERA_SPREAD_FACTOR) ** 2
    return C
