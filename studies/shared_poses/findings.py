"""Findings of `shared_poses` in words, from its tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, linregress, t

from studies.common.study import Tables, markdown
from uq_handeye.trials.validation.cross_check.ratios import number

INDEPENDENT, AWARE = "NEES, pairs independent", "NEES, pose-aware"
NAMES = {
    "disjoint": "disjoint pairs",
    "consecutive": "consecutive pairs",
    "all": "all pairs",
    "poses": "`efficient`, poses",
}
CERTAIN = 0.999


def findings(tables: Tables) -> str:
    sampled, predicted = tables["sampled"], tables["predicted"]
    first = sampled.iloc[0]
    half = 100 * float(first["NEES to"] / 6 - 1)
    parts = [
        f"{int(first['trials']):,} trials per cell: 99.9 % of the means of a true NEES lie within {half:.1f} % of 6 "
        f"({first['NEES from']:.2f} to {first['NEES to']:.2f}). Trials without X: {int(sampled['failures'].sum())}.",
        _nees_table(sampled),
        _independent(sampled),
        _aware(sampled),
        _law(sampled, predicted),
        _thirty_one(predicted),
        _accuracy(sampled, predicted),
    ]
    return "\n\n".join(parts)


def inside(lines: pd.DataFrame, column: str) -> int:
    """Count the lines in which the mean NEES lies where that of a consistent covariance does."""
    return int(((lines["NEES from"] <= lines[column]) & (lines[column] <= lines["NEES to"])).sum())


def numbers_of_poses(table: pd.DataFrame) -> list[int]:
    return sorted(int(n) for n in table["poses"].unique())


def _cell(table: pd.DataFrame, **where: Any) -> Mapping[Any, Any]:
    """The only line with these values."""
    for column, value in where.items():
        table = table[table[column] == value]
    (line,) = table.to_dict("records")
    return line


def _nees_table(sampled: pd.DataFrame) -> str:
    lines = []
    for noise in sampled["noise"].unique():
        for way in ("disjoint", "consecutive", "all"):
            cells = [_cell(sampled, noise=noise, data=way, poses=n) for n in numbers_of_poses(sampled)]
            lines.append([noise, NAMES[way], *(f"{c[INDEPENDENT]:.2f} / {c[AWARE]:.2f}" for c in cells)])
        cells = [_cell(sampled, noise=noise, data="poses", poses=n) for n in numbers_of_poses(sampled)]
        lines.append([noise, NAMES["poses"], *(f"{c[AWARE]:.2f}" for c in cells)])
    text = "Mean NEES, 6 if the covariance is consistent: pairs taken as independent / pose-aware."
    return f"{text}\n\n{markdown(['noise', 'data', *(f'{n} poses' for n in numbers_of_poses(sampled))], lines)}"


def _independent(sampled: pd.DataFrame) -> str:
    said = []
    for way in ("disjoint", "consecutive", "all"):
        some = sampled[sampled["data"] == way]
        true = inside(some, INDEPENDENT)
        ratio = [some[f"sd over stated, pairs independent: {which}"] for which in ("least", "largest")]
        said.append(
            f"- {NAMES[way]}: true in {true} of {len(some)} cells; the errors are "
            f"{number(ratio[0].min())} to {number(ratio[1].max())} times what it states per axis."
        )
    return "**The covariance that takes pairs as independent** (true: mean NEES in its interval)\n\n" + "\n".join(said)


def _aware(sampled: pd.DataFrame) -> str:
    some = sampled[sampled["data"] != "poses"]
    poses = sampled[sampled["data"] == "poses"]
    outside = len(sampled) - inside(sampled, AWARE)
    chance = float(binom.sf(outside - 1, len(sampled), 1 - CERTAIN))
    explained = "chance explains that" if chance > 0.01 else "**more than chance explains**"
    why = f"; {explained} (probability of so many or more: {chance:.2f})" if outside else ""
    return (
        f"**The pose-aware covariance** is true in {inside(some, AWARE)} of {len(some)} cells, with a NEES of "
        f"{some[AWARE].min():.2f} to {some[AWARE].max():.2f}; the bound as that of `efficient` in "
        f"{inside(poses, AWARE)} of {len(poses)}. Outside in all: {outside}{why}."
    )


def slope(poses: Sequence[float], values: Sequence[float]) -> tuple[float, float]:
    """Exponent of a power law of the number of poses, and half its 95 % interval."""
    fit = linregress(np.log(poses), np.log(values))
    return float(fit.slope), float(t.ppf(0.975, len(poses) - 2) * fit.stderr)


def _law(sampled: pd.DataFrame, predicted: pd.DataFrame) -> str:
    lines = []
    for noise in sampled["noise"].unique():
        some = sampled[(sampled["data"] == "all") & (sampled["noise"] == noise)]
        exponent, half = slope(some["poses"].tolist(), some[INDEPENDENT].tolist())
        over = some[INDEPENDENT] / some["poses"]
        cells = [f"{exponent:.3f} ± {half:.3f}", f"{over.min():.2f} to {over.max():.2f}"]
        lines.append([noise, *cells, *(_slopes(of) for of in _kinds(predicted, noise))])
    kinds = [f"first order, {kind}" for kind in predicted["motions"].unique()]
    header = ["noise", "sampled (95 %)", "NEES / n, sampled", *kinds]
    slopes = [
        value for noise in sampled["noise"].unique() for of in _kinds(predicted, noise) for value in _exponents(of)
    ]
    near = sum(0.9 < value < 1.1 for value in slopes)
    consecutive = sampled[sampled["data"] == "consecutive"].groupby("poses")[INDEPENDENT].mean()
    drawn = numbers_of_poses(sampled)
    change = f"{consecutive.iloc[0]:.2f} at {drawn[0]} poses to {consecutive.iloc[-1]:.2f}"
    poses = numbers_of_poses(predicted)
    return (
        f"**Growth with the number of poses n**, {poses[0]} to {poses[-1]}. Of all pairs taken as independent, the "
        "NEES as a power of n has the exponent (range over geometries and, in brackets, from the last two numbers of "
        f"poses alone):\n\n{markdown(header, lines)}\n\n"
        f"That it grows like n (exponent 0.9 to 1.1) holds in {near} of {len(slopes)} geometries and noises. Of "
        f"consecutive pairs the NEES (mean over the three noises) goes from {change} at {drawn[-1]}."
    )


def _kinds(predicted: pd.DataFrame, noise: str) -> list[pd.DataFrame]:
    """All pairs with this noise, one table per kind of geometry."""
    chosen = predicted[(predicted["data"] == "all") & (predicted["noise"] == noise)]
    return [of for _, of in chosen.groupby("motions", sort=False)]


def _exponents(some: pd.DataFrame, last: int = 0) -> list[float]:
    """Return the exponent of each geometry, from all or the last numbers of poses."""
    found = []
    for _, of in some.sort_values("poses").groupby("geometry"):
        chosen = of.iloc[-last:]
        found.append(float(np.polyfit(np.log(chosen["poses"]), np.log(chosen["NEES"]), 1)[0]))
    return found


def _slopes(some: pd.DataFrame) -> str:
    every, late = _exponents(some), _exponents(some, 2)
    return f"{min(every):.2f} to {max(every):.2f} ({min(late):.2f} to {max(late):.2f})"


def _thirty_one(predicted: pd.DataFrame) -> str:
    lines = []
    some = predicted[predicted["poses"] == 31]
    for (motions, noise), of in some.groupby(["motions", "noise"], sort=False):
        cells = []
        for way in ("consecutive", "all"):
            values = of[of["data"] == way]["NEES"]
            cells.append(f"{values.min():.2f} to {values.max():.2f} ({values.median():.2f})")
        lines.append([motions, noise, *cells])
    pairs = [int(some[some["data"] == way]["pairs"].iloc[0]) for way in ("consecutive", "all")]
    header = ["poses", "noise", f"{pairs[0]} consecutive pairs", f"{pairs[1]} pairs, all"]
    return (
        f"**31 poses, {some['geometry'].nunique()} geometries of each kind.** Mean NEES of pairs taken as independent, "
        f"to first order, range and median:\n\n{markdown(header, lines)}"
    )


def _accuracy(sampled: pd.DataFrame, predicted: pd.DataFrame) -> str:
    lines = []
    for noise in sampled["noise"].unique():
        for way in NAMES:
            cells = []
            for n in numbers_of_poses(sampled):
                line = _cell(sampled, noise=noise, data=way, poses=n)
                cells.append("{} to {}".format(*(number(line[f"sd over bound: {k}"]) for k in ("least", "largest"))))
            lines.append([noise, NAMES[way], *cells])
    chance = 100 * 3.29 / np.sqrt(2 * float(sampled["trials"].min()))
    by_way = predicted.pivot(
        index=["motions", "geometry", "noise", "poses"], columns="data", values="sd over bound: mean"
    )
    cost = by_way["disjoint"] / by_way["all"]
    better = int((by_way["all"] < by_way["disjoint"]).sum())
    worse = by_way["all"]
    header = ["noise", "data", *(f"{n} poses" for n in numbers_of_poses(sampled))]
    return (
        f"**What it costs in accuracy.** Standard deviation over the Cramér-Rao bound, sampled (each to {chance:.1f} "
        f"%), over the six axes:\n\n{markdown(header, lines)}\n\n"
        f"To first order over {len(by_way)} geometries, noises and numbers of poses, disjoint pairs, whose independent "
        f"covariance is consistent, have {number(cost.min())} to {number(cost.max())} times (median "
        f"{number(cost.median())}) the standard deviation of all pairs (mean over the axes); all pairs are better in "
        f"{better}. All pairs in turn have {number(worse.min())} to {number(worse.max())} times (median "
        f"{number(worse.median())}) that of the bound, which `efficient` reaches on the poses."
    )
