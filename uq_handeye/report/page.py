"""The report of a calibration: one self-contained HTML file, or its two pages as PDF.

Page one has the answer, page two the evidence for it; everything else follows in sections that are folded on the
screen and printed where they are unfolded (``details=True``).

Nothing is loaded from anywhere: style and figures are in the file, and a content security policy forbids the rest. All
text is escaped by the template. The same result gives the same file, except for the date.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .._version import __version__
from ..calibration.report.first_screen import data_words
from ..calibration.result import Calibration
from ..calibration.tolerance import Verdict
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.presentation.document import Section
from ..core.presentation.page import PAPERS, Page, drawing, page_path, write_page
from ..errors import InputError, require_type
from ..trials.validation.cross_check.result import CrossCheck as CrossCheck
from .certificate import make_certificate
from .comparison.compare import Compared, compare_result
from .comparison.result import Comparison
from .figures import pictures, require_same_problem, small_pictures
from .sections import folded_sections
from .sheets import caution_points, first_sheet, second_sheet, split_cautions

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..calibration.tolerance import Verdict

# What a report may be given of the methods: a comparison, True for one to be made, False for none.
Methods = Comparison | Compared | bool
NOT_COMPARED = "Not compared with other methods."


def write_report(
    result: Calibration,
    path: str | Path,
    *,
    comparison: Methods = True,
    cross_check: CrossCheck | None = None,
    about: Mapping[str, str] | None = None,
    verdict: Verdict | None = None,
    details: bool = False,
    paper: str = PAPERS[0],
    certificate: bool = False,
) -> Path:
    """Write the report of ``result``; the arguments are those of `Calibration.report`.

    Only ``comparison=True`` computes anything: the methods, before the page is written.

    Returns
    -------
    Path
        Of the file, which is written whole or not at all.

    Raises
    ------
    InputError
        A path that ends neither in .html nor in .pdf or cannot be written; a comparison or cross-check of another
        problem.
    MissingExtraError
        A PDF where neither WeasyPrint nor a Chromium browser is installed.
    """
    if certificate:
        return make_certificate(result, verdict=verdict, about=about).write(path, paper=paper)
    path = page_path(path, paper)  # before the methods are compared
    require_type("comparison", comparison, (bool, Comparison, Compared), "True, False or a Comparison")
    result = replace(result, about=as_about({**result.about, **(about or {})}))
    folded = path.suffix.lower() == ".html" or details
    if comparison is True:
        comparison = folded and compare_result(result)
    text = report_html(
        result,
        comparison=comparison or None,
        cross_check=cross_check,
        verdict=verdict,
        details=details,
        folded=folded,
    )
    return write_page(path, text, paper)


def report_html(
    result: Calibration,
    *,
    comparison: Comparison | Compared | None = None,
    cross_check: CrossCheck | None = None,
    verdict: Verdict | None = None,
    details: bool = False,
    folded: bool = True,
    date: str | None = None,
) -> str:
    """Return the report as HTML text.

    Parameters
    ----------
    result : Calibration
    comparison, cross_check, verdict
        As for `write_report`; a comparison is not made.
    details : bool
        Open the folded sections.
    folded : bool
        False: the two pages only.
    date : str or None
        Written into the report; None is now (UTC).

    Raises
    ------
    InputError
        A comparison or cross-check of another problem.
    """
    if cross_check is not None:
        require_same_problem(result, cross_check)
    found = comparison if isinstance(comparison, Compared) else Compared(comparison, NOT_COMPARED, "")
    if found.comparison is not None and found.comparison.frame != result.frame:
        raise InputError(
            f"Expected `comparison` to be of {result.frame}, as the result, got one of {found.comparison.frame}."
        )
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    drawn = pictures(result, cross_check, found.comparison, None if folded else ("rig",))
    drawings = {stem: drawing(stem, picture) for stem, picture in drawn.items()}
    drawings |= {stem: drawing(stem, picture, small=True) for stem, picture in small_pictures(result).items()}
    shown, further = split_cautions(result.cautions)
    sheets = [first_sheet(result, verdict, drawings), second_sheet(result, drawings, shown)]
    sections: list[Section] = []
    if further:
        sections.append(Section("further", "Further cautions", [caution_points(further)], folded=True))
    if folded:
        sections += folded_sections(result, drawings, found, cross_check, date)
    facts = [
        result.setup or "motions without poses",
        data_words(result),
        f"method {result.method}",
        f"report of {date}",
    ]
    return Page(
        "Hand-eye calibration",
        result.frame,
        facts,
        sections,
        sheets=sheets,
        fields=title_fields(result),
        foot=_foot(result, sections),
        full=details,
    ).html()


def _foot(result: Calibration, sections: Sequence[Section]) -> str:
    """Return the last line of page two: what made the report, of which data, and what is not printed."""
    text = f"uq-handeye {__version__}. Standard deviations are 1 sigma."
    if result.provenance is not None:
        text += f" SHA-256 of the data: {result.provenance.data_sha256[:16]}..."
    if sections:
        text += f" Not printed: {'; '.join(section.title for section in sections)}."
    return text


def title_fields(result: Calibration) -> list[tuple[str, str]]:
    """Return the names and texts of the title block; those without text are room to write on paper."""
    shown = [key for key in ABOUT if key not in OF_CERTIFICATE and (key != "note" or key in result.about)]
    return [(ABOUT[key], result.about.get(key, "")) for key in shown]
