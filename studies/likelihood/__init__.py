"""Distance from the Cramer-Rao bound of 4DPA, one closed-form step, two (`efficient`), and maximum likelihood (`ml`).

Model: ``G X C = W`` on 31 poses or ``A X = X B`` on 60 pairs; every pose is its true value with a Gaussian error
``xi = (theta, tau)``, left rotation, additive translation, of known 6x6 covariance. Geometry: rotations of 0.4 to 2.6
rad about any axis, translations of 0.5 m per axis; "star": nearly a common translation. One geometry per row, and upon
it 10,000 draws of noise (quick: 200), seed 2019. The last row has the noise (70) of the paper's section IV-C.

Per estimator the smallest and largest of its six standard deviations about the truth as multiples of the bound's, and
the mean NEES ``e^T Sigma^-1 e`` with its own covariance, 6 if that is true. 4DPA's is the one predicted at exact data,
for all pairs where there are poses. Two more tables: where first order ends, and errors that all poses share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import chi2

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import both, diagonal, paper
from studies.common.scores import CERTAIN, errors, nees, true_means
from studies.common.study import Study, Tables, markdown
from studies.common.styles import style
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.core.presentation.colours import GRID, INK, ORANGE
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.gauss_helmert import Fit, bound, efficient, fit, maximum_likelihood
from uq_handeye.fit.graph.starts import start_of
from uq_handeye.methods.all_pairs import solve_all_pairs
from uq_handeye.trials.simulation.rig import disturbed

SEED = 2019
BLOCK = 200  # draws at a time, for the memory
Data = uq.PosePairs | uq.Motions
Noise = uq.PoseNoise | uq.PairNoise


ROWS: list[tuple[str, str, Noise]] = [
    ("31 poses", "camera, isotropic: 1 mrad, 1 mm", uq.PoseNoise(camera=diagonal(1, 1))),
    (
        "31 poses",
        "camera, weak in depth and tilt: 3, 3, 0.5 mrad, 0.3, 0.3, 3 mm; robot: 0.1 mrad, 0.1 mm",
        uq.PoseNoise(diagonal(0.1, 0.1), diagonal(3, 3, 0.5, 0.3, 0.3, 3)),
    ),
    (
        "31 poses",
        "robot dominates: 1 mrad, 1 mm; camera: 0.2 mrad, 0.2 mm",
        uq.PoseNoise(diagonal(1, 1), diagonal(0.2, 0.2)),
    ),
    *(
        (f"60 pairs, {geometry}", f"{rotation:g} mrad, {translation:g} mm", both(rotation, translation))
        for geometry in ("random", "star")
        for rotation, translation in ((1, 1), (1, 0.1), (10, 0.1), (30, 0.1))
    ),
    ("60 pairs, random", "(70)", paper()),
]
# Where first order ends.
LIMITS: list[tuple[str, str, Noise]] = [
    ("60 pairs, random", "100 mrad, 0.1 mm", both(100, 0.1)),
    ("31 poses", "camera: 100 mrad, 0.1 mm", uq.PoseNoise(camera=diagonal(100, 0.1))),
    ("31 poses", "robot and camera: 100 mrad, 0.1 mm each", uq.PoseNoise(diagonal(100, 0.1), diagonal(100, 0.1))),
]


class Draws(NamedTuple):
    """One geometry, and noise upon it block by block."""

    X: Array
    exact: Data
    blocks: Iterator[Data]


def draws(row: int, geometry: str, noise: Noise, trials: int) -> Draws:
    rng = np.random.default_rng([SEED, row])
    X = random_transforms(rng, ())
    make: Callable[[Array, Array], Data]
    if isinstance(noise, uq.PoseNoise):
        W, first = random_transforms(rng, ()), random_transforms(rng, (31,))
        second, covariances, make = inverse(X) @ inverse(first) @ W, (noise.robot, noise.camera), uq.PosePairs
    else:
        second = random_transforms(rng, (60,))
        if "star" in geometry:  # nearly a common translation
            second[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(60, 3))
        first, covariances, make = X @ second @ inverse(X), (noise.A, noise.B), uq.Motions
    blocks = (
        make(disturbed(first, covariances[0], (BLOCK,), rng), disturbed(second, covariances[1], (BLOCK,), rng))
        for _ in range(0, trials, BLOCK)
    )
    return Draws(X, make(first, second), blocks)


def four_dpa(data: Data) -> Array:
    return solve_all_pairs(data) if isinstance(data, uq.PosePairs) else np.asarray(uq.solve(data.A, data.B))


def one_step(data: Data, noise: Noise) -> Fit:
    constraint = constraint_of(data, noise)
    return fit(constraint, noise, start_of(data, constraint, None), steps=1)


STEPS: dict[str, Callable[[Data, Noise], Fit]] = {
    "one step": one_step,
    "efficient": efficient,
    "ml": maximum_likelihood,
}


class Score(NamedTuple):
    """Smallest and largest of six sd / bound, and mean NEES."""

    least: float
    largest: float
    nees: float


def score(e: Array, distances: Array, limit: Array) -> Score:
    """Score errors (T, 6) by their NEES (T,) and the standard deviations (6,) of the bound."""
    ratio = np.sqrt(np.mean(e**2, axis=0)) / limit
    return Score(float(ratio.min()), float(ratio.max()), float(distances.mean()))


def scores(row: int, geometry: str, noise: Noise, trials: int) -> dict[str, Score]:
    """Return scores by estimator; ``trials`` in whole blocks."""
    drawn = draws(row, geometry, noise, trials)
    limit = np.sqrt(np.diag(bound(drawn.exact, noise, drawn.X)))
    exact = drawn.exact if isinstance(drawn.exact, uq.Motions) else uq.relative_motions(drawn.exact, "all")
    predicted = uq.propagate(exact, noise=noise)
    parts: dict[str, list[tuple[Array, Array]]] = {name: [] for name in ("4dpa", *STEPS)}
    for data in drawn.blocks:
        e = errors(four_dpa(data), drawn.X)
        parts["4dpa"].append((e, nees(e, predicted)))
        for name, method in STEPS.items():
            found = method(data, noise)
            e = errors(found.X, drawn.X)
            parts[name].append((e, nees(e, found.covariance_X)))
    return {
        name: score(np.concatenate([e for e, _ in found]), np.concatenate([d for _, d in found]), limit)
        for name, found in parts.items()
    }


def joint(poses: int, trials: int) -> dict[str, Score]:
    """Score `efficient` where all camera poses share 3 mm in depth: with that model, and with independent errors."""
    rng = np.random.default_rng([SEED, 1000])
    X, W, robot = random_transforms(rng, ()), random_transforms(rng, ()), random_transforms(rng, (poses,))
    camera = inverse(X) @ inverse(robot) @ W
    own, shared, S = diagonal(0.3, 0.2), diagonal(0.1, 0.1, 0.1, 0.1, 0.1, 3), diagonal(0.1, 0.1)
    true = uq.PoseNoise(S, np.kron(np.eye(poses), own) + np.kron(np.ones((poses, poses)), shared))
    own_errors, common = rng.standard_normal((trials, poses, 6)), rng.standard_normal((trials, 1, 6))
    data = uq.PosePairs(
        disturbed(robot, S, (trials,), rng), perturb(camera, own_errors @ np.sqrt(own) + common @ np.sqrt(shared))
    )
    limit = np.sqrt(np.diag(bound(uq.PosePairs(robot, camera), true, X)))
    told = {}
    for name, noise in (("joint", true), ("independent", uq.PoseNoise(S, own + shared))):
        found = efficient(data, noise)
        e = errors(found.X, X)
        told[name] = score(e, nees(e, found.covariance_X), limit)
    return told


def rows_of(found: Mapping[str, Score], trials: int, **about: str) -> list[dict[str, Any]]:
    return [
        {
            **about,
            "estimator": name,
            "draws": trials,
            "least_sd_over_bound": score.least,
            "largest_sd_over_bound": score.largest,
            "mean_nees": score.nees,
        }
        for name, score in found.items()
    ]


def measure(full: bool) -> Tables:
    trials = 10_000 if full else BLOCK
    tables: dict[str, list[dict[str, Any]]] = {"bound": [], "limits": [], "joint": []}
    with progress_bar("geometries", len(ROWS) + len(LIMITS), "rows") as advance:
        for row, (geometry, label, noise) in enumerate(ROWS + LIMITS):
            name, count = ("bound", trials) if row < len(ROWS) else ("limits", BLOCK)
            tables[name] += rows_of(scores(row, geometry, noise, count), count, data=geometry, noise=label)
            advance(1)
    count = min(trials, 1_000)
    for told, score in joint(15, count).items():
        tables["joint"] += rows_of({"efficient": score}, count, told=told)
    return {name: pd.DataFrame(rows) for name, rows in tables.items()}


def true_ratios(trials: int) -> tuple[float, float]:
    """The interval that holds all six sampled sd over true ones with a probability of at least 99.9 %."""
    tail = (1 - CERTAIN) / 12
    low, high = np.sqrt(np.asarray(chi2.ppf([tail, 1 - tail], trials)) / trials)
    return float(low), float(high)


def at_bound(table: pd.DataFrame) -> pd.Series[bool]:
    low, high = np.array([true_ratios(int(count)) for count in table["draws"]]).T
    return table["least_sd_over_bound"].gt(low) & table["largest_sd_over_bound"].lt(high)


def honest(table: pd.DataFrame) -> pd.Series[bool]:
    """Return whether the mean NEES is that of a consistent covariance."""
    low, high = np.array([true_means(int(count)) for count in table["draws"]]).T
    return table["mean_nees"].between(low, high)


def span(row: Any) -> str:
    return f"{row.least_sd_over_bound:.2f} to {row.largest_sd_over_bound:.2f}"


def said(table: pd.DataFrame, estimator: str) -> str:
    """One estimator over all rows."""
    own = table[table["estimator"] == estimator]
    near, true = at_bound(own), honest(own)
    largest = own["largest_sd_over_bound"]
    sentence = (
        f"- `{estimator}`: at the bound in {near.sum()} of {len(own)} rows (largest sd {largest.min():.2f} to "
        f"{largest.max():,.2f} times the bound's); NEES of a consistent covariance in {true.sum()} of {len(own)}"
    )
    wrong = own[~true]
    if wrong.empty:
        return f"{sentence}."
    cases = "; ".join(f"{row.data}, {row.noise}: {row.mean_nees:,.1f}" for row in wrong.itertuples())
    return f"{sentence}, not in: {cases}."


def findings(tables: Tables) -> str:
    table = tables["bound"]
    names = list(dict.fromkeys(table["estimator"]))
    draws = int(table["draws"].iloc[0])
    lines = [
        [data, noise, *(text for row in own.itertuples() for text in (span(row), f"{row.mean_nees:,.2f}"))]
        for (data, noise), own in table.groupby(["data", "noise"], sort=False)
    ]
    header = ["data", "noise", *(text for name in names for text in (f"{name}: sd / bound", "NEES"))]
    low, high = true_means(draws)
    least, most = true_ratios(draws)
    limits = tables["limits"]
    at_limits = [
        [data, noise, *(f"{x:,.1f}" for x in own["mean_nees"])]
        for (data, noise), own in limits.groupby(["data", "noise"], sort=False)
    ]
    told = {str(row.told): row for row in tables["joint"].itertuples()}
    joint_draws = int(tables["joint"]["draws"].iloc[0])
    return "\n\n".join(
        [
            f"{draws:,} draws per row. sd / bound: smallest and largest of six, *at the bound* if all lie between "
            f"{least:.3f} and {most:.3f}. NEES: its mean over the draws, that of a consistent covariance between "
            f"{low:.2f} and {high:.2f}. Either range holds 99.9 %.",
            markdown(header, lines),
            "\n".join(said(table, name) for name in names),
            f"Beyond first order, mean NEES over {int(limits['draws'].iloc[0])} draws:",
            markdown(["data", "noise", *names], at_limits),
            f"15 poses that share 3 mm in depth, {joint_draws:,} draws, `efficient`: told the joint covariance, "
            f"sd / bound is {span(told['joint'])} and NEES {told['joint'].mean_nees:.2f}; told that errors are "
            f"independent, {span(told['independent'])} and {told['independent'].mean_nees:.2f}.",
        ]
    )


def figures(tables: Tables) -> dict[str, Figure]:
    table = tables["bound"]
    cases = list(table[["data", "noise"]].drop_duplicates().itertuples(index=False, name=None))
    names = list(dict.fromkeys(table["estimator"]))
    draws = int(table["draws"].iloc[0])
    figure = canvas(5.2)
    ratio, distance = figure.subplots(1, 2, sharey=True)
    ratio.axvspan(*true_ratios(draws), color=GRID)
    distance.axvspan(*true_means(draws), color=GRID)
    for shift, name in zip(np.linspace(-0.27, 0.27, len(names)), names, strict=True):
        own = table[table["estimator"] == name]
        y = np.arange(len(cases)) + shift
        look = {"color": ORANGE, "marker": "v", "markersize": 4} if name == "one step" else style(name)
        look = {**look, "linestyle": "none"}
        if name == "ml":
            look["markerfacecolor"] = "white"
        ratio.hlines(y, own["least_sd_over_bound"], own["largest_sd_over_bound"], color=look["color"], linewidth=1.2)
        ratio.plot(own["largest_sd_over_bound"], y, **look)
        distance.plot(own["mean_nees"], y, label=name, **look)
    for axis, label in ((ratio, "sd / bound, least to largest of six"), (distance, "mean NEES of X")):
        plain(axis)
        axis.set_xscale("log")
        axis.set_xlabel(label, fontsize=TEXT)
    ratio.set_ylim(len(cases) - 0.5, -0.5)
    ratio.set_yticks(range(len(cases)), [f"{data}\n{_short(noise)}" for data, noise in cases], fontsize=SMALL)
    for axis in (ratio, distance):
        axis.tick_params(axis="y", length=0)
    figure.legend(
        *distance.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=len(names),
        fontsize=SMALL,
        frameon=False,
        labelcolor=INK,
    )
    return {"bound": finished(figure)}


def _short(noise: str) -> str:
    """Return a label that fits beside an axis."""
    return noise.replace(": 3, 3, 0.5 mrad, 0.3, 0.3, 3 mm; robot: 0.1 mrad, 0.1 mm", "").replace(
        ": 1 mrad, 1 mm; camera: 0.2 mrad, 0.2 mm", ""
    )


STUDY = Study("likelihood", measure, findings, figures)
