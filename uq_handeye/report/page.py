"""The report of a calibration: one self-contained HTML file, or its two pages as PDF.

Page one has the answer, page two what it rests on; everything else follows in sections that are folded on the
screen and printed where they are open (``details=True``).

Nothing is loaded from anywhere: style and figures are in the file, and a content security policy forbids the rest. All
text is escaped by the template. The same result gives the same file, except for the date.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from .._version import __version__
from ..calibration.report.first_screen import data_words
from ..calibration.result import Calibration
from ..calibration.statement.tolerance import Verdict
from ..core.files.about import as_about
from ..core.geometry.conventions import CONVENTION
from ..core.presentation.document import Block, Drawing, Paragraph, Points, Section
from ..core.presentation.page import Page, drawing
from ..core.presentation.pdf import PAPERS, page_path, write_page
from ..errors import InputError
from ..trials.validation.cross_check.run import CrossCheck as CrossCheck
from .comparison.compare import Compared, compare_beside
from .comparison.result import Comparison
from .figures import pictures, require_same_problem, small_pictures
from .sections_data import (
    budget_section,
    covariances_section,
    methods_section,
    noise_section,
    observability_section,
    residuals_section,
    shared_section,
)
from .sections_origin import camera_sections, repeat_section
from .sections_result import (
    arm_sections,
    ellipses_section,
    forms_section,
    full_section,
    scope_section,
    task_space_section,
)
from .sheets import caution_points, first_sheet, second_sheet, split_cautions, title_fields

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
    path = page_path(path, paper)  # before the methods are compared
    if not isinstance(comparison, bool | Comparison | Compared):
        raise InputError(f"Expected `comparison` to be True, False or a Comparison, got {type(comparison).__name__}.")
    result = replace(result, about=as_about({**result.about, **(about or {})}))
    folded = path.suffix.lower() == ".html" or details
    if comparison is True:
        comparison = folded and compare_beside(result)
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
        sections += _folded_sections(result, drawings, found, cross_check, date)
    *sheets, sections = edited([*sheets, sections])
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


def _folded_sections(
    result: Calibration,
    drawings: Mapping[str, Drawing],
    found: Compared,
    cross_check: CrossCheck | None,
    date: str,
) -> list[Section]:
    """Return what follows the two pages, in the order of the contents."""
    return [
        full_section(result),
        *arm_sections(result, drawings),
        ellipses_section(result, drawings, cross_check),
        residuals_section(result, drawings),
        budget_section(result, drawings),
        shared_section(result, drawings),
        task_space_section(result, drawings),
        *camera_sections(result),
        observability_section(result),
        noise_section(result),
        covariances_section(result),
        methods_section(found.comparison, found.reason, found.note, drawings.get("methods")),
        scope_section(result, CONVENTION),
        forms_section(result),
        repeat_section(result, date, __version__),
    ]


def _foot(result: Calibration, sections: Sequence[Section]) -> str:
    """Return the last line of page two: what made the report, of which data, and what is not printed."""
    text = f"uq-handeye {__version__}. Standard deviations are 1 sigma."
    if result.provenance is not None:
        text += f" SHA-256 of the data: {result.provenance.data_sha256[:16]}..."
    if sections:
        text += f" Not printed: {'; '.join(section.title for section in sections)}."
    return text


# Sections for those who repeat the run or take X into their software.
FOR_PROGRAMMERS = ("forms", "repeat")
ADVICE = "Advice for repeating the run:"
# An option, an argument, a call, or an attribute of a result.
_CODE = re.compile(
    r"(?<![\w-])--[a-z]|\b[a-z_]+=[\w\"'\[(]|\b(?:calibrate|compare|report|[a-z]+_[a-z_]+)\(|\bresult\.[a-z_]+\b"
)
_BETWEEN = re.compile(r"(?<=[.!?]) (?=[A-Z])")


def edited(pages: Sequence[Sequence[Section]]) -> list[list[Section]]:
    """Return the sections without sentences that stand before, and without code.

    Sentences with options of the command or arguments of functions are moved to the section "repeat", if there is one.
    """
    said: set[str] = set()
    advice: list[str] = []

    def kept(text: str) -> str:
        """Return the sentences that were not said yet and hold no code."""
        found = []
        for sentence in _BETWEEN.split(text):
            if _CODE.search(sentence):
                advice.append(sentence)
            elif sentence not in said:
                found.append(sentence)
        said.update(sentence for sentence in found if len(sentence) > 40)
        return " ".join(found)

    def of_block(block: Block) -> list[Block]:
        if isinstance(block, Paragraph) and not block.empty:
            text = kept(block.text)
            return [replace(block, text=text)] if text else []
        if isinstance(block, Points):
            items = [(text, k in block.marked) for k, item in enumerate(block.items) if (text := kept(item))]
            marked = frozenset(k for k, (_, stands_out) in enumerate(items) if stands_out)
            return [Points([text for text, _ in items], marked)] if items else []
        return [block]

    def of_section(section: Section) -> Section:
        if section.anchor in FOR_PROGRAMMERS:
            return section
        return replace(section, blocks=[part for block in section.blocks for part in of_block(block)])

    found = [[of_section(section) for section in page] for page in pages]
    extra = [Paragraph(ADVICE), Points(list(dict.fromkeys(advice)))] if advice else []
    return [
        [replace(s, blocks=[*s.blocks, *extra]) if s.anchor == "repeat" else s for s in sections] for sections in found
    ]
