"""Findings of `figure_5` in words, from its tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from studies.common.study import Tables, markdown
from uq_handeye.trials.validation.cross_check.ratios import number

LABELS = {
    "4dpa-pairs": "4DPA, sum over pairs",
    "4dpa-literal": "4DPA, (45) as printed",
    "4dpa-mean": "4DPA, (45) with $F$ a mean too",
    "nguyen-own": "Nguyen and Pham, own",
    "nguyen-first-order": "Nguyen and Pham, first order",
    "efficient-own": "`efficient`, own",
    "bound": "Cramér-Rao bound",
}
Line = Mapping[Any, Any]  # of a table, by column
SLIGHTLY = 0.9  # "very slightly smaller": by less than 10 %
CLOSE = 0.05  # of a standard deviation; what differs by less is called right


def findings(tables: Tables) -> str:
    main = tables["statistics"].query("geometry == 0")
    trials = int(main["trials"].max())
    chance = 3.29 / np.sqrt(2 * trials)
    parts = [
        f"{int(tables['same_error']['pairs'].iloc[0])} motions, noise (70), {trials:,} trials of each method. *sd "
        "ratio* is the standard deviation that a row states over the one sampled from the trials of its own method (of "
        "`efficient` for the bound), over the six axes and over all directions; the sampled one is known to "
        f"{100 * chance:.1f} % (99.9 %). The NEES is 6 and the coverage 95 % where a covariance is consistent; in "
        "brackets, where 99.9 % of the means of a true NEES lie, and the 99.9 % interval of the coverage.",
        _table(main),
        _correct(main),
        _smaller(tables["deviations"].query("geometry == 0"), tables["projections"]),
        _printed(tables),
        _same(tables["same_error"]),
        _geometries(tables),
        _first_order(tables["noise"]),
    ]
    return "\n\n".join(parts)


def _span(low: float, high: float) -> str:
    a, b = (_ratio(x) for x in (low, high))
    return a if a == b else f"{a} to {b}"


def _ratio(value: float) -> str:
    if value < 0.1:
        return f"{value:.2g}" if value >= 1e-4 else "0"
    return number(value)


def _table(main: pd.DataFrame) -> str:
    lines = []
    for line in main.to_dict("records"):
        nees = coverage = "singular"
        if not np.isnan(line["NEES"]):
            nees = f"{line['NEES']:.2f} ({line['NEES from']:.2f} to {line['NEES to']:.2f})"
            coverage = (
                f"{100 * line['coverage']:.1f} % ({100 * line['coverage from']:.1f} to {100 * line['coverage to']:.1f})"
            )
        axes = _span(line["least axis"], line["largest axis"])
        directions = _span(line["least direction"], line["largest direction"])
        lines.append([LABELS[line["row"]], axes, directions, nees, coverage])
    return markdown(["covariance", "sd ratio, axes", "sd ratio, directions", "NEES", "coverage of 95 %"], lines)


def by_row(some: pd.DataFrame) -> dict[str, Line]:
    """The lines of a table in which every row of `LABELS` stands once."""
    return {line["row"]: line for line in some.to_dict("records")}


def is_true(line: Line) -> bool:
    """Return whether the mean NEES lies where that of a consistent covariance does; a singular covariance is not
    consistent.
    """
    return bool(line["NEES from"] <= line["NEES"] <= line["NEES to"])


def _is_right(line: Line) -> bool:
    """True by its NEES, or with standard deviations that are right to `CLOSE` over all axes."""
    return is_true(line) or bool(line["least axis"] > 1 - CLOSE and line["largest axis"] < 1 + CLOSE)


def _correct(main: pd.DataFrame) -> str:
    said, lines = [], by_row(main)
    for key in ("4dpa-pairs", "4dpa-literal", "nguyen-own"):
        line = lines[key]
        verdict = "**holds**" if is_true(line) else "**does not hold**"
        if not is_true(line) and _is_right(line):
            verdict = "**nearly holds** (NEES outside of its interval, standard deviations right to 5 %)"
        size = f"standard deviations {_span(line['least axis'], line['largest axis'])} times those sampled"
        said.append(f"- {LABELS[key]}: {verdict}; {size}.")
    claim = '**"Both methods can estimate the covariance correctly"**'
    rule = "rule: mean NEES in its interval, as far as so many trials can tell"
    return f"{claim} ({rule})\n\n" + "\n".join(said)


def _against_nguyen(deviations: pd.DataFrame, key: str, column: str = "sd") -> pd.Series:
    """Standard deviations of a row over those of Nguyen and Pham's own, per geometry and axis."""
    table = deviations.pivot(index=["geometry", "axis"], columns="row", values=column)
    return table[key] / table["nguyen-own"]


