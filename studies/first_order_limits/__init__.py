"""Noise at which first order ends, by geometry and method, and the reach of sigma points.

Model: ``G X C = W`` or ``A X = X B`` with Gaussian errors, left rotation, additive translation. Each row is one
geometry (`uq.simulate`, or 60 random pairs, "star": nearly a common translation) at a noise of 1 mrad of rotation and
some translation, whose standard deviations are multiplied by up to 300. At each level the errors of 1,000 trials are
held against the covariance of first order, for 4DPA that of the paper's section III-C, and that of sigma points, both
at the true data: `uq_handeye.trials.validation.sweep.run` has the rule by which a covariance fails, and finds where by
bisection. Seed 2019. Quick: 100 trials, fewer levels, the smallest geometry.
"""

from __future__ import annotations

import math
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
from uq_handeye.core.formatting.numbers import digits
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.core.presentation.figure_parts import GRID, QUIET, SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.runtime.progress import progress_bar
from uq_handeye.trials.validation.sweep.level import KINDS, MethodSweep
from uq_handeye.trials.validation.sweep.run import sweep

SEED = 2019
DEVIATIONS = (1, 3, 10, 30, 100, 300)  # mrad
METHODS = ("4dpa", "efficient")
USUAL = 5.0  # mrad; a cell has less
QUICK = ("cell, 6 poses",)


def problems() -> Iterator[tuple[str, str, uq.PosePairs | uq.Motions, uq.Noise]]:
    """Name, noise at 1 mrad in words, exact data, noise."""
    for n in (6, 20, 60):
        noise: uq.Noise = uq.PoseNoise(diagonal(0.1, 0.1), diagonal(1, 1))
        yield f"cell, {n} poses", "camera 1 mrad, 1 mm; robot 0.1 mrad, 0.1 mm", uq.simulate(n, seed=SEED), noise
    yield (
        "cell, 20 poses, tilt 10 deg, roll 10 deg",
        "camera 1 mrad, 1 mm; robot 0.1 mrad, 0.1 mm",
        uq.simulate(20, tilt="10deg", roll="10deg", seed=SEED),
        noise,
    )
    for name, translation in (("random", 1.0), ("random", 0.1), ("star", 0.1), ("star", 0.01)):
        rng = np.random.default_rng([SEED, len(name)])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        if name == "star":  # nearly a common translation
            B[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(60, 3))
        S = diagonal(1, translation)
        motions = uq.Motions(X @ B @ inverse(X), B)
        yield (
            f"60 pairs, {name}, {translation:g} mm",
            f"A and B 1 mrad, {translation:g} mm",
            motions,
            uq.PairNoise(S, S),
        )


def limits_of(found: MethodSweep) -> Iterator[dict[str, Any]]:
    """Rotation standard deviations (mrad) of the last level that holds and the first that fails, of each kind of
    covariance.
    """
    for kind in KINDS:
        limit = found.limit(kind)
        holds, fails = (None if x is None else math.sqrt(x) for x in (limit.holds, limit.fails))
        reason = "" if limit.fails is None else found.at(limit.fails).of(kind).reason
        yield {
            "method": found.method,
            "covariance": kind,
            "holds_mrad": holds,
            "fails_mrad": fails,
            "heavy_tails": limit.heavy,
            "reason": reason,
        }


def measure(full: bool) -> Tables:
    trials, deviations = (1_000, DEVIATIONS) if full else (100, DEVIATIONS[-3:])
    chosen = [problem for problem in problems() if full or problem[0] in QUICK]
    levels, limits = [], []
    with progress_bar("geometries", len(chosen), "rows") as advance:
        for name, words, data, noise in chosen:
            factors = [float(x) ** 2 for x in deviations]
            found = sweep(data, noise=noise, methods=METHODS, factors=factors, trials=trials, seed=SEED)
            about = {"data": name, "noise": words, "trials": trials, "most_mrad": deviations[-1]}
            table = found.to_dataframe().rename(columns={"kind": "covariance", "sd_factor": "rotation_mrad"})
            levels.append(pd.DataFrame([about] * len(table)).join(table.drop(columns="factor")))
            limits += [{**about, **row} for of in found.methods for row in limits_of(of)]
            advance(1)
    return {"levels": pd.concat(levels), "limits": pd.DataFrame(limits)}


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
    rows = []
    for key, own in limits.groupby(["data", "noise", "method"], sort=False):
        by_kind = own.set_index("covariance").loc[list(KINDS)]
        why = f"{by_kind['reason'].iloc[1]}{' Heavy tails.' if by_kind['heavy_tails'].iloc[1] else ''}"
        rows.append([*key, *(cell(row) for row in by_kind.itertuples()), why])
    return "\n\n".join(
        [
            f"{int(limits['trials'].iloc[0]):,} trials per level of noise. Rotation noise per pose or motion, in "
            "mrad, at "
            f"which each covariance begins to fail (>: it holds at all levels); translation noise grows alike.",
            markdown(["data", "noise at 1 mrad", "method", "first order", "sigma points", "why those fail"], rows),
            "\n".join(said(limits, kind) for kind in KINDS),
            farther(limits),
        ]
    )


def said(limits: pd.DataFrame, kind: str) -> str:
    own = limits[limits["covariance"] == kind]
    failed = own[own["fails_mrad"].notna()]
    sentence = f"- {kind}: holds at all levels in {len(own) - len(failed)} of {len(own)} rows"
    if failed.empty:
        return f"{sentence}."
    least = next(failed.sort_values("fails_mrad").itertuples())
    usual = (failed["fails_mrad"] <= USUAL).sum()
    return (
        f"{sentence}; fails first on {least.data} with `{least.method}`, at {cell(least)} mrad; below {USUAL:g} "
        "mrad, the "
        f"usual noise of a cell, in {usual}."
    )


def farther(limits: pd.DataFrame) -> str:
    ends = limits.pivot(index=["data", "noise", "method"], columns="covariance", values="fails_mrad").fillna(np.inf)
    more, less = (ends[KINDS[1]] > ends[KINDS[0]]).sum(), (ends[KINDS[1]] < ends[KINDS[0]]).sum()
    return f"Sigma points reach farther than first order in {more} of {len(ends)} rows, less far in {less}."


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
    for method, shift in zip(methods, np.linspace(-0.16, 0.16, len(methods)), strict=True):
        look = {**style(method), "linestyle": "none", "markersize": 5}
        for kind, filled in zip(KINDS, (True, False), strict=True):
            own = limits[(limits["method"] == method) & (limits["covariance"] == kind)]
            x = [at_mrad(row, (1.4 if filled else 1.6) * most) for row in own.itertuples()]
            y = np.array([names.index(name) for name in own["data"]]) + shift
            face = look["color"] if filled else "none"
            axis.plot(x, y, label=f"{method}, {kind}", markerfacecolor=face, markeredgewidth=1.2, **look)
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
