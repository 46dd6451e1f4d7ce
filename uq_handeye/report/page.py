"""The report of any result: one self-contained HTML file, or its two pages as PDF.

Page one has the answer, page two the evidence for it; everything else follows in sections that are folded on the
screen and printed where they are unfolded (``details=True``).

Nothing is loaded from anywhere: style and figures are in the file, and a content security policy forbids the rest. All
text is escaped by the template. The same result gives the same file, except for the date.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from .._version import __version__
from ..calibration.load import Result
from ..calibration.tolerance import Verdicts
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from ..errors import require_type
from ..trials.validation.cross_check.result import CrossCheck as CrossCheck
from . import rig_page as rig_page  # registers the content of a rig
from .certificate import make_certificate
from .comparison.compare import Compared, compare_result
from .comparison.result import Comparison
from .content import Wanted, content_of
from .decision import verdicts_by_name

# What a report may be given of the methods: a comparison, True for one to be made, False for none.
Methods = Comparison | Compared | bool
NOT_COMPARED = "Not compared with other methods."


def write_report(
    result: Result,
    path: str | Path,
    *,
    comparison: Methods = True,
    cross_check: CrossCheck | None = None,
    about: Mapping[str, str] | None = None,
    verdict: Verdicts | None = None,
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
    result: Result,
    *,
    comparison: Comparison | Compared | None = None,
    cross_check: CrossCheck | None = None,
    verdict: Verdicts | None = None,
    details: bool = False,
    folded: bool = True,
    date: str | None = None,
) -> str:
    """Return the report as HTML text.

    Parameters
    ----------
    result : Calibration or RigCalibration
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
    found = comparison if isinstance(comparison, Compared) else Compared(comparison, NOT_COMPARED, "")
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    verdicts = verdicts_by_name(result, verdict)
    content = content_of(result, Wanted(found, cross_check, verdicts, folded, date))
    return Page(
        "Hand-eye calibration",
        ", ".join(content.subjects),
        [*content.facts, f"method {result.method}", f"report of {date}"],
        content.sections,
        sheets=content.sheets,
        fields=title_fields(result),
        foot=_foot(result, [section.title for section in content.sections]),
        full=details,
    ).html()


def _foot(result: Result, not_printed: list[str]) -> str:
    """Return the last line of page two: what made the report, of which data, and what is not printed."""
    text = f"uq-handeye {__version__}. Standard deviations are 1 sigma."
    if result.provenance is not None:
        text += f" SHA-256 of the data: {result.provenance.data_sha256[:16]}..."
    if not_printed:
        text += f" Not printed: {'; '.join(not_printed)}."
    return text


def title_fields(result: Result) -> list[tuple[str, str]]:
    """Return the names and texts of the title block; those without text are room to write on paper."""
    shown = [key for key in ABOUT if key not in OF_CERTIFICATE and (key != "note" or key in result.about)]
    return [(ABOUT[key], result.about.get(key, "")) for key in shown]