def areas(projections: pd.DataFrame) -> dict[Any, Any]:
    """Areas of the ellipses up to a common factor, by plane and row."""
    square = projections["variance x"] * projections["variance y"] - projections["covariance"] ** 2
    found = projections.assign(area=np.sqrt(square.clip(lower=0)))
    return found.pivot(index=["x", "y"], columns="row", values="area").to_dict("index")


def _planes(projections: pd.DataFrame) -> list[tuple[str, str]]:
    return list(dict.fromkeys(zip(projections["x"], projections["y"], strict=True)))


def _smaller(deviations: pd.DataFrame, projections: pd.DataFrame) -> str:
    sd, sampled = (_against_nguyen(deviations, "4dpa-pairs", column) for column in ("sd", "sampled sd"))
    holds = _slightly(sd)
    larger = int((sd > 1).sum())
    text = (
        f'**"Our method achieves very slightly smaller covariances bounds": {"holds" if holds else "does not hold"}** '
        f"(rule: smaller by less than {100 - 100 * SLIGHTLY:.0f} % on all axes). 4DPA's standard deviations (sum over "
        f"pairs) are {_span(sd.min(), sd.max())} times those of Nguyen and Pham, larger on {larger} of {len(sd)} axes; "
        f"those sampled, {_span(sampled.min(), sampled.max())} times. `efficient`'s are "
        f"{_span(*_extremes(_against_nguyen(deviations, 'efficient-own')))} times Nguyen and Pham's. The six planes of "
        "Fig. 5, areas of the ellipses over that of Nguyen and Pham's:"
    )
    every = areas(projections)
    shares = projections.pivot(index=["x", "y"], columns="row", values="share in 95 % ellipse").to_dict("index")
    lines = []
    for plane in _planes(projections)[:6]:
        of, share = every[plane], shares[plane]
        held = [f"{100 * share[key]:.1f} %" for key in ("4dpa-pairs", "nguyen-own", "4dpa-literal")]
        keys = ("4dpa-pairs", "4dpa-sampled", "4dpa-literal", "4dpa-mean", "efficient-own")
        lines.append([_plane(*plane), *(_ratio(of[key] / of["nguyen-own"]) for key in keys), *held])
    header = ["plane", "4DPA, sum over pairs", "4DPA, sampled", "(45) as printed", "(45) with $F$ a mean too"]
    header += ["`efficient`"]
    header += [f"95 % ellipse holds: {who}" for who in ("4DPA", "Nguyen and Pham", "(45)")]
    return f"{text}\n\n{markdown(header, lines)}"


def _plane(x: str, y: str) -> str:
    what = "rotation" if x.startswith("theta") else "translation"
    return f"{what} {x[-1]}{y[-1]}"


def _extremes(values: pd.Series) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _times(low: float, high: float) -> str:
    """Say how many times too small ratios between low and high are."""
    return f"{number(1 / high)} to {number(1 / low)}"


def _printed(tables: Tables) -> str:
    every = tables["statistics"].query("row == '4dpa-literal'")
    main = every.query("geometry == 0").iloc[0]
    singular = int(every["NEES"].isna().sum())
    return (
        f"**(45) as printed** states standard deviations that are {_times(main['least axis'], main['largest axis'])} "
        "times too small per axis (over all geometries, "
        f"{_times(every['least axis'].min(), every['largest axis'].max())}), and none at all in some direction of X in "
        f"{singular} of {len(every)} geometries, where its NEES has no value."
    )


