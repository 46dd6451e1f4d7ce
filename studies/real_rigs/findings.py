"""Findings of `real_rigs` in words, from its tables."""

from __future__ import annotations

import pandas as pd

from studies.common.study import Tables, markdown


def findings(tables: Tables) -> str:
    poses, views = tables["poses"], tables["views"]
    parts = [
        f"{int(poses['sets'].sum()):,} sets of simulated poses. Mean d² of the true X, 6 where the covariance is right "
        "and the noise known, somewhat more where few poses tell the noise; in parentheses how many of the 95 % "
        "ellipsoids hold X. Each cell is eye-in-hand, eye-to-hand.",
        _of_poses(poses),
        _price(poses),
        _motion(poses),
        f"{int(views['sets'].sum()):,} calibrated cameras whose corners were thrown away: median error of X, mean d², "
        "share of 95 % ellipsoids that hold it.",
        _of_views(views),
        _refused(poses, views),
    ]
    return "\n\n".join(part for part in parts if part)


def _pair(lines: pd.DataFrame, way: str) -> str:
    """Mean d^2 of the setups, and the share inside."""
    d2 = ", ".join(f"{value:.1f}" if value < 30 else f"{value:,.0f}" for value in lines[f"mean d2, {way}"])
    inside = ", ".join(f"{100 * value:.0f}" for value in lines[f"inside 95 %, {way}"])
    return f"{d2} ({inside} %)"


def _of_poses(table: pd.DataFrame) -> str:
    rows = []
    for (case, n), lines in table.groupby(["error", "poses"], sort=False):
        found = ", ".join(f"{value:.2f}" for value in lines["motion mm"])
        one = "" if len(lines) > 1 else f" ({lines['setup'].iloc[0]})"
        rows.append([f"{case}{one}", f"{n:,}", _pair(lines, "alone"), _pair(lines, "default"), f"{found} mm"])
    head = ["error beside the noise", "poses", "independent, nothing shared", "by default", "motion stated"]
    return markdown(head, rows)


def _price(table: pd.DataFrame) -> str:
    """State the cost of the defaults where they are not needed."""
    clean = table[table["error"] == "nothing"]
    ratio = clean["median mm, default"] / clean["median mm, alone"]
    least, most = (f"{100 * (one - 1):+.0f}" for one in (ratio.min(), ratio.max()))
    d2 = {way: [f"{clean[f'mean d2, {way}'].agg(end):.1f}" for end in ("min", "max")] for way in ("alone", "default")}
    return (
        f"Where nothing is wrong, what is assumed by default changes the median error of X by {least} to {most} %, and "
        f"mean d² is {' to '.join(d2['default'])} where it is "
        f"{' to '.join(d2['alone'])} as of independent poses."
    )


def _motion(table: pd.DataFrame) -> str:
    clean = table[table["error"] == "nothing"]
    stated = ", ".join(f"{lines['motion mm'].mean():.2f} mm of {n} poses" for n, lines in clean.groupby("poses"))
    return f"Where nothing moves, the motion of X during the session is stated as {stated} (medians)."


def _of_views(table: pd.DataFrame) -> str:
    ways = {
        "views": "`camera_noise`",
        "default": "isotropic noise, default shared errors",
        "alone": "isotropic noise, nothing shared",
    }
    rows = []
    for line in table.to_dict("records"):
        cells = []
        for way in ways:
            mm, d2, inside = (line[f"{what}, {way}"] for what in ("median mm", "mean d2", "inside 95 %"))
            cells.append(f"{mm:.2f} mm, {d2:,.{0 if d2 >= 30 else 1}f}, {100 * inside:.0f} %")
        rows.append([str(line["poses"]), line["setup"], *cells])
    return markdown(["poses", "setup", *ways.values()], rows)


def _refused(*tables: pd.DataFrame) -> str:
    """Sets without X; empty where there are none."""
    refused = tried = 0
    for table in tables:
        names = [name for name in map(str, table.columns) if name.startswith("refused")]
        refused += int(table[names].to_numpy().sum())
        tried += len(names) * int(table["sets"].sum())
    return f"Refused as not converged, and in no mean: {refused} of {tried:,} calibrations." if refused else ""
