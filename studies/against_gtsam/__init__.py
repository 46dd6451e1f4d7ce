"""Agreement of `ml` and GTSAM on the same poses and noise, and the time of `efficient` and GTSAM.

Model: ``G X C = W`` with a Gaussian error on every robot and camera pose. GTSAM has the same poses and noise in a
factor graph with latent robot poses, `LevenbergMarquardt` and `Marginals`; the graphs are those of the tests
(tests/fixtures/gtsam_graphs.py). Seed 2019. Real poses are compared where UQ_HANDEYE_DATA names their folder. Needs
GTSAM (extra `test`; without it the exit code is 2). Quick: simulated poses, and 10 and 30 poses for the times. The
paper does not compare with GTSAM.

Agreement: the largest ``|eigenvalue - 1|`` of the covariances of X and of W whitened by GTSAM's, and the distance of
the two X and W in standard deviations, the larger of the two; with GTSAM's own errors (right perturbation, logarithm of
SE(3)), and with the toolkit's (left rotation, additive translation) written into GTSAM's factors. Times: medians of
interleaved runs, one thread in BLAS. GTSAM starts at 4DPA's X; neither that start nor building its graph is counted,
while `efficient` finds its own; GTSAM's camera factor is a Python callback.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.gtsam_graphs import gtsam_graphs
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.presentation.colours import BLUE, INK, ORANGE, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.methods.all_pairs import solve_all_pairs
from uq_handeye.methods.target_pose import mean_target

SEED = 2019
OTHERS = 20  # random covariances tried besides those of the tests
POSES = (10, 30, 60, 100, 300, 1000)


def cases(graphs: Any, full: bool) -> Iterator[tuple[str, uq.PosePairs, uq.PoseNoise]]:
    """Label, poses and noise."""
    for setup in ("eye-in-hand", "eye-to-hand"):
        for sd in (1e-4, 1e-3):
            noise = graphs.anisotropic(sd)
            poses = uq.simulate(20, noise=noise, setup=setup, seed=SEED)
            yield f"simulated, {setup}, full 6x6 of {1e3 * sd:g} mrad, mm", poses, noise
    if not full or "UQ_HANDEYE_DATA" not in os.environ:
        return
    for label, (folder, count, setup, noise) in graphs.REAL.items():
        yield label, graphs.poses_of(folder, count, setup), noise
    poses = graphs.poses_of("nguyen_pham", 100, "eye-to-hand")
    rng = np.random.default_rng(SEED)
    for _ in range(OTHERS):
        robot, camera = (graphs.random_covariance(rng, sd=sd) for sd in (1e-3, 5e-3))
        yield f"nguyen, {OTHERS} other full 6x6, largest", poses, uq.PoseNoise(robot, camera)


def agreement(graphs: Any, full: bool) -> Iterator[dict[str, Any]]:
    """Yield the largest differences for each label."""
    rows: dict[str, tuple[int, list[list[float]]]] = {}
    with progress_bar("poses", None, "sets") as advance:
        for label, poses, noise in cases(graphs, full):
            found = []
            for graph_of in (graphs.native, graphs.in_our_convention):
                difference = graphs.Difference(poses, noise, graph_of)
                found += [max(difference.spread), max(difference.shift)]
            rows.setdefault(label, (poses.n, []))[1].append(found)
            advance(1)
    for label, (n, all_found) in rows.items():
        spread, shift, our_spread, our_shift = np.max(all_found, axis=0)
        yield {
            "data": label,
            "poses": n,
            "sets": len(all_found),
            "covariance": spread,
            "X_and_W_sd": shift,
            "covariance_our_errors": our_spread,
            "X_and_W_sd_our_errors": our_shift,
        }


def by_gtsam(graphs: Any, poses: uq.PosePairs, noise: uq.PoseNoise) -> Callable[[], object]:
    """Solve and marginals of X and W, with GTSAM's default parameters, from 4DPA."""
    gtsam = graphs.gtsam
    graph, start = graphs.native(poses, noise), gtsam.Values()
    X = solve_all_pairs(poses)
    for key, T in ((graphs.x, X), (graphs.w, mean_target(poses, X))):
        start.insert(key, gtsam.Pose3(T))
    for k, T in enumerate(poses.robot):
        start.insert(gtsam.symbol("g", k), gtsam.Pose3(T))

    def run() -> object:
        values = gtsam.LevenbergMarquardtOptimizer(graph, start, gtsam.LevenbergMarquardtParams()).optimize()
        marginals = gtsam.Marginals(graph, values)
        return [marginals.marginalCovariance(key) for key in (graphs.x, graphs.w)]

    return run


def interleaved(runs: list[Callable[[], object]], seconds: float) -> list[float]:
    """Medians in ms, each run once per round."""
    taken: list[list[float]] = [[] for _ in runs]
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(taken[0]) < 5:
        for run, times in zip(runs, taken, strict=True):
            began = time.perf_counter()
            run()
            times.append(1e3 * (time.perf_counter() - began))
    return [float(np.median(times)) for times in taken]