def _same(same: pd.DataFrame) -> str:
    lines, right = [], []
    for line in same.to_dict("records"):
        span = _span(line["least axis"], line["largest axis"])
        lines.append([line["same error of"], LABELS[line["row"]], span])
        if line["least axis"] > 1 - CLOSE and line["largest axis"] < 1 + CLOSE:
            right.append(f"{LABELS[line['row']]}, one error of {line['same error of']}")
    said = "; ".join(right) if right else "none of them"
    return (
        "**When (45) would be right.** Its formula is that of one error $b$ of $(\\mathrm{vec}\\,E, "
        "\\mathrm{vec}\\,Z)$ that all pairs share. So simulated"
        f" ({int(same['trials'].min()):,} trials), its standard deviations over those "
        f"sampled are:\n\n{markdown(['one error for all pairs, of', 'covariance', 'sd ratio, axes'], lines)}\n\n"
        f"Right to {100 * CLOSE:.0f} %: {said}. As printed, (45) averages the derivative but not $F_{{11}}$ of (35); "
        f"averaging both multiplies its standard deviations by N = {int(same['pairs'].iloc[0])}."
    )


def _geometries(tables: Tables) -> str:
    statistics, deviations = tables["statistics"], tables["deviations"]
    further = deviations[deviations["geometry"] > 0]
    keys = ("4dpa-pairs", "4dpa-mean", "efficient-own")
    lines = []
    for kind, some in further.groupby("kind", sort=False):
        spans = [_span(*_extremes(_against_nguyen(some, key))) for key in keys]
        lines.append([kind, some["geometry"].nunique(), *spans])
    number_of = further["geometry"].nunique()
    slightly = [
        f"{LABELS[key]} in {sum(_slightly(of) for _, of in _against_nguyen(further, key).groupby('geometry'))}"
        for key in keys
    ]
    shares = []
    for key in ("4dpa-pairs", "nguyen-own", "nguyen-first-order", "efficient-own", "bound"):
        of = statistics[statistics["row"] == key]
        inside = sum(map(is_true, of.to_dict("records")))
        span = _span(of["least direction"].min(), of["largest direction"].max())
        shares.append([LABELS[key], f"{inside} of {len(of)}", span, int(of["failures"].sum())])
    return (
        f"**{number_of} further geometries.** Standard deviations over those of Nguyen and Pham, over all axes and "
        f"geometries:\n\n{markdown(['motions', 'geometries', *(LABELS[key] for key in keys)], lines)}\n\n"
        f"Very slightly smaller (by less than {100 - 100 * SLIGHTLY:.0f} %, on all axes) of these {number_of}: "
        f"{'; '.join(slightly)}. All geometries, how often the mean NEES is in its interval (Nguyen and Pham's own "
        "leave out the covariance of rotation with translation):\n\n"
        + markdown(["covariance", "NEES in its interval", "sd ratio, directions", "trials without X"], shares)
    )


def _slightly(ratios: pd.Series) -> bool:
    return bool(((ratios >= SLIGHTLY) & (ratios < 1)).all())


def _first_order(noise: pd.DataFrame) -> str:
    lines = []
    for factor, some in noise.groupby("times sd of (70)"):
        cells, of = [], by_row(some)
        for key in ("4dpa-pairs", "nguyen-first-order", "bound"):
            line = of[key]
            cells += [f"{line['NEES']:.2f}{'' if is_true(line) else ' !'}", f"{line['bias (sd)']:.2f}"]
        sizes = (
            f"{some.iloc[0][f'B: least sd ({unit})']:.1f} to {some.iloc[0][f'B: largest sd ({unit})']:.1f} {unit}"
            for unit in ("mrad", "mm")
        )
        lines.append([f"{factor:g}", ", ".join(sizes), *cells])
    interval = noise.iloc[0]
    names = [LABELS[key] for key, line in by_row(noise[noise["times sd of (70)"] == 1]).items() if is_true(line)]
    verdict = f"At (70) first order holds for: {'; '.join(names)}." if names else "At (70) it holds for none of them."
    header = ["times (70)", "errors of B per axis", "4DPA: NEES", "bias", "Nguyen and Pham: NEES", "bias"]
    return (
        "**Does first order hold at (70)?** With all standard deviations of (70) multiplied, the mean NEES of the "
        f"first-order covariances ({interval['NEES from']:.2f} to {interval['NEES to']:.2f} if they are true; ! "
        "outside) and the largest bias of an axis in sampled standard deviations:\n\n"
        + markdown([*header, "bound (`efficient`): NEES", "bias"], lines)
        + f"\n\n{verdict}"
    )
