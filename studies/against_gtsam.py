"""`ml` and `efficient` against GTSAM: how far the answers agree, and the time of both.

    python -m studies.against_gtsam [--csv against_gtsam.csv]

Prints the two tables of docs/explanation/likelihood.md. Needs GTSAM (extra `test`; without it the exit code is 2). The
factor graphs are those of tests/test_against_gtsam.py. Real poses are compared where UQ_HANDEYE_DATA names their
folder.

Agreement: the largest ``|eigenvalue - 1|`` of the covariances of X (and of W) whitened by GTSAM's, and the distance of
the two X (and W) in standard deviations; with GTSAM's own errors, and with the toolkit's written into its factors.
Times: ratios of the medians of interleaved runs, one thread in BLAS; the CSV has the medians. GTSAM starts at 4DPA's X;
neither that start nor building its graph is counted, while `efficient` finds its own.
"""

from __future__ import annotations

import studies.performance.core  # before NumPy: it sets one thread  # isort: skip  # noqa: F401

import argparse
import csv
import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import uq_handeye as uq
from uq_handeye.all_pairs import solve_all_pairs
from uq_handeye.likelihood import efficient
from uq_handeye.robot_world import mean_target

SEED = 2019
OTHERS = 20  # random covariances tried besides those of the tests
POSES = (10, 30, 60, 100, 300, 1000)


def cases(tests: Any) -> Iterator[tuple[str, int, uq.PosePairs, uq.PoseNoise]]:
    """Label, which of several random covariances, poses and noise."""
    for setup in ("eye-in-hand", "eye-to-hand"):
        for sd in (1e-4, 1e-3):
            noise = tests.anisotropic(sd)
            poses = uq.simulate(20, noise=noise, setup=setup, seed=SEED)
            yield f"simulated, {setup}, full 6x6 of {1e3 * sd:g} mrad, mm", 0, poses, noise
    if "UQ_HANDEYE_DATA" not in os.environ:
        return
    for label, (folder, count, setup, noise) in tests.REAL.items():
        yield label, 0, tests.poses_of(folder, count, setup), noise
    poses = tests.poses_of("nguyen_pham", 100, "eye-to-hand")
    rng = np.random.default_rng(SEED)
    for k in range(OTHERS):
        robot, camera = (tests.random_covariance(rng, sd=sd) for sd in (1e-3, 5e-3))
        yield f"nguyen, {OTHERS} other full 6x6, largest", k, poses, uq.PoseNoise(robot, camera)


def agreement(tests: Any, write: Callable[[list[object]], object]) -> None:
    """Rows of one label: the largest figures are printed."""
    rows: dict[str, tuple[int, list[list[float]]]] = {}
    for label, which, poses, noise in cases(tests):
        found = []
        for graph_of in (tests.native, tests.in_our_convention):
            difference = tests.Difference(poses, noise, graph_of)
            found += [max(difference.spread), max(difference.shift)]
        rows.setdefault(label, (poses.n, []))[1].append(found)
        write(["agreement", label, poses.n, which, *(f"{value:.3g}" for value in found)])
    print("| poses | n | covariance | X, W | covariance, our errors | X, W, our errors |")
    print("|---|---|---|---|---|---|")
    for label, (n, all_found) in rows.items():
        spread, shift, our_spread, our_shift = np.max(all_found, axis=0)
        print(f"| {label} | {n} | {100 * spread:.2f} % | {shift:.3f} | {our_spread:.0e} | {our_shift:.0e} |")


def by_gtsam(tests: Any, poses: uq.PosePairs, noise: uq.PoseNoise) -> Callable[[], object]:
    """Solve and marginals of X and W, with GTSAM's default parameters, from 4DPA."""
    gtsam = tests.gtsam
    graph, start = tests.native(poses, noise), gtsam.Values()
    X = solve_all_pairs(poses)
    for key, T in ((tests.x, X), (tests.w, mean_target(poses, X))):
        start.insert(key, gtsam.Pose3(T))
    for k, T in enumerate(poses.robot):
        start.insert(gtsam.symbol("g", k), gtsam.Pose3(T))

    def run() -> object:
        values = gtsam.LevenbergMarquardtOptimizer(graph, start, gtsam.LevenbergMarquardtParams()).optimize()
        marginals = gtsam.Marginals(graph, values)
        return [marginals.marginalCovariance(key) for key in (tests.x, tests.w)]

    return run


def interleaved(runs: list[Callable[[], object]], seconds: float = 4.0) -> list[float]:
    """Medians in ms, each run once per round."""
    taken: list[list[float]] = [[] for _ in runs]
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(taken[0]) < 5:
        for run, times in zip(runs, taken, strict=True):
            began = time.perf_counter()
            run()
            times.append(1e3 * (time.perf_counter() - began))
    return [float(np.median(times)) for times in taken]


def times(tests: Any, write: Callable[[list[object]], object]) -> None:
    noise = tests.anisotropic(1e-3)
    ratios = []
    for n in POSES:
        poses = uq.simulate(n, noise=noise, seed=SEED)
        ours, theirs = interleaved([partial(efficient, poses, noise), by_gtsam(tests, poses, noise)])
        ratios.append(f"{theirs / ours:.2g}")
        write(["time", "efficient, GTSAM in ms", n, "", f"{ours:.3f}", f"{theirs:.3f}"])
    print("\n| poses | " + " | ".join(f"{n:,}" for n in POSES) + " |")
    print("|---" * (1 + len(POSES)) + "|")
    print("| GTSAM / `efficient` | " + " | ".join(ratios) + " |")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--csv", default="against_gtsam.csv")
    options = parser.parse_args()
    if importlib.util.find_spec("gtsam") is None:
        print("GTSAM is not installed: pip install gtsam, where it has wheels.", file=sys.stderr)
        raise SystemExit(2)
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    tests = importlib.import_module("test_against_gtsam")
    with open(options.csv, "w", newline="") as file:
        writer = csv.writer(file)
        columns = ["covariance or ms", "X and W or ms", "covariance, our errors", "X and W, our errors"]
        writer.writerow(["table", "row", "poses", "number", *columns])
        agreement(tests, writer.writerow)
        times(tests, writer.writerow)
    if "UQ_HANDEYE_DATA" not in os.environ:
        print("\nReal poses were left out: UQ_HANDEYE_DATA is not set.")


if __name__ == "__main__":
    main()
