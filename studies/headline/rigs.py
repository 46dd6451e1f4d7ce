"""Rigs of the kinds that users have, right and wrong, each with its true X."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import uq_handeye as uq
from studies.camera_covariance import poses_of, recorded
from studies.kinematics.arms import ARMS
from studies.real_rigs import finished, walking
from studies.robot_accuracy.rigs import session
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.model.shared_errors.assumed import default_errors
from uq_handeye.model.shared_errors.shared_error import SharedError

SETUPS = ("eye-in-hand", "eye-to-hand")
# Standard deviations (rad, m), drawn log-uniformly between these.
ROBOT = ((1e-4, 2e-5), (1e-3, 2e-4))
CAMERA = ((3e-4, 1e-4), (3e-3, 1e-3))
SQUARE, FOCAL, COEFFICIENT = 0.01, 0.002, 0.9
OUTLIERS, FAR = 0.08, (0.1, 0.05)  # share of the poses; rad and m
HALF = 0.5  # noise given is so much of the true one


@dataclass(frozen=True, eq=False)
class Rig:
    """Poses, the true X, and what `calibrate` is told."""

    poses: uq.PosePairs
    X: Array
    options: dict[str, Any] = field(default_factory=dict)


Kind = Callable[[np.random.Generator], Rig | None]


def count(rng: np.random.Generator, least: int = 8, most: int = 60) -> int:
    """Draw a number of poses, log-uniformly."""
    return int(np.exp(rng.uniform(np.log(least), np.log(most + 1))))


def drawn(rng: np.random.Generator, n: int, setup: str | None = None) -> tuple[uq.PosePairs, uq.PoseNoise]:
    """Draw true poses and the noise of both sides."""
    setup = setup or SETUPS[int(rng.integers(2))]
    truth = uq.simulate(n, setup=setup, seed=rng).truth
    assert truth is not None
    sides = []
    for low, high in (ROBOT, CAMERA):
        turn, move = np.exp(rng.uniform(np.log(low), np.log(high)))
        sides.append(np.diag(np.repeat([turn, move], 3) ** 2))
    return uq.PosePairs(truth.robot, truth.camera, setup, np.arange(float(n)), truth), uq.PoseNoise(*sides)


def measured(
    true: uq.PosePairs, noise: uq.PoseNoise, rng: np.random.Generator, wrong: dict[str, Array] | None = None
) -> uq.PosePairs:
    """Move the poses by the errors ``wrong`` (n, 6) of a side, and then by noise."""
    moved = []
    for side in ("robot", "camera"):
        T = perturb(getattr(true, side), np.broadcast_to((wrong or {}).get(side, 0.0), (true.n, 6)))
        sd = np.sqrt(np.diag(getattr(noise, side)))
        moved.append(perturb(T, sd * rng.standard_normal((true.n, 6))))
    return uq.PosePairs(moved[0], moved[1], true.setup, true.timestamps)


def shared(errors: list[SharedError], true: uq.PosePairs, rng: np.random.Generator) -> dict[str, Array]:
    """Draw errors that all camera poses share from their standard deviations."""
    parts = [error.at(true) @ (error.sd * rng.standard_normal(len(error.sd))) for error in errors]
    return {"camera": np.asarray(sum(parts))}


def usual(rng: np.random.Generator, least: int = 8, most: int = 60) -> tuple[uq.PosePairs, uq.PoseNoise, uq.PosePairs]:
    """Draw a rig whose camera has shared errors as large as `calibrate` assumes: true poses, noise, measured poses."""
    true, noise = drawn(rng, count(rng, least, most))
    return true, noise, measured(true, noise, rng, shared(list(default_errors(False)), true, rng))


def given(rng: np.random.Generator) -> Rig:
    true, noise = drawn(rng, count(rng, 4))
    assert true.truth is not None
    return Rig(measured(true, noise, rng), true.truth.X, {"noise": noise})


def given_too_small(rng: np.random.Generator) -> Rig:
    rig = given(rng)
    noise = rig.options["noise"]
    return Rig(rig.poses, rig.X, {"noise": uq.PoseNoise(HALF**2 * noise.robot, HALF**2 * noise.camera)})


def estimated(least: int, most: int) -> Kind:
    def made(rng: np.random.Generator) -> Rig:
        true, _, poses = usual(rng, least, most)
        assert true.truth is not None
        return Rig(poses, true.truth.X)

    return made


def outliers(rng: np.random.Generator) -> Rig:
    true, _, poses = usual(rng, 10)
    assert true.truth is not None
    camera = np.array(poses.camera)
    bad = rng.choice(true.n, max(1, round(OUTLIERS * true.n)), replace=False)
    camera[bad] = perturb(camera[bad], rng.standard_normal((len(bad), 6)) * np.repeat(FAR, 3))
    return Rig(uq.PosePairs(poses.robot, camera, poses.setup, poses.timestamps), true.truth.X)


def of_error(make: Callable[[uq.PosePairs, np.random.Generator], dict[str, Array]]) -> Kind:
    def made(rng: np.random.Generator) -> Rig:
        true, noise = drawn(rng, count(rng))
        assert true.truth is not None
        return Rig(measured(true, noise, rng, make(true, rng)), true.truth.X)

    return made


def square(true: uq.PosePairs, rng: np.random.Generator) -> dict[str, Array]:
    return {"camera": SharedError.target_scale().at(true) @ np.full(1, SQUARE * rng.choice([-1, 1]))}


def focal(true: uq.PosePairs, rng: np.random.Generator) -> dict[str, Array]:
    return {"camera": SharedError.focal_length().at(true) @ np.full(1, FOCAL * rng.choice([-1, 1]))}


def correlated(rng: np.random.Generator) -> Rig:
    """Draw a rig of whose noise half the variance is an autoregressive process."""
    true, noise = drawn(rng, count(rng, 15))
    assert true.truth is not None
    z = rng.standard_normal((true.n, 6))
    for k in range(1, true.n):
        z[k] = COEFFICIENT * z[k - 1] + np.sqrt(1 - COEFFICIENT**2) * z[k]
    walk = {"camera": z * np.sqrt(np.diag(np.asarray(noise.camera)))}
    return Rig(measured(true, noise, rng, walk), true.truth.X)


def finished_poses(rng: np.random.Generator) -> Rig | None:
    """Poses by corners whose corners were thrown away."""
    n, setup = count(rng, 10, 40), SETUPS[int(rng.integers(2))]
    made = finished(n, setup, int(rng.integers(1_000_000)))
    return None if made is None else Rig(made[0], made[2])


def corners(rng: np.random.Generator) -> Rig:
    """Poses with their corners."""
    setup = SETUPS[int(rng.integers(2))]
    seen, robot, X = recorded(rng, count(rng, 10, 25), setup=setup)
    return Rig(poses_of(seen, robot, setup=setup), X)


def arm(place: str, declared: bool = False) -> Kind:
    """Arms of the study `robot_accuracy`; ``declared``: with their accuracy over the workspace as an option."""

    def made(rng: np.random.Generator) -> Rig:
        of = session(ARMS[int(rng.integers(len(ARMS)))], SETUPS[int(rng.integers(2))], place, count(rng, 10), rng)
        errors = [*default_errors(False), SharedError.robot_accuracy(*of.accuracy)]
        return Rig(of.poses, of.X, {"shared": errors} if declared else {})

    return made


def changed(change: Callable[[Array, Array], tuple[Array, Array]]) -> Kind:
    """Change the files of a usual rig as a mistake would."""

    def made(rng: np.random.Generator) -> Rig:
        true, _, poses = usual(rng)
        assert true.truth is not None
        robot, camera = change(poses.robot, poses.camera)
        return Rig(uq.PosePairs(robot, camera, poses.setup), true.truth.X)

    return made


def in_mm(T: Array) -> Array:
    found = np.array(T)
    found[:, :3, 3] *= 1e3
    return found


def scalar_first(T: Array) -> Array:
    """Read quaternions x, y, z, w as w, x, y, z."""
    from scipy.spatial.transform import Rotation

    found = np.array(T)
    x, y, z, w = Rotation.from_matrix(T[:, :3, :3]).as_quat().T
    found[:, :3, :3] = Rotation.from_quat(np.stack([y, z, w, x], axis=-1)).as_matrix()
    return found


# Rigs with errors that `calibrate` says it includes, or finds.
HONEST: dict[str, Kind] = {
    "noise given, 4 to 60 poses": given,
    "noise estimated, 4 to 7 poses": estimated(4, 7),
    "noise estimated, 8 to 14 poses": estimated(8, 14),
    "noise estimated, 15 to 60 poses": estimated(15, 60),
    "8 % outliers": outliers,
    "focal length 0.2 % off": of_error(focal),
    "squares 1 % off": of_error(square),
    "camera drifts": of_error(walking("camera")),
    "target drifts": of_error(walking("target")),
    "neighbours correlated": correlated,
    "finished poses from corners": finished_poses,
    "poses with corners": corners,
    "noise given too small by 2": given_too_small,
    "arm without URDF, one region": arm("one region"),
    "arm without URDF, wide": arm("wide"),
    "the same, one region, accuracy declared": arm("one region", declared=True),
    "the same, wide, accuracy declared": arm("wide", declared=True),
}
# Files that are wrong.
MISTAKES: dict[str, Kind] = {
    "rows shifted by one": changed(lambda G, C: (G[1:], C[:-1])),
    "camera poses inverse": changed(lambda G, C: (G, inverse(C))),
    "robot poses inverse": changed(lambda G, C: (inverse(G), C)),
    "camera in mm": changed(lambda G, C: (G, in_mm(C))),
    "robot in mm": changed(lambda G, C: (in_mm(G), C)),
    "camera scalar first": changed(lambda G, C: (G, scalar_first(C))),
    "robot scalar first": changed(lambda G, C: (scalar_first(G), C)),
}
KINDS = HONEST | MISTAKES
