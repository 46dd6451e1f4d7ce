r"""Robust weights of views and of robot poses.

A wrong detection spoils the rows of one view, a wrong robot pose those of its group. Both are tested with the same
formula. With ``P = S^-1 - S^-1 A H^-1 A^T S^-1``, ``g = S^-1 residual`` and D the derivatives of the rows by the error
of covariance Sigma that is tested (of a camera pose or a robot pose),

    mu, V = eigen(L^T D^T P D L),   Sigma = L L^T,     d^2 = sum (V^T L^T D^T g)^2 / (mu (1 - mu (1/w - 1)))

is the square distance between the pose as measured and as everything else predicts it: chi-square with 6 degrees of
freedom for a good one, whatever its weight w (`likelihood.robust`). In a group of one edge the two cannot be separated:
the edge is tested by all of its rows. Where both are suspect in a group of several edges, the robot pose is
down-weighted if it explains more than the worst edge does, as its error affects all of them.

*One camera, one target, one arm.* Such a graph has one kind of edge, each with its own robot pose: its rows are those
of `likelihood.constraint`. `one_model` takes the components of the rig, weighs the poses and estimates the sizes
(`one_model.weights`), as for `calibrate`; its sizes, weights and unknowns are the start of the fit of the graph.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..core.numbers.limits import MIN_POSES_FOR_ROBUST
from ..errors import InputError, NotConvergedError
from ..fit.likelihood.constraint import Unknowns, constraint_of
from ..fit.likelihood.gauss_helmert import FITS, Fit, corrected
from ..fit.likelihood.robust import UNDAMPED_STEPS, largest_by_chance, left_out, robust_weights
from ..fit.likelihood.robust import fit_robustly as likelihood_robust
from ..fit.likelihood.shared_estimates import motion_in_session
from ..fit.one_model.component import Component
from ..fit.one_model.estimation import JointModel
from ..fit.one_model.weights import TAIL_SLACK, settle, weigh_from_two_starts
from ..model.noise.joint_covariance import JointCovariance
from ..model.noise.models import Noise, PoseNoise, factor, with_prior
from ..model.noise.pose_prior import PosePrior
from ..model.noise.square_roots import LEAST_WEIGHT
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.assumed import assumed_drift
from ..model.shared_errors.sizes import Size
from .description import Rig
from .fit import MIN_POSE_WEIGHT, Prior, RigFit, Task, fit
from .graph import Graph
from .noise import RigNoise, given_covariances
from .sizes import Found, components_of, found_of

# Robust weights have converged where none of them changes by more.
MAX_SETTLED_CHANGE = 0.01


@dataclass(frozen=True, eq=False)
class Distances:
    """d^2 of all views and robot poses."""

    edges: Array  # (E,)
    poses: Array  # (P,); 0 where the group has one edge
    alone: NDArray[np.bool_]  # (P,) robot poses that cannot be separated from their only view


def distances(found: RigFit) -> Distances:
    """Return the distance of each measured pose from its prediction by the others."""
    graph, noise = found.graph, found.noise
    of_edges, of_poses = np.zeros(graph.E), np.zeros(graph.P)
    alone = np.zeros(graph.P, dtype=bool)
    for part in found.rows:
        batch, d = part.batch, part.residual.shape[1]
        (b, e), q = batch.edges.shape, batch.robots.shape[1]
        Q = part.half.mT @ part.half
        SA = Q @ part.A
        P = Q - SA @ found.whole @ SA.mT
        g = (Q @ part.residual[..., None])[..., 0]
        if e == 1:
            w = np.maximum(found.edge_weights[batch.edges[:, 0]], LEAST_WEIGHT)
            scale = np.sqrt(w)[:, None, None]
            of_edges[batch.edges[:, 0]] = _distance2(P, g, np.eye(d), part.L * scale, w)
            alone[batch.robots] = True
            continue
        for k in range(e):
            D = np.zeros((b, d, 6))
            D[:, 6 * k : 6 * k + 6] = part.D_C[:, k]
            edges = batch.edges[:, k]
            of_edges[edges] = _distance2(
                P, g, D, factor(noise.camera[edges]), np.maximum(found.edge_weights[edges], MIN_POSE_WEIGHT)
            )
        for k in range(q):
            D, robots = part.D_R[..., 6 * k : 6 * k + 6], batch.robots[:, k]
            of_poses[robots] = _distance2(
                P, g, D, factor(noise.robot[robots]), np.maximum(found.pose_weights[robots], MIN_POSE_WEIGHT)
            )
    return Distances(of_edges, of_poses, alone)


def _distance2(P: Array, g: Array, D: Array, L: Array, w: Array) -> Array:
    """(b,) square distances."""
    M = D @ L
    return left_out(M.mT @ P @ M, M.mT @ g[..., None], w)


def fit_robustly(
    graph: Graph,
    noise: RigNoise,
    start: Array,
    method: str = "efficient",
    prior: Prior | None = None,
    begin: NDArray[np.bool_] | RigFit | None = None,
) -> tuple[RigFit, Distances]:
    """Fit with weights of the views and of the robot poses; all are 1 where the largest distance is not unusual.

    ``begin`` (E,): the edges that count at first, or a fit whose weights are those to begin with. Raises `InputError`
    where less than half of the views agree.
    """
    limit = largest_by_chance(graph.E + graph.P)
    found: RigFit | None = None
    if isinstance(begin, RigFit):
        w_e, w_k, found = begin.edge_weights, begin.pose_weights, begin
    else:
        w_e, w_k = _first(graph, np.ones(graph.E, dtype=bool) if begin is None else begin)
    if w_e.all() and w_k.all():
        found = fit(graph, noise, start, method, prior=prior, after=found)
        far = distances(found)
        if max(far.edges.max(initial=0.0), far.poses.max(initial=0.0)) <= limit:
            return found, far
    at, cleared = start, np.zeros(graph.P, dtype=bool)
    for k in range(40):
        found = fit(graph, noise, at, method, w_e, w_k, prior, found)
        at, far = found.at, distances(found)
        worst = _worst(graph, far)
        cleared |= (w_k == 0) & (worst > limit)  # its views contradict each other without it, too
        wanted = _wanted(graph, far, worst, cleared)
        if k >= 20:  # those that take turns would never end: weights only fall
            wanted = np.minimum(wanted[0], w_e), np.minimum(wanted[1], w_k)
        change = max(np.abs(wanted[0] - w_e).max(), np.abs(wanted[1] - w_k).max(initial=0.0))
        if change < MAX_SETTLED_CHANGE:
            break
        w_e, w_k = wanted if k < UNDAMPED_STEPS or k >= 20 else (0.5 * (wanted[0] + w_e), 0.5 * (wanted[1] + w_k))
    else:
        if change > 0.2:
            raise NotConvergedError("The weights of the robust fit did not settle: views contradict each other.", found)
    if 2 * int((w_e > 0).sum()) < graph.E:
        raise InputError(
            f"Only {int((w_e > 0).sum())} of {graph.E} views agree with one rig within the noise; at least half of "
            "them must. Look at the names of the poses, what cameras and targets are on, the units and the noise given."
        )
    assert found is not None
    return found, far


def _first(graph: Graph, begin: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Weights to begin with: a robot pose all of whose views, two or more, are suspect takes the blame for them."""
    count, good = np.zeros(graph.P + 1), np.zeros(graph.P + 1)
    for side in graph.side:
        np.add.at(count, side, 1.0)
        np.add.at(good, side, begin.astype(float))
    blamed = (count > 1) & (good == 0)
    blamed[-1] = False
    w_e = begin | blamed[graph.side[0]] | blamed[graph.side[1]]
    return w_e.astype(float), np.where(blamed[:-1], 0.0, 1.0)


