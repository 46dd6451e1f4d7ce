"""The commands ``export`` and ``report``: a stored result for another program, or for people."""

from pathlib import Path
from typing import Annotated

import typer

from ...errors import InputError
from ...runtime.progress import working
from ..messages import progress_wanted, timed
from ..options import OUTPUT, emit, made_of, one_of, option, require_writable
from ..report_options import ReportOptions, report_options_of
from .calibrate import REPORTS, NoCompare

# The names of export.FORMATS, written down once more to be quick.
EXPORT_NAMES = ("json", "ros", "urdf", "opencv", "npz")

ResultFile = Annotated[Path, typer.Argument(metavar="RESULT", help="result.json of calibrate -o.")]


def export_command(
    result: ResultFile,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What to write, e.g. x.urdf.")],
    format: Annotated[
        str | None,
        option(
            "--format",
            of=EXPORT_NAMES,
            metavar="NAME",
            panel=OUTPUT,
            help=f"{', '.join(EXPORT_NAMES)}. Left out: by the ending of FILE.",
        ),
    ] = None,
    corrects: Annotated[
        Path | None,
        option(
            "--corrects",
            metavar="ROBOT.urdf",
            panel=OUTPUT,
            help="Write this URDF, of the arm as it was calibrated, with the errors corrected that are known (standard "
            "deviation below half of that assumed), and their covariance beside it as JSON.",
        ),
    ] = None,
) -> None:
    """X of a stored result for ROS, URDF, OpenCV or NumPy; or the URDF of the arm, corrected.

    Example: uq-handeye export result/result.json x.urdf

    The arm:
    uq-handeye export result/result.json new.urdf --corrects robot.urdf
    """
    from ...calibration.result import Calibration

    require_writable(file, "FILE")
    if corrects is not None:
        if format is not None:
            raise InputError("--format is of X, not of the URDF of --corrects; leave it out.")
        found = Calibration.from_json(result).export_urdf(file, corrects)
        emit(f"Wrote {file} and {file.with_suffix('.corrections.json')}. {found.summary}\n")
        return
    name = None if format is None else one_of(format, "--format", EXPORT_NAMES)
    emit(f"Wrote {Calibration.from_json(result).export(file, name)}\n")


@made_of(wishes=report_options_of)
def report_command(
    result: ResultFile,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What to write, .html or .pdf.")],
    wishes: "ReportOptions",
    no_compare: NoCompare = False,
) -> None:
    """A report for people from a stored result.

    Example: uq-handeye report result/result.json report.html

    It is that of calibrate --report: the result file holds the poses. A file of
    an older version holds none; its report lacks the rig and the methods.
    """
    from ...calibration.result import Calibration

    require_writable(file, "FILE", REPORTS)
    stored = Calibration.from_json(result)
    with timed(f"writing {file}"), working(f"writing {file}", progress_wanted()):
        written = stored.report(file, comparison=not no_compare, about=wishes.about, **wishes.of_report)
    emit(f"Wrote {written}\n")
