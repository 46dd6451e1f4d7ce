"""Findings of `kinematics` in words, from its tables."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from studies.common.study import Tables, markdown

NAMES = {
    "ur5_like": "UR5-like, calibrated in the factory",
    "irb120_like": "IRB 120-like, industrial",
    "panda_like": "Panda-like, cobot",
    "fr3_philnad": "FR3",
    "industrial_kinematic": "two-axis positioner",
}
WORDS = {"local": "in one region", "anywhere": "anywhere"}


def findings(tables: Tables) -> str:
    simulated = tables["simulated"]
    sets = simulated[simulated["way"] == "declared"]["sets"].sum()
    parts = [
        f"**Simulated arms**, {int(sets):,} sets of 30 poses in one region. Predictions of what the camera measures at "
        "other joints: share inside their 95 % ellipsoid, RMS distance from the truth; X in the frames aligned "
        "over the workspace: mean d² (6 is right) and share inside.",
        _of_simulated(simulated),
        _against_today(simulated),
        "**Physical flange.** Mean d² of X, the errors declared as they were drawn.",
        _of_flange(tables["flange"]),
        "**A population of arms** with an error that no model has, measured about as well as by a laser tracker; "
        "scales estimated. *Mean*: predictions without the noise of one new measurement, against the true pose.",
        _of_population(tables["population"]),
    ]
    if "real" in tables:
        parts += ["**Real arms**: camera poses that were held out.", _of_real(tables["real"])]
    if "touches" in tables:
        parts += ["**Three Pandas**: touches that were held out.", _of_touches(tables["touches"])]
    refused = sum(int(table["refused"].sum()) for table in tables.values())
    tried = sum(int(table["sets"].sum()) for table in tables.values())
    parts.append(f"Refused as not converged, and in no mean: {refused} of {tried:,} fits.")
    return "\n\n".join(parts)


def percent(value: float) -> str:
    return f"{100 * value:.0f} %"


def _prediction(line: pd.Series, place: str) -> str:
    return f"{percent(line[f'{place}: inside'])}, {line[f'{place}: mm']:.2f} mm"


def _d2(value: float) -> str:
    return f"{value:,.1f}" if value < 30 else f"{value:,.0f}"


def _rows(table: pd.DataFrame) -> Sequence[pd.Series]:
    return [line for _, line in table.iterrows()]


def _of_simulated(table: pd.DataFrame) -> str:
    rows = [
        [
            NAMES[line["arm"]],
            line["setup"],
            line["way"],
            _prediction(line, "near"),
            _prediction(line, "far"),
            f"{_d2(line['X: d2'])}, {percent(line['X: inside'])}",
        ]
        for line in _rows(table)
    ]
    return markdown(["arm", "setup", "kinematic errors", "near", "anywhere", "X: d², inside"], rows)


def _against_today(table: pd.DataFrame) -> str:
    """RMS anywhere, over that without joints."""
    by = table.set_index(["arm", "setup", "way"])["far: mm"].unstack("way")
    said = []
    for way in ("declared", "estimated"):
        ratio = by[way] / by["no joints"]
        said.append(f"{ratio.min():.2f} to {ratio.max():.2f} ({way})")
    shares = {
        way: " to ".join(percent(table.loc[table["way"] == way, "far: inside"].agg(end)) for end in ("min", "max"))
        for way in ("declared", "estimated", "no joints")
    }
    return (
        f"Anywhere in the workspace {shares['declared']} are inside with declared scales, {shares['estimated']} with "
        f"estimated ones, {shares['no joints']} without joints. The RMS there is {' and '.join(said)} times that "
        "without joints."
    )


def _of_flange(table: pd.DataFrame) -> str:
    rows = [
        [
            NAMES[line["arm"]],
            line["setup"],
            f'`flange="{line["flange"]}"`',
            _d2(line["controller's: d2"]),
            f"{_d2(line['physical: d2'])}, {percent(line['physical: inside'])}",
        ]
        for line in _rows(table)
    ]
    head = [
        "arm",
        "setup",
        "calibrated for",
        "d² in the controller's flange",
        "d² in the physical flange, inside",
    ]
    return markdown(head, rows)


def _of_population(table: pd.DataFrame) -> str:
    rows = [
        [
            f"{line['poses']} {WORDS[line['where']]}",
            line["way"],
            f"{_d2(line['X: d2'])}, {percent(line['X: inside'])}, {line['X: mm']:.2f} mm",
            _prediction(line, "near"),
            _prediction(line, "far"),
            f"{percent(line['near: mean inside'])}, {percent(line['far: mean inside'])}",
        ]
        for line in _rows(table)
    ]
    head = ["poses", "scales", "X: d², inside, error", "near", "anywhere", "mean: near, anywhere"]
    return markdown(head, rows)


def _of_real(table: pd.DataFrame) -> str:
    rows = [
        [
            NAMES[line["arm"]],
            f"{line['poses']} {WORDS[line['where']]}",
            line["way"],
            percent(line["held out: inside"]),
            f"{line['held out: d2/6']:.2f}",
            f"{line['held out: mm']:.2f} mm",
            f"{line['held out: deg']:.2f} deg",
        ]
        for line in _rows(table)
    ]
    return markdown(["arm", "poses", "calibrated with", "inside 95 %", "mean d²/6", "RMS", "RMS of the angle"], rows)


def _of_touches(table: pd.DataFrame) -> str:
    rows = [
        [
            line["arm"].replace("_", " "),
            f"{line['poses']} touches",
            line["held out"],
            percent(line["inside"]),
            f"{line['d2/3']:.2f}",
            f"{line['mm']:.2f} mm",
            f"{line['nominal mm']:.2f} mm",
        ]
        for line in _rows(table)
    ]
    head = ["arm", "calibrated with", "held out", "inside 95 %", "mean d²/3", "RMS", "RMS by the URDF"]
    return markdown(head, rows)
