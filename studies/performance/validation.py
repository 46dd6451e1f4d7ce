"""Time and memory of the validation against its goals: Monte Carlo, two workers, posterior, cross-check.

    python -m studies.performance.validation [--full]

Prints ratios of one run, each the median over interleaved repeats. The unit is the time NumPy takes to draw as many
standard normals as 10,000 trials of 60 motions with two full covariances need, 7.2 million. ``--full`` adds 1,000,000
trials with one and two workers, the memory of 10,000,000 trials, and the complete cross-check of (70).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

import uq_handeye as uq
from studies.common.geometries import random_transforms
from uq_handeye.core.geometry.se3 import inverse, perturb
from uq_handeye.trials.simulation.experiment import experiment
from uq_handeye.trials.simulation.run import run

SEED = 2019
N, TRIALS = 60, 10_000
# Nguyen and Pham's own program, 10,000 trials of 60 pairs, and the draw, on the machine of peers.md.
PEER_SECONDS, PEER_DRAW = 196.0, 0.061


def problem() -> tuple[uq.Motions, uq.PairNoise]:
    """60 motions with full 6x6 noise on both sides, drawn."""
    rng = np.random.default_rng(SEED)
    X, B = random_transforms(rng, ()), random_transforms(rng, (N,))
    factors = 1e-3 * (0.5 * np.eye(6) + rng.normal(size=(2, 6, 6)) / np.sqrt(6))
    noise = uq.PairNoise(*(L @ L.T for L in factors))
    A = X @ B @ inverse(X)
    A, B = (perturb(T, rng.normal(size=(N, 6)) @ L.T) for T, L in zip((A, B), factors, strict=True))
    return uq.Motions(A, B), noise


def seconds(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def interleaved(functions: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median time of each, the calls taking turns."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(repeats):
        for name, function in functions.items():
            times[name].append(seconds(function))
    return {name: float(np.median(values)) for name, values in times.items()}


def line(what: str, measured: str, goal: str, met: bool) -> None:
    print(f"{what:58s} {measured:>22s}   goal {goal:24s} {'' if met else 'MISS'}")


def memory_of(code: str) -> float:
    """Peak memory in MB of a fresh interpreter that runs the code."""
    ended = f"{code}\nimport resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)"
    done = subprocess.run([sys.executable, "-c", ended], check=True, capture_output=True, text=True)
    return float(done.stdout.split()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--full", action="store_true", help="the long runs too")
    parser.add_argument("--repeats", type=int, default=11)
    arguments = parser.parse_args()
    data, noise = problem()

    trials = {name: experiment(data, noise, name) for name in ("4dpa", "efficient", "ml", "nguyen")}
    generator = np.random.default_rng
    medians = interleaved(
        {
            "draw": lambda: generator(SEED).standard_normal(TRIALS * N * 12),
            "engine": lambda: run(trials["4dpa"], np.random.Generator(np.random.SFC64(SEED)), TRIALS),
            "monte_carlo": lambda: uq.monte_carlo(data, noise=noise, trials=TRIALS, seed=SEED),
            "efficient": lambda: uq.monte_carlo(data, noise=noise, method="efficient", trials=TRIALS, seed=SEED),
        },
        arguments.repeats,
    )
    draw, call = medians["draw"], medians["monte_carlo"]
    print(f"draw of {TRIALS * N * 12:,} standard normals: {1e3 * draw:.1f} ms\n")
    line("4dpa, 10,000 trials of 60 motions, engine", f"{medians['engine'] / draw:.2f} draws", "", True)
    line("monte_carlo, all of it", f"{call / draw:.2f} draws", "1.6", call <= 1.6 * draw)
    scaled = PEER_SECONDS / PEER_DRAW * draw
    line("  against Nguyen and Pham's program", f"{scaled / call:,.0f} times faster", "1,000", scaled >= 1000 * call)
    ratio = medians["efficient"] / call
    line("monte_carlo of efficient", f"{ratio:.2f} times 4dpa", "6", ratio <= 6)
    for name in ("ml", "nguyen"):
        taken = seconds(partial(uq.monte_carlo, data, noise=noise, method=name, trials=TRIALS, seed=SEED))
        line(f"monte_carlo of {name}", f"{taken / call:.0f} times 4dpa", "", True)
    taken = seconds(lambda: uq.sample_posterior(data, noise=noise, seed=SEED))
    limit = 15 * draw / PEER_DRAW
    line("sample_posterior, 10,000 effective samples", f"{taken:.2f} s", f"{limit:.0f} s", taken < limit)
    if not arguments.full:
        return
    million = 1_000_000
    one, two = (
        seconds(partial(uq.monte_carlo, data, noise=noise, trials=million, seed=SEED, workers=workers))
        for workers in (1, 2)
    )
    line("1,000,000 trials, two workers", f"{one / two:.2f} times faster", "1.7", one >= 1.7 * two)
    code = (
        "from studies.performance.validation import problem, SEED\nimport uq_handeye as uq\n"
        "data, noise = problem()\nuq.monte_carlo(data, noise=noise, trials=10_000_000, seed=SEED)"
    )
    peak = memory_of(code)
    line("10,000,000 trials, one process", f"{peak:.0f} MB", "500 MB", peak < 500)
    taken = seconds(lambda: uq.cross_check(data, noise=noise, trials=TRIALS, seed=SEED, workers=2))
    line("cross_check, 10,000 trials", f"{taken:.1f} s", "120 s", taken < 120)


if __name__ == "__main__":
    main()
