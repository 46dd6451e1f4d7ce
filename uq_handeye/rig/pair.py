r"""A rig that is one camera, one target and one arm: sizes and weights as `calibrate` finds them.

Such a graph has one kind of edge, each with a robot pose of its own: its rows are those of `likelihood.constraint`, and
`one_model` takes the components of the rig as they are, weighs the poses and finds the sizes (`one_model.weights`).
What comes back are sizes, weights and unknowns to fit the graph from.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se3 import Array
from ..fit.likelihood.constraint import Unknowns, constraint_of
from ..fit.likelihood.gauss_helmert import FITS, Fit, corrected
from ..fit.likelihood.robust import fit_robustly as likelihood_robust
from ..fit.one_model.component import Component
from ..fit.one_model.estimation import JointModel
from ..fit.one_model.weights import TAILS, settle, weigh_from_two_starts
from ..model.noise.joint_covariance import JointCovariance
from ..model.noise.models import Noise, PoseNoise, with_prior
from ..model.noise.pose_prior import PosePrior
from ..model.poses.pose_pairs import PosePairs
from ..model.shared_errors.assumed import assumed_drift
from ..model.shared_errors.sizes import Size
from .description import Rig
from .fit import Prior, Task
from .graph import Graph
from .noise import RigNoise
from .sizes import Found, components_of, found_of, given_roots

# Poses from which on wrong ones can be told from good ones.
FEWEST_FOR_ROBUST = 5


class OfPair(NamedTuple):
    """Sizes, poses (2, 4, 4) and weights (E,) of a pair."""

    sizes: Found
    at: Array
    weights: Array


def is_pair(task: Task) -> bool:
    """Return whether the graph has one kind of edge, each with a robot pose of its own, and all covariances or none."""
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

    roots = given_roots(rig, graph)
    known: dict[str, Any] = {"robot": np.zeros((6, 6)), "camera": np.zeros((6, 6))}
    if roots is not None:
        known["camera"] = roots @ roots.mT
    beside = _known(prior)
    source = JointModel(constraint, poses=poses, pose_prior=beside, more=parts_at(graph), **known)
    at = Unknowns(start[0], start[1])
    if robust and graph.E >= FEWEST_FOR_ROBUST:
        slack = TAILS if rig.arms[next(iter(rig.arms))].kinematics is not None else 1.0
        weighed, sizes = weigh_from_two_starts(source, at, method, seed, slack, TAILS if shared else slack)
        if sizes is None or weighed.noise is None:
            return None
        fitted, noise = weighed.fit, weighed.noise
    else:
        weighed, sizes = None, source.find(at)
        if sizes.noise is None:
            return None
        noise = with_prior(sizes.noise, beside)
        fitted = FITS[method](constraint, noise, at)
    assert isinstance(noise, PoseNoise)
    unknowns = fitted.unknowns
    sizes, *_ = settle(source, noise, fitted, weighed, sizes, method, at_corrected)
    assert unknowns.W is not None
    found = found_of(rig, graph, all_at(where), sizes.mixture, sizes.spread @ sizes.spread.T)
    weights = np.ones(graph.E) if fitted.weights is None else fitted.weights
    return OfPair(found, np.stack([unknowns.X, unknowns.W]), weights)


def weigh_pair(task: Task, noise: RigNoise, start: Array) -> tuple[Array, Array]:
    """Poses to fit a pair from, and weights, where the noise is given."""
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
    at = [moment for view in rig.views for moment in view.at or ()]
    times = [moment for moment in at if isinstance(moment, float)]
    if len(times) < len(at) or all(time.is_integer() for time in times):
        return ()
    timed = replace(poses, timestamps=np.array(times))
    return tuple(
        Component(f"{graph.names[0]} {error.name}", error.side, Size(float(error.sd[0]), error.factor),
                  columns=error.at(timed)) for error in assumed_drift(timed)
    )  # fmt: skip
