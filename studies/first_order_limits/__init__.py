"""Noise at which first order ends, by geometry and method.

Model: ``G X C = W`` or ``A X = X B`` with Gaussian errors, left rotation, additive translation. Each row is one
geometry (`uq.simulate`, or 60 random pairs, "star": nearly a common translation) at a noise of 1 mrad of rotation and
some translation, whose standard deviations are multiplied by up to 300. At each level `uq.monte_carlo` holds the errors
of 1,000 trials against the covariance of first order at the true data, for 4DPA that of the paper's section III-C. The
covariance fails at a level where the root mean square error (joint, of rotation or of translation) is more than 10 %
above or below the predicted one and the mean NEES lies outside its 99 % interval, or where more than 1 % of the trials
give no X. Bisection on a logarithmic scale finds the end to 5 %. Seed 2019. Quick: 100 trials, fewer levels, the
smallest geometry.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import diagonal
from studies.common.study import Study, Tables, markdown
from studies.common.styles import style
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.core.presentation.colours import GRID, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.presentation.numbers import digits
from uq_handeye.core.progress import progress_bar

SEED = 2019
DEVIATIONS = (1, 3, 10, 30, 100, 300)  # mrad
METHODS = ("4dpa", "efficient")
USUAL = 5.0  # mrad; a cell has less
QUICK = ("cell, 6 poses",)
TOLERANCE = 0.1  # relative error of a standard deviation that matters
PRECISION = 1.05  # ratio of two levels between which bisection ends
PARTS = {"joint": 6, "rotation": 3, "translation": 3}  # degrees of freedom of each


def problems() -> Iterator[tuple[str, str, uq.PosePairs | uq.Motions, type[uq.Noise], tuple[Any, Any]]]:
    """Name, noise at 1 mrad in words, exact data, kind of the noise, its two covariances at 1 mrad."""
    camera = (diagonal(0.1, 0.1), diagonal(1, 1))
    words = "camera 1 mrad, 1 mm; robot 0.1 mrad, 0.1 mm"
    for n in (6, 20, 60):
        yield f"cell, {n} poses", words, uq.simulate(n, seed=SEED), uq.PoseNoise, camera
    tilted = uq.simulate(20, tilt="10deg", roll="10deg", seed=SEED)
    yield "cell, 20 poses, tilt 10 deg, roll 10 deg", words, tilted, uq.PoseNoise, camera
    for name, translation in (("random", 1.0), ("random", 0.1), ("star", 0.1), ("star", 0.01)):
        rng = np.random.default_rng([SEED, len(name)])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        if name == "star":  # nearly a common translation
            B[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(60, 3))
        motions = uq.Motions(X @ B @ inverse(X), B)
        about = f"A and B 1 mrad, {translation:g} mm"
        yield f"60 pairs, {name}, {translation:g} mm", about, motions, uq.PairNoise, (diagonal(1, translation),) * 2


def level(data: Any, noise: uq.Noise, method: str, trials: int) -> dict[str, Any]:
    """Return one level as a row: the mean NEES of each part, coverage, bias, failures, and why it fails, if it does."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)  # data as noisy as this look wrong, which is the point
        try:
            run = uq.monte_carlo(data, noise=noise, method=method, trials=trials, seed=SEED)
        except uq.DegenerateMotionError:
            return {"reason": "Within this noise all motions rotate about one axis: X is not determined."}
    row: dict[str, Any] = {f"mean_nees_{part}": nees for part, (nees, _, _) in run.nees.items()}
    row |= {"coverage_95": run.coverage.get(0.95), "failed": run.failures / run.trials}
    return row | {"reason": reason(run.nees, row["failed"])}


def reason(nees: dict[str, tuple[float, float, float]], failed: float) -> str:
    """Return why a covariance fails; empty if it holds. ``nees``: of each part the mean and its interval."""
    if failed > 0.01:
        return f"{100 * failed:.2g} % of the trials give no X."
    ratios = {part: math.sqrt(mean / PARTS[part]) for part, (mean, _, _) in nees.items()}
    off = [
        part
        for part, (mean, low, high) in nees.items()
        if not 1 / (1 + TOLERANCE) <= ratios[part] <= 1 + TOLERANCE and not low <= mean <= high
    ]
    if not off:
        return ""
    part = max(off, key=lambda name: abs(math.log(ratios[name])))
    of = "" if part == "joint" else f"{part} "
    return f"The {of}errors are {ratios[part]:.3g} times as large as predicted."


def end(rows: dict[float, dict[str, Any]]) -> tuple[float, float]:
    """Return the last level (mrad) before the first that fails, and that one; NaN where there is none."""
    levels = sorted(rows)
    first = next((k for k, x in enumerate(levels) if rows[x]["reason"]), None)
    if first is None:
        return levels[-1], math.nan
    return levels[first - 1] if first else math.nan, levels[first]


