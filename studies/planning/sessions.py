"""Simulated sessions of planning, and real poses, for `studies.planning`: what is drawn and what is scored.

Noise of a session: robot 0.02 deg, 0.05 mm; camera 0.1 deg, 0.5 mm, per axis; poses are those of `uq.simulate`. Each
function gives the rows of one table; every session has a generator of its own, so that more sessions change none.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common.scores import errors, nees
from uq_handeye.core.geometry.se3 import Array, inverse, skew
from uq_handeye.fit.graph.constraint import OnPoses, residual_covariance
from uq_handeye.fit.graph.gauss_helmert import bound, efficient
from uq_handeye.fit.graph.selection import covariance_of, greedy, value
from uq_handeye.model.errors.square_roots import cholesky_of, whiten
from uq_handeye.trials.simulation.rig import RIGS, disturbed
from uq_handeye.use.planning.by_posterior import CRITERIA
from uq_handeye.use.planning.candidates import sample_candidates
from uq_handeye.use.planning.plan import plan
from uq_handeye.use.planning.weak_prior import so_far

SEED = 2024
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
REAL_NOISE = uq.PoseNoise.isotropic(robot=("0.05deg", "0.2mm"), camera=("0.2deg", "1mm"))
POINT = np.array([0.0, 0.0, 0.3])
EQUAL = 1e-9  # relative (logdet: absolute) difference that counts as none
ORDERS = 10  # random orders of the pool per session
SAMPLES = (50, 200, 1000, 5000)
CURVE = 25  # random poses that are followed

Row = dict[str, Any]


def predicted_camera(robot: Array, X: Array, W: Array, setup: str) -> Array:
    """``C = inv(X) inv(G) W`` (m, 4, 4), what the camera would see from the robot poses (m, 4, 4)."""
    return np.asarray(inverse(X) @ (robot if setup == "eye-to-hand" else inverse(robot)) @ W)


def generators(table: int, count: int) -> Iterator[np.random.Generator]:
    return (np.random.default_rng([SEED, table, session]) for session in range(count))


def offered(data: uq.PosePairs, robot: Array) -> tuple[Array, Array]:
    """Information (12, 12) of the poses so far, whitened derivatives (m, 6, 12) at robot poses, as `plan` has them."""
    at, information, _ = so_far(data, NOISE)
    assert at.W is not None
    camera = predicted_camera(robot, at.X, at.W, data.setup)
    linear = OnPoses(robot, camera, data.setup == "eye-to-hand").linearise(at, robot, camera)
    return information, whiten(cholesky_of(residual_covariance(linear.sides, NOISE)), linear.J)


def measured(rng: np.random.Generator, robot: Array, camera: Array) -> tuple[Array, Array]:
    """Poses (n, 4, 4) with noise."""
    return disturbed(robot, NOISE.robot, (), rng), disturbed(camera, NOISE.camera, (), rng)


def worst_translation(covariance: Array) -> Array:
    """Standard deviation (mm) of the translation along its worst axis."""
    return np.asarray(1e3 * np.sqrt(np.linalg.eigvalsh(covariance[..., 3:, 3:])[..., -1]))


def worst_rotation(covariance: Array) -> Array:
    """Standard deviation (deg) of the rotation along its worst axis."""
    return np.asarray(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance[..., :3, :3])[..., -1])))


def spread(values: Array, unit: str, tail: float = 0.0) -> Row:
    """Median, and the range that leaves out the share ``tail`` at either end; infinite values stay empty."""
    numbers = np.quantile(values, [0.5, tail, 1 - tail], method="inverted_cdf")
    names = (f"median_{unit}", f"least_{unit}", f"largest_{unit}")
    return {name: float(x) if np.isfinite(x) else None for name, x in zip(names, numbers, strict=True)}


def against_all_subsets(sessions: int) -> Iterator[Row]:
    """3 out of 12 candidates after 5 poses: gap of the criterion to the best of all 220 subsets."""
    subsets = np.array(list(combinations(range(12), 3)))
    gaps: dict[str, list[tuple[float, float]]] = {name: [] for name in CRITERIA}
    for rng in generators(0, sessions):
        data = uq.simulate(5, noise=NOISE, seed=rng)
        at = so_far(data, NOISE)[0]
        assert at.W is not None
        candidates = sample_candidates(data, at.X, at.W, 12, seed=rng)
        information, rows = offered(data, candidates)
        grams = rows.mT @ rows
        covariances = covariance_of(information + grams[subsets].sum(axis=1))[:, :6, :6]
        for criterion in CRITERIA:
            point = POINT if criterion == "point" else None
            found = plan(data, candidates, 3, noise=NOISE, criterion=criterion, point=point)
            Q = None
            if criterion == "point":
                M = np.concatenate([-skew(found.X[:3, :3] @ POINT), np.eye(3)], axis=1)
                Q = M.T @ M
            elif found.length is not None:
                Q = np.diag([2 / 3 * found.length**2] * 3 + [1.0] * 3)
            best = float(value(covariances, Q).min())
            alone = greedy(information, rows, np.arange(12), 3, Q, repeat=False)
            reached = float(value(covariance_of(information + grams[alone].sum(axis=0))[:6, :6], Q))
            scale = 1.0 if Q is None else best
            gaps[criterion].append(((reached - best) / scale, (found.criterion_values[-1] - best) / scale))
    for criterion, pairs in gaps.items():
        for selection, gap in zip(("greedy", "exchange"), np.array(pairs).T, strict=True):
            assert gap.min() > -EQUAL
            gap[gap < EQUAL] = 0.0
            yield {
                "criterion": criterion,
                "selection": selection,
                "sessions": sessions,
                "at_the_optimum": int((gap == 0.0).sum()),
                "mean_gap": gap.mean(),
                "worst_gap": gap.max(),
            }


def against_random_poses(sessions: int) -> tuple[list[Row], list[Row]]:
    """5 more poses after 10, of a pool of 400: predicted standard deviations, then NEES of X from those poses.

    Second table: the predicted standard deviation pose by pose, at random and as planned.
    """
    taken: list[list[uq.PosePairs]] = [[], [], []]
    predicted: list[list[Array]] = [[], [], []]
    needed = []
    curves: dict[str, list[Array]] = {"at random": [], "planned": []}
    X, W = RIGS["eye-in-hand"]
    for rng in generators(1, sessions):
        data = uq.simulate(10, noise=NOISE, seed=rng)
        pool = uq.simulate(400, seed=rng).robot
        found = plan(data, pool, 5, noise=NOISE)
        information, rows = offered(data, pool)
        orders = rng.permuted(np.tile(np.arange(len(pool)), (ORDERS, 1)), axis=1)
        grams = (rows.mT @ rows)[orders]
        random = covariance_of(information + np.cumsum(grams, axis=1))[..., :6, :6]
        before = np.asarray(found.covariance_before)[None]
        curves["planned"].append(worst_translation(np.concatenate([before, found.covariances])))
        of_random = random[:, :CURVE]
        start = np.broadcast_to(before, (ORDERS, 1, 6, 6))
        curves["at random"] += list(worst_translation(np.concatenate([start, of_random], axis=1)))
        good = worst_translation(random) <= worst_translation(found.covariances[-1])
        assert good.any(axis=1).all()
        needed.append(1 + good.argmax(axis=1))
        after = (found.covariance_before, random[0, 4].copy(), found.covariances[-1])
        for case, (chosen, covariance) in enumerate(zip(([], orders[0, :5], found.chosen), after, strict=True)):
            G = pool[np.asarray(chosen, dtype=np.intp)]
            robot, camera = measured(rng, G, predicted_camera(G, X, W, data.setup))
            taken[case].append(uq.PosePairs(np.concatenate([data.robot, robot]), np.concatenate([data.camera, camera])))
            predicted[case].append(covariance)
    table: list[Row] = []
    for name, poses, covariances in zip(("none", "5 at random", "5 planned"), taken, predicted, strict=True):
        S = np.array(covariances)
        batch = uq.PosePairs(np.stack([data.robot for data in poses]), np.stack([data.camera for data in poses]))
        distance = nees(errors(efficient(batch, NOISE).X, X), S)
        same = spread(np.concatenate(needed), "random_poses_as_good", 0.05) if name == "5 planned" else {}
        table.append(
            {
                "more_poses": name,
                "sessions": sessions,
                "translation_sd_mm": worst_translation(S).mean(),
                "rotation_sd_deg": worst_rotation(S).mean(),
                "mean_nees": distance.mean(),
                **same,
            }
        )
    followed: list[Row] = []
    for name, lines in curves.items():
        low, middle, high = np.quantile(lines, [0.05, 0.5, 0.95], axis=0)
        followed += [
            {"more_poses": name, "poses": k, "median_mm": middle[k], "low_5_mm": low[k], "high_95_mm": high[k]}
            for k in range(len(middle))
        ]
    return table, followed


def more_candidates(sessions: int) -> Iterator[Row]:
    """5 more poses after 10, among more and more candidates drawn: what they bring, and the time."""
    sd, times = np.zeros((2, len(SAMPLES), sessions))
    for session, rng in enumerate(generators(2, sessions)):
        data = uq.simulate(10, noise=NOISE, seed=rng)
        for i, sample in enumerate(SAMPLES):
            start = perf_counter()
            found = plan(data, k=5, noise=NOISE, sample=sample, seed=rng)
            times[i, session] = perf_counter() - start
            sd[i, session] = worst_translation(found.covariances[-1])
    for sample, mean, time in zip(SAMPLES, sd.mean(axis=1), np.median(times, axis=1), strict=True):
        yield {"candidates": sample, "sessions": sessions, "translation_sd_mm": mean, "median_ms": 1e3 * time}


def degenerate(rng: np.random.Generator, setup: str, turn: float) -> uq.PosePairs:
    """8 robot poses that move and rotate up to ``turn`` (deg) about the base's z axis alone, without noise."""
    X, W = RIGS[setup]
    start = uq.simulate(1, setup=setup, seed=rng).robot[0]
    G = np.tile(start, (8, 1, 1))
    G[:, :3, :3] = Rotation.from_euler("z", rng.uniform(-turn, turn, (8, 1)), degrees=True).as_matrix() @ start[:3, :3]
    G[:, :3, 3] += rng.uniform(-0.15, 0.15, (8, 3))
    return uq.PosePairs(G, predicted_camera(G, X, W, setup), setup)


