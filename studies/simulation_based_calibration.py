"""Simulation-based calibration of the posterior: are its probabilities those of the world it claims?

    python -m studies.simulation_based_calibration [--full] [--workers 2] [--csv x.csv] [--figure x.png]

Talts et al. 2018 (arXiv:1804.06788): draw the unknowns from the prior, data from the model, and samples from the
posterior of those data; the rank of the true value among the samples is uniform, whatever the data look like, if and
only if the posterior is right. Per case 100 problems (``--full``: 2,000), each with an X, a geometry and noise of its
own, run through `sample_posterior` as a user would (at least 100 effective samples), of which 99 are drawn. Ranked are
the six coordinates of the true X, the scales where they are unknown, and the Mahalanobis distance of the true X from
the samples' mean, which is most sensitive to a covariance that is too large or too small.

*What stands in for the flat prior.* X of the problems has rotations of 0.4 to 2.6 rad about any axis and translations
of 0.5 m: with the data transformed along, every X is like every other, so that the ranks of its error are uniform under
the flat prior to the order in which the posterior treats W and the latent poses (first order in the noise). Scales are
drawn from the very log-normal prior that the sampler is given (within a factor of 1.5), Student-t errors from the
likelihood that it is given: one factor per pose on all its errors.

The last two cases are wrong on purpose: the sampler is told deviations 20 % too small, and Gaussian errors where they
are Student-t. They must be rejected.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

import uq_handeye as uq
from studies.efficiency import errors, paper
from studies.geometries import random_transforms
from uq_handeye.se3 import Array, inverse, perturb
from uq_handeye.validation.posterior import sample_posterior
from uq_handeye.validation.posterior_density import ScalePrior

SEED = 1804
DRAWN, BINS = 99, 20
FACTOR, NU = 1.5, 5.0
POSE_NOISE = uq.PoseNoise.isotropic(robot=("0.5mrad", "0.2mm"), camera=("1mrad", "1mm"))


class Case(NamedTuple):
    """Data of n pairs or poses: errors times a drawn scale and tail, and what the sampler is told."""

    name: str
    noise: uq.PairNoise | uq.PoseNoise
    n: int
    scales: bool = False
    heavy: bool = False
    told: float = 1.0  # the deviations that the sampler is told, over the true ones
    told_heavy: bool | None = None  # as `heavy` if None
    wrong: bool = False


CASES = (
    Case("30 pairs, noise (70)", paper(), 30),
    Case("15 poses, W integrated out", POSE_NOISE, 15),
    Case("15 poses, scales unknown", POSE_NOISE, 15, scales=True),
    Case("30 pairs, Student-t", paper(), 30, heavy=True),
    Case("15 poses, Student-t, W sampled", POSE_NOISE, 15, heavy=True),
    Case("30 pairs, deviations told 20 % too small", paper(), 30, told=0.8, wrong=True),
    Case("15 poses, Student-t told Gaussian", POSE_NOISE, 15, heavy=True, told_heavy=False, wrong=True),
)


def problem(case: Case, rng: np.random.Generator) -> tuple[Array, uq.PosePairs | uq.Motions, Array]:
    """The true X, data, and the true log-scales of both sides."""
    X = random_transforms(rng, ())
    log_scales = np.log(FACTOR) * rng.standard_normal(2) if case.scales else np.zeros(2)
    tail = np.sqrt(NU / rng.chisquare(NU, case.n)) if case.heavy else np.ones(case.n)
    make: Callable[[Array, Array], Any]
    if isinstance(case.noise, uq.PoseNoise):
        W, first = random_transforms(rng, ()), random_transforms(rng, (case.n,))
        second, sides, make = inverse(X) @ inverse(first) @ W, (case.noise.robot, case.noise.camera), uq.PosePairs
    else:
        second = random_transforms(rng, (case.n,))
        first, sides, make = X @ second @ inverse(X), (case.noise.A, case.noise.B), uq.Motions
    measured = []
    for T, S, log_s in zip((first, second), sides, log_scales, strict=True):
        assert S is not None
        xi = rng.standard_normal((case.n, 6)) @ np.linalg.cholesky(S).T
        measured.append(perturb(T, np.exp(log_s) * tail[:, None] * xi))
    return X, make(*measured), log_scales


def told(case: Case) -> uq.PairNoise | uq.PoseNoise:
    parts = [S * case.told**2 for S in (vars(case.noise)[name] for name in case.noise.__dataclass_fields__)]
    return type(case.noise)(*parts)


def ranked(case: Case, seed: int, number: int) -> tuple[list[str], Array]:
    """Of one problem: names, and how many of the samples lie below the true value."""
    rng = np.random.default_rng([seed, number])
    X, data, log_scales = problem(case, rng)
    heavy = case.heavy if case.told_heavy is None else case.told_heavy
    posterior = sample_posterior(
        data,
        told(case),
        seed=number,
        samples=100,
        scales=ScalePrior(FACTOR, FACTOR) if case.scales else False,
        student_t=NU if heavy else None,
        walkers=48,
    )
    x = posterior.chain.reshape(-1, len(posterior.names))
    kept = [k for k, name in enumerate(posterior.names) if not name.startswith("W_")]
    true = np.concatenate([errors(X, posterior.X), log_scales if case.scales else []])
    draws = x[rng.choice(len(x), DRAWN, replace=False)][:, kept]
    L = np.linalg.cholesky(posterior.covariance)
    far, of_true = (np.linalg.norm(np.linalg.solve(L, (v[..., :6] - posterior.mean).T), axis=0) for v in (draws, true))
    below = np.append((draws < true).sum(axis=0), (far < of_true).sum())
    return [*(posterior.names[k] for k in kept), "distance"], below


def ranks(case: Case, problems: int, seed: int, workers: int = 1) -> tuple[list[str], Array]:
    """Names, and the ranks (problems, quantities); the same for any number of workers."""
    work = partial(ranked, case, seed)
    if workers == 1:
        found = [work(number) for number in range(problems)]
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            found = list(pool.map(work, range(problems), chunksize=10))
    return found[0][0], np.array([below for _, below in found])


class Verdict(NamedTuple):
    name: str
    counts: Array  # (BINS,)
    p: float


def verdicts(names: list[str], found: Array) -> list[Verdict]:
    """Chi-square tests of uniform ranks."""
    edges = np.linspace(-0.5, DRAWN + 0.5, BINS + 1)
    rows = []
    for name, column in zip(names, found.T, strict=True):
        counts = np.histogram(column, edges)[0]
        rows.append(Verdict(name, counts, float(stats.chisquare(counts).pvalue)))
    return rows


def band(problems: int, level: float = 0.99) -> Array:
    """Half the width (DRAWN + 1,) of a simultaneous band about the distribution function of uniform ranks."""
    rng = np.random.default_rng(SEED)
    expected = np.arange(1, DRAWN + 2) / (DRAWN + 1)
    deviation = np.sqrt(expected * (1 - expected) / problems)
    counts = rng.multinomial(problems, np.full(DRAWN + 1, 1 / (DRAWN + 1)), size=4000)
    apart = np.abs(np.cumsum(counts, axis=1) / problems - expected)[:, :-1] / deviation[:-1]
    return np.asarray(np.quantile(apart.max(axis=1), level) * deviation)


def figure(results: list[tuple[Case, list[str], Array]], path: Path) -> None:
    """Per case the distribution functions of the ranks less that of uniform ones, in the 99 % band."""
    from matplotlib.figure import Figure

    columns = 4
    rows = -(-len(results) // columns)
    drawing = Figure(figsize=(3.3 * columns, 2.9 * rows), layout="constrained")
    axes = drawing.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    share = np.arange(DRAWN + 1) / DRAWN
    for axis, (case, names, found) in zip(axes, results, strict=False):
        half = band(len(found))
        axis.fill_between(share, -half, half, color="0.88", label="99 % band, all ranks together")
        for k, name in enumerate(names):
            counts = np.bincount(found[:, k].astype(int), minlength=DRAWN + 1)
            apart = np.cumsum(counts) / len(found) - np.arange(1, DRAWN + 2) / (DRAWN + 1)
            colour = "black" if name == "distance" else f"C{k % 3}" if k < 6 else f"C{k - 1}"
            style = "-" if k < 3 or name == "distance" else "--" if k < 6 else ":"
            axis.plot(share, apart, style, color=colour, linewidth=1.4 if name == "distance" else 0.9, label=name)
        axis.set_title(f"{case.name}{' (wrong)' if case.wrong else ''}", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.set_xlabel("rank of the truth / 99", fontsize=8)
    for axis in axes[len(results) :]:
        axis.set_axis_off()
    fullest = max(range(len(results)), key=lambda k: len(results[k][1]))
    handles, labels = axes[fullest].get_legend_handles_labels()
    axes[-1].legend(handles, labels, loc="center", fontsize=8, frameon=False)
    drawing.supylabel("distribution function of the ranks less that of uniform ranks", fontsize=8)
    drawing.savefig(path, dpi=160)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="2,000 problems per case instead of 100")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--csv", default="ranks.csv")
    parser.add_argument("--figure", default="ranks.png")
    options = parser.parse_args()
    problems = 2_000 if options.full else 100
    results = []
    print(f"{problems} problems per case; p of the chi-square test of uniform ranks in {BINS} bins\n")
    print("| case | smallest p of a coordinate | p of the distance | uniform at 0.1 % over all quantities |")
    print("|---|---|---|---|")
    with open(options.csv, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["case", "wrong on purpose", "quantity", "problems", "p", *(f"bin {k}" for k in range(BINS))])
        for number, case in enumerate(CASES):
            names, found = ranks(case, problems, SEED + number, options.workers)
            results.append((case, names, found))
            judged = verdicts(names, found)
            for row in judged:
                writer.writerow([case.name, case.wrong, row.name, problems, f"{row.p:.3g}", *row.counts])
            *coordinates, distance = judged
            least = min(coordinates, key=lambda row: row.p)
            uniform = min(row.p for row in judged) > 0.001 / len(judged)
            print(
                f"| {case.name}{' (wrong on purpose)' if case.wrong else ''} | {least.p:.2g} ({least.name}) | "
                f"{distance.p:.2g} | {'yes' if uniform else 'no'} |",
                flush=True,
            )
    figure(results, Path(options.figure))


if __name__ == "__main__":
    main()
