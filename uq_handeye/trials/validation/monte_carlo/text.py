"""Text of a Monte Carlo run: whether the covariance is consistent, then the numbers with units."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from ....core.levels import CONTRADICTED, IMPOSSIBLE, INTERVAL, RARE
from ....core.presentation.document import Block, Paragraph, Table
from ....core.presentation.numbers import digits, fixed, probability
from ....core.rounding import TINY
from .consistency import HARMLESS_SD_ERROR, LIKELIHOOD_RATIO, MIN_TRIALS
from .sums import COMPONENTS, LEVELS, PARTS, SIZES, UNITS, in_words

if TYPE_CHECKING:
    from .consistency import Consistency

WHO = "Monte Carlo"


def verdict(c: Consistency, method: str | None = None) -> str:
    """Return whether the covariance is consistent, too small or too large, by how much, and which tests reject it."""
    return " ".join([answer(c, method), *details(c)])


def answer(c: Consistency, method: str | None) -> str:
    """Return the verdict, after what limits it."""
    T = c.sums.count
    if T == 0:
        none = f"none of {c.trials:,} trials gave an estimate" if c.trials else "there was no trial"
        return f"Nothing can be said about the covariance: {none}."
    parts = []
    if c.many_failed:
        parts.append(
            f"Only {T:,} of {c.trials:,} trials gave an estimate: all that follows is of these, and the covariance "
            f"does not describe the other {c.failures:,} ({digits(100 * c.failures / c.trials, 2)} %)."
        )
    if T < MIN_TRIALS:
        few = "the spread in single directions cannot be judged, only the NEES and the shares in ellipsoids."
        if c.size_by_chance is not None:
            few = f"standard deviations that are wrong by less than {digits(100 * c.size_by_chance, 2)} % may not show."
        parts.append(f"Only {T} {'estimate' if T == 1 else 'estimates'}: {few}")
    return " ".join([*parts, (_inconsistent if c.rejected else _consistent)(c, method)])


def details(c: Consistency, verbose: bool = True) -> list[str]:
    """Return which tests reject (if ``verbose``), and how many trials failed."""
    said = [f"Rejected at {percent(c.confidence)} over all tests by {_listed(c.rejected)}."] if c.rejected else []
    return said * verbose + [failures(c)] * bool(c.failures and not c.many_failed and c.sums.count)


def failures(c: Consistency) -> str:
    """Return how many trials gave no estimate."""
    if c.failures == 0:
        return "All trials gave an estimate."
    share = c.failures / c.trials
    return (
        f"{c.failures:,} of {c.trials:,} trials ({digits(100 * share, 2)} %) gave no estimate and are left out: the "
        "covariance does not describe them."
    )


def _subject(c: Consistency, method: str | None) -> str:
    of = "" if method is None else f" of {method}"
    return f"The covariances that the trials{of} report are" if c.own else f"The covariance{of} is"


def few_axes(c: Consistency) -> list[Block]:
    """Return the standard deviations per axis, predicted and sampled."""
    if c.std is None or c.predicted_std is None or c.std_ratio_interval is None:
        return []
    predicted = "mean own" if c.own else "predicted"
    head = ["1 sigma", "", predicted, "sampled", "ratio", f"{percent(c.confidence)} interval"]
    rows = []
    for k, axis in enumerate(COMPONENTS):
        numbers = [fixed(value * UNITS[k]) for value in (c.predicted_std[k], c.std[k])]
        low, high = c.std_ratio_interval[k]
        ratio = f"{c.std[k] / c.predicted_std[k]:.3f}"
        rows.append([axis, "deg" if k < 3 else "mm", *numbers, ratio, f"{low:.3f} to {high:.3f}"])
    return [Table("", head, rows, frozenset({1}))]


def few_numbers(c: Consistency) -> list[Block]:
    """Return the share of the errors in the 95 % ellipsoid, and whether X is biased."""
    if c.coverage is None or c.coverage_interval is None:
        return []
    k = LEVELS.index(INTERVAL.probability)
    share, low, high = (_share(x, c) for x in (c.coverage[0, k], *c.coverage_interval[0, k]))
    text = f"The 95 % ellipsoid holds {share} % of the errors ({percent(c.confidence)} interval: {low} to {high} %)."
    if c.bias_p_value is not None:
        found = "A" if c.bias_p_value < 1 - c.confidence else "No"
        text += f" {found} bias of X was found ({probability(c.bias_p_value)})."
    return [Paragraph(text)]


def _consistent(c: Consistency, method: str | None) -> str:
    """Return that no test rejects."""
    T = c.sums.count
    count = f"{T:,} {'estimates' if c.failures else 'trials'}"
    start = f"{_subject(c, method)} consistent with this noise, as far as {count} can tell"
    if T < MIN_TRIALS:
        start = "No test contradicts the covariance" if not c.own else "No test contradicts the trials' own covariances"
    if c.size is None or c.size_by_chance is None:
        return f"{start}: {_expected(c)}."
    return (
        f"{start}: {_expected(c)}; no standard deviation is off by more than {_change(c.size)} in any direction "
        f"({digits(100 * c.size_by_chance, 2)} % by chance)."
    )


def _inconsistent(c: Consistency, method: str | None) -> str:
    """Some test rejects: what is wrong, by how much."""
    subject = _subject(c, method)
    assert c.mean_nees is not None and c.nees_interval is not None
    says = "than they say" if c.own else "than it says"
    if c.size is None or c.overall is None or c.eigenvalues is None or c.directions is None or c.worst is None:
        (low, high), nees = c.nees_interval[0], c.mean_nees[0]
        word = "too small" if nees > high else "too large" if nees < low else "wrong"
        return f"{subject} {word} for this noise: {_expected(c)}{_holds(c)}."
    assert c.kurtosis is not None and c.kurtosis_error is not None
    assert c.eigenvalue_interval is not None and c.size_error is not None
    where = in_words(c.directions[c.worst])
    error = digits(100 * c.size_error, 1)
    if c.harmless:
        of = f"{c.sums.count:,} {'estimates' if c.failures else 'trials'}"
        return (
            f"{subject} not exactly consistent with this noise: standard deviations differ by {_change(c.overall)} "
            f"over all directions, by {_change(c.size)} (+- {error}) at most. That is significant with {of}, but of no "
            f"practical weight below {percent(HARMLESS_SD_ERROR)}."
        )
    tails = abs(c.kurtosis) > np.sqrt(RARE.chi_square(1)) * c.kurtosis_error
    if c.same_spread and tails:
        heavy = "heavier" if c.kurtosis > 0 else "lighter"
        return (
            f"{subject} right in size (standard deviations are {_change(c.overall)} off over all directions), but "
            f"the errors are not Gaussian, their tails are {heavy}{_holds(c)}."
        )
    if c.same_spread and c.bias_p_value is not None and c.bias_p_value < 1 - c.confidence:
        assert c.bias is not None and c.predicted is not None
        added = float(c.bias @ np.linalg.solve(c.predicted, c.bias))
        return (
            f"{subject} right in size, but the estimate is biased: {_expected(c)}; the mean error adds "
            f"{digits(added, 2)} to it{_holds(c)}."
        )
    low, high = c.eigenvalues[[0, 5]] / c.eigenvalue_interval
    wide = 1 + 1.5 * max(c.kurtosis, 0.0)
    spread = np.log(c.eigenvalues[5]) - np.log(c.eigenvalues[0])
    sd = np.sqrt((1 + 3.5 * max(c.kurtosis, 0.0)) / (12 * (c.sums.count - 1)))
    shifted = abs(c.overall) > np.sqrt(CONTRADICTED.chi_square(1)) * sd
    word = ("too small" if c.overall > 0 else "too large") if shifted and not (low < 1 and high > 1) else "wrong"
    if spread < np.sqrt(wide) * np.log(c.eigenvalue_interval[1] / c.eigenvalue_interval[0]):
        text = f"standard deviations are {_change(c.overall, says)}, in all directions alike"
    elif word == "wrong":
        ends = [float(np.sqrt(c.eigenvalues[k]) - 1) for k in (0, 5)]
        text = (
            f"standard deviations are from {_change(ends[0], '')} to {_change(ends[1], says)}, by direction "
            f"({_change(c.overall, '')} over all); farthest off is {where}"
        )
    else:
        text = (
            f"standard deviations are {_change(c.overall, says)} over all directions, {_change(c.size, '')} "
            f"(+- {error}) in the worst, {where}"
        )
    text = f"{subject} {word} for this noise: {text}{_axes_off(c)}{_holds(c)}"
    if tails and c.kurtosis > 0:
        text += "; the errors have heavier tails than Gaussian ones"
    return f"{text}."


def _axes_off(c: Consistency) -> str:
    """Single axes whose standard deviation is clearly off, unless all are."""
    assert c.std is not None and c.predicted_std is not None and c.kurtosis is not None
    ratio = np.maximum(c.std / c.predicted_std, TINY)
    per_cent = 100 * (ratio - 1)
    error = 0.5 * np.sqrt((2 + 3 * max(c.kurtosis, 0.0)) / c.sums.count)
    off = np.flatnonzero(np.abs(np.log(ratio)) > np.sqrt(RARE.chi_square(1)) * error)
    if len(off) == 6:
        return ""
    if len(off) == 0:
        return "; no single axis shows it"
    said = [f"{COMPONENTS[k]} ({'+' * int(per_cent[k] > 0)}{digits(per_cent[k], 2)} %)" for k in off]
    return f"; single axes off: {_joined(said)}"


def _expected(c: Consistency) -> str:
    """Mean NEES and where it should lie."""
    assert c.mean_nees is not None and c.nees_interval is not None
    mean, low, high = (nees_number(x, c) for x in (c.mean_nees[0], *c.nees_interval[0]))
    return f"mean NEES {mean}, expected {low} to {high}"


def _holds(c: Consistency) -> str:
    """Say what an ellipsoid holds, if coverage is rejected: the highest level that is clearly missed, as people use
    it.
    """
    parts = [k for k, part in enumerate(PARTS) if f"coverage, {part}" in c.rejected]
    if not parts or c.coverage is None or c.coverage_p_values is None or c.coverage_interval is None:
        return ""
    part = parts[0]
    p = c.coverage_p_values[part]
    level = np.flatnonzero(p <= max(p.min(), IMPOSSIBLE.probability))[-1]
    of = "" if part == 0 else f" of the {PARTS[part]}"
    share, low, high = (_share(x, c) for x in (c.coverage[part, level], *c.coverage_interval[part, level]))
    return f"; the {percent(LEVELS[level])} ellipsoid{of} holds {share} % of the errors ({low} to {high})"


def _axes(c: Consistency) -> list[Block]:
    """Standard deviations and bias per axis."""
    if c.std is None or c.bias is None or c.bias_error is None:
        return []
    predicted, ratios = c.predicted_std, c.std_ratio_interval
    name = "mean own" if c.own else "predicted"
    head = ["", "", name, "sampled", "ratio", f"{percent(c.confidence)} interval", "bias", "in sd"]
    units = ["1 sigma", "unit", "sd", "sd", "", "of the ratio", "+- 1 sigma", ""]
    rows = []
    for k, axis in enumerate(COMPONENTS):
        cells = ["-", digits(c.std[k] * UNITS[k]), "-", "-"]
        if predicted is not None and ratios is not None:
            cells[0] = digits(predicted[k] * UNITS[k])
            cells[2] = f"{c.std[k] / predicted[k]:.3f}"
            cells[3] = f"{ratios[k, 0]:.3f} to {ratios[k, 1]:.3f}"
        in_sd = "-" if c.bias_sd is None else f"{round(c.bias_sd[k], 3) + 0.0:+.3f}"
        bias = _with_error(c.bias[k] * UNITS[k], c.bias_error[k] * UNITS[k])
        rows.append([axis, "deg" if k < 3 else "mm", *cells, bias, in_sd])
    text = "The axes are those of the frame of X: errors are (log(R R_true^T), t - t_true)."
    if c.bias_p_value is not None:
        text += f" That there is no bias has {probability(c.bias_p_value)} (Hotelling); it is of second order."
    return [Table("", head, rows, frozenset({1}), units=units), Paragraph(text)]


def _nees(c: Consistency) -> list[Block]:
    """Mean NEES with the interval of a consistent covariance."""
    if c.mean_nees is None or c.nees_interval is None:
        return []
    head = ["NEES", "expected", "mean", f"{percent(c.confidence)} interval", "p"]
    rows = []
    for part, size, mean, (low, high) in zip(PARTS, SIZES, c.mean_nees, c.nees_interval, strict=True):
        p = f"{c.p_values[f'mean NEES, {part}']:.1g}"
        mean, low, high = (nees_number(x, c) for x in (mean, low, high))
        rows.append([part, str(size), mean, f"{low} to {high}", p])
    return [Table("", head, rows)]


def _coverage(c: Consistency) -> list[Block]:
    """Shares in the ellipsoids with binomial intervals."""
    if c.coverage is None or c.coverage_interval is None:
        return []
    rows = []
    for part, shares, limits in zip(PARTS, c.coverage, c.coverage_interval, strict=True):
        rows.append([f"{part} holds %", *(_share(x, c) for x in shares)])
        rows.append(["", *(f"{_share(low, c)}-{_share(high, c)}" for low, high in limits)])
    note = f"Second lines: {percent(c.confidence)} intervals of Clopper and Pearson (exact binomial)."
    return [Table("", ["Ellipsoid", *map(percent, LEVELS)], rows), Paragraph(note)]


def _directions(c: Consistency) -> list[Block]:
    """Generalised eigenvalues, as ratios of standard deviations."""
    if c.eigenvalues is None or c.directions is None or c.eigenvalue_interval is None:
        return []
    ratios = ", ".join(f"{x:.3f}" for x in np.sqrt(c.eigenvalues))
    low, high = np.sqrt(c.eigenvalue_interval)
    text = (
        f"Sampled over predicted standard deviation in six directions (roots of the eigenvalues of P^-1 S): {ratios}. "
        f"A consistent covariance shows {low:.3f} to {high:.3f}. Smallest in {in_words(c.directions[0])}; largest in "
        f"{in_words(c.directions[5])}."
    )
    return [Paragraph(text)]


def _tests(c: Consistency) -> list[Block]:
    """Likelihood ratio and tails, which no table shows."""
    if c.likelihood_ratio is None or c.kurtosis is None or c.kurtosis_error is None:
        return []
    p = probability(c.p_values[LIKELIHOOD_RATIO])
    text = (
        f"Likelihood ratio of sampled against predicted covariance: {c.likelihood_ratio:.1f}, chi-square with 21 "
        f"degrees of freedom, {p}. Fourth moment of d over that of Gaussian errors: {1 + c.kurtosis:.3f} +- "
        f"{digits(c.kurtosis_error, 1)}."
    )
    return [Paragraph(text)]


# Everything that is known, as tables.
SECTIONS = (_axes, _nees, _coverage, _directions, _tests)


def _change(x: float, than: str | None = None) -> str:
    """``10 %``; with ``than`` ``10 % larger`` or ``smaller`` and that text."""
    text = f"{digits(100 * abs(x), 2)} %"
    return text if than is None else f"{text} {'larger' if x > 0 else 'smaller'} {than}".rstrip()


def percent(level: float) -> str:
    return f"{100 * level:g} %"


def _share(x: float, c: Consistency) -> str:
    """A share in per cent; two decimals where it is near 0 or 100 or trials are many."""
    if x in (0.0, 1.0):
        return f"{100 * x:.0f}"
    return f"{100 * x:.1f}" if 0.001 < x < 0.999 and c.sums.count < 50_000 else f"{100 * x:.2f}"


def nees_number(x: float, c: Consistency) -> str:
    """Return a mean NEES with the decimals that the number of trials gives it."""
    return f"{x:.{2 if c.sums.count < 50_000 else 3 if c.sums.count < 5_000_000 else 4}f}"


def _with_error(value: float, error: float) -> str:
    """``-0.0009 +- 0.0011``: two digits of the error."""
    if error < 1e-6:
        return f"{digits(value, 2)} +- {digits(error, 2)}"
    decimals = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{round(value, decimals) + 0.0:.{decimals}f} +- {error:.{decimals}f}"


def _listed(names: Iterable[str]) -> str:
    """``mean NEES (joint, rotation) and coverage (joint)``."""
    groups: dict[str, list[str]] = {}
    for name in names:
        test, _, part = name.partition(", ")
        groups.setdefault(test, []).extend([part] if part else [])
    texts = [f"{test} ({', '.join(parts)})" if parts else test for test, parts in groups.items()]
    return _joined(texts)


def _joined(texts: list[str]) -> str:
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"