def limit(poses: uq.PosePairs, X: Array) -> float:
    """The bound on the translation of X (mm, worst axis), infinite where poses leave it open."""
    try:
        return float(worst_translation(bound(poses, NOISE, X)))
    except uq.DegenerateMotionError:
        return np.inf


def degenerate_starts(sessions: int) -> Iterator[Row]:
    """The bound on the translation of X (mm, worst axis) with the true rig after each pose of one plan."""
    for i, (start, turn) in enumerate((("parallel axes", 60.0), ("pure translations", 0.0))):
        for j, (setup, (X, W)) in enumerate(RIGS.items()):
            reached, n_open = [], set()
            for rng in generators(3 + 2 * i + j, sessions):
                exact = degenerate(rng, setup, turn)
                robot, camera = measured(rng, exact.robot, exact.camera)
                found = plan(uq.PosePairs(robot, camera, setup), k=3, noise=NOISE, seed=rng)
                n_open.add(len(found.open_directions))
                robot = np.concatenate([exact.robot, found.robot])
                poses = uq.PosePairs(robot, predicted_camera(robot, X, W, setup), setup)
                reached.append([limit(poses.rows(np.arange(n)), X) for n in (9, 10, 11)])
            for k, x in enumerate(np.array(reached).T, start=1):
                yield {
                    "so_far": start,
                    "setup": setup,
                    "sessions": sessions,
                    "open_directions": " or ".join(map(str, sorted(n_open))),
                    "after": k,
                    "left_open": int(np.isinf(x).sum()),
                    **spread(x, "mm"),
                }


def real_poses(sessions: int, folder: Path) -> Iterator[Row]:
    """8 poses so far, 5 of the others planned: standard deviations with them measured, over those predicted."""
    for i, name in enumerate(("kuka_1", "nguyen_pham")):
        data = uq.read_poses(folder / name / "robot.csv", folder / name / "camera.csv")
        ratios, n_open = [], 0
        for session, rng in enumerate(generators(7 + i, sessions)):
            order = np.arange(data.n) if session == 0 else rng.permutation(data.n)
            first, others = order[:8], order[8:]
            found = plan(data.rows(first), data.robot[others], 5, noise=REAL_NOISE)
            later = efficient(data.rows(np.append(first, others[found.chosen])), REAL_NOISE)
            ratios.append(np.sqrt(np.diag(later.covariance_X)) / found.std[-1])
            n_open += len(found.open_directions) > 0
        yield {
            "poses": name,
            "available": data.n,
            "sessions": sessions,
            "first_8_least_ratio": np.min(ratios[0]),
            "first_8_largest_ratio": np.max(ratios[0]),
            **spread(np.ravel(ratios[1:]), "ratio"),
            "left_open": n_open,
        }
