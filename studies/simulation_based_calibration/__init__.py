"""Simulation-based calibration of the posterior: are its probabilities those of the world it claims?

Talts et al. 2018 (arXiv:1804.06788): draw the unknowns from the prior, data from the model, and samples from the
posterior of those data; the rank of the true value among the samples is uniform, whatever the data look like, if and
only if the posterior is right. Model: 30 pairs ``A X = X B`` with the noise (70) of the paper's section IV-C, or 15
poses ``G X C = W``. Per case 100 problems (quick: two cases, 4), each with an X, a geometry and noise of its own, seed
1804, run through `sample_posterior` as a user would (at least 100 effective samples), of which 99 are drawn. Ranked
are the six coordinates of the true X, the scales where they are unknown, and the Mahalanobis distance of the true X
from the samples' mean, which is most sensitive to a covariance that is too large or too small.

*What stands in for the flat prior.* X of the problems has rotations of 0.4 to 2.6 rad about any axis and translations
of 0.5 m: with the data transformed along, every X is like every other, so that the ranks of its error are uniform under
the flat prior to the order in which the posterior treats W and the latent poses (first order in the noise). Scales are
drawn from the very log-normal prior that the sampler is given (within a factor of 1.5), Student-t errors from the
likelihood that it is given: one factor per pose on all its errors.

The last two cases are wrong on purpose: the sampler is told standard deviations 20 % too small, and Gaussian errors
where they are Student-t. They must be rejected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy import stats

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import paper
from studies.common.scores import errors
from studies.common.study import Study, Tables, markdown
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.core.presentation.colours import BLUE, GRID, INK, ORANGE, PURPLE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.constraint import covariances_of
from uq_handeye.trials.validation.posterior.density import ScalePrior
from uq_handeye.trials.validation.posterior.sample import sample_posterior

SEED = 1804
DRAWN, BINS = 99, 20
FACTOR, NU = 1.5, 5.0
LEVEL = 0.001  # of the test of all quantities of a case together
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

QUICK = (0, 5)  # of them


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
    return X, make(measured[0], measured[1]), log_scales


def told(case: Case) -> uq.PairNoise | uq.PoseNoise:
    return type(case.noise)(*(np.asarray(S) * case.told**2 for S in covariances_of(case.noise)))


def ranked(case: Case, seed: int, number: int) -> tuple[list[str], Array]:
    """Return the names of one problem, and how many of the samples lie below the true value."""
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


def ranks(case: Case, problems: int, seed: int, advance: Callable[[int], None] = lambda more: None) -> pd.DataFrame:
    """Count how many ranks of each quantity fall into each of `BINS` bins."""
    found = []
    for number in range(problems):
        names, below = ranked(case, seed, number)
        found.append(below)
        advance(1)
    edges = np.linspace(-0.5, DRAWN + 0.5, BINS + 1)
    return pd.concat(
        pd.DataFrame(
            {
                "case": case.name,
                "wrong_on_purpose": case.wrong,
                "quantity": name,
                "problems": problems,
                "bin": np.arange(1, BINS + 1),
                "ranks": np.histogram(column, edges)[0],
            }
        )
        for name, column in zip(names, np.array(found).T, strict=True)
    )


def measure(full: bool) -> Tables:
    problems, cases = (100, list(enumerate(CASES))) if full else (4, [(k, CASES[k]) for k in QUICK])
    tables = []
    with progress_bar("problems", len(cases) * problems, "problems") as advance:
        for number, case in cases:
            tables.append(ranks(case, problems, SEED + number, advance))
    return {"ranks": pd.concat(tables)}


def verdicts(table: pd.DataFrame) -> pd.DataFrame:
    """p of the chi-square test of uniform ranks, of each quantity; ``uniform`` by all quantities of its case."""
    by_quantity = table.groupby(["case", "wrong_on_purpose", "quantity"], sort=False)["ranks"]
    judged = by_quantity.agg(lambda counts: float(stats.chisquare(counts).pvalue)).rename("p").reset_index()
    of_case = judged.groupby("case")["p"]
    judged["uniform"] = of_case.transform("min") > LEVEL / of_case.transform("size")
    return judged


def findings(tables: Tables) -> str:
    judged = verdicts(tables["ranks"])
    rows: list[list[str]] = []
    right: list[bool] = []
    rejected: list[bool] = []
    for (case, wrong), own in judged.groupby(["case", "wrong_on_purpose"], sort=False):
        coordinates, distance = own[own["quantity"] != "distance"], own[own["quantity"] == "distance"]
        least = coordinates.sort_values("p").to_dict("records")[0]
        uniform = bool(own["uniform"].all())
        (rejected if wrong else right).append(uniform)
        rows.append(
            [
                f"{case}{' (wrong on purpose)' if wrong else ''}",
                f"{least['p']:.2g} ({least['quantity']})",
                f"{distance['p'].iloc[0]:.2g}",
                "yes" if uniform else "no",
            ]
        )
    problems = int(tables["ranks"]["problems"].iloc[0])
    text = [
        f"{problems} problems per case; p of the chi-square test of uniform ranks in {BINS} bins. Uniform: no p of a "
        "case "
        f"below {100 * LEVEL:g} % over its number of quantities.",
        markdown(["case", "smallest p of a coordinate", "p of the distance", "uniform"], rows),
        f"The ranks are uniform, as far as {problems} problems can tell, in {sum(right)} of {len(right)} cases in "
        "which "
        f"the sampler is told the truth; {len(rejected) - sum(rejected)} of {len(rejected)} cases that are wrong on "
        "purpose are rejected.",
    ]
    if problems < BINS:
        text.append("So few problems can reject almost nothing: this is a run to see that the study works.")
    return "\n\n".join(text)


def band(problems: int, level: float = 0.99) -> Array:
    """Half the width (BINS,) of a simultaneous band about the distribution function of uniform ranks, at the bins."""
    rng = np.random.default_rng(SEED)
    expected = np.arange(1, BINS + 1) / BINS
    deviation = np.sqrt(expected * (1 - expected) / problems)
    counts = rng.multinomial(problems, np.full(BINS, 1 / BINS), size=4000)
    apart = np.abs(np.cumsum(counts, axis=1) / problems - expected)[:, :-1] / deviation[:-1]
    return np.asarray(np.quantile(apart.max(axis=1), level) * deviation)


def figures(tables: Tables) -> dict[str, Figure]:
    """Per case the distribution functions of the ranks less that of uniform ones, in the 99 % band of one quantity."""
    table = tables["ranks"]
    cases = list(dict.fromkeys(table["case"]))
    rows = len(cases) // 4 + 1  # one place is for the legend
    figure = canvas(max(2.9, 2.2 * rows))
    axes = figure.subplots(rows, 4, sharex=True, sharey=True).ravel()
    share = np.arange(BINS + 1) / BINS
    for axis, case in zip(axes, cases, strict=False):
        plain(axis)
        of_case = table[table["case"] == case]
        half = np.append(0.0, band(int(of_case["problems"].iloc[0])))
        axis.fill_between(share, -half, half, color=GRID, label="99 % of one quantity", linewidth=0)
        for name, own in of_case.groupby("quantity", sort=False):
            counts = own.sort_values("bin")["ranks"].to_numpy()
            apart = np.append(0.0, np.cumsum(counts) / counts.sum()) - share
            axis.plot(share, apart, label=LABELS[kind_of(str(name))], **LOOKS[kind_of(str(name))])
        wrong = bool(of_case["wrong_on_purpose"].iloc[0])
        axis.set_title(wrapped(case) + ("\n(wrong on purpose)" if wrong else ""), fontsize=SMALL)
        axis.set_xlim(0, 1)
        axis.set_xticks([0, 0.5, 1], ["0", "0.5", "1"])
    for axis in axes[len(cases) :]:
        axis.set_axis_off()
    handles: dict[str, Any] = {}
    for axis in axes[: len(cases)]:
        handles.update(dict(zip(*reversed(axis.get_legend_handles_labels()), strict=True)))
    axes[-1].legend(handles.values(), handles.keys(), loc="center", fontsize=SMALL, frameon=False)
    figure.supxlabel("rank of the truth / number of samples", fontsize=TEXT)
    figure.supylabel("distribution of the ranks less uniform", fontsize=TEXT)
    return {"ranks": finished(figure)}


LABELS = {"theta": "rotation", "tau": "translation", "scale": "scale of the noise", "distance": "distance"}
LOOKS: dict[str, dict[str, Any]] = {
    "theta": {"color": BLUE, "linestyle": "-", "linewidth": 0.9},
    "tau": {"color": ORANGE, "linestyle": "--", "linewidth": 0.9},
    "scale": {"color": PURPLE, "linestyle": ":", "linewidth": 1.2},
    "distance": {"color": INK, "linestyle": "-", "linewidth": 1.7},
}


def kind_of(quantity: str) -> str:
    return next((kind for kind in ("theta", "tau", "distance") if quantity.startswith(kind)), "scale")


def wrapped(case: str) -> str:
    """Wrap the text into two lines, at the last comma."""
    first, _, second = case.rpartition(", ")
    return f"{first},\n{second}" if first else case


STUDY = Study("simulation_based_calibration", measure, findings, figures, packages=("emcee", "arviz-stats"))