def _worst(graph: Graph, far: Distances) -> Array:
    """(P,) largest distance of the views of each robot pose."""
    worst = np.zeros(graph.P + 1)
    for side in graph.side:
        np.maximum.at(worst, side, far.edges)
    return worst[:-1]


def _wanted(graph: Graph, far: Distances, worst: Array, cleared: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Weights by the distances: a robot pose that explains more than its worst view spares its views.

    ``cleared``: poses that are not to blame.
    """
    of_edges, of_poses = robust_weights(far.edges), robust_weights(far.poses)
    blamed = (far.poses > worst) & (of_poses < 1.0) & ~cleared
    of_poses = np.where(blamed, of_poses, 1.0)
    spared = np.zeros(graph.E, dtype=bool)
    for side in graph.side:
        spared |= np.concatenate([blamed, [False]])[side]
    return np.where(spared, 1.0, of_edges), of_poses


class OfPair(NamedTuple):
    """Sizes, poses (2, 4, 4) and weights (E,) of a pair."""

    sizes: Found
    at: Array
    weights: Array


def is_pair(task: Task) -> bool:
    """Return whether the graph has one kind of edge, each with its own robot pose, and all covariances or none."""
    graph = task.graph
    sides = [side < graph.P for side in graph.side]
    one_kind = graph.m == 2 and bool((sides[0] ^ sides[1]).all() and (sides[0] == sides[0][0]).all())
    given = {view.covariance is None for view in task.rig.views}
    return one_kind and len(given) == 1 and graph.P == graph.E


def find_pair(task: Task, start: Array) -> OfPair | None:
    """Find sizes, weights and poses of a pair; None where its data are exact."""
    rig, graph, prior, method, robust, shared, seed = task
    where = graph
    poses, robots = _poses_of(graph)
    constraint = replace(constraint_of(poses, None), split_known=False)
    drift = _drift(rig, graph, poses) if shared is True else ()

    def all_at(at: Graph) -> tuple[Component, ...]:
        return (*components_of(rig, at, shared, (rig, graph)), *drift)

    def parts_at(at: Graph) -> tuple[Component, ...]:
        return tuple(part.rows(robots) if part.side == "robot" else part for part in all_at(at))

    def at_corrected(source: JointModel, noise: Noise, fitted: Fit) -> JointModel:
        nonlocal where
        robot, C = corrected(fitted, noise, poses.robot, poses.camera)
        where = replace(graph, robot=robot[np.argsort(robots)], C=C)
        return replace(source, more=parts_at(where))

    given, some = given_covariances(rig, graph)
    known: dict[str, Any] = {"robot": np.zeros((6, 6)), "camera": given if some.any() else np.zeros((6, 6))}
    beside = _known(prior)
    source = JointModel(constraint, poses=poses, pose_prior=beside, more=parts_at(graph), **known)
    at = Unknowns(start[0], start[1])
    if robust and graph.E >= MIN_POSES_FOR_ROBUST:
        slack = TAIL_SLACK if rig.arms[next(iter(rig.arms))].kinematics is not None else 1.0
        weighed, sizes = weigh_from_two_starts(source, at, method, seed, slack, TAIL_SLACK if shared else slack)
        if sizes is None or weighed.noise is None:
            return None
        fitted, noise = weighed.fit, weighed.noise
    else:
        weighed, sizes = None, source.find(at)
        if sizes.noise is None:
            return None
        noise = with_prior(sizes.noise, beside)
        fitted = FITS[method](constraint, noise, at)
    unknowns = fitted.unknowns
    sizes, noise, fitted = settle(source, noise, fitted, weighed, sizes, method, at_corrected)
    assert unknowns.W is not None
    spread = sizes.spread @ sizes.spread.T
    if (motion := motion_in_session(fitted, noise)) is not None:
        spread = spread + motion @ motion.T
    found = found_of(rig, graph, all_at(where), sizes.mixture, spread)
    weights = np.ones(graph.E) if fitted.weights is None else fitted.weights
    return OfPair(found, np.stack([unknowns.X, unknowns.W]), weights)


def weigh_pair(task: Task, noise: RigNoise, start: Array) -> tuple[Array, Array]:
    """Return start poses and weights for the fit of a pair, where the noise is given."""
    poses, robots = _poses_of(task.graph)
    sides = {"robot": (noise.robot[robots], noise.K_robot[robots]), "camera": (noise.camera, noise.K_camera)}
    of_poses: dict[str, Any] = {
        side: JointCovariance(own, K) if K.shape[-1] else own for side, (own, K) in sides.items()
    }
    given = with_prior(PoseNoise(**of_poses), _known(task.prior))
    constraint = constraint_of(poses, given)
    found = likelihood_robust(constraint, given, Unknowns(start[0], start[1]), task.method, seed=task.seed)
    assert found.begun is not None and found.begun.W is not None
    return np.stack([found.begun.X, found.begun.W]), found.weights


def _poses_of(graph: Graph) -> tuple[PosePairs, NDArray[np.intp]]:
    """Poses of a pair, and the number of the robot pose of each."""
    on_left = bool(graph.side[0][0] < graph.P)
    robots = graph.side[0 if on_left else 1]
    return PosePairs(graph.robot[robots], graph.C, "eye-in-hand" if on_left else "eye-to-hand"), robots


def _known(prior: Prior) -> PosePrior | None:
    X, W = (prior.get(u, (None, None)) for u in (0, 1))
    return PosePrior(X[0], X[1], W[0], W[1]) if prior else None


def _drift(rig: Rig, graph: Graph, poses: PosePairs) -> tuple[Component, ...]:
    """Drifts of camera and target, where the names of the moments are times: numbers that are not all whole."""
    at: list[Any] = [moment for view in rig.views for moment in view.at or ()]
    if {type(moment) for moment in at} != {float} or all(time.is_integer() for time in at):
        return ()
    timed = replace(poses, timestamps=np.array(at))
    return tuple(
        Component(f"{graph.names[0]} {error.name}", error.side, Size(float(error.sd[0]), error.factor),
                  columns=error.at(timed)) for error in assumed_drift(timed)
    )  # fmt: skip