def measure(full: bool) -> Tables:
    trials, deviations = (1_000, DEVIATIONS) if full else (100, DEVIATIONS[-3:])
    chosen = [problem for problem in problems() if full or problem[0] in QUICK]
    levels, limits = [], []
    with progress_bar("geometries", len(chosen), "rows") as advance:
        for name, words, data, kind, (first, second) in chosen:
            for method in METHODS:
                about = {"data": name, "noise": words, "trials": trials, "most_mrad": deviations[-1], "method": method}
                rows: dict[float, dict[str, Any]] = {}
                wanted = [float(x) for x in deviations]
                while wanted:
                    for x in wanted:
                        rows[x] = level(data, kind(x**2 * first, x**2 * second), method, trials)
                    holds, fails = end(rows)
                    wanted = [math.sqrt(holds * fails)] if fails > PRECISION * holds else []
                levels += [{**about, "rotation_mrad": x, **rows[x]} for x in sorted(rows)]
                why = rows[fails]["reason"] if fails > 0 else ""
                limits.append({**about, "holds_mrad": holds, "fails_mrad": fails, "reason": why})
            advance(1)
    return {"levels": pd.DataFrame(levels), "limits": pd.DataFrame(limits)}


def middle(row: Any) -> float:
    """Return the noise at which a covariance begins to fail, mrad; NaN if it holds everywhere, or nowhere."""
    return float(np.sqrt(row.holds_mrad * row.fails_mrad))


def at_mrad(row: Any, beyond: float) -> float:
    """Return the place to draw it: ``beyond`` if it holds at all levels."""
    if np.isnan(row.fails_mrad):
        return beyond
    return float(row.fails_mrad) if np.isnan(row.holds_mrad) else middle(row)


def cell(row: Any) -> str:
    if np.isnan(row.fails_mrad):
        return f"> {row.most_mrad}"
    return f"< {digits(row.fails_mrad, 2)}" if np.isnan(row.holds_mrad) else digits(middle(row), 2)


def findings(tables: Tables) -> str:
    limits = tables["limits"]
    rows = [
        [row.data, row.noise, row.method, cell(row), row.reason] for row in limits.fillna({"reason": ""}).itertuples()
    ]
    failed = limits[limits["fails_mrad"].notna()]
    text = f"Holds at all levels in {len(limits) - len(failed)} of {len(limits)} rows"
    if not failed.empty:
        least = next(failed.sort_values("fails_mrad").itertuples())
        usual = (failed["fails_mrad"] <= USUAL).sum()
        text += (
            f"; fails first on {least.data} with `{least.method}`, at {cell(least)} mrad; below {USUAL:g} mrad, the "
            f"usual noise of a cell, in {usual}"
        )
    return "\n\n".join(
        [
            f"{int(limits['trials'].iloc[0]):,} trials per level of noise. Rotation noise per pose or motion, in "
            "mrad, at which the first-order covariance begins to fail (>: it holds at all levels); translation noise "
            "grows alike.",
            markdown(["data", "noise at 1 mrad", "method", "fails at", "why"], rows),
            f"{text}.",
        ]
    )


def figures(tables: Tables) -> dict[str, Figure]:
    limits = tables["limits"]
    names = list(dict.fromkeys(limits["data"]))
    methods = list(dict.fromkeys(limits["method"]))
    most = float(limits["most_mrad"].max())
    figure = canvas(1.3 + 0.32 * len(names))
    axis = figure.subplots()
    plain(axis)
    axis.axvspan(0.9, USUAL, color=GRID, label="usual noise of a cell")
    axis.axvline(most, color=QUIET, linewidth=0.8, linestyle=":")
    for method, shift in zip(methods, np.linspace(-0.12, 0.12, len(methods)), strict=True):
        own = limits[limits["method"] == method]
        x = [at_mrad(row, 1.5 * most) for row in own.itertuples()]
        y = np.array([names.index(name) for name in own["data"]]) + shift
        axis.plot(x, y, label=method, **{**style(method), "linestyle": "none", "markersize": 5})
    axis.set_xscale("log")
    axis.set_xlim(0.9, 2 * most)
    ticks = [tick for tick in DEVIATIONS if tick <= most]
    axis.set_xticks([*ticks, 1.45 * most], [*(str(tick) for tick in ticks), f"    > {most:.0f}"])
    axis.minorticks_off()
    axis.set_xlabel("rotation noise at which the covariance begins to fail (mrad)", fontsize=TEXT)
    axis.set_ylim(len(names) - 0.5, -0.5)
    labels = [name.replace(", tilt", "\ntilt") for name in names]
    axis.set_yticks(range(len(names)), labels, fontsize=SMALL)
    axis.tick_params(axis="y", length=0)
    figure.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=3, fontsize=SMALL, frameon=False)
    return {"limits": finished(figure)}


STUDY = Study("first_order_limits", measure, findings, figures)
