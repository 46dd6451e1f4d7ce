"""How good plans are: against all subsets, against random poses, from degenerate starts, on real poses.

    python -m studies.planning [--full] [--csv planning.csv]

Prints the tables of docs/how-to/plan.md and writes their numbers as CSV, with a fixed seed. 200 simulated sessions for
the first two tables, 50 for each row of the others (``--full``: 1,000 and 250, in about two minutes), poses and noise
of each drawn anew: robot 0.02 deg, 0.05 mm; camera 0.1 deg, 0.5 mm. Real poses are looked for in the folder named by
UQ_HANDEYE_DATA; without it their table is left out. Times are ratios within one run.
"""

from __future__ import annotations

import argparse
import csv
import os
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import uq_handeye as uq
from studies.efficiency import disturbed, errors
from uq_handeye.candidates import predicted_camera, sample_candidates
from uq_handeye.constraint import OnPoses, residual_covariance
from uq_handeye.likelihood import bound, cholesky_of, efficient, whiten
from uq_handeye.planning import CRITERIA, plan
from uq_handeye.planning_selection import covariance_of, greedy, value
from uq_handeye.planning_start import so_far
from uq_handeye.se3 import Array, skew
from uq_handeye.simulation import RIGS

SEED = 2024
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
REAL_NOISE = uq.PoseNoise.isotropic(robot=("0.05deg", "0.2mm"), camera=("0.2deg", "1mm"))
POINT = np.array([0.0, 0.0, 0.3])
EQUAL = 1e-9  # relative (logdet: absolute) difference that counts as none
ORDERS = 10  # random orders of the pool per session
SAMPLES = (50, 200, 1000, 5000)

# A table: its columns, and rows of cells as the page shows them with the numbers behind each.
Cell = tuple[str, dict[str, float]]
Row = tuple[str, list[Cell]]


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
    return disturbed(rng, robot, NOISE.robot, 1)[0], disturbed(rng, camera, NOISE.camera, 1)[0]


def worst_translation(covariance: Array) -> Array:
    """Standard deviation (mm) of the translation along its worst axis."""
    return np.asarray(1e3 * np.sqrt(np.linalg.eigvalsh(covariance[..., 3:, 3:])[..., -1]))


def worst_rotation(covariance: Array) -> Array:
    """Standard deviation (deg) of the rotation along its worst axis."""
    return np.asarray(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance[..., :3, :3])[..., -1])))


def number(name: str, x: float, form: str) -> Cell:
    return format(x, form), {name: float(x)}


def spread(name: str, values: Array, form: str, tail: float = 0.0) -> Cell:
    """Median, and in brackets the range that leaves out the share ``tail`` at either end; infinite is "open"."""
    numbers = np.quantile(values, [0.5, tail, 1 - tail], method="inverted_cdf")
    middle, low, high = (f"{x:{form}}" if np.isfinite(x) else "open" for x in numbers)
    text = "open" if low == "open" else f"{middle} ({low} to {high})"
    return text, dict(zip((f"{name} median", f"{name} low", f"{name} high"), map(float, numbers), strict=True))


# ---------------------------------------------------------------------------------------------- against all subsets


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
        cells = []
        for name, gap in zip(("greedy", "exchange"), np.array(pairs).T, strict=True):
            assert gap.min() > -EQUAL
            gap[gap < EQUAL] = 0.0
            at_best, mean, most = int((gap == 0.0).sum()), gap.mean(), gap.max()
            size = f"{mean:.4f}, {most:.2f}" if criterion == "logdet" else f"{mean:.2%}, {most:.1%}".replace("%", " %")
            numbers = {"at the optimum": at_best, "mean gap": mean, "worst gap": most}
            cells.append((f"{at_best} of {sessions:,}, {size}", {f"{name} {key}": x for key, x in numbers.items()}))
        yield f"`{criterion}`", cells


# ------------------------------------------------------------------------------------------- against random poses


