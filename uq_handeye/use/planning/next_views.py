r"""Best views of a rig to take next: the robot pose and the camera of the view that would add most.

A candidate is a pair of camera and target that the rig has views of, at a robot pose (of each arm that carries one of
them). The camera should see the target at ``C = P^-1 Q`` of the estimates; candidates at which it would be nearer or
farther, more to the side or more tilted than in the views so far are left out. The rows of the candidate, whitened by
the noise of robot and camera, and the posterior give the covariance after it; the criterion is the mean square error

    mean over cameras of  2/3 L^2 tr Cov(theta) + tr Cov(tau)

with L the mean distance of the targets: the mean square error of points at that distance, in all directions. Views are
chosen one after the other, then exchanged (`graph.selection`). Directions that the views so far leave open have a weak
prior (`weak_prior`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...calibration.prediction.noise_of_views import new_noise, posterior_of
from ...calibration.rig_statement import RigStatement
from ...calibration.tolerance import Tolerance
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, perturb
from ...errors import InputError
from ...fit.graph.graph import Graph, Sides
from ...fit.graph.noise import RigNoise
from ...fit.graph.posterior import Posterior
from ...fit.graph.selection import weight_of_X
from ...model.errors.cholesky import checked_cholesky, substitute
from ...model.rig.description import WORLD, ArmPoses, Rig, View
from .by_posterior import MAX_POSES_TO_PASS, PlanRequest, first_within
from .result import Plan
from .weak_prior import WEAK_PRIOR_SD

# A candidate may exceed the distances and angles seen so far by this factor.
MAX_BEYOND = 1.15


def plan_rig(result: RigStatement, asked: PlanRequest) -> Plan:
    """Choose the views after which the poses of the cameras have the smallest errors.

    ``asked.candidates``: mapping of names of arms to poses (n, 4, 4), row by row; None: drawn near those of the
    calibration. Raises `InputError` where at no candidate a camera would see a target as it did before.
    """
    drawn = asked.candidates is None
    robot = _drawn(result, asked) if drawn else _given(result.rig, asked.candidates)
    rig, numbers = _candidates(result, robot)
    if not len(numbers):
        raise InputError(
            "At no candidate would a camera see a target as it did before. Give other robot poses, nearer to those of "
            "the calibration."
        )
    graph = Graph.of(rig)
    noise = new_noise(result, rig, graph, measured=False)
    sides, posterior = graph.linearise(result.poses), _with_open(posterior_of(result), result.open)
    B = _whitened_alone(graph, sides, noise)
    names = tuple(result.cameras)
    length = float(result.lever) if asked.length is None else cast("float", asked.length)
    Q = np.asarray(np.kron(np.eye(len(names)), weight_of_X(np.eye(4), None, length) / len(names)), dtype=float)
    found = posterior.choose(B, asked.k if asked.repeat else min(asked.k, len(B)), Q, repeat=asked.repeat)
    tolerance, needed = cast("Tolerance | None", asked.tolerance), None
    if tolerance is not None and not len(result.open):
        until = posterior.choose(B, MAX_POSES_TO_PASS, Q, repeat=True)
        poses = [one.pose for one in result.cameras.values()]
        needed = first_within(_of_cameras(until.covariances, len(names)), result.reference, tolerance, poses)
    views = [rig.views[graph.view[e]] for e in found.chosen.tolist()]
    return Plan(
        chosen=numbers[found.chosen],
        views=tuple((view.camera, view.target) for view in views),
        robots={name: T[numbers[found.chosen]] for name, T in robot.items()},
        camera=graph.C[found.chosen],
        cameras=names,
        of_cameras=_of_cameras(found.covariances, len(names)),
        criterion="trace",
        criterion_before=float(found.values[0]),
        criterion_values=found.values[1:],
        length=length,
        point=None,
        X=next(iter(result.cameras.values())).pose,
        W=next(iter(result.targets.values())).pose,
        setup=None,
        n_poses=result.rig.n_views,
        n_candidates=len(next(iter(robot.values()))),
        sampled=drawn,
        noise=None,
        noise_estimated=bool(result.components),
        open_directions=np.concatenate([one.open for one in result.cameras.values()]),
        shared=tuple(dict.fromkeys(str(key.error) for key in posterior.keys)),
        tolerance=tolerance,
        needed=needed,
        contradictions=result.contradictions,
    )


def _with_open(posterior: Posterior, opened: Array) -> Posterior:
    """Return the posterior with a weak prior along the directions (k, p) that are open, of which it has variance 0."""
    if not len(opened):
        return posterior
    covariance = posterior.covariance.copy()
    covariance[: opened.shape[1], : opened.shape[1]] += WEAK_PRIOR_SD**2 * opened.T @ opened
    return replace(posterior, covariance=covariance)


def _of_cameras(covariances: Array, count: int) -> Array:
    """(k + 1, count, 6, 6) blocks of the cameras, which are the first unknowns."""
    blocks = covariances[:, : 6 * count, : 6 * count].reshape(-1, count, 6, count, 6)
    return np.stack([blocks[:, c, :, c] for c in range(count)], axis=1)


def _whitened_alone(graph: Graph, sides: Sides, noise: RigNoise) -> Array:
    """(E, 6, p + m) rows of each view by itself, whitened by its noise and that of its robot poses."""
    K = sides.camera @ noise.K_camera
    S = sides.camera @ noise.camera @ sides.camera.mT
    zero = np.zeros((1, 6, 6))
    for D, side in zip(sides.robot, graph.side, strict=True):
        S = S + D @ np.concatenate([noise.robot, zero])[side] @ D.mT
        K = K + D @ np.concatenate([noise.K_robot, np.zeros((1, 6, noise.count))])[side]
    return substitute(checked_cholesky(S), np.concatenate([graph.by_unknowns(sides), K], axis=-1))


def _given(rig: Rig, candidates: Any) -> dict[str, Array]:
    if not isinstance(candidates, Mapping):
        raise InputError("Expected the candidates of a rig as a mapping of names of arms to poses (n, 4, 4).")
    found = {}
    for name, T in candidates.items():
        if name not in rig.arms:
            raise InputError(f"Expected candidates of the arms {', '.join(rig.arms)}, got {name!r}.")
        found[name] = as_transforms(T, f"candidates[{name!r}]")
    if len({len(T) for T in found.values()}) != 1:
        raise InputError("Expected as many candidates of each arm, row by row, and at least one arm.")
    return found


def _drawn(result: RigStatement, asked: PlanRequest) -> dict[str, Array]:
    """Poses near those of the calibration, inside their box, which is made a little larger, and above the floor."""
    sample, rig = asked.sample, result.rig
    if sample < 1:
        raise InputError(f"Expected `sample` (--sample) to be at least 1, got {sample}.")
    rng, found, kept = np.random.default_rng(asked.seed), dict[str, Array](), np.ones(sample, dtype=bool)
    for name, arm in rig.arms.items():
        number = rng.integers(0, len(arm.poses), sample)
        lowest = np.full(sample, np.inf)
        if arm.kinematics is not None and arm.joints is not None:  # joints near those so far, which the arm reaches
            q = arm.joints[number] + 0.5 * np.std(arm.joints, axis=0) * rng.normal(size=(sample, arm.joints.shape[1]))
            q = np.clip(q, *arm.kinematics.limits.T)
            found[name] = T = arm.kinematics.poses(q)
            lowest = arm.kinematics.frames(q)[:, 1:, 2, 3].min(axis=1)  # the first joint is where it is
        else:
            near, t = arm.poses[number], arm.poses[:, :3, 3]
            low, high = t.min(axis=0), t.max(axis=0)
            spread = 0.15 * float(np.linalg.norm(high - low))
            moves = np.concatenate([0.25 * rng.normal(size=(sample, 3)), spread * rng.normal(size=(sample, 3))], axis=1)
            T = perturb(near, moves)
            T[:, :3, 3] = np.clip(T[:, :3, 3], low - spread, high + spread)
            found[name] = T
        if asked.floor_m is not None:
            carried = [one.pose for one in result.singles if {**rig.cameras, **rig.targets}.get(one.name) == name]
            heights = [lowest, T[:, 2, 3], *((T @ pose)[:, 2, 3] for pose in carried)]
            kept &= np.min(heights, axis=0) >= asked.floor_m
    if not kept.any():
        raise InputError("No candidate that is drawn is above the floor. Give candidates, or a lower --floor.")
    return {name: T[kept] for name, T in found.items()}


def _candidates(result: RigStatement, robot: Mapping[str, Array]) -> tuple[Rig, NDArray[np.intp]]:
    """Views that may be taken, as a rig, and the number of the candidate of each."""
    rig, count = result.rig, len(next(iter(robot.values())))
    before: dict[tuple[str, str], list[Array]] = {}
    for view in rig.views:
        if (arms := set(rig.places(view)) - {WORLD}) and arms <= set(robot):
            before.setdefault((view.camera, view.target), []).append(view.poses)
    if not before:
        return rig, np.zeros(0, dtype=np.intp)
    poses = {name: arm.like(ArmPoses(robot[name])) if name in robot else arm for name, arm in rig.arms.items()}
    anything = np.broadcast_to(np.eye(4), (count, 4, 4))
    every = Rig(poses, rig.cameras, rig.targets, tuple(View(*pair, anything, tuple(range(count))) for pair in before))
    C = Graph.of(every).seen(result.poses).reshape(-1, count, 4, 4)
    kept = [np.flatnonzero(_visible(T, np.concatenate(seen))) for T, seen in zip(C, before.values(), strict=True)]
    views = tuple(
        replace(view, poses=T[some], at=tuple(some.tolist()))
        for view, T, some in zip(every.views, C, kept, strict=True) if len(some)
    )  # fmt: skip
    return (replace(every, views=views) if views else rig), np.concatenate(kept)


def _visible(C: Array, seen: Array) -> NDArray[np.bool_]:
    """Return which poses (k, 4, 4) lie within what has been seen: distance, angle from the axis, tilt."""

    def numbers(T: Array) -> tuple[Array, Array, Array]:
        distance = np.linalg.norm(T[:, :3, 3], axis=1)
        aside = np.arccos(np.clip(T[:, 2, 3] / np.maximum(distance, 1e-12), -1, 1))
        return distance, aside, np.arccos(np.clip(T[:, 2, 2], -1, 1))

    now, before = numbers(C), numbers(seen)
    good = (now[0] > before[0].min() / MAX_BEYOND) & (now[0] < before[0].max() * MAX_BEYOND)
    for value, known in zip(now[1:], before[1:], strict=True):
        middle, reach = 0.5 * (known.min() + known.max()), 0.5 * (known.max() - known.min())
        good &= np.abs(value - middle) < MAX_BEYOND * reach + 0.05
    return np.asarray(good)
