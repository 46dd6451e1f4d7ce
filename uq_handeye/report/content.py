"""The content of a report: selections of its sections, for two pages and folded below them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import NamedTuple

from ..calibration.report.first_screen import data_words
from ..calibration.result import Calibration
from ..calibration.stored_result import not_a_result
from ..calibration.tolerance import Verdict
from ..core.presentation.document import Section
from ..core.presentation.page import drawing
from ..errors import InputError
from ..trials.validation.cross_check.result import CrossCheck
from .comparison.compare import Compared
from .figures import pictures, require_same_problem, small_pictures
from .sections import folded_sections
from .sheets import caution_points, first_sheet, second_sheet, split_cautions


class Wanted(NamedTuple):
    """The inputs of a report beside the result."""

    comparison: Compared
    cross_check: CrossCheck | None
    verdicts: Mapping[str, Verdict]
    folded: bool  # whether it has more than the two pages
    date: str


class Content(NamedTuple):
    """The content of a report."""

    subjects: Sequence[str]  # frame of X, or names of the cameras
    facts: Sequence[str]  # a line below the title
    sheets: Sequence[Sequence[Section]]
    sections: Sequence[Section]


@singledispatch
def content_of(result: object, wanted: Wanted) -> Content:
    """Return what the report of a result shows.

    Raises `InputError` for a comparison or a cross-check of another problem.
    """
    raise not_a_result(result)


@content_of.register
def _of_camera(result: Calibration, wanted: Wanted) -> Content:
    cross_check, found = wanted.cross_check, wanted.comparison
    if cross_check is not None:
        require_same_problem(result, cross_check)
    if found.comparison is not None and found.comparison.frame != result.frame:
        raise InputError(
            f"Expected `comparison` to be of {result.frame}, as the result, got one of {found.comparison.frame}."
        )
    drawn = pictures(result, cross_check, found.comparison, None if wanted.folded else ("rig",))
    drawings = {stem: drawing(stem, picture) for stem, picture in drawn.items()}
    drawings |= {stem: drawing(stem, picture, small=True) for stem, picture in small_pictures(result).items()}
    shown, further = split_cautions(result.cautions)
    sheets = [first_sheet(result, wanted.verdicts, drawings), second_sheet(result, drawings, shown)]
    sections: list[Section] = []
    if further:
        sections.append(Section("further", "Further cautions", [caution_points(further)], folded=True))
    if wanted.folded:
        sections += folded_sections(result, drawings, found, cross_check, wanted.date)
    return Content([result.frame], [result.setup or "motions without poses", data_words(result)], sheets, sections)
