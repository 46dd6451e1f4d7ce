"""Quality of plans: against all subsets, against random poses, from degenerate starts, on real poses.

Model: ``G X C = W``; every robot and camera pose is its true value with a Gaussian error, left rotation, additive
translation: robot 0.02 deg, 0.05 mm; camera 0.1 deg, 0.5 mm per axis. Poses and noise of each session are drawn again,
seed 2024. 1,000 simulated sessions for the tables of subsets and of random poses, a quarter of that for each row of the
others (quick: 24). Real poses are looked for in the folder named by UQ_HANDEYE_DATA; without it there is no such table.
The paper does not plan poses; the question is whether the covariance (its section III-C) serves to choose them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from studies.common.scores import true_means
from studies.common.study import Study, Tables, markdown
from studies.planning.sessions import (
    Row,
    against_all_subsets,
    against_random_poses,
    degenerate_starts,
    more_candidates,
    real_poses,
)
from uq_handeye.core.presentation.colours import BLUE, GRID, QUIET
from uq_handeye.core.presentation.figure_parts import SMALL, TEXT, canvas, finished, plain
from uq_handeye.core.progress import progress_bar

QUICK = 24  # sessions


def measure(full: bool) -> Tables:
    sessions = 1_000 if full else QUICK
    random: list[list[Row]] = []

    def of_random() -> Iterable[Row]:
        random.extend(against_random_poses(sessions))
        return random[0]

    work: dict[str, Callable[[], Iterable[Row]]] = {
        "subsets": lambda: against_all_subsets(sessions),
        "random": of_random,
        "pose_by_pose": lambda: random[1],
        "candidates": lambda: more_candidates(sessions // 4),
        "degenerate": lambda: degenerate_starts(sessions // 4),
    }
    if folder := os.environ.get("UQ_HANDEYE_DATA"):
        work["real"] = lambda: real_poses(sessions // 4, Path(folder))
    tables = {}
    with progress_bar("planning", len(work), "tables") as advance:
        for name, rows in work.items():
            tables[name] = pd.DataFrame(list(rows()))
            advance(1)
    return tables


def gap(row: Any) -> str:
    """Format the gap of a mean squared error in %, of a logarithm in its own units."""
    if row.criterion == "logdet":
        return f"{row.at_the_optimum:,} of {row.sessions:,}, {row.mean_gap:.4f}, {row.worst_gap:.2f}"
    return f"{row.at_the_optimum:,} of {row.sessions:,}, {100 * row.mean_gap:.2f} %, {100 * row.worst_gap:.1f} %"


def findings(tables: Tables) -> str:
    parts = [*of_subsets(tables["subsets"]), *of_random(tables["random"]), *of_candidates(tables["candidates"])]
    parts += of_degenerate(tables["degenerate"])
    if "real" in tables:
        parts += of_real(tables["real"])
    return "\n\n".join(parts)


def of_subsets(table: pd.DataFrame) -> list[str]:
    cells: dict[str, list[str]] = {}
    for row in table.itertuples():
        cells.setdefault(f"`{row.criterion}`", []).append(gap(row))
    best = table.groupby("selection")["at_the_optimum"].sum()
    return [
        "Against all 220 subsets of 3 out of 12 candidates, after 5 poses: sessions in which the optimum was found, "
        "mean "
        "and worst gap of the criterion (of the mean squared error in %, of the logarithm in its own units).",
        markdown(
            ["criterion", "greedy alone", "with exchange (as used)"], [[name, *own] for name, own in cells.items()]
        ),
        f"Exchange finds the optimum in {best['exchange'] / table['sessions'].sum() * 2:.1%} of all, greedy choice "
        "alone "
        f"in {best['greedy'] / table['sessions'].sum() * 2:.1%}.".replace("%", " %"),
    ]


def of_random(table: pd.DataFrame) -> list[str]:
    rows = table.set_index("more_poses")
    sessions = int(table["sessions"].iloc[0])
    low, high = true_means(sessions)
    true = table["mean_nees"].between(low, high)
    planned, random = rows.loc["5 planned"], rows.loc["5 at random"]
    return [
        f"{sessions:,} sessions of 10 poses, and 5 more of 400 in the same workspace. Predicted standard deviations "
        "along "
        "the worst axis, means; NEES of X estimated once the poses are measured, with the covariance predicted before "
        f"(mean of a true one, 99.9 %: {low:.2f} to {high:.2f}).",
        markdown(
            ["more poses", "translation sd, mm", "rotation sd, deg", "NEES"],
            [
                [row.more_poses, f"{row.translation_sd_mm:.2f}", f"{row.rotation_sd_deg:.3f}", f"{row.mean_nees:.2f}"]
                for row in table.itertuples()
            ],
        ),
        f"5 planned poses are worth {planned['median_random_poses_as_good']:.0f} random ones "
        f"({planned['least_random_poses_as_good']:.0f} to {planned['largest_random_poses_as_good']:.0f} in 90 % of "
        f"orders); the translation sd is {planned['translation_sd_mm'] / random['translation_sd_mm']:.2f} times that "
        "of "
        f"5 random ones. The predicted covariance is consistent in {true.sum()} of {len(table)} rows.",
    ]


def of_candidates(table: pd.DataFrame) -> list[str]:
    usual = table.set_index("candidates")["median_ms"][200]
    return [
        f"5 planned among more candidates, {int(table['sessions'].iloc[0])} sessions of 10 poses; time as a multiple "
        "of "
        "that with 200, median.",
        markdown(
            ["candidates", "translation sd, mm", "time"],
            [
                [f"{row.candidates:,}", f"{row.translation_sd_mm:.2f}", f"{row.median_ms / usual:.2g}"]
                for row in table.itertuples()
            ],
        ),
    ]


def of_degenerate(table: pd.DataFrame) -> list[str]:
    rows = []
    for (so_far, setup), own in table.groupby(["so_far", "setup"], sort=False):
        cells = [reached(row) for row in own.sort_values("after").itertuples()]
        rows.append([f"{so_far}, {setup}", own["open_directions"].iloc[0], *cells])
    last = table[table["after"] == table["after"].max()]
    return [
        f"One plan of 3 poses after 8 that leave X open, {int(table['sessions'].iloc[0])} sessions per row. The "
        "bound on the "
        "translation of X along its worst axis with the true rig: median and range.",
        markdown(["8 poses so far", "open directions", *(f"after {k}, mm" for k in (1, 2, 3))], rows),
        f"After the last pose X is determined in {(last['sessions'] - last['left_open']).sum():,} of "
        f"{last['sessions'].sum():,} sessions.",
    ]


def reached(row: Any) -> str:
    if row.left_open == row.sessions:
        return "open"
    return f"{row.median_mm:.2f} ({row.least_mm:.2f} to {'open' if row.left_open else f'{row.largest_mm:.2f}'})"


def of_real(table: pd.DataFrame) -> list[str]:
    rows = [
        [
            f"{row.poses}, {row.available} poses",
            f"{row.first_8_least_ratio:.2f} to {row.first_8_largest_ratio:.2f}",
            f"{row.median_ratio:.2f} ({row.least_ratio:.2f} to {row.largest_ratio:.2f})",
            f"{row.left_open} of {row.sessions}",
        ]
        for row in table.itertuples()
    ]
    return [
        "Real poses: 8 so far, 5 of the others planned without their camera poses; noise taken as 0.05 deg, 0.2 mm "
        "of the "
        "robot and 0.2 deg, 1 mm of the camera. The six standard deviations once the camera poses are known, over "
        "those "
        f"predicted: of the first 8 poses (range of six), and of {int(table['sessions'].iloc[0]) - 1} random choices "
        "of 8 "
        "(median and range).",
        markdown(["poses", "first 8 so far", "random 8 so far", "left a part of X open"], rows),
        f"The prediction is off by at most {100 * (table['largest_ratio'] - 1).max():.0f} % upwards and "
        f"{100 * (1 - table['least_ratio']).max():.0f} % downwards over the random choices.",
    ]


def figures(tables: Tables) -> dict[str, Figure]:
    table = tables["pose_by_pose"]
    figure = canvas(3.2)
    axis = figure.subplots()
    plain(axis)
    for name, colour, marker, shade in (("at random", QUIET, "s", GRID), ("planned", BLUE, "o", "#cfe2f0")):
        own = table[table["more_poses"] == name]
        axis.fill_between(own["poses"], own["low_5_mm"], own["high_95_mm"], color=shade, linewidth=0)
        axis.plot(own["poses"], own["median_mm"], color=colour, marker=marker, markersize=4, linewidth=1.2, label=name)
    end = table[table["more_poses"] == "planned"]["median_mm"].iloc[-1]
    axis.axhline(end, color=BLUE, linewidth=0.8, linestyle=":")
    axis.set_ylim(bottom=0)
    axis.set_xlim(-0.3, table["poses"].max() + 0.3)
    axis.set_xlabel("more poses after 10", fontsize=TEXT)
    axis.set_ylabel("predicted sd of the translation,\nworst axis (mm)", fontsize=TEXT)
    axis.legend(title="median, 5 % to 95 %", fontsize=SMALL, title_fontsize=SMALL, frameon=False)
    return {"pose_by_pose": finished(figure)}


STUDY = Study("planning", measure, findings, figures)
