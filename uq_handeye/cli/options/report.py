"""Options of the report: its title block, paper, and whether its folded sections are open."""

from dataclasses import dataclass
from typing import Annotated, Any

from ...errors import InputError
from ...files.about import ABOUT, read_about
from ..groups import OUTPUT
from .common import one_of, option

PAPERS = ("a4", "letter")


@dataclass(frozen=True)
class ReportOptions:
    """Title block of the report, and how it is printed."""

    about: dict[str, str]  # title block, by the names of `files.about.ABOUT`
    of_report: dict[str, Any]  # arguments of `Calibration.report`


def report_options_of(
    about: Annotated[
        list[str] | None,
        option(
            "--about",
            panel=OUTPUT,
            common=True,
            metavar="KEY=VALUE",
            help=f"Title block of the report, or a TOML file. Keys: {', '.join(ABOUT)}. Repeatable.",
        ),
    ] = None,
    full_report: bool = False,
    paper: str = "a4",
) -> ReportOptions:
    """Read the options of the report.

    Options (Output):
      --full-report: Open the folded sections of the report, also in the PDF. Default: two pages.
      --paper NAME <PAPERS>: Paper of a PDF report: a4 or letter.
    """
    for text in about or ():
        if not text.strip():
            raise InputError("Expected --about to name a TOML file or KEY=VALUE, got an empty text.")
    return ReportOptions(read_about(about or ()), {"details": full_report, "paper": one_of(paper, "--paper", PAPERS)})