def against_random_poses(sessions: int) -> Iterator[Row]:
    """5 more poses after 10, of a pool of 400: predicted standard deviations, then NEES of X from those poses."""
    taken: list[list[uq.PosePairs]] = [[], [], []]
    predicted: list[list[Array]] = [[], [], []]
    needed = []
    X, W = RIGS["eye-in-hand"]
    for rng in generators(1, sessions):
        data = uq.simulate(10, noise=NOISE, seed=rng)
        pool = uq.simulate(400, seed=rng).robot
        found = plan(data, pool, 5, noise=NOISE)
        information, rows = offered(data, pool)
        orders = rng.permuted(np.tile(np.arange(len(pool)), (ORDERS, 1)), axis=1)
        grams = (rows.mT @ rows)[orders]
        random = covariance_of(information + np.cumsum(grams, axis=1))[..., :6, :6]
        good = worst_translation(random) <= worst_translation(found.covariances[-1])
        assert good.any(axis=1).all()
        needed.append(1 + good.argmax(axis=1))
        after = (found.covariance_before, random[0, 4], found.covariances[-1])
        for case, (chosen, covariance) in enumerate(zip(([], orders[0, :5], found.chosen), after, strict=True)):
            G = pool[np.asarray(chosen, dtype=np.intp)]
            robot, camera = measured(rng, G, predicted_camera(G, X, W, data.setup))
            taken[case].append(uq.PosePairs(np.concatenate([data.robot, robot]), np.concatenate([data.camera, camera])))
            predicted[case].append(covariance)
    cases = zip(("none", "5 at random", "5 planned"), taken, predicted, strict=True)
    for name, poses, covariances in cases:
        S = np.array(covariances)
        batch = uq.PosePairs(np.stack([data.robot for data in poses]), np.stack([data.camera for data in poses]))
        e = errors(efficient(batch, NOISE).X, X)
        distance = (e[:, None, :] @ np.linalg.solve(S, e[..., None]))[:, 0, 0]
        same: Cell = ("", {})
        if name == "5 planned":
            same = spread("random poses as good", np.concatenate(needed), ".0f", 0.05)
        yield (
            name,
            [
                number("translation sd mm", worst_translation(S).mean(), ".2f"),
                number("rotation sd deg", worst_rotation(S).mean(), ".3f"),
                same,
                number("NEES", distance.mean(), ".2f"),
            ],
        )


# ------------------------------------------------------------------------------------------------- more candidates


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
    median = np.median(times, axis=1)
    for sample, mean, time in zip(SAMPLES, sd.mean(axis=1), median / median[SAMPLES.index(200)], strict=True):
        yield f"{sample:,}", [number("translation sd mm", mean, ".2f"), number("time", time, ".2g")]


# ------------------------------------------------------------------------------------------------ degenerate starts


def degenerate(rng: np.random.Generator, setup: str, turn: float) -> uq.PosePairs:
    """8 robot poses that move and turn up to ``turn`` (deg) about the base's z axis alone, without noise."""
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
            yield (
                f"{start}, {setup}",
                [
                    (" or ".join(map(str, sorted(n_open))), {"most open directions": max(n_open)}),
                    *(spread(f"sd mm after {k}", x, ".2f") for k, x in enumerate(np.array(reached).T, start=1)),
                ],
            )


# -------------------------------------------------------------------------------------------------------- real data


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
        low, high = np.min(ratios[0]), np.max(ratios[0])
        yield (
            f"{name}, {data.n} poses",
            [
                (f"{low:.2f} to {high:.2f}", {"first 8 low": float(low), "first 8 high": float(high)}),
                spread("random 8", np.ravel(ratios[1:]), ".2f"),
                (f"{n_open} of {sessions}", {"open starts": n_open}),
            ],
        )


# ------------------------------------------------------------------------------------------------------------ output


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="1,000 sessions instead of 200")
    parser.add_argument("--csv", default="planning.csv")
    options = parser.parse_args()
    sessions = 1000 if options.full else 200
    tables: list[tuple[str, Sequence[str], Iterator[Row]]] = [
        (
            "subsets",
            ("criterion", "greedy alone: at the optimum, mean and worst gap", "with exchange (as used)"),
            against_all_subsets(sessions),
        ),
        (
            "random",
            ("more poses", "translation sd, mm", "rotation sd, deg", "random poses for the same", "NEES"),
            against_random_poses(sessions),
        ),
        ("candidates", ("candidates", "translation sd, mm", "time"), more_candidates(sessions // 4)),
        (
            "degenerate",
            ("8 poses so far", "open directions", *(f"after {k}, mm" for k in (1, 2, 3))),
            degenerate_starts(sessions // 4),
        ),
    ]
    if folder := os.environ.get("UQ_HANDEYE_DATA"):
        of_real = ("poses", "first 8 poses so far", "random 8 poses so far", "left a part of X open")
        tables.append(("real", of_real, real_poses(sessions // 4, Path(folder))))
    with open(options.csv, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["table", "row", "quantity", "value"])
        for name, columns, rows in tables:
            print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
            for title, cells in rows:
                print("| " + " | ".join([title, *(text for text, _ in cells)]) + " |", flush=True)
                for _, numbers in cells:
                    writer.writerows([name, title.strip("`"), quantity, f"{x:.6g}"] for quantity, x in numbers.items())
            print()
    low, high = np.asarray(chi2.ppf([0.0005, 0.9995], 6 * sessions)) / sessions
    print(f"99.9 % of means of a true NEES over {sessions:,} sessions lie between {low:.2f} and {high:.2f}.")


if __name__ == "__main__":
    main()