def times(graphs: Any, counts: tuple[int, ...], seconds: float) -> Iterator[dict[str, Any]]:
    noise = graphs.anisotropic(1e-3)
    for n in counts:
        poses = uq.simulate(n, noise=noise, seed=SEED)
        ours, theirs = interleaved([partial(efficient, poses, noise), by_gtsam(graphs, poses, noise)], seconds)
        yield {"poses": n, "efficient_ms": ours, "gtsam_ms": theirs}


def load_graphs() -> Any:
    """The module with the factor graphs; without GTSAM the program ends."""
    if importlib.util.find_spec("gtsam") is None:
        print("GTSAM is not installed: pip install gtsam, where it has wheels.", file=sys.stderr)
        raise SystemExit(2)
    return gtsam_graphs()


def measure(full: bool) -> Tables:
    graphs = load_graphs()
    counts, seconds = (POSES, 4.0) if full else (POSES[:2], 0.5)
    return {
        "agreement": pd.DataFrame(agreement(graphs, full)),
        "times": pd.DataFrame(times(graphs, counts, seconds)),
    }


def findings(tables: Tables) -> str:
    table, taken = tables["agreement"], tables["times"]
    ratios = taken["gtsam_ms"] / taken["efficient_ms"]
    worst = table.sort_values("covariance").to_dict("records")[-1]
    same = table[["covariance_our_errors", "X_and_W_sd_our_errors"]].max().max()
    faster = (ratios > 1).sum()
    return "\n\n".join(
        [
            "Largest |eigenvalue - 1| of the whitened covariances of X and of W, and distance of X and of W in "
            "standard deviations, the larger of the two: with GTSAM's errors, then with the toolkit's in its factors.",
            markdown(
                ["poses", "n", "covariance", "X, W", "covariance, our errors", "X, W, our errors"],
                [
                    [
                        row["data"],
                        row["poses"],
                        f"{100 * row['covariance']:.2f} %",
                        f"{row['X_and_W_sd']:.3f}",
                        f"{row['covariance_our_errors']:.0e}",
                        f"{row['X_and_W_sd_our_errors']:.0e}",
                    ]
                    for row in table.to_dict("records")
                ],
            ),
            f"With GTSAM's errors the covariances agree to 1 % in {(table['covariance'] < 0.01).sum()} of {len(table)} "
            f"rows, X and W to a tenth of a standard deviation in {(table['X_and_W_sd'] < 0.1).sum()}; farthest apart "
            f'are the covariances on "{worst["data"]}": {100 * worst["covariance"]:.2f} %. With the same errors on '
            f"both sides the largest difference of all is {same:.0e}.",
            "Time of GTSAM's solve and marginals over that of `efficient`, full 6x6 noise on both sides:",
            markdown(
                ["poses", *(f"{n:,}" for n in taken["poses"])],
                [["GTSAM / `efficient`", *(f"{ratio:.2g}" for ratio in ratios)]],
            ),
            f"`efficient` is the faster one in {faster} of {len(taken)} sizes, {ratios.min():.2g} to "
            f"{ratios.max():.2g} "
            "times as fast.",
        ]
    )


def figures(tables: Tables) -> dict[str, Figure]:
    table, taken = tables["agreement"], tables["times"]
    figure = canvas(2.2 + 0.17 * len(table))
    differences, ratio = figure.subplots(1, 2, width_ratios=(3, 2))
    y = np.arange(len(table))
    for column, colour, marker, label in (
        ("covariance", ORANGE, "o", "GTSAM's errors"),
        ("covariance_our_errors", BLUE, "s", "our errors in GTSAM"),
    ):
        differences.plot(table[column], y, color=colour, marker=marker, markersize=5, linestyle="none", label=label)
    plain(differences)
    differences.set_xscale("log")
    differences.set_xlabel("|eigenvalue - 1| of covariances", fontsize=TEXT)
    differences.set_ylim(len(table) - 0.5, -0.5)
    differences.set_yticks(
        y, [label.replace(", largest", "").replace("simulated, ", "") for label in table["data"]], fontsize=SMALL
    )
    differences.tick_params(axis="y", length=0)
    differences.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, fontsize=SMALL, frameon=False)
    plain(ratio)
    ratio.plot(taken["poses"], taken["gtsam_ms"] / taken["efficient_ms"], color=INK, marker="D", markersize=4.5)
    ratio.axhline(1, color=QUIET, linewidth=0.8, linestyle=":")
    ratio.set_xscale("log")
    ratio.set_yscale("log")
    ratio.set_xlabel("poses", fontsize=TEXT)
    ratio.set_ylabel("time of GTSAM / efficient", fontsize=TEXT)
    return {"agreement": finished(figure)}


STUDY = Study("against_gtsam", measure, findings, figures, packages=("gtsam",))
