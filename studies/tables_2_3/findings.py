"""Findings of `studies.tables_2_3`, from its tables only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from studies.common.paper_tables import CLASSICAL, PAPER, RECENT
from studies.common.study import Tables, markdown

TRUTH, BOUND = "true X", "bound"
PAPER_SCALE = "4dpa, d = 1e4"
OTHERS = ("gwak", "nguyen", "efficient")  # beneath the paper's columns
TEXT = {  # 4DPA as % of the others, section IV-A
    "error, classical": ("error62", CLASSICAL, "3.06 to 94.01"),
    "error, recent": ("error62", RECENT, "0.39 to 86.11"),
    "time, classical": ("seconds", CLASSICAL, "9.98 to 70.68"),
    "time, recent": ("seconds", RECENT, "1.45 to 28.58"),
}
LIKE = 1.25, 0.25  # a (62) is like the printed one: within this factor at both ends, and this much in the exponent
ENOUGH = 8  # draws, for a word on whether an error grows
REAL_ERRORS = (
    ("rotation", "rotation_mrad", "rotation_se_mrad"),
    ("translation", "translation_mm", "translation_se_mm"),
)


def of(table: pd.DataFrame, column: str, **equal: object) -> pd.DataFrame:
    """N by method."""
    for name, value in equal.items():
        table = table[table[name] == value]
    return table.pivot(index="N", columns="method", values=column)


def slope(N: Any, values: Any) -> float:
    """p of ``values ~ N^p``."""
    return float(np.polyfit(np.log(np.asarray(N, dtype=float)), np.log(np.asarray(values, dtype=float)), 1)[0])


def span(values: Any, digits: int = 2) -> str:
    """Smallest to largest of a column or a table."""
    flat = np.ravel(np.asarray(values, dtype=float))
    flat = flat[np.isfinite(flat)]
    return f"{flat.min():.{digits}f} to {flat.max():.{digits}f}"


def holds(share: float, printed: float) -> str:
    """Say whether 4DPA has the smallest value as often as in the tables as printed, from which the paper claims it."""
    return "holds" if share >= printed else "does not hold"


def printed_share(paper: pd.DataFrame, column: str) -> float:
    """Return the share of the printed cases in which 4DPA has the smallest value."""
    table = of(paper, column)
    return smallest(table) / len(table)


def smallest(table: pd.DataFrame, methods: Sequence[str] = PAPER) -> int:
    """Count the values of N at which 4DPA has the smallest value of these methods."""
    known = table[[name for name in methods if name in table]]
    return int((known.idxmin(axis=1) == "4dpa").sum())


def findings(tables: Tables) -> str:
    parts = [
        _printed(tables["paper"]),
        _as_the_paper(tables["accuracy"], tables["times"], tables["paper"]),
        _truth(tables["accuracy"], printed_share(tables["paper"], "error62")),
        _growing(tables["accuracy"]),
        _late(tables["accuracy"], tables["paper"]),
        _time(tables["times"], printed_share(tables["paper"], "seconds")),
        _real(tables.get("real"), tables.get("published")),
    ]
    return "\n\n".join(parts)


def _printed(paper: pd.DataFrame) -> str:
    error, seconds = of(paper, "error62"), of(paper, "seconds")
    first, last = error.index[0], error.index[-1]
    rows, hits = [], {"all": 0, "last": 0}
    for name, (column, methods, text) in TEXT.items():
        share = 100 / of(paper, column)[list(methods)].div(of(paper, column)["4dpa"], axis=0)
        spans = {"all": span(share), "last": span(share.loc[last])}
        for which, found in spans.items():
            limits = zip(text.split(" to "), found.split(" to "), strict=True)
            hits[which] += sum(abs(float(a) / float(b) - 1) < 0.01 for a, b in limits)
        rows.append([name, text, *spans.values()])
    return (
        "## The printed tables\n\n"
        f"In the tables as printed, 4DPA has the smallest error (62) in {smallest(error)} of {len(error)} cases and "
        f"the smallest time in {smallest(seconds)}. The ranges that the text gives, beside those of the tables:\n\n"
        + markdown(["4DPA as % of", "text", "tables, all cases", f"tables, N = {last}"], rows)
        + f"\n\nLimits in the text that are those of all cases: {hits['all']} of {2 * len(TEXT)}; those of the last "
        f"case alone: {hits['last']} of {2 * len(TEXT)} (within 1 %)."
        "\n\n(62) is a sum of squares under a root, divided by N and not by its root: for one fixed X it falls as "
        f"N^-0.5. 4DPA's printed error falls as N^{slope(error.index, error['4dpa']):.2f}. The residual of one motion, "
        f"(62) times the root of N, is {error['4dpa'][first] * first**0.5:.3f} at N = {first} and "
        f"{error['4dpa'][last] * last**0.5:.3f} at {last}: rotations of some "
        f"{np.degrees(error['4dpa'][last] * (last / 2) ** 0.5):.0f} to "
        f"{np.degrees(error['4dpa'][first] * (first / 2) ** 0.5):.0f} degrees, if it is rotation."
    )


def _as_the_paper(accuracy: pd.DataFrame, times: pd.DataFrame, paper: pd.DataFrame) -> str:
    """The layout of Tables II and III, for the recording ``longer``."""
    errors, spread = of(accuracy, "error62", sequence="longer"), accuracy[accuracy["sequence"] == "longer"]
    ratios = of(accuracy, "error62_over_4dpa", sequence="longer")
    time = of(times, "over_4dpa")
    band = spread[spread["method"] == "4dpa"].set_index("N")

    def own(N: int) -> str:
        low, high = band["error62_low"][N], band["error62_high"][N]
        return f"{1e4 * errors['4dpa'][N]:.3f} ({1e4 * low:.3f} to {1e4 * high:.3f})"

    def rows(methods: Sequence[str]) -> list[list[str]]:
        return [
            [str(N), *(f"{ratios[name][N]:.5f}, {time[name][N]:.3g}" for name in methods), own(N)] for N in errors.index
        ]

    others = list(PAPER[:-1])
    compared = 100 / ratios[others]
    alike = [name for name in others if (ratios[name] - 1).abs().max() < 0.01]
    spread_of = 100 * float(np.abs(ratios[alike].to_numpy() - 1).max()) if alike else 0.0
    above = 100 * (1 / ratios["gwak"] - 1).max()
    behind = 100 * (1 / ratios[list(PAPER)].min(axis=1) - 1).max()
    printed = of(paper, "error62")
    verdict = holds(smallest(ratios) / len(ratios), printed_share(paper, "error62"))
    heading = ["N", *CLASSICAL, "4dpa: (62), 1e-4"]
    draws = int(spread["draws"].max())
    return (
        "## The paper's columns, on the simulated rig\n\n"
        f"Recording that goes on as N grows, {draws} draws (fewer of zhao and heller). In each cell: error (62) and "
        "time, both as multiples of 4DPA's; last column: 4DPA's mean (62) with the band of 90 % of the draws.\n\n"
        + markdown(heading, rows(CLASSICAL))
        + "\n\n"
        + markdown(["N", *RECENT, *OTHERS, "4dpa: (62), 1e-4"], rows((*RECENT, *OTHERS)))
        + f"\n\n4DPA has the smallest (62) of the paper's nine methods at {smallest(ratios)} of {len(ratios)} N, and "
        f'is above the smallest by {behind:.4f} % at most. That it "almost always gives the most accurate results", '
        f"read by (62), {verdict} here (rule: in no smaller a share of the cases than in the printed tables, "
        f"{smallest(printed)} of {len(printed)}). 4DPA's (62) is {span(compared[list(CLASSICAL)])} % of that of "
        f"the classical methods and {span(compared[list(RECENT)])} % of the recent ones'. For "
        f"{', '.join(alike) or 'none'} and 4DPA it is the same within {spread_of:.2f} %. No method can be below "
        f"`gwak`, which minimises (62): 4DPA is above it by at most {above:.4f} %."
    )


def _truth(accuracy: pd.DataFrame, printed: float) -> str:
    """The real error beside (62); ``printed``: the share of cases from which the paper claims the smallest error."""
    table = accuracy[accuracy["sequence"] == "longer"]
    ends = sorted(table["N"].unique())[:: max(1, table["N"].nunique() - 1)][:2]
    columns = {name: of(table, name) for _, *pair in REAL_ERRORS for name in pair}
    failed = of(table, "failed")
    ratio = of(table, "error62_over_4dpa")
    rows = []
    for name in (*PAPER, *OTHERS, BOUND):
        cells = [name, "" if name == BOUND else f"{ratio[name].iloc[-1]:.4f}"]
        for _, column, se in REAL_ERRORS:
            value, error = columns[column], columns[se]
            cells += [f"{value[name][N]:.3f}" + ("" if name == BOUND else f" ± {error[name][N]:.3f}") for N in ends]
        rows.append([*cells, "" if name == BOUND else int(failed[name].sum())])
    counts = []
    for what, column, se in REAL_ERRORS:
        table_of, own = columns[column], columns[column]["4dpa"]
        others = table_of[list(PAPER[:-1])]
        rivals = others.min(axis=1)
        rivals_se = columns[se][list(others)].to_numpy()[range(len(others)), np.nanargmin(others.to_numpy(), axis=1)]
        n, total = smallest(table_of), len(table_of)
        close = int((own - rivals <= 2 * np.hypot(columns[se]["4dpa"], rivals_se)).sum())
        verdict = holds(n / total, printed) if n >= printed * total or close < printed * total else "cannot be judged"
        clearly = int((own < 0.99 * rivals).sum())
        counts.append(
            f"{what}: smallest of the nine at {n} of {total} N, by more than 1 % at {clearly}, not larger than the "
            f"smallest by two standard errors at {close} (the claim {verdict}); "
            f"{span(own / np.minimum(rivals, own))} times the smallest, {span(own / table_of[BOUND])} times the bound"
        )
    spreads = columns["translation_mm"][list(PAPER)].iloc[-1]
    same = [name for name in PAPER if abs(ratio[name].iloc[-1] - 1) < 0.01]
    apart = spreads[same].max() / spreads[same].min()
    above = ratio[TRUTH]
    return (
        "## The real error of X\n\n"
        f"RMS error against the true X at N = {ends[0]} and {ends[-1]} (± standard error), beside (62) at the larger N "
        "as a multiple of 4DPA's:\n\n"
        + markdown(
            [
                "method",
                "(62)",
                *(f"rotation, mrad, {N}" for N in ends),
                *(f"translation, mm, {N}" for N in ends),
                "failed",
            ],
            rows,
        )
        + f"\n\n4DPA by the real error: {'; '.join(counts)}. The rule is the same; where the smallest cannot be told "
        "from it by so many draws, there is no verdict.\n\n"
        f"{'(62) does not tell' if apart > 1.5 else '(62) may tell'} which X is good: among the {len(same)} of the "
        f"nine methods whose (62) is that of 4DPA within 1 % at N = {ends[-1]}, the translation error differs by a "
        f"factor of {apart:.1f}. The true X itself has {span(above, 5)} times 4DPA's (62), and "
        + (
            "a larger one"
            if (above > 1).all()
            else "not a larger one"
            if (above < 1).all()
            else f"a larger one at {int((above > 1).sum())} of {len(above)} N"
        )
        + "."
    )


def _growing(accuracy: pd.DataFrame) -> str:
    """Say whether more data mean a better X, and whether (62) shows it."""
    rows, worse = [], []
    for name in (*PAPER, *OTHERS):
        cells = [name]
        for sequence in ("longer", "denser"):
            for column in ("error62", "rotation_mrad", "translation_mm"):
                values = of(accuracy, column, sequence=sequence)[name].dropna()
                cells.append(f"{slope(values.index, values):+.2f}" if len(values) > 1 else "")
        rows.append(cells)
        for sequence in ("longer", "denser"):
            for what, column, error in REAL_ERRORS:
                values = of(accuracy, column, sequence=sequence)[name]
                noise = of(accuracy, error, sequence=sequence)[name]
                if of(accuracy, "draws", sequence=sequence)[name].min() < ENOUGH:
                    continue
                change = values.iloc[-1] - values.iloc[0]
                if change > 3 * np.hypot(noise.iloc[-1], noise.iloc[0]):
                    factor = values.iloc[-1] / values.iloc[0]
                    bias = (
                        of(accuracy, error.replace("_se_", "_bias_"), sequence=sequence)[name].iloc[-1]
                        / values.iloc[-1]
                    )
                    worse.append((sequence, f"`{name}` in {what}, {factor:.1f} times ({bias:.0%} bias)"))
    fixed = [of(accuracy, "error62", sequence=s)[TRUTH] for s in ("longer", "denser")]
    said = [
        f"in `{sequence}`, from the first N to the last, the real error *grows* of "
        + ", ".join(text for where, text in worse if where == sequence)
        for sequence in ("longer", "denser")
        if any(where == sequence for where, _ in worse)
    ]
    calm = "".join(f"; in `{s}` of none" for s in ("longer", "denser") if all(s != where for where, _ in worse))
    falls = all(
        of(accuracy, "error62", sequence=s)[name].iloc[-1] < of(accuracy, "error62", sequence=s)[name].iloc[0]
        for s in ("longer", "denser")
        for name in PAPER
    )
    return (
        "## Growing sample counts\n\n"
        'The paper: "with growing sample counts, all the methods obtain more accurate estimates of X". It sees '
        "(62) fall. The (62) of the *true* X, which has nothing to improve, falls as "
        f"N^{slope(fixed[0].index, fixed[0]):.2f} (longer) and N^{slope(fixed[1].index, fixed[1]):.2f} (denser). "
        "Exponents p of N^p, fitted over all N:\n\n"
        + markdown(
            ["method", *(f"{s}: {w}" for s in ("longer", "denser") for w in ("(62)", "rotation", "translation"))], rows
        )
        + f"\n\n(62) falls for {'all' if falls else 'not all'} nine methods in both recordings. "
        + (
            "The sentence does not hold: "
            + "; ".join(said)
            + f"{calm} (by more than three standard errors; in brackets the mean error as a share of the RMS error at "
            "the last N, which more draws would not reduce)."
            if said
            else f"No real error grows by more than three standard errors (of methods with {ENOUGH} draws or more)."
        )
    )


def _late(accuracy: pd.DataFrame, paper: pd.DataFrame) -> str:
    table = accuracy[accuracy["sequence"] == "late"]
    errors, printed = of(table, "error62"), of(paper, "error62")
    turn, shift = of(table, "rotation_mrad"), of(table, "translation_mm")
    first, last = errors.index[0], errors.index[-1]
    failed = table.groupby("method")[["failed", "draws"]].sum()
    lost = [f"{name} {row.failed} of {row.draws}" for name, row in failed.iterrows() if row.failed]
    better = [name for name in PAPER if name in errors and (errors[name] < errors[TRUTH]).all()]
    ends = [errors["4dpa"][N] / printed["4dpa"][N] for N in (first, last)]
    trends = [slope(values.index, values) for values in (errors["4dpa"], printed["4dpa"])]
    like = max(max(x, 1 / x) for x in ends) < LIKE[0] and abs(trends[0] - trends[1]) < LIKE[1]
    return (
        "## Robot poses that are late\n\n"
        f"Robot poses 5 steps older than their images: 4DPA's (62) is {errors['4dpa'][first]:.2e} at N = {first} and "
        f"{errors['4dpa'][last]:.2e} at {last} (printed: {printed['4dpa'][first]:.2e} and "
        f"{printed['4dpa'][last]:.2e}), and falls as N^{trends[0]:.2f} (printed: N^{trends[1]:.2f}). The delay is "
        "chosen for the first number, not for the others. Its X is wrong by "
        f"{np.degrees(1e-3 * turn['4dpa'][first]):.1f} degrees and {shift['4dpa'][first]:.0f} mm at N = {first}, by "
        f"{np.degrees(1e-3 * turn['4dpa'][last]):.1f} degrees and {shift['4dpa'][last]:.0f} mm at {last}: (62) fell to "
        f"{errors['4dpa'][last] / errors['4dpa'][first]:.2f} of what it was, the error of X to "
        f"{shift['4dpa'][last] / shift['4dpa'][first]:.2f}. Synchronous poses of this rig have a (62) "
        f"{errors['4dpa'][first] / _synchronous(accuracy, first):.0f} times smaller at N = {first}. "
        + (
            "So the printed errors have the size and the trend that such a delay makes "
            if like
            else "The printed errors do not have both the size and the trend that this delay makes "
        )
        + f"(rule: within a factor of {LIKE[0]} at both ends, within {LIKE[1]} in the exponent). "
        + (
            f"The X of {', '.join(better)} has a smaller (62) than the true X at every N. "
            if better
            else "No method's X has a smaller (62) than the true X at every N. "
        )
        + (f"Without an answer: {'; '.join(lost)}." if lost else "All methods answer.")
    )


def _synchronous(accuracy: pd.DataFrame, N: int) -> float:
    return float(of(accuracy, "error62", sequence="denser")["4dpa"][N])


def _time(times: pd.DataFrame, printed: float) -> str:
    ratio = of(times, "over_4dpa")
    share = 100 / ratio
    fastest = smallest(ratio)
    ends = [ratio.index[0], ratio.index[-1]]
    rows = [[name, *(f"{ratio[name][N]:.3g}" for N in ends)] for name in (*PAPER, PAPER_SCALE, *OTHERS)]
    return (
        "## Time\n\n"
        "One problem at a time, motions given, as multiples of the time of 4DPA (its limit without d):\n\n"
        + markdown(["method", *(f"N = {N}" for N in ends)], rows)
        + f'\n\n4DPA is the fastest of the nine at {fastest} of {len(ratio)} N: "within the least computation time" '
        f"{holds(fastest / len(ratio), printed)}. It takes {span(share[list(CLASSICAL)], 0)} % of the time of the "
        f"classical methods (paper: 9.98 to 70.68) and {span(share[list(RECENT)], 1)} % of the recent ones' (paper: "
        f"1.45 to 28.58). With the paper's d = 1e4 it takes {span(ratio[PAPER_SCALE])} times as long, and is then the "
        f"fastest at {int((ratio[[PAPER_SCALE, *PAPER[:-1]]].idxmin(axis=1) == PAPER_SCALE).sum())} of {len(ratio)} N. "
        "`efficient` is timed from the poses, and gives its covariance and W as well."
    )


def _real(real: pd.DataFrame | None, published: pd.DataFrame | None) -> str:
    text = "## Recordings\n\n"
    if published is not None:
        row = published.iloc[0]
        text += (
            f"The recording as published is {row['verdict']} by `calibrate`, with {row['warnings']} warnings; it is "
            "not used.\n\n"
        )
    if real is None:
        return text + "No other recordings were at hand (UQ_HANDEYE_DATA)."
    found, best, lines, slopes, smallest_of = [], {}, [], [], 0
    for data, rows in real.groupby("data", sort=False):
        errors = of(rows, "error62")
        best[data] = errors.iloc[-1] / errors["gwak"].iloc[-1]
        found.append(str(data))
        smallest_of += smallest(errors)
        if len(errors) > 2:
            slopes.append(f"{data} N^{slope(errors.index, errors['4dpa']):.2f}")
    cases = len(real[["data", "N"]].drop_duplicates())
    largest = real.groupby("data")["N"].max()
    for name in (*PAPER, *OTHERS):
        lines.append(
            [
                name,
                *(f"{best[d][name]:.4f}" if name in best[d] and np.isfinite(best[d][name]) else "none" for d in found),
            ]
        )
    not_solved = real[real["status"] != "converged"]
    text += (
        "(62) of all consecutive motions of each recording, as a multiple of `gwak`'s, the smallest there is "
        "(`efficient` with the noise that it estimates; `none`: refused or not converged):\n\n"
        + markdown(["method", *(f"{d}, N = {largest[d]}" for d in found)], lines)
        + f"\n\n4DPA has the smallest (62) of the paper's nine in {smallest_of} of {cases} cases."
        + (f" Its (62) goes as {', '.join(slopes)}." if slopes else "")
        + f" {len(not_solved)} of {len(real)} estimates were refused or did not converge."
    )
    if "translation_mm" in real and real["translation_mm"].notna().any():
        known = real[real["translation_mm"].notna()]
        last = known[known["N"] == known["N"].max()].set_index("method")["translation_mm"]
        cells = ", ".join(f"{name} {last[name]:.2f}" for name in (*PAPER, *OTHERS) if name in last)
        text += f"\n\nWhere the truth is published ({known['data'].iloc[0]}), translation error of X in mm: {cells}."
    return text
