r"""Robust weights of views and of robot poses.

A wrong detection spoils the rows of one view, a wrong robot pose those of its group. Both are tested with the same
formula. With ``P = S^-1 - S^-1 A H^-1 A^T S^-1``, ``g = S^-1 residual`` and D the derivatives of the rows by the error
of covariance Sigma that is tested (of a camera pose or a robot pose),

    mu, V = eigen(L^T D^T P D L),   Sigma = L L^T,     d^2 = sum (V^T L^T D^T g)^2 / (mu (1 - mu (1/w - 1)))

is the square distance between the pose as measured and as everything else predicts it: chi-square with 6 degrees of
freedom for a good one, whatever its weight w (`graph.robust`). In a group of one edge the two cannot be separated:
the edge is tested by all of its rows. Where both are suspect in a group of several edges, the robot pose is
down-weighted if it explains more than the worst edge does, as its error affects all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...core.geometry.se3 import Array
from ...errors import InputError, NotConvergedError
from ...model.errors.cholesky import factor
from ...model.errors.square_roots import LEAST_WEIGHT
from .fit import MIN_POSE_WEIGHT, Prior, RigFit, Weights, fit
from .gauss_helmert import MAX_ROUNDS
from .graph import Graph
from .noise import RigNoise
from .robust import in_turns, largest_by_chance, left_out, robust_weights, scale_guard

# Robust weights have converged where none of them changes by more; and in the last round.
MAX_SETTLED_CHANGE, MAX_LAST_CHANGE = 0.01, 0.2
# The views contradict each other where so many fits in a row, with other weights each, do not converge.
MAX_FAILURES = 4


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
        e, q = batch.edges.shape[1], batch.robots.shape[1]
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
        for k in range(e):  # the error of a camera pose moves the rows of its edge only
            edges, of = batch.edges[:, k], slice(6 * k, 6 * k + 6)
            w = np.maximum(found.edge_weights[edges], MIN_POSE_WEIGHT)
            of_edges[edges] = _distance2(P[:, of, of], g[:, of], part.D_C[:, k], factor(noise.camera[edges]), w)
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
    begin: NDArray[np.bool_] | Weights | None = None,
) -> tuple[RigFit, Distances]:
    """Fit with weights of the views and of the robot poses; all are 1 where the largest distance is not unusual.

    ``begin`` (E,): the edges that count at first, or the weights to begin with. Raises `InputError` where less than
    half of the views agree, `NotConvergedError` where the fits do not converge whatever the weights.
    """
    limit = largest_by_chance(graph.E + graph.P)
    weights = (
        begin if isinstance(begin, Weights) else _first(graph, np.ones(graph.E, dtype=bool) if begin is None else begin)
    )
    if weights.edges.all() and weights.poses.all():
        found = fit(graph, noise, start, method, weights, prior)
        far = distances(found)
        if max(far.edges.max(initial=0.0), far.poses.max(initial=0.0)) <= limit:
            return found, far
        weights = found.weights
        del found, far
    at, cleared, failures = start, np.zeros(graph.P, dtype=bool), 0

    def fitted(w: Array, _: bool) -> tuple[tuple[RigFit, Distances], Array]:
        nonlocal at, weights, cleared, failures
        found = fit(graph, noise, at, method, weights._replace(edges=w[: graph.E], poses=w[graph.E :]), prior)
        failures = 0 if found.converged else failures + 1
        if failures == MAX_FAILURES:
            raise NotConvergedError(
                "The robust fit did not converge: the views contradict each other. Look at the units and the frames of "
                "each file, what cameras and targets are on, and the noise given.",
                found,
            )
        at, far, weights = found.at, distances(found), found.weights
        worst = _worst(graph, far)
        cleared |= (weights.poses == 0) & (worst > limit)  # its views contradict each other without it, too
        return (found, far), np.concatenate(_wanted(graph, far, worst, cleared))

    def still(done: int) -> float:
        return MAX_SETTLED_CHANGE if done < 2 * MAX_ROUNDS - 1 else MAX_LAST_CHANGE

    (found, far), _ = in_turns(fitted, np.concatenate([weights.edges, weights.poses]), still, 2 * MAX_ROUNDS)
    counted = int((found.view_weights > 0).sum())
    if 2 * counted < graph.E:
        raise InputError(
            f"Only {counted} of {graph.E} views agree with one rig within the noise; at least half of "
            "them must. Look at the names of the poses, what cameras and targets are on, the units and the noise given."
        )
    return found, far


def _first(graph: Graph, begin: NDArray[np.bool_]) -> Weights:
    """Weights to begin with: a robot pose all of whose views, two or more, are suspect takes the blame for them."""
    count, good = np.zeros(graph.P + 1), np.zeros(graph.P + 1)
    for side in graph.side:
        np.add.at(count, side, 1.0)
        np.add.at(good, side, begin.astype(float))
    blamed = (count > 1) & (good == 0)
    blamed[-1] = False
    w_e = begin | blamed[graph.side[0]] | blamed[graph.side[1]]
    return Weights(w_e.astype(float), np.where(blamed[:-1], 0.0, 1.0))


def _worst(graph: Graph, far: Distances) -> Array:
    """(P,) largest distance of the views of each robot pose."""
    worst = np.zeros(graph.P + 1)
    for side in graph.side:
        np.maximum.at(worst, side, far.edges)
    return worst[:-1]


def _scaled(d2: Array) -> Array:
    """Distances in units of the noise of most of them, where that is beyond chance larger than the noise given."""
    of = d2[d2 > 0]
    return d2 / scale_guard(of) if len(of) else d2


def _wanted(graph: Graph, far: Distances, worst: Array, cleared: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Weights by the distances: a robot pose that explains more than its worst view spares its views.

    ``cleared``: poses that are not to blame.
    """
    of_edges, of_poses = (robust_weights(_scaled(d2)) for d2 in (far.edges, far.poses))
    blamed = (far.poses > worst) & (of_poses < 1.0) & ~cleared
    of_poses = np.where(blamed, of_poses, 1.0)
    spared = np.zeros(graph.E, dtype=bool)
    for side in graph.side:
        spared |= np.concatenate([blamed, [False]])[side]
    return np.where(spared, 1.0, of_edges), of_poses
