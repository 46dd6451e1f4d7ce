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
from typing import TYPE_CHECKING, Any

from .._version import __version__
from ..calibration.report.analysis import budget_table
from ..calibration.report.first_screen import data_words, suited_to
from ..calibration.result import Calibration
from ..calibration.statement.accuracy import combined_parts, point_ahead, two_numbers
from ..calibration.statement.tolerance import Verdict
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.formatting.numbers import digits, fixed
from ..core.formatting.units import DEG_PER_RAD, MM_PER_M
from ..core.numbers.limits import MAX_NAMED
from ..core.presentation.document import Answer, Badge, Block, Checks, Drawing, Paragraph, Points, Section, Table
from ..core.presentation.page import PAPERS, Page, drawing, page_path, write_page
from ..errors import InputError, require_type
from ..findings import Finding
from ..trials.validation.cross_check.result import CrossCheck as CrossCheck
from .certificate import make_certificate
from .comparison.compare import Compared, compare_beside
from .comparison.result import Comparison
from .figures import pictures, require_same_problem, small_pictures
from .sections import colour_of, folded_sections, needs

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..calibration.statement.accuracy import Accuracy
    from ..calibration.statement.tolerance import Verdict

# Characters of cautions that fit on the second page; the others are in a section of their own.
MAX_CAUTION_CHARACTERS = 1500
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
        sections += folded_sections(result, drawings, found, cross_check, date)
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
        match block:
            case Paragraph(empty=False):
                text = kept(block.text)
                return [replace(block, text=text)] if text else []
            case Points():
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


def title_fields(result: Calibration) -> list[tuple[str, str]]:
    """Return the names and texts of the title block; those without text are room to write on paper."""
    shown = [key for key in ABOUT if key not in OF_CERTIFICATE and (key != "note" or key in result.about)]
    return [(ABOUT[key], result.about.get(key, "")) for key in shown]


def first_sheet(result: Calibration, verdict: Verdict | None, drawings: Mapping[str, Drawing]) -> list[Section]:
    """Return the sections of page one: number, verdict, checks, a picture, X, and points ahead of the camera."""
    number: list[Block] = [Answer(result.headline, colour_of(result))]
    if verdict is not None:
        number.append(Badge(verdict.word, verdict.sentence, colour_of(result, verdict)))
    elif (suits := suited_to(result)) is not None:
        number.append(Paragraph(suits))
    if not result.reasons:
        number += [Paragraph(text) for text in _contents_of(result.accuracy)]
    elif also := list({re.sub(r"[\d.]+", "", text): text for text in reversed(result.reasons[1:])}.values()):
        number.append(Paragraph(f"Also: {'; '.join(reversed(also))}."))  # those that differ by more than numbers
    checks, subject = Checks.of(result.checks), result.facts.subject
    rows = [[one.name, *one.parts, one.unit] for one in result.facts.X]
    caption = "Value and standard deviation (1 sigma)" + ("" if result.std is not None else "; ? is not determined")
    head = [result.frame, "value", "\N{PLUS-MINUS SIGN} 1 sigma", "unit"]
    X = Table(f"{caption}.", head, rows, frozenset({3}))
    return [
        Section("answer", "Result", number, wide=True),
        Section("checks", "Checks", [checks]),
        _picture(result, drawings),
        Section("x", f"X: the {subject}" if subject else "X of AX = XB", [X]),
        Section("ahead", "A point in front of the camera", _point_blocks(result)),
    ]


def _contents_of(accuracy: Accuracy | None) -> list[str]:
    """Return what the number is made of, what it includes, and what it does not."""
    if accuracy is None:
        return []
    shown = combined_parts(accuracy.parts, MAX_NAMED)
    parts = [
        f"{one.name} {digits(MM_PER_M * one.translation, 2)} mm, {digits(DEG_PER_RAD * one.rotation, 2)} deg"
        for one in shown
    ]
    return [
        *([f"Made of: {'; '.join(parts)}."] if parts else []),
        *([text] if (text := two_numbers(accuracy)) else []),
        f"Includes {', '.join(accuracy.included)}. Does not include {', '.join(accuracy.not_included)}.",
    ]


