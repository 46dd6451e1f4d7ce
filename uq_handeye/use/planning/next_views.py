r"""Best views of a rig to take next: the robot pose and the camera of the view that would add most.

A candidate is a pair of camera and target that the rig has views of, at a robot pose (of each arm that carries one of
them). The camera should see the target at ``C = P^-1 Q`` of the estimates; candidates at which it would be nearer or
farther, more to the side or more tilted than in the views so far are left out. The rows of the candidate, whitened by
the noise of robot and camera, and the posterior give the covariance after it; the criterion is the mean square error

    mean over cameras of  L^2 tr Cov(theta) + tr Cov(tau)

with L the mean distance of the targets: the mean square error of points at that distance. Views are chosen one after
the other, then exchanged (`posterior.selection`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...calibration.estimate.rig_poses import RigPoses
from ...calibration.prediction.noise_of_views import new_noise, posterior_of
from ...core.files.json_files import json_text
from ...core.files.records import Record
from ...core.geometry.checks import as_transforms
from ...core.geometry.se3 import Array, perturb
from ...errors import InputError
from ...fit.graph.graph import Graph, Sides
from ...fit.graph.noise import RigNoise
from ...model.noise.cholesky import checked_cholesky, substitute
from ...model.rig.description import WORLD, ArmPoses, Rig, View

# A candidate may exceed the distances and angles seen so far by this factor.
MAX_BEYOND = 1.15


@dataclass(frozen=True, eq=False)
class RigStep(Record):
    """One view to take: camera, target, number of the candidate, error of the cameras after it (m)."""

    camera: str
    target: str
    candidate: int
    error: float


@dataclass(frozen=True, eq=False)
class RigPlan(Record):
    """Views to take next, in order.

    ``error``: root mean square error of the cameras before (m), of points at the ``lever`` (m); each step has that
    after it. ``robot``: candidates (k, 4, 4) by arm.
    """

    _in_file: ClassVar[str] = "error lever steps robot"

    error: float
    lever: float
    steps: tuple[RigStep, ...]
    robot: dict[str, list[list[list[float]]]]

    def text(self) -> str:
        """Return a table of the views."""
        known = f"{1e3 * self.error:.3f} mm (root mean square)"
        lines = [f"Points {self.lever:.2f} m ahead of the cameras are known to {known}.",
                 f"{'view':<5} {'camera':<16} {'target':<16} {'pose':>5} {'error (mm)':>11}"]  # fmt: skip
        for k, step in enumerate(self.steps, 1):
            row = f"{k:<5} {step.camera:<16} {step.target:<16} {step.candidate:>5} {1e3 * step.error:>11.3f}"
            lines.append(row)
        return "\n".join([*lines, "Reach and obstacles are not known. Check each pose before you drive there."]) + "\n"

    def to_json(self) -> str:
        """Return it as JSON text."""
        return json_text(self.to_dict())


def plan_rig(
    result: RigPoses, candidates: Mapping[str, ArrayLike] | None = None, k: int = 5, *, sample: int = 200, seed: int = 0
) -> RigPlan:
    """Choose the k views after which the poses of the cameras have the smallest errors.

    Parameters
    ----------
    result : RigCalibration
    candidates : mapping of names of arms to poses (n, 4, 4), or None
        Robot poses to choose from, of all arms row by row; None: drawn near those of the calibration.
    k : int
    sample, seed : int
        Number of candidates drawn, and their seed.

    Raises
    ------
    InputError
        No candidate at which a camera would see a target as it did before.
    """
    if k < 1:
        raise InputError(f"Expected `k` (-k) to be at least 1, got {k}.")
    robot = _drawn(result.rig, sample, seed) if candidates is None else _given(result.rig, candidates)
    rig, numbers = _candidates(result, robot)
    if not len(numbers):
        raise InputError(
            "At no candidate would a camera see a target as it did before. Give other robot poses, nearer to those of "
            "the calibration."
        )
    graph = Graph.of(rig)
    noise = new_noise(result, rig, graph)
    B = _whitened_alone(graph, graph.linearise(result.poses), noise)
    lever, cameras = float(result.lever), len(result.cameras)
    Q = np.zeros((len(B[0, 0]), len(B[0, 0])))
    weight = np.repeat([lever**2, 1.0], 3) / cameras
    Q[np.arange(6 * cameras), np.arange(6 * cameras)] = np.tile(weight, cameras)
    chosen = posterior_of(result).choose(B, min(k, len(B)), Q)
    errors = np.sqrt(np.maximum(chosen.values, 0.0)).tolist()
    steps = []
    for e, after in zip(chosen.chosen.tolist(), errors[1:], strict=True):
        view = rig.views[graph.view[e]]
        steps.append(RigStep(view.camera, view.target, int(numbers[e]), after))
    return RigPlan(errors[0], lever, tuple(steps), {name: T.tolist() for name, T in robot.items()})


def _whitened_alone(graph: Graph, sides: Sides, noise: RigNoise) -> Array:
    """(E, 6, p + m) rows of each view by itself, whitened by its noise and that of its robot poses."""
    K = sides.camera @ noise.K_camera
    S = sides.camera @ noise.camera @ sides.camera.mT
    zero = np.zeros((1, 6, 6))
    for D, side in zip(sides.robot, graph.side, strict=True):
        S = S + D @ np.concatenate([noise.robot, zero])[side] @ D.mT
        K = K + D @ np.concatenate([noise.K_robot, np.zeros((1, 6, noise.count))])[side]
    return substitute(checked_cholesky(S), np.concatenate([graph.by_unknowns(sides), K], axis=-1))


def _given(rig: Rig, candidates: Mapping[str, ArrayLike]) -> dict[str, Array]:
    found = {}
    for name, T in candidates.items():
        if name not in rig.arms:
            raise InputError(f"Expected candidates of the arms {', '.join(rig.arms)}, got {name!r}.")
        found[name] = as_transforms(T, f"candidates[{name!r}]")
    if len({len(T) for T in found.values()}) != 1:
        raise InputError("Expected as many candidates of each arm, row by row, and at least one arm.")
    return found


def _drawn(rig: Rig, sample: int, seed: int) -> dict[str, Array]:
    """Poses near those of the calibration, inside their box, which is made a little larger."""
    if sample < 1:
        raise InputError(f"Expected `sample` (--sample) to be at least 1, got {sample}.")
    rng, found = np.random.default_rng(seed), {}
    for name, arm in rig.arms.items():
        number = rng.integers(0, len(arm.poses), sample)
        if arm.kinematics is not None and arm.joints is not None:  # joints near those so far, which the arm reaches
            q = arm.joints[number] + 0.5 * np.std(arm.joints, axis=0) * rng.normal(size=(sample, arm.joints.shape[1]))
            found[name] = arm.kinematics.poses(np.clip(q, *arm.kinematics.limits.T))
            continue
        near = arm.poses[number]
        t = arm.poses[:, :3, 3]
        low, high = t.min(axis=0), t.max(axis=0)
        spread = 0.15 * float(np.linalg.norm(high - low))
        moves = np.concatenate([0.25 * rng.normal(size=(sample, 3)), spread * rng.normal(size=(sample, 3))], axis=1)
        T = perturb(near, moves)
        T[:, :3, 3] = np.clip(T[:, :3, 3], low - spread, high + spread)
        found[name] = T
    return found


def _candidates(result: RigPoses, robot: Mapping[str, Array]) -> tuple[Rig, NDArray[np.intp]]:
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
