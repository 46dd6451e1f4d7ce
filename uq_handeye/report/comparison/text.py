"""The text of a comparison of methods: verdict, two tables, and an explanation of their columns."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from textwrap import shorten

import numpy as np

from ...core.geometry.pose_numbers import pose_numbers
from ...core.presentation.document import (
    COLUMNS,
    Answer,
    Block,
    Caution,
    Cell,
    Checks,
    Document,
    Paragraph,
    Table,
    document_of,
    to_text,
)
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M, MS_PER_S
from .result import Comparison, Row, apart, digits, to_rely_on, verdict

# Of each column its name and unit, and what a row shows there; the verdict needs the reference.
_Show = Callable[["Row"], str]
_COLUMNS: tuple[tuple[str, str, _Show], ...] = (
    ("rotation", "deg", lambda row: apart(row.difference_rotation, DEG_PER_RAD)),
    ("transl.", "mm", lambda row: apart(row.difference_translation, MM_PER_M)),
    ("d^2", "", lambda row: apart(row.d2)),
    ("", "", lambda row: ""),
    ("rot.", "deg", lambda row: digits(row.weakest and row.weakest[0], DEG_PER_RAD)),
    ("transl.", "mm", lambda row: digits(row.weakest and row.weakest[1], MM_PER_M)),
    ("rot.", "deg", lambda row: digits(row.residuals and row.residuals.rotation_rms, DEG_PER_RAD)),
    ("transl.", "mm", lambda row: digits(row.residuals and row.residuals.translation_rms, MM_PER_M)),
    ("error (62)", "1e-3", lambda row: digits(row.residuals and row.residuals.error, 1e3)),
    ("time", "ms", lambda row: digits(row.seconds, MS_PER_S)),
    ("iter.", "", lambda row: str(row.iterations or "-")),
)
# The column of the verdict is the one without a heading.
_VERDICT = [name for name, _, _ in _COLUMNS].index("")
_SHORT = range(8)  # the columns of the first screen
_SHORTER = range(6)  # where these are too wide for it
_SHORT_LEGEND = (
    "agrees: the reference lies inside the method's 95 % ellipsoid. All methods see the same data: agreement does "
    "not show that X is right."
)

_LEGEND = (
    ("difference", "angle between the rotations and distance between the translations of the method and the reference"),
    ("d^2", "squared Mahalanobis distance of that difference in the method's own covariance (6 degrees of freedom)"),
    (
        "agrees",
        "d^2 <= 12.6: the reference lies inside the 95 % ellipsoid of the method. All methods see the same noise: "
        "agreement is expected and is not a test, and methods that agree may be wrong together, for example where the "
        "robot or the camera has a systematic error",
    ),
    ("DIFFERS", "outside of it: one of the two is biased, weights the data worse, or the noise is not as given"),
    ("UNDETERMINED", "the noise leaves X open to this method: standard deviations of first order mean nothing there"),
    ("1 sigma", "largest standard deviation over all directions, of the noise, to first order"),
    (
        "residuals",
        "how well X explains the pairs, AX against XB, less the shared errors that calibrate estimates; not how "
        "accurate X is",
    ),
    ("error (62)", "sqrt(sum |A X - X B|^2) / N, Frobenius norm, translations in m"),
    ("time", "of the estimate alone, without reading, pairs and covariance"),
)


def notes(comparison: Comparison, of_pairs: bool = True) -> list[str]:
    """Return notes on deviations from the request; ``of_pairs``: also that not all pairs were used."""
    found = []
    reference, asked = comparison.reference, comparison.requested_reference
    if reference is not None and reference != asked:
        rely = to_rely_on(comparison[asked])
        found.append(f"{asked} gave no result{rely}: the reference is {reference}, the first that did.")
    if of_pairs and comparison.n_pairs < comparison.n_pairs_available:
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


@document_of.register(Comparison)
def comparison_document(comparison: Comparison, verbose: bool = False) -> Document:
    """Return verdict, warnings and differences per method; ``verbose``: all numbers, X, legend, all warnings."""
    count = len(comparison.rows)
    found = [row for row in comparison.rows if row.X is not None]
    doubts = comparison.doubts
    apart = any(row.agrees is False or row.failure for row in comparison.rows) or bool(doubts or comparison.warnings)
    status = "failed" if comparison.reference is None else "caution" if apart else "ok"
    what = f"{comparison.frame} by {count} method{'s'[: count != 1]} from {comparison.origin}"
    start: list[Block] = [Answer(comparison.verdict, status), *map(Paragraph, notes(comparison))]
    if not verbose:
        said = notes(comparison)
        answer = verdict(comparison.rows, comparison.reference, comparison.noise is not None, 4)
        start = [Answer(answer, status), *map(Paragraph, said), *_short_warnings(comparison, 3 - len(said))]
        end = f"{comparison.frame} from {comparison.origin}."
        table = _table_of(comparison, _SHORT)
        if max(map(len, to_text([table], COLUMNS).splitlines()), default=0) > COLUMNS:
            table = _table_of(comparison, _SHORTER)
        return [start, table, [Paragraph(_SHORT_LEGEND), Paragraph(end)]]
    texts = [*(f"Warning: {text}" for text in comparison.warnings)]
    texts += [f"Warning (!), {text}" for text in comparison.own_warnings]
    cautions = [Caution(f"{len(comparison.warnings)} warning(s) say that something looks wrong.")]
    words = {word(row, comparison.reference) for row in comparison.rows}
    terms = [(term, meaning) for term, meaning in _LEGEND if term != "UNDETERMINED" or term in words]
    legend = Table("", ["", ""], [[term, (f"{meaning}.", 1)] for term, meaning in terms])
    shown: list[Block | list[Block]] = [_poses(comparison, found), legend] if found else []
    return [
        [*start, Paragraph(f"{what}.")],
        *(cautions if comparison.warnings else []),
        _table_of(comparison, range(len(_COLUMNS)), verbose=True),
        *shown,
        *(Paragraph(text, hang="  ") for text in texts),
    ]


def _short_warnings(comparison: Comparison, most: int) -> list[Block]:
    """Return the checks of calibrate that warn, or else the warnings themselves, each cut to a line or two."""
    blocks: list[Block] = []
    if comparison.doubts:
        blocks.append(Paragraph("On these data calibrate warns:"))
        shown = comparison.doubts[: max(most, 1)]
        blocks.append(Checks.of(shown))
        if more := len(comparison.doubts) - len(shown):
            blocks.append(Paragraph(f"and {more} more (-v)"))
    elif comparison.warnings:
        first = shorten(comparison.warnings[0], 150, placeholder=" ...")
        more = len(comparison.warnings) - 1
        blocks.append(Caution(f"{first}{f' And {more} more.' if more else ''}"))
    own = [row.method for row in comparison.rows if row.warnings]
    if own:
        blocks.append(Paragraph(f"! {len(own)} method{'s' * (len(own) > 1)} with warnings of their own (-v)."))
    return blocks


def methods_table(comparison: Comparison) -> Table:
    """Return the table of a page: differences, verdict and standard deviations of each method, with its year."""
    years = {row.method: f"{row.method} {row.year}" for row in comparison.rows if row.year}
    caption = (
        f"Differences of each method from {comparison.reference or 'a reference'}, its own standard deviations (1 "
        "sigma, worst direction), and whether its 95 % ellipsoid holds the reference (d^2 up to 12.6)"
    )
    found = _table_of(comparison, _SHORTER, verbose=True)
    rows = [[years.get(str(name).removesuffix(" !"), name), *cells] for name, *cells in found.rows]
    return replace(found, caption=caption, rows=rows)


def _table_of(comparison: Comparison, columns: range, verbose: bool = False) -> Table:
    """The numbers of each method, and why there are none; ``verbose``: in full, as there is room."""
    rows: list[list[Cell]] = []
    causes: dict[str, str] = {}
    marks = [" !" if row.warnings else "" if verbose else _MARKS.get(row.status, "") for row in comparison.rows]
    names = [row.method + mark for row, mark in zip(comparison.rows, marks, strict=True)]
    for row, name in zip(comparison.rows, names, strict=True):
        if row.X is None:
            like = causes.setdefault(row.failure or "", row.method)
            reason = f"{row.status}: {row.failure if like == row.method else f'like {like}'}"
            text = reason if verbose else shorten(reason, 60, placeholder=" ...")
            rows.append([row.method if verbose else name.ljust(max(map(len, names))), (text, len(columns))])
            continue
        cells: list[Cell] = [_COLUMNS[k][2](row) for k in columns]
        cells[_VERDICT] = word(row, comparison.reference)
        rows.append([name if verbose else name.ljust(max(map(len, names))), *cells])
        if verbose and row.failure is not None:
            rows.append(["", (row.failure, len(columns))])
    if all(row.X is None for row in comparison.rows):
        return Table("", ["", ""], rows if verbose else [[row[0], (row[1][0], 1)] for row in rows])
    groups = [("", 1), (f"difference from {comparison.reference or 'none'}", 3), ("", 1)]
    groups.append((f"1 sigma, {'weakest' if verbose else 'worst'}", 2))
    if columns != _SHORTER:
        groups.append(("residuals, RMS" if verbose else "residuals", 2))
    head, units = [_COLUMNS[k][0] for k in columns], [_COLUMNS[k][1] for k in columns]
    return Table("", ["method", *head], rows, frozenset({_VERDICT + 1}), units=["", *units], groups=groups)


def word(row: Row, reference: str | None) -> str:
    """Return the word for a row: reference, agrees, DIFFERS, UNDETERMINED, UNCONVERGED, or nothing where it is not
    known.
    """
    if row.failure is not None:
        return row.status.upper()
    if row.method == reference:
        return "reference"
    return "" if row.agrees is None else "agrees" if row.agrees else "DIFFERS"


def _poses(comparison: Comparison, rows: Sequence[Row]) -> list[Block]:
    """X of each method that has one, with standard deviations where they are known."""
    known = any(row.covariance is not None for row in rows)
    sigma = " +- 1 sigma" if known else ""
    lines, longest = [], 0.0
    for row in rows:
        assert row.X is not None  # chosen so
        values, std = pose_numbers(row.X, row.covariance, None if comparison.base is None else comparison.base.X)
        longest = max(longest, float(np.linalg.norm(values[3:])))
        cells = [row.method + _MARKS.get(row.status, "")]
        for k in (3, 4, 5, 0, 1, 2):
            cells.append(_value(values[k], 4 if k > 2 else 3))
            if known:
                cells.append("" if std is None else f"+-{_brief(float(std[k]))}")
        lines.append(cells)
    count = 2 if known else 1
    titles = [(f"{part} of X ({unit}){sigma}", 3 * count) for part, unit in _PARTS]
    head = ["method", *(name for axis in "xyzxyz" for name in (axis, "")[:count])]
    table = Table("", head, lines, frozenset(range(2, 14, 2)) if known else frozenset(), groups=[("", 1), *titles])
    statuses = {row.status for row in rows}
    below = [text for status, text in _MARKED.items() if status in statuses]
    if longest > 180 * (1 + 1e-12):
        below.append(
            "Rotation vectors longer than 180 degrees: of the two that describe a rotation, the one nearer to that of "
            "the reference is shown."
        )
    return [table, *(Paragraph(text) for text in below)]


_PARTS = (("rotation vector", "deg"), ("translation", "mm"))
_MARKED = {
    "unconverged": "* not converged: what the iteration reached",
    "undetermined": "? undetermined: what the method makes of the data all the same",
}
# Behind the name of a method whose X is not to be relied on.
_MARKS = {"unconverged": " *", "undetermined": " ?"}


def _value(x: float, decimals: int) -> str:
    """A value of eight characters at most; large ones have fewer decimals."""
    places = 6 - len(f"{abs(x):.0f}")
    return f"{x + 0.0:.{min(decimals, places)}f}" if places >= 0 else f"{x:.1e}"


def _brief(deviation: float) -> str:
    """Three significant digits, or two where these do not fit into six characters."""
    text = apart(deviation)
    return text if len(text) <= 6 else re.sub(r"e([-+])0*", r"e\1", f"{deviation:.1e}").replace("e+", "e")
