"""Findings of `scaling_factor` from its table only: law, single precision (III-D), Table V, noise, answer."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd

from studies.common.paper_tables import TABLE_V
from studies.common.study import Tables, markdown
from studies.scaling_factor.curves import (
    CLAIM_SCALES,
    LENGTHS,
    NOISE,
    PRECISIONS,
    QUANTITIES,
    SLOPES,
    SMALLEST_RATIO,
    chosen,
    curve,
    power,
    with_ratios,
)


def agree(found: float, uncertain: float, expected: float) -> bool:
    """Within 0.3, or three standard errors."""
    return bool(abs(found - expected) <= max(0.3, 3 * uncertain))


def findings(tables: Tables) -> str:
    table = with_ratios(tables["accuracy"])
    count, pairs = int(table.rigs.iloc[0]), int(table.pairs.iloc[0])
    parts = [
        f"{count} rigs of {pairs} pairs. Distances are medians over the rigs, lengths the root mean square of the "
        "translations of A and B.",
        *_law(table),
        *_single(table),
        *_table_v(table),
        *_noise(table),
    ]
    return "\n\n".join(parts)


def _law(table: pd.DataFrame) -> list[str]:
    curves = {
        (precision, quantity): curve(table, precision, quantity) for quantity in QUANTITIES for precision in PRECISIONS
    }
    rows, verdicts = [], []
    for (precision, quantity), c in curves.items():
        shown = [
            "none to fit" if math.isnan(slope) else f"{slope:.2f} ± {uncertain:.2f}"
            for slope, uncertain in zip(c.slopes, c.uncertain, strict=True)
        ]
        rows.append((quantity, precision, *shown, power(c.best), power(c.least), power(c.limit)))
        verdicts += [
            agree(slope, uncertain, expected)
            for slope, uncertain, expected in zip(c.slopes, c.uncertain, SLOPES[quantity], strict=True)
            if not math.isnan(slope)
        ]
    header = ("", "precision", "slope, small d", "slope, large d", "best d / length", "there", "limit itself")
    ratio = max(c.ratio for (_, quantity), c in curves.items() if quantity == "translation")
    collapse = "Only d / length matters" if ratio < 1.1 else "Not only d / length matters"
    balance = []
    for precision, dtype in PRECISIONS.items():
        c = curves[precision, "translation"]
        a, b = c.factors
        eps = float(np.finfo(dtype).eps)
        balance.append(
            f"{precision}: a = {a:.2g}, b = {b / eps:.2g} eps, balance at {power(c.balanced)} lengths "
            f"(eps^(-1/3) = {power(eps ** (-1 / 3))}), least found at {power(c.best)}"
        )
    usual = chosen(table, precision="single", noise="none", length_m=1.0, d_m=1e4).iloc[0]
    gains = ", ".join(
        f"{curves[precision, 'translation'].least / curves[precision, 'translation'].limit:,.0f} times ({precision})"
        for precision in PRECISIONS
    )
    span = table[table.noise == "none"].groupby("d_m").translation_from_limit
    far = float((span.max() / span.min()).max())
    return [
        "**Distance from the limit against d, exact data.** Rotation in rad, translation in lengths, covariance as the "
        "largest deviation of a whitened eigenvalue from 1. Limit itself: the error of X, and how far two ways to "
        "write the covariance (T3) are apart.",
        markdown(header, rows),
        "Expected are a truncation that falls as 1/d^2, and a rounding that grows as d in the translation and in the "
        "covariance, as d^2 in the covariance as printed (that of the octonion (48) first, then multiplied by d^2 in "
        f"(59)), and not at all in the rotation. {sum(verdicts)} of {len(verdicts)} fitted slopes are -2, and 1, 2 or "
        "0, within 0.3 or three standard errors.",
        f"{collapse}: from d = {SMALLEST_RATIO:g} lengths on, medians of the translation at equal "
        f"d / length differ by a factor of {ratio:.4g} at most between the lengths; at equal d they differ by up to "
        f"{power(far)}.",
        "The distance is `a (length/d)^2 + b d/length` with b of the order of eps, least at "
        "`d = (2a/b)^(1/3)` lengths. " + "; ".join(balance) + ".",
        f"The least translation distance at any d is {gains} the error of the limit, which needs no d. At the "
        "paper's d = 1e4 m and a length of 1 m, in single precision, a whitened eigenvalue of the covariance is off by "
        f"{power(usual.covariance_from_limit)} of it, as printed by {power(usual.printed_covariance_from_limit)}.",
    ]


def _single(table: pd.DataFrame) -> list[str]:
    """III-D: 1e5 to 1e6 in single precision guarantee 2.44e-4 m within a range of 10 m."""
    rows, kept, of, found = [], 0, 0, []
    single = chosen(table, precision="single", noise="none")
    for length in (1.0, 10.0):
        for d in (*CLAIM_SCALES, None):
            at = chosen(single, length_m=length)
            row = at[at.d_m.isna() if d is None else at.d_m == d].iloc[0]
            distances = (row.translation_from_limit_m, row.translation_error_median_m, row.translation_error_largest_m)
            within = f"{row.within_claim} of {row.rigs}"
            rows.append((f"{length:g} m", "limit" if d is None else power(d), *map(power, distances), within))
            if d is None:
                continue
            kept, of = kept + int(row.within_claim), of + int(row.rigs)
            found.append(f"{power(row.translation_error_largest_m)} (d = {power(d)}, {length:g} m)")
    verdict = "holds" if kept == of else "does not hold"
    return [
        "**Single precision, section III-D:** d of 1e5 to 1e6 guarantees 2^-12 m = 2.44e-4 m. Exact data, rounded to "
        "single precision:",
        markdown(("length", "d, m", "t from the limit, m", "error of t, m", "largest, m", "within 2.44e-4 m"), rows),
        f"The guarantee {verdict}: {kept} of {of} translations keep it. The paper counts 2^(20-32); of the 32 bits "
        f"of a single-precision number 24 are its digits, which gives 2^(20-24) m = {2.0**-4:.2g} m by that count. "
        f"Measured, the largest error in m is {', '.join(found)}.",
    ]


def _table_v(table: pd.DataFrame) -> list[str]:
    wanted = list(TABLE_V)
    falls, rises = 0, []
    double = chosen(table, precision="double", noise="none")
    for length in LENGTHS:
        at = chosen(double, length_m=length).set_index("d_m").translation_from_limit_m.reindex(wanted)
        steps = np.diff(at.to_numpy())
        falls += int((steps < 0).all())
        if not (steps < 0).all():
            rises.append(f"{length:g} m from d = {power(wanted[int(np.argmax(steps >= 0))])} m on")
    last = chosen(double, length_m=1.0).set_index("d_m").translation_from_limit_m
    theirs = np.array(list(TABLE_V.values()))
    above = theirs[:-1] - theirs[-1]
    monotone = "fall" if (np.diff(theirs, axis=0) <= 0).all() else "do not always fall"
    rate = above[0] / above[1]
    ours = last[1e3] / last[1e4]
    tail = f" It rises again for {', '.join(rises)}." if rises else ""
    return [
        f"**Table V:** its errors {monotone} monotonically from d = 1e3 to 1e7 m. In double precision our distance of "
        f"the translation from the limit does so for {falls} of {len(LENGTHS)} lengths.{tail} At 1 m it is "
        f"{power(last[1e3])} m at d = 1e3 m, {power(last[1e5])} m at 1e5 m and {power(last[1e7])} m at 1e7 m; of the "
        f"d tried, the last that moves it by half a millimetre, half the last digit of Table V, is "
        f"{power(float(last[last >= 5e-4].index.max()))} m. From 1e3 to 1e4 m we find a fall by a factor of "
        f"{ours:.0f}; what is above the last line of Table V falls there by {min(rate):.1f} to {max(rate):.0f}.",
    ]


def flat(rows: pd.DataFrame, column: str, reference: float, tolerance: float = 0.01) -> str:
    """The widest run of d at which ``column`` is within 1 % of the reference, e.g. "1e2 to 1e7"."""
    rows = rows[rows.d_m.notna()].sort_values("d_m")
    good = (np.abs(rows[column] / reference - 1) <= tolerance).to_numpy()
    runs: list[list[float]] = []
    for d, ok, before in zip(rows.d_m, good, [False, *good[:-1]], strict=True):
        if ok:
            if not before:
                runs.append([])
            runs[-1].append(float(d))
    if not runs:
        return "nowhere"
    longest = max(runs, key=len)
    return f"{power(longest[0])} to {power(longest[-1])}"


def _noise(table: pd.DataFrame) -> list[str]:
    rows = []
    noisy = table[table.noise != "none"]
    for precision in PRECISIONS:
        for length in LENGTHS:
            part = chosen(noisy, precision=precision, length_m=length)
            limit = part[part.d_m.isna()].iloc[0]
            columns = ("rotation_error_rms_rad", "translation_error_rms_m", "error_62")
            cells = [flat(part, column, float(limit[column])) for column in columns]
            close = part.assign(one=1 + part.covariance_from_limit)
            rows.append((precision, f"{length:g} m", *cells, flat(close, "one", 1.0)))
    header = ("precision", "length", "rotation of X", "translation of X", "error (62)", "covariance")
    double = [row for row in rows if row[0] == "double"]
    usual = sum("nowhere" not in row for row in double)
    limits = noisy[noisy.d_m.isna()]
    worst = float((limits.translation_error_rms_m / limits.length_m).groupby(limits.length_m).agg(np.ptp).max())
    single = chosen(noisy, precision="single", length_m=1.0)
    paper = chosen(single, d_m=CLAIM_SCALES[1]).translation_error_rms_m.iloc[0]
    paper /= single[single.d_m.isna()].translation_error_rms_m.iloc[0]
    return [
        f"**With noise** of {NOISE * 1e3:g} mrad and length / 1000: from which to which d (m, of 1e1 to 1e8) the root "
        "mean square error of X, (62) and the covariance are within 1 % of those of the limit.",
        markdown(header, rows),
        f"In double precision there is such a range of d for all four at {usual} of {len(double)} lengths: within it "
        f"d does not matter. In single precision, d = 1e6 m at a length of 1 m makes the error of the translation "
        f"{paper:.3g} times that of the limit. The limit in single precision differs from that in double by "
        f"{power(worst)} lengths in root mean square error.",
        "**How to choose d: do not; take the limit.** It is what all d approach, it rounds least, and it has no "
        "length to be told."
        if _limit_wins(table)
        else "**How to choose d:** in this run the limit is not the best at every length and precision.",
    ]


def _limit_wins(table: pd.DataFrame) -> bool:
    """Return whether the limit rounds less than the least distance at any d, in each quantity and precision."""
    curves = [curve(table, precision, quantity) for quantity in QUANTITIES for precision in PRECISIONS]
    return all(c.limit < 1.5 * c.least for c in curves)
