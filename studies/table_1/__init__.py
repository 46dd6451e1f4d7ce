r"""Time, accuracy and consistency of every method (Table I of the paper, measured).

Table I gives each of 14 methods a type, its basic tools, a class of speed, a class of accuracy, and says whether it has
an uncertainty; it gives no rule. Here all of `METHODS` are measured, and beneath them `efficient`, `ml` and the two
robot-world methods:

    exact       largest error of X on 200 problems without noise: 5 motions of 1 to 179 degrees (robot-world: 6 poses)
    accuracy    RMS of |theta| and of |tau| of X in five cases of geometry and noise, over that of the Cramer-Rao bound:
                drawn in one geometry of each case, predicted to first order in ten further ones
    uncertainty mean NEES e^T Sigma^-1 e with the covariance that the method's delta method predicts at the true data;
                6 if it is true, and 99.9 % of such means lie in the interval beside it
    speed       smallest processor time of one problem of 60 consecutive motions (61 poses), and of a batch of 100

Classes: a speed is High below 5 times the fastest, Medium below 15, Low below 50, else Very Low; an accuracy (geometric
mean of the predicted ratios to the bound, over the further geometries, cases, rotation and translation) is High below
1.25, Medium below 2, else Low. Full: 2,000 draws per case (zhao 400, heller 200), the same for all methods; quick: 40,
and two further geometries. Seed 2019.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.common import paper_tables
from studies.common.geometries import random_transforms
from studies.common.noises import both, diagonal, paper
from studies.common.scores import errors, nees, true_means
from studies.common.study import Study, Tables
from studies.table_1.figures import figures
from studies.table_1.findings import findings
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import ESTIMATORS
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.methods.robot_world import RobotWorldMethod
from uq_handeye.model.poses.pose_pairs import Truth
from uq_handeye.trials.simulation.experiment import Experiment
from uq_handeye.trials.simulation.rig import disturbed
from uq_handeye.trials.simulation.run import Trials, errors_of, estimates

SEED = 2019
METHODS = (*uq.METHODS, *uq.ROBOT_WORLD_METHODS, *ESTIMATORS)
SLOW = {"zhao": 0.2, "heller": 0.1}  # share of the draws
BLOCK = 100  # draws at a time, for the memory
RIG = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("0.4mrad", "0.4mm"))
PAIRS = 60


class Case(NamedTuple):
    """Exact data that carry their truth, and the noise on them."""

    X: Array
    data: uq.PosePairs | uq.Motions
    noise: uq.PoseNoise | uq.PairNoise


def rig(camera: Array | None, robot: Array | None, rng: np.random.Generator) -> Case:
    """15 poses that look at a target, all 105 pairs."""
    poses = uq.simulate(15, seed=rng)
    assert poses.truth is not None
    return Case(poses.truth.X, poses, uq.PoseNoise(robot, camera))


def random_poses(n: int, rng: np.random.Generator) -> uq.PosePairs:
    X, W, robot = random_transforms(rng, ()), random_transforms(rng, ()), random_transforms(rng, (n,))
    camera = inverse(X) @ inverse(robot) @ W
    return uq.PosePairs(robot, camera, truth=Truth(X, W, robot, camera))


def on_random_poses(rng: np.random.Generator) -> Case:
    """15 random poses, all pairs; the robot is the worse side."""
    poses = random_poses(15, rng)
    assert poses.truth is not None
    return Case(poses.truth.X, poses, uq.PoseNoise(diagonal(1, 1), diagonal(0.2, 0.2)))


def on_motions(noise: uq.PairNoise, rng: np.random.Generator) -> Case:
    """60 random motions with noise of their own."""
    X, B = random_transforms(rng, ()), random_transforms(rng, (PAIRS,))
    return Case(X, uq.Motions(X @ B @ inverse(X), B), noise)


CASES: dict[str, Callable[[np.random.Generator], Case]] = {
    "rig, isotropic": partial(rig, RIG.camera, RIG.robot),
    "rig, weak depth": partial(rig, diagonal(1.5, 1.5, 0.4, 0.04, 0.04, 0.4), diagonal(0.1, 0.1)),
    "random poses, robot": on_random_poses,
    "motions, (70)": partial(on_motions, paper()),
    "motions, 1 mrad 0.1 mm": partial(on_motions, both(1, 0.1)),
}


def about() -> pd.DataFrame:
    """Describe every method: here, and in Table I."""
    rows: list[dict[str, object]] = []
    published: list[uq.Method | RobotWorldMethod] = [*uq.METHODS.values(), *uq.ROBOT_WORLD_METHODS.values()]
    for method in published:
        rows.append(
            {
                "method": method.name,
                "year": method.year,
                "reference": f"{method.authors} ({method.year})",
                "doi": method.doi or "",
                "structure": method.structure,
                "form": method.form,
                "minimises": method.minimises,
            }
        )
    for name, form in (("efficient", "closed form, two steps"), ("ml", "iterative")):
        row: dict[str, object] = {
            "method": name,
            "reference": "this toolkit",
            "structure": "simultaneous",
            "form": form,
        }
        rows.append(row | {"minimises": "minus the log-likelihood of all poses, given their noise"})
    printed = paper_tables.classes().add_prefix("paper_").rename(columns={"paper_method": "method"})
    table = pd.DataFrame(rows).merge(printed, "left").astype({"year": "Int64"})
    words = table.columns.drop("year")
    return table.fillna(dict.fromkeys(words, ""))


def exact_problems(count: int, N: int) -> tuple[Array, Array, Array]:
    """X (count, 4, 4), A and B (count, N, 4, 4) with ``A X = X B``; angles of 1 to 179 degrees."""
    rng = np.random.default_rng(SEED)
    axes = rng.normal(size=(count, N, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    T = np.zeros((count, N + 1, 4, 4))
    T[:, :N, :3, :3] = Rotation.from_rotvec(axes * np.radians(rng.uniform(1, 179, (count, N, 1)))).as_matrix()
    T[:, N, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    T[..., :3, 3] = 0.5 * rng.normal(size=(count, N + 1, 3))
    T[..., 3, 3] = 1.0
    B, X = T[:, :N], T[:, N:]
    return X[:, 0], X @ B @ inverse(X), B


def exact(count: int) -> pd.DataFrame:
    """Largest component of the error of X (rad or m) without noise."""
    X, A, B = exact_problems(count, 5)
    rng = np.random.default_rng([SEED, 1])
    robot, W = random_transforms(rng, (count, 6)), random_transforms(rng, (count, 1))
    poses = uq.PosePairs(robot, inverse(X[:, None]) @ inverse(robot) @ W)
    rows = []
    for name in METHODS:
        if name in uq.METHODS:
            found = uq.METHODS[name].estimate(A, B).X
        elif name in uq.ROBOT_WORLD_METHODS:
            found = uq.ROBOT_WORLD_METHODS[name](poses).X
        else:
            solve = uq.efficient if name == "efficient" else uq.maximum_likelihood
            found = solve(uq.Motions(A, B), both(0.1, 0.1)).X
        rows.append({"method": name, "problems": len(X), "largest_error_rad_m": float(np.abs(errors(found, X)).max())})
    return pd.DataFrame(rows)


def drawn(case: Case, count: int) -> Iterator[tuple[Array, Array]]:
    """Blocks of disturbed poses or motions (m, n, 4, 4) of robot and camera."""
    rng = np.random.default_rng([SEED, 2])
    data = case.data
    first, second = (data.robot, data.camera) if isinstance(data, uq.PosePairs) else (data.A, data.B)
    noise = case.noise
    noises = (noise.robot, noise.camera) if isinstance(noise, uq.PoseNoise) else (noise.A, noise.B)
    for done in range(0, count, BLOCK):
        m = (min(BLOCK, count - done),)
        yield disturbed(first, noises[0], m, rng), disturbed(second, noises[1], m, rng)


def limits_of(S: Array) -> Array:
    """RMS of |theta| (rad) and |tau| (m) of errors with the covariance S (6, 6)."""
    variances = np.diag(S)
    return np.sqrt([variances[:3].sum(), variances[3:].sum()])


def problems(case: Case) -> Iterator[Experiment]:
    """Yield the problem of every method that the case has data for."""
    on_poses = isinstance(case.data, uq.PosePairs)
    W = case.data.truth.W if isinstance(case.data, uq.PosePairs) and case.data.truth is not None else None
    for name in METHODS:
        if on_poses or name not in uq.ROBOT_WORLD_METHODS:
            yield Experiment(case.data, case.X, W, case.noise, name)


def case_of(label: str, geometry: int) -> Case:
    """Geometry 0 is that of the draws."""
    seed = [SEED, 10 + list(CASES).index(label), geometry]
    return CASES[label](np.random.default_rng(seed[: 3 if geometry else 2]))


def geometries(count: int) -> pd.DataFrame:
    """Predicted standard deviations over the bound in the geometry of the draws and in ``count`` further ones, no
    draws.
    """
    rows = []
    with progress_bar("geometries", len(CASES) * (count + 1), "geometries") as advance:
        for label in CASES:
            for geometry in range(count + 1):
                advance(1)
                case = case_of(label, geometry)
                least = limits_of(uq.bound(case.data, case.noise, case.X))
                for problem in problems(case):
                    turn, shift = limits_of(problem.predicted()) / least
                    rows.append(
                        {
                            "case": label,
                            "geometry": geometry,
                            "method": problem.method,
                            "rotation_over_bound": turn,
                            "translation_over_bound": shift,
                        }
                    )
    return pd.DataFrame(rows)


def accuracy(full: bool) -> pd.DataFrame:
    count = 2000 if full else 40
    rows = []
    with progress_bar("table 1", len(CASES) * len(METHODS), "cells") as advance:
        for label in CASES:
            case = case_of(label, 0)
            draws = list(drawn(case, count))
            limits = limits_of(uq.bound(case.data, case.noise, case.X))
            for problem in problems(case):
                advance(1)
                name = problem.method
                trials = max(4, round(SLOW.get(name, 1.0) * count))
                found: list[Trials] = []
                for first, second in draws:
                    m = trials - BLOCK * len(found)
                    if m > 0:
                        found.append(errors_of(problem, estimates(problem, first[:m], second[:m], False)))
                xi, ok = (np.concatenate([getattr(part, what) for part in found]) for what in ("errors", "ok"))
                xi = xi[ok]
                root = np.sqrt(np.mean(np.sum(xi.reshape(-1, 2, 3) ** 2, axis=2), axis=0))
                low, high = true_means(len(xi))
                rows.append(
                    {
                        "case": label,
                        "method": name,
                        "trials": len(ok),
                        "failed": int((~ok).sum()),
                        "rotation_mrad": 1e3 * root[0],
                        "translation_mm": 1e3 * root[1],
                        "rotation_over_bound": root[0] / limits[0],
                        "translation_over_bound": root[1] / limits[1],
                        "nees": float(nees(xi, problem.predicted()).mean()),
                        "nees_low": low,
                        "nees_high": high,
                    }
                )
    return pd.DataFrame(rows)


def calls(robot: Array, camera: Array, exact_motions: uq.Motions) -> dict[str, Callable[[], object]]:
    """Return the calls from motions (poses, for those that take them) to X; leading axes are problems."""
    poses = uq.PosePairs(robot, camera)
    motions = uq.relative_motions(poses)
    weights = noise_of_pairs(exact_motions, RIG)

    def of(method: uq.Method) -> Callable[[], object]:
        return lambda: method.estimate(motions.A, motions.B, weights if method.weighted else None)

    def on_poses(solve: Callable[[uq.PosePairs], object]) -> Callable[[], object]:
        return lambda: solve(poses)

    table = {name: of(method) for name, method in uq.METHODS.items()}
    table |= {name: on_poses(method) for name, method in uq.ROBOT_WORLD_METHODS.items()}
    return table | {
        "efficient": lambda: uq.efficient(poses, RIG),
        "ml": lambda: uq.maximum_likelihood(poses, RIG),
    }


def times(full: bool) -> pd.DataFrame:
    """Milliseconds per problem, alone and in a batch: the smallest of interleaved calls."""
    many = uq.simulate(PAIRS + 1, noise=RIG, trials=100 if full else 10, seed=SEED)
    assert many.truth is not None
    exact_motions = uq.relative_motions(uq.PosePairs(many.truth.robot, many.truth.camera))
    single = calls(many.robot[0], many.camera[0], exact_motions)
    batch = calls(many.robot, many.camera, exact_motions)
    rows: dict[str, dict[str, float | str]] = {name: {"method": name} for name in METHODS}
    for label, table, problems, repeats in (
        ("one", single, 1, 51 if full else 5),
        ("batch", batch, len(many.robot), 7 if full else 3),
    ):
        taken: dict[str, list[float]] = {name: [] for name in table}
        for repeat in range(repeats):
            for name, call in table.items():
                if name in SLOW and repeat >= (9 if label == "one" else 1):
                    continue
                started = time.process_time()
                call()
                taken[name].append(1e3 * (time.process_time() - started) / problems)
        least = {name: min(values) for name, values in taken.items()}
        for name, ms in least.items():
            rows[name] |= {f"{label}_ms": ms, f"{label}_over_fastest": ms / min(least.values())}
    return pd.DataFrame(rows.values())


def measure(full: bool) -> Tables:
    paper_times = paper_tables.errors_and_times()
    return {
        "about": about(),
        "exact": exact(200 if full else 20),
        "accuracy": accuracy(full),
        "geometries": geometries(10 if full else 2),
        "times": times(full),
        "paper_times": paper_times[["N", "method", "seconds"]],
    }


STUDY = Study("table_1", measure, findings, figures, packages=("cvxpy",))