def _picture(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """Return the residuals by pose; the rig where there are none."""
    table = result.table
    if table is not None and "residuals-small" in drawings:
        return Section("by-pose", f"Residuals by {table.item}", [drawings["residuals-small"]])
    if "rig" in drawings:
        return Section("by-pose", "The rig", [replace(drawings["rig"], small=True)])
    text = needs("Residuals of each pose are found", result)
    return Section("by-pose", "Residuals", [Paragraph(text, empty=True)])


def _point_blocks(result: Calibration) -> list[Block]:
    """Return the uncertainty of points straight ahead of the camera, by their distance."""
    accuracy = result.accuracy
    if accuracy is None:
        return [Paragraph("Not known: the noise of the poses was not given and could not be estimated.", empty=True)]
    if result.reasons:
        return [Paragraph("Not stated, because X is not usable.", empty=True)]
    if result.opened is not None:
        return [Paragraph(f"Not determined: {'; '.join(result.open_words)}.", empty=True)]
    rows = []
    for step in (0.5, 1.0, 1.5, 2.0):
        z = step * accuracy.distance
        one, expanded = (accuracy.point, accuracy.point_95) if step == 1 else point_ahead(result, z)
        name = f"{fixed(z)} m" + (" (target)" if step == 1 and accuracy.distance_known else "")
        rows.append([name, fixed(MM_PER_M * one, 2), fixed(MM_PER_M * expanded, 2)])
    caption = (
        f"Uncertainty that X gives a point on the optical axis, in the worst direction, in the {result.facts.parent}. "
        "The camera's own error of the point is not part of it."
    )
    return [Table(caption, ["distance", "1 sigma (mm)", "95 % (mm)"], rows)]


# ------------------------------------------------------------------------------------------------------- page two


def second_sheet(result: Calibration, drawings: Mapping[str, Drawing], cautions: Sequence[Finding]) -> list[Section]:
    """Return the sections of page two: cautions in full, ellipses, budget, rig."""
    sections = []
    if cautions:
        sections.append(Section("cautions", "Cautions", [caution_points(cautions)], wide=True))
    ellipses = drawings.get("ellipses-small")
    if ellipses is None:
        why = Paragraph("Not known, because the accuracy of X is not known.", empty=True)
        sections += [Section("error", "Error of X", [why]), Section("budget", "Uncertainty budget", [why])]
    else:
        sections += [
            Section("error", "Error of X", [ellipses]),
            Section("budget", "Uncertainty budget", _budget(result)),
        ]
    if "rig" in drawings and result.table is not None:
        sections.append(Section("rig", "The rig", [drawings["rig"]], wide=True))
    elif "rig" not in drawings:
        text = "Not drawn: the motions came without poses."
        if result.setup is not None:
            text = "Not drawn: the stored result holds no poses. Calibrate again and store the result."
        sections.append(Section("rig", "The rig", [Paragraph(text, empty=True)], wide=True))
    return sections


def caution_points(cautions: Sequence[Finding]) -> Points:
    """Return cautions as a list in which each stands out."""
    return Points([str(finding) for finding in cautions], frozenset(range(len(cautions))))


def split_cautions(cautions: Sequence[Finding]) -> tuple[list[Finding], list[Finding]]:
    """Return the cautions that fit on page two, and the others."""
    shown: list[Finding] = []
    size = 0
    for finding in cautions:
        size += len(str(finding)) + 60
        if size > MAX_CAUTION_CHARACTERS and shown:
            break
        shown.append(finding)
    return shown, list(cautions[len(shown) :])


def _budget(result: Calibration) -> list[Block]:
    table = budget_table(result, MAX_NAMED)
    if table is None:
        return [Paragraph(needs("The budget is computed", result), empty=True)]
    columns = [0, 2, 3, 4, 5]
    rows: list[Any] = [[row[k] for k in columns] if row else row for row in table.rows]
    head = [table.head[k] for k in columns]
    caption = (
        "Standard uncertainties u of translation and rotation per axis (root mean square), and shares of the variance "
        "(JCGM 100)."
    )
    return [replace(table, caption=caption, head=head, rows=rows, text_columns=frozenset())]
