"""Findings of the study of peers: every number and verdict from its tables."""

from __future__ import annotations

from typing import Any

import pandas as pd

from studies.common.scores import true_means
from studies.common.study import Tables, markdown

OURS, REFERENCE = "uq-handeye, efficient", "uq-handeye, ml"
CERTAIN, SLIGHT = 4.0, 0.01  # standard errors, and squared error over the bound's, by which one exceeds `ml`
SAME = 0.1  # of a deviation, and of the covariance: below it two answers are one
AS_FAST = 1.1  # times
README_POSES = 30


def findings(tables: Tables) -> str:
    quality, times = tables["quality"], tables["times"]
    blocks = []
    for noise, rows in quality.groupby("noise", sort=False):
        low, high = true_means(int(rows.trials.max()))
        blocks += [
            f"**{str(noise).capitalize()}**, {int(rows.poses.iloc[0])} poses, {int(rows.trials.max()):,} draws of the "
            f"noise. NEES of a consistent covariance: {low:.2f} to {high:.2f} (99.9 %; where there are fewer trials, "
            f"wider). Time, on isotropic noise: times that of {_code(OURS)}.",
            _table(rows, times),
        ]
    blocks += [
        "\n".join(f"- {line}" for noise, rows in quality.groupby("noise", sort=False) for line in _said(noise, rows)),
        "**The same model, the same answer?** Largest difference from `ml`, X in its standard deviations, "
        "covariance as `|eigenvalue - 1|` after whitening with that of `ml`:",
        _equal_table(tables["equal"]),
        _equal_words(tables["equal"]),
        "**Time**, as multiples of `efficient` at the same number of poses (medians of interleaved runs, CPU time):",
        _times_table(times),
        _times_words(times),
        "**What was run**:",
        markdown(
            ["program", "on PyPI", "version", "gives"],
            ([row.name, f"`{row.package}`", row.version, row.gives] for row in rows_of(tables["peers"])),
        ),
    ]
    return "\n\n".join(block for block in blocks if block)


def rows_of(table: pd.DataFrame) -> list[Any]:
    """Its rows, with the columns as attributes."""
    return list(table.itertuples())


def _code(label: str) -> str:
    name, method = label.split(", ")
    return f"{name}, `{method}`"


def _shown(row: Any) -> str:
    label = f"{row.program}, {row.method}"
    return _code(label) if row.program == "uq-handeye" else label


def _table(rows: pd.DataFrame, times: pd.DataFrame) -> str:
    at = times[times.poses == README_POSES].set_index(["program", "method"])["times efficient"]
    lines = []
    for row in rows_of(rows.rename(columns={"error over bound": "error", "standard error": "spread"})):
        error = "none" if pd.isna(row.error) else f"{row.error:.2f} ± {row.spread:.2f}"
        consistency = "no covariance" if pd.isna(row.NEES) else f"{row.NEES:.2f}"
        lines.append(
            [
                _shown(row),
                row.version,
                error,
                consistency,
                _ratio(at.get((row.program, row.method))),
                f"{row.failed} of {row.trials + row.failed}",
            ]
        )
    return markdown(["program", "version", "error over bound", "NEES", "time", "failed"], lines)


def _ratio(value: float | None) -> str:
    return "" if value is None or pd.isna(value) else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def _said(noise: object, rows: pd.DataFrame) -> list[str]:
    excess, spread = rows["excess"], rows["excess standard error"]
    at = rows[excess <= (CERTAIN * spread).clip(lower=SLIGHT)]
    far = rows.drop(at.index)
    lines = [
        _reference(noise, rows),
        f"{noise}: no larger error than `ml` on the same draws (that these draws show): {_listed(at)}.",
    ]
    slow = rows[rows.trials + rows.failed < (rows.trials + rows.failed).max()]
    for row in rows_of(slow.rename(columns={"error over bound": "error"})):
        if pd.isna(row.error):
            continue
        other = max(row.error**2 - row.excess, 0.0) ** 0.5
        lines.append(f"{noise}: on the {row.trials} draws of {_shown(row)} ({row.error:.2f}), `ml` has {other:.2f}.")
    if len(far):
        values = far["error over bound"]
        lines.append(
            f"{noise}: the others have {values.min():.2f} times the bound's ({_listed(far[values == values.min()])}) "
            f"to {values.max():.2f} ({_listed(far[values == values.max()])})."
        )
    own = rows[rows.NEES.notna()]
    true = [low <= row.NEES <= high for row in rows_of(own) for low, high in [true_means(int(row.trials))]]
    wrong = own[[not good for good in true]]
    lines.append(
        f"{noise}: {len(own)} of {len(rows)} give a covariance; it is true (NEES, 99.9 %) for {sum(true)} of them"
        + (f", not for {_listed(wrong)}." if len(wrong) else ".")
    )
    return lines


