"""Simulated rigs with their true poses: for trials, tests and examples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array, perturb
from ...fit.graph.graph import Graph
from ...fit.graph.noise import given_noise
from ...model.errors.cholesky import factor
from ...model.rig.description import WORLD, ArmPoses, Rig, View
from ...model.rig.noise_by_name import NoiseByName


def simulate_rig(
    cameras: Mapping[str, str],
    targets: Mapping[str, str],
    *,
    arms: Sequence[str] = ("arm",),
    n_poses: int = 40,
    noise: NoiseByName | None = None,
    seen: float | Sequence[tuple[str, str]] = 1.0,
    axes: Array | None = None,
    seed: int | np.random.Generator = 0,
) -> tuple[Rig, dict[str, Array]]:
    """Draw a rig, with noise, and its true poses by name.

    Parameters
    ----------
    cameras, targets : mapping of names to their carriers
    arms : names of the arms; all move to a pose of their own at each moment
    n_poses : number of moments
    noise : as `calibrate_rig` takes it; None: exact poses
    seen : share of the moments at which a camera sees a target, or the pairs of them that see each other at all
    axes : (k, 3) axes of rotation of the arms; None: all
    seed : of the draws

    Examples
    --------
    >>> rig, truth = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=12, seed=1)
    >>> rig
    Rig(1 arm, 2 cameras, 1 target, 24 views)
    """
    rng = np.random.default_rng(seed)
    truth = {name: _placed(place, rng, 1.2) for name, place in cameras.items()}
    truth |= {name: _placed(place, rng, 0.6) for name, place in targets.items()}
    truth |= {
        name: _pose(rng.normal(size=3), np.array([1.2, 0.0, 0.0]) + 0.1 * rng.normal(size=3)) for name in arms[1:]
    }
    robots = {}
    for name in arms:
        turn = 0.5 * rng.normal(size=(n_poses, 3))
        if axes is not None:
            unit = np.asarray(axes) / np.linalg.norm(axes, axis=-1, keepdims=True)
            turn = rng.normal(size=(n_poses, len(unit))) @ unit
        start = Rotation.from_rotvec(rng.normal(size=3))
        robots[name] = np.tile(np.eye(4), (n_poses, 1, 1))
        robots[name][:, :3, :3] = (Rotation.from_rotvec(turn) * start).as_matrix()
        robots[name][:, :3, 3] = [0.5, 0.0, 0.4] + 0.25 * rng.normal(size=(n_poses, 3))
    views = []
    for camera in cameras:
        for target in targets:
            share = seen if isinstance(seen, float | int) else float((camera, target) in seen)
            if not share:
                continue
            some = np.flatnonzero(rng.random(n_poses) < share)
            if len(some):
                anything = np.broadcast_to(np.eye(4), (len(some), 4, 4))
                views.append(View(camera, target, anything, tuple(some.tolist())))
    rig = Rig({name: ArmPoses(poses) for name, poses in robots.items()}, dict(cameras), dict(targets), tuple(views))
    graph = Graph.of(rig)
    C = graph.seen(np.stack([truth[name] for name in graph.names]))
    rig = replace(rig, views=tuple(replace(view, poses=C[graph.view == k]) for k, view in enumerate(views)))
    return (rig if noise is None else with_noise(rig, noise, rng)), truth


def with_noise(rig: Rig, noise: NoiseByName, seed: int | np.random.Generator = 0) -> Rig:
    """Return a rig of exact poses with noise drawn for each robot pose and each view."""
    rng, graph = np.random.default_rng(seed), Graph.of(rig)
    S = given_noise(rig, graph, noise)
    errors = [(factor(own) @ rng.normal(size=(len(own), 6, 1)))[..., 0] for own in (S.robot, S.camera)]
    errors[1] = errors[1] + S.K_camera @ rng.normal(size=S.count)
    robot, C = perturb(graph.robot, errors[0]), perturb(graph.C, errors[1])
    arms = {}
    for k, (name, arm) in enumerate(rig.arms.items()):
        poses = np.array(arm.poses)
        poses[graph.pose[graph.arm == k]] = robot[graph.arm == k]
        arms[name] = ArmPoses(poses, arm.names, arm.source)
    views = [replace(view, poses=C[graph.view == k]) for k, view in enumerate(rig.views)]
    return Rig(arms, rig.cameras, rig.targets, tuple(views))


def _placed(place: str, rng: np.random.Generator, away: float) -> Array:
    if place != WORLD:
        return _pose(0.5 * rng.normal(size=3), np.array([0.0, 0.0, 0.1]) + 0.05 * rng.normal(size=3))
    return _pose(rng.normal(size=3), np.array([away, 0.0, 0.3]) + 0.4 * rng.normal(size=3))


def _pose(turn: Array, t: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), t
    return T
