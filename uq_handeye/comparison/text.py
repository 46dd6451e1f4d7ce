"""A comparison of methods as plain text: verdict, two tables, and what the columns mean."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.pose_numbers import pose_numbers
from ..geometry.se3 import Array
from .row import without_numbers

if TYPE_CHECKING:
    from .result import Comparison
    from .row import Row

WIDTH = 118
_NAME = 12
_MM, _DEG, _MS = 1e3, 180 / np.pi, 1e3

# Heading of a group of columns; of each its name and unit, width, and what a row shows there.
_Show = Callable[["Row"], str]
_GROUPS: tuple[tuple[str, tuple[tuple[str, str, int, _Show], ...]], ...] = (
    (
        "difference from {reference}",
        (
            ("rotation", "deg", 10, lambda row: apart(row.difference_rotation, _DEG)),
            ("transl.", "mm", 9, lambda row: apart(row.difference_translation, _MM)),
            ("d^2", "", 9, lambda row: apart(row.d2)),
        ),
    ),
    ("", (("", "", 14, lambda row: ""),)),  # the verdict, which needs the reference
    (
        "1 sigma, weakest",
        (
            ("rot.", "deg", 9, lambda row: digits(row.weakest and row.weakest[0], _DEG)),
            ("transl.", "mm", 9, lambda row: digits(row.weakest and row.weakest[1], _MM)),
        ),
    ),
    (
        "residuals, RMS",
        (
            ("rot.", "deg", 9, lambda row: digits(row.residuals and row.residuals.rotation_rms, _DEG)),
            ("transl.", "mm", 9, lambda row: digits(row.residuals and row.residuals.translation_rms, _MM)),
        ),
    ),
    ("", (("error (62)", "1e-3", 12, lambda row: digits(row.residuals and row.residuals.error, 1e3)),)),
    ("", (("time", "ms", 8, lambda row: digits(row.seconds, _MS)),)),
    ("", (("iter.", "", 7, lambda row: str(row.iterations or "-")),)),
)
_COLUMNS = tuple(column for _, columns in _GROUPS for column in columns)
_VERDICT = 3  # its place among the columns

_LEGEND = (
    ("difference", "angle between the rotations and distance between the translations of the method and the reference"),
    ("d^2", "squared Mahalanobis distance of that difference in the method's own covariance (6 degrees of freedom)"),
    (
        "agrees",
        "d^2 <= 12.6: the reference lies inside the 95 % ellipsoid of the method. All methods see the same noise: "
        "agreement is expected and no test, and methods that agree may be wrong together, for example where the robot "
        "or the camera has a systematic error",
    ),
    ("DIFFERS", "outside of it: one of the two is biased, weights the data worse, or the noise is not as given"),
    ("UNDETERMINED", "the noise leaves X open to this method: standard deviations of first order mean nothing there"),
    ("1 sigma", "largest standard deviation over all directions, of the noise, to first order"),
    ("residuals", "how well X explains the pairs, AX against XB; not how accurate X is"),
    ("error (62)", "sqrt(sum |A X - X B|^2) / N, Frobenius norm, translations in m"),
    ("time", "of the estimate alone, without reading, pairs and covariance"),
)


def verdict(comparison: Comparison) -> str:
    """Who agrees with the reference, who differs, who failed."""
    rows, reference = comparison.rows, comparison.reference
    if reference is None:
        if len(rows) == 1:
            return f"{rows[0].method} gave no result{_to_rely_on(rows[0])}."
        rely = next((_to_rely_on(row) for row in rows if row.X is not None), "")
        return f"None of the {len(rows)} methods gave a result{rely}."
    others = [row for row in rows if row.method != reference and row.failure is None]
    judged = [row for row in others if row.agrees is not None]
    differ = [row.method for row in judged if not row.agrees]
    if len(judged) == 1:
        parts = [f"{judged[0].method} {'differs from' if differ else 'agrees with'} {reference} at 95 %"]
        differ = []
    elif judged:
        agree = len(judged) - len(differ)
        parts = [f"{agree} of {len(judged)} methods {'agrees' if agree == 1 else 'agree'} with {reference} at 95 %"]
    elif others:
        rotation = max(row.difference_rotation or 0.0 for row in others)
        translation = max(row.difference_translation or 0.0 for row in others)
        parts = [f"Up to {apart(rotation, _DEG)} deg and {apart(translation, _MM)} mm from {reference}"]
        if comparison.noise is None:
            parts[0] += "; whether that is much cannot be said without noise"
    elif len(rows) == 1:
        parts = [f"{reference} alone, with nothing to compare"]
    else:
        parts = [f"Only {reference} gave a result"]
    silent = [row.method for row in others if row.agrees is None and comparison.noise is not None]
    by_status = {status: [row.method for row in rows if row.status == status] for status in _STATUS}
    for names, words in (
        (differ, "differs" if len(differ) == 1 else "differ"),
        (silent, "without covariance"),
        *((by_status[status], words) for status, words in _STATUS.items()),
    ):
        if names:
            parts.append(f"{len(names)} {words}: {', '.join(names)}")
    return "; ".join(parts) + "."


# What the verdict calls the rows without a result to rely on.
_STATUS = {"undetermined": "undetermined", "unconverged": "did not converge", "failed": "failed"}


def _to_rely_on(row: Row) -> str:
    return "" if row.X is None else " to rely on"


def notes(comparison: Comparison) -> list[str]:
    """What is not as asked for, or not as one would expect."""
    found = []
    reference, asked = comparison.reference, comparison.asked_reference
    if reference is not None and reference != asked:
        rely = _to_rely_on(comparison[asked])
        found.append(f"{asked} gave no result{rely}: the reference is {reference}, the first that did.")
    if comparison.n_pairs < comparison.n_pairs_available:
        found.append(
            f"Of {comparison.n_pairs_available:,} pairs all methods used the same {comparison.n_pairs:,}, "
            "spread evenly."
        )
    judged = [row.agrees for row in comparison.rows if row.agrees is not None and row.method != reference]
    central = comparison.most_central
    if len(judged) > 2 and sum(judged) < 0.5 * len(judged) and central is not None:
        name, agree = central  # the reference, rather than the others, may be the odd one out
        if name != reference and agree > 0.5 * len(judged):
            found.append(
                f"Most methods differ from {reference}, but {agree} of {len(judged)} others agree with {name}: look at "
                f"--reference {name} as well."
            )
    return found


def table(comparison: Comparison, warnings: bool = True) -> str:
    """Verdict, differences, residuals and times; X with standard deviations; what the columns mean; warnings."""
    count = len(comparison.rows)
    title = f"{comparison.frame} by {count} method{'s'[: count != 1]} from {comparison.origin}"
    lines = [title, ""]
    if comparison.warnings:
        lines += [f"CAUTION: {len(comparison.warnings)} warning(s) say that something looks wrong.", ""]
    for text in (verdict(comparison), *notes(comparison)):
        lines += textwrap.wrap(text, WIDTH, break_on_hyphens=False)
    lines += ["", *_head(comparison)]
    causes: dict[str, str] = {}
    for row in comparison.rows:
        like = causes.setdefault(without_numbers(row.failure), row.method) if row.failure and row.X is None else None
        alike = like not in (None, row.method)
        lines += [f"{row.method:{_NAME}s}failed: like {like}"] if alike else _line(row, comparison.reference)
    lines += ["", *_poses(comparison)]
    if any(row.X is not None for row in comparison.rows):
        shown = {word(row, comparison.reference) for row in comparison.rows}
        for term, meaning in _LEGEND:
            if term == "UNDETERMINED" and term not in shown:
                continue
            lines += textwrap.wrap(
                f"{term:{_NAME}s} {meaning}.", WIDTH, subsequent_indent=" " * (_NAME + 1), break_on_hyphens=False
            )
    if warnings:
        for text in comparison.warnings:
            lines += ["", *_wrapped(f"Warning: {text}")]
        for text in comparison.own_warnings:
            lines += ["", *_wrapped(f"Warning (!), {text}")]
    return "\n".join(lines).rstrip() + "\n"


def word(row: Row, reference: str | None) -> str:
    """What to call a row: reference, agrees, DIFFERS, UNDETERMINED, UNCONVERGED, or nothing where it is not known."""
    if row.failure is not None:
        return row.status.upper()
    if row.method == reference:
        return "reference"
    return "" if row.agrees is None else "agrees" if row.agrees else "DIFFERS"


def apart(value: float | None, factor: float = 1.0) -> str:
    """A difference: as `digits`, and what is rounding as such."""
    return "<1e-9" if value is not None and 0 < value * factor < 1e-9 else digits(value, factor)


def digits(value: float | None, factor: float = 1.0) -> str:
    """Three significant digits, all digits of larger numbers; ``-`` for what is not there."""
    if value is None:
        return "-"
    value *= factor
    if not math.isfinite(value):
        return "inf"
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.1e}"
    exponent = math.floor(math.log10(abs(float(f"{value:.2e}"))))
    return f"{value:.{min(max(0, 2 - exponent), 5)}f}"


def _wrapped(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def _line(row: Row, reference: str | None) -> list[str]:
    """The row of one method: its numbers, and why there are none."""
    said = word(row, reference)
    reason: list[str] = []
    if row.failure is not None:
        indent = " " * (_NAME + 2)
        start = f"{row.method:{_NAME}s}" if row.X is None else indent
        reason = textwrap.wrap(
            f"{'failed: ' if row.X is None else ''}{row.failure}",
            WIDTH,
            initial_indent=start,
            subsequent_indent=indent,
            break_on_hyphens=False,
        )
        if row.X is None:
            return reason
    cells = [f"{show(row):>{width}s}" for _, _, width, show in _COLUMNS]
    cells[_VERDICT] = f"  {said:<{_COLUMNS[_VERDICT][2] - 2}s}"
    name = row.method + (" !" if row.warnings else "")
    return [f"{name:{_NAME}s}{''.join(cells)}", *reason]


def _head(comparison: Comparison) -> list[str]:
    """Three lines over the columns: groups, names, units."""
    if all(row.X is None for row in comparison.rows):
        return []
    reference = comparison.reference or "none"
    titles = [(title.format(reference=reference), columns) for title, columns in _GROUPS]
    groups = "".join(f"{title:>{sum(column[2] for column in columns)}s}" for title, columns in titles)
    names, units = ("".join(f"{column[k]:>{column[2]}s}" for column in _COLUMNS) for k in (0, 1))
    return [f"{'':{_NAME}s}{groups}".rstrip(), f"{'method':{_NAME}s}{names}", f"{'':{_NAME}s}{units}".rstrip()]


def _poses(comparison: Comparison) -> list[str]:
    """X of each method that has one, with standard deviations where they are known."""
    rows = [row for row in comparison.rows if row.X is not None]
    if not rows:
        return []
    known = any(row.covariance is not None for row in rows)
    value, width = (9, 18) if known else (12, 12)
    heads = "".join(f"{axis:>{value}s}{'':{width - value}s}" for axis in "xyz")
    sigma = " +- 1 sigma" if known else ""
    titles = [f"{part} of X ({unit}){sigma}" for part, unit in (("rotation vector", "deg"), ("translation", "mm"))]
    lines = [
        f"{'':{_NAME}s}" + "".join(f"{title:^{3 * width}s}" for title in titles),
        f"{'method':{_NAME}s}{heads}{heads}",
    ]
    base = comparison.base
    longest = 0.0
    for row in rows:
        assert row.X is not None  # chosen so
        values, std = pose_numbers(row.X, row.covariance, None if base is None else base.X)
        longest = max(longest, float(np.linalg.norm(values[3:])))
        cells = [
            *_cells(values[3:], None if std is None else std[3:], 4, value, width),
            *_cells(values[:3], None if std is None else std[:3], 3, value, width),
        ]
        lines.append(f"{row.method + _MARKS.get(row.status, ''):{_NAME}s}{''.join(cells)}")
    statuses = {row.status for row in rows}
    if "unconverged" in statuses:
        lines.append("* not converged: what the iteration reached")
    if "undetermined" in statuses:
        lines.append("? undetermined: what the method makes of the data all the same")
    if longest > 180 * (1 + 1e-12):
        lines += _wrapped(
            "Rotation vectors longer than 180 degrees: of the two that describe a rotation, the one nearer to that of "
            "the reference is shown."
        )
    return [*(line.rstrip() for line in lines), ""]


# Behind the name of a method whose X is not to be relied on.
_MARKS = {"unconverged": " *", "undetermined": " ?"}


def _cells(values: Array, std: Array | None, decimals: int, value: int, width: int) -> list[str]:
    """Values, each with its standard deviation; large ones with fewer decimals."""
    cells = []
    for k, x in enumerate(values):
        places = 6 - len(f"{abs(x):.0f}")  # eight characters at most
        number = f"{x + 0.0:.{min(decimals, places)}f}" if places >= 0 else f"{x:.1e}"
        plus = "" if std is None else f" +-{_brief(float(std[k]))}"
        cells.append(f"{number:>{value}s}{plus:{width - value}s}")
    return cells


def _brief(deviation: float) -> str:
    """Three significant digits, or two where these do not fit into six characters."""
    text = apart(deviation)
    return text if len(text) <= 6 else re.sub(r"e([-+])0*", r"e\1", f"{deviation:.1e}").replace("e+", "e")