def _reference(noise: object, rows: pd.DataFrame) -> str:
    own = rows[rows.program + ", " + rows.method == REFERENCE].iloc[0]
    error, spread = float(own["error over bound"]), float(own["standard error"])
    verdict = "is" if abs(error - 1) <= CERTAIN * spread else "is not"
    return f"{noise}: `ml` has {error:.2f} ± {spread:.2f} times the bound's error and {verdict} at the bound."


def _listed(rows: pd.DataFrame) -> str:
    return "; ".join(_shown(row) for row in rows_of(rows)) or "none"


def _equal_table(equal: pd.DataFrame) -> str:
    return markdown(
        ["noise", "program", "trials", "X", "covariance"],
        (
            [
                row.noise,
                _shown(row),
                row.trials,
                f"{row.distance:.1e}",
                f"{row.difference:.1e}",
            ]
            for row in rows_of(
                equal.rename(columns={"largest distance": "distance", "largest covariance difference": "difference"})
            )
        ),
    )


def _equal_words(equal: pd.DataFrame) -> str:
    columns = {"largest distance": "distance", "largest covariance difference": "difference"}
    worst = equal.rename(columns=columns).groupby(["program", "method"], sort=False)[list(columns.values())].max()
    lines = []
    for row in rows_of(worst.reset_index()):
        verdict = "is `ml`'s" if max(row.distance, row.difference) < SAME else "is not `ml`'s"
        lines.append(
            f"- The answer of {_shown(row)} {verdict}: X within {row.distance:.1e} deviations, covariance within "
            f"{100 * row.difference:.2g} % (the rule: less than {SAME:g} deviations and {100 * SAME:.0f} %)."
        )
    return "\n".join(lines)


def _times_table(times: pd.DataFrame) -> str:
    counts = sorted(set(times.poses))
    table = times.pivot(index=["program", "method"], columns="poses", values="times efficient")
    keys = list(dict.fromkeys(zip(times.program, times.method, strict=True)))
    return markdown(
        ["program", *(f"{n:,} poses" for n in counts)],
        (
            [_code(", ".join(key)) if key[0] == "uq-handeye" else ", ".join(key), *(_ratio(x) for x in table.loc[key])]
            for key in keys
        ),
    )


def _times_words(times: pd.DataFrame) -> str:
    others = times[times.program != "uq-handeye"]
    lines = []
    for n, rows in others.groupby("poses"):
        faster = rows[rows["times efficient"] < 1 / AS_FAST]
        slower = rows[rows["times efficient"] > AS_FAST]
        lines.append(
            f"- {n:,} poses: faster than `efficient` by more than {100 * (AS_FAST - 1):.0f} %: {_listed(faster)}; "
            f"slower: {len(slower)} of {len(rows)}."
        )
    for name in ("GTSAM", "SymForce"):
        own = others[others.program == name]
        if own.empty:
            continue
        ratios = ", ".join(
            f"{_ratio(ratio)} at {n:,}" for n, ratio in zip(own.poses, own["times efficient"], strict=True)
        )
        lines.append(
            f"- {name} takes {ratios} poses, as multiples of `efficient`, without its graph and start; the residuals "
            "of camera poses run in Python."
        )
    return "\n".join(lines)
