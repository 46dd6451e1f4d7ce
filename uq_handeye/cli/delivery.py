"""Results into the folder of ``-o DIR``: all files or none, and the line that names them.

Options of the report: its title block, paper, and whether its folded sections are open.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files.about import read_about
from ..core.runtime.progress import working
from ..errors import InputError
from .messages import LOG, progress_wanted, timed
from .options.common import PAPERS, emit, one_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def deliver(directory: Path, files: Mapping[str, str | bytes], figures: "Mapping[str, Figure] | None" = None) -> str:
    """Write files, and each figure by its stem as PNG and SVG, into a folder; return the line that says so."""
    from ..read import write_files

    written = dict(files)
    for stem, figure in (figures or {}).items():
        from ..core.presentation.ellipses import render  # Matplotlib is slow to import

        written |= {f"{stem}.{kind}": render(figure, kind) for kind in ("png", "svg")}
    write_files(directory, written)
    return wrote(directory, written)


def wrote(directory: Path, names: Iterable[str]) -> str:
    """Return ``Wrote a.json, a.png and a.svg to DIR``, wrapped, below an empty line."""
    from ..core.presentation.document import Paragraph, to_text

    *most, last = names
    listed = f"{', '.join(most)} and {last}" if most else last
    return "\n" + to_text([Paragraph(f"Wrote {listed} to {directory}", hang="  ")])


def deliver_camera_poses(
    found: Any, to_dict: Callable[[Any], dict[str, Any]], output: Path | None, as_json: bool, example: str
) -> None:
    """Write camera poses into the folder of -o, and print them with the command that goes on with them.

    ``example`` is the folder that is named where none is given.
    """
    if output is not None:
        with timed(f"writing {output}"), working(f"writing {output}", progress_wanted()):
            found.write(output)
    if as_json:
        from ..read import json_text

        emit(json_text(to_dict(found)))
        return
    go_on = "uq-handeye calibrate robot.csv"
    if output is None:
        emit(f"{found.summary()}\nNothing was written: give -o {example} to go on with {go_on} {example}\n")
    else:
        emit(f"{found.summary()}\nWrote {output}. Next: {go_on} {output}\n")


def deliver_csv(path: Path, table: str) -> str:
    """Write the table alone to ``-o FILE.csv``, with a note that this form is going to end."""
    from ..read import write_atomically

    write_atomically(path, table)
    LOG.info("-o FILE.csv is deprecated: -o names a folder, as for all other commands, e.g. -o %s/.", path.stem)
    return f"\nWrote {path}\n"


@dataclass(frozen=True)
class ReportOptions:
    """Title block of the report, and how it is printed."""

    about: dict[str, str]  # title block, by the names of `files.about.ABOUT`
    of_report: dict[str, Any]  # arguments of `Calibration.report`


def report_options_of(
    about: list[str] | None = None,
    full_report: bool = False,
    paper: str = "a4",
) -> ReportOptions:
    """Read the options of the report.

    Options (Output):
      --full-report: Open the folded sections of the report, also in the PDF. Default: two pages.
    """
    for text in about or ():
        if not text.strip():
            raise InputError("Expected --about to name a TOML file or KEY=VALUE, got an empty text.")
    return ReportOptions(read_about(about or ()), {"details": full_report, "paper": one_of(paper, "--paper", PAPERS)})
