"""Output of a command: files in the folder of ``-o DIR``, the report, the printed text, tolerance and exit status."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from ..core.files.about import read_about
from ..core.limits import MIN_SHOWN_CORRELATION
from ..core.progress import working
from ..errors import DegenerateMotionError, InputError, NotConvergedError
from .exit_status import ExitStatus
from .messages import LOG, command_line, fail, progress_wanted, quiet, terminal_width, timed, verbose
from .names import PAPERS
from .printing import emit, emit_document
from .values import one_of, require_writable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..calibration.load import Result
    from ..calibration.tolerance import Tolerance, Verdict
    from ..core.presentation.document import Document
    from ..model.camera.result import CameraCalibration
    from ..model.points.result import PointPoses
    from ..report.comparison.compare import Compared
    from ..scene.result import ScenePoses
    from ..trials.validation.cross_check.result import CrossCheck


def tolerance_of(tolerance: str | None = None, at: str | None = None) -> "Tolerance | None":
    """Read the requested tolerance; None: none.

    Options (Output):
      * --tolerance MM,DEG: Accepted error of X, e.g. 1mm,0.1deg: PASS or FAIL. A length, an angle or both. NOT SHOWN if
        the data cannot decide. Exit status 5 unless PASS.
      * --at LENGTH: Point distance for --tolerance. The length applies to a point so far ahead of the camera, e.g.
        0.5m. Default: X itself.
    """
    if tolerance is None:
        if at is not None:
            raise InputError("--at needs a tolerance. Add, for example, --tolerance 1mm.")
        return None
    from ..calibration.tolerance import Tolerance

    return Tolerance.read(tolerance, at)


def emit_result(
    result: "Result",
    verdicts: "Mapping[str, Verdict]",
    *,
    as_json: bool = False,
    last: Sequence[str] = (),
    threshold: float = MIN_SHOWN_CORRELATION,
) -> int:
    """Print a result and return the exit status: JSON, the matrices (-q), everything (-v) or one screen.

    ``last`` are paragraphs below the text.
    """
    from ..calibration.report import text as text  # registers the text of one camera
    from ..core.presentation.document import document_of

    if as_json:
        emit(json_of(result, verdicts))
    elif quiet():
        emit(_matrices(result))
    else:
        options = {"threshold": threshold, "verdicts": verdicts, "last": last, "width": terminal_width()}
        emit_document(document_of(result, verbose=verbose(), **options))
    if quiet() and not result.usable:
        LOG.error("%s", result.headline)
    return status_of(result, *verdicts.values())


def _matrices(result: "Result") -> str:
    """Return X as four lines below the headline; of several cameras a line each, with its name."""
    poses = result.camera_poses
    if len(poses) > 1:
        return "".join(f"{name} {' '.join(map(repr, X.ravel().tolist()))}\n" for name, X in poses.items())
    matrix = "".join(" ".join(map(repr, row)) + "\n" for X in poses.values() for row in X.tolist())
    return f"# X in m. {result.headline}\n{matrix}"


def emit_answer(result: "Result", verdicts: "Mapping[str, Verdict]", written: str) -> int:
    """Print the headline of a result, the verdicts on it and what was written; return the exit status."""
    from ..calibration.report.answer import verdict_blocks
    from ..core.presentation.document import Answer, Paragraph

    if not quiet():
        answers = [Answer(result.headline, result.status), *verdict_blocks(result, verdicts)]
        emit_document([[*answers, Paragraph(written, hang="  ")]])
    return status_of(result, *verdicts.values())


def emit_refusal(error: InputError | NotConvergedError, as_json: bool, shown: list[str]) -> int:
    """Print why there is no X, if findings about the data explain it; return the exit status.

    Otherwise raise the error. Sentences that are printed are added to ``shown``.
    """
    from ..calibration.checks import failures_in_words
    from ..calibration.stored_result import NOT_USABLE as HEADLINE
    from ..core.files.json_files import json_text
    from ..core.presentation.document import Answer, Paragraph
    from ..findings import step_after

    reasons = failures_in_words(error.findings)
    if not reasons:
        raise error
    headline = f"{HEADLINE}: {reasons[0]}."
    if as_json:
        emit(
            json_text(
                {"headline": headline, "usable": False, "answered": "no", "reasons": list(reasons), "error": str(error)}
            )
        )
    elif not quiet():
        failures = [finding for finding in error.findings if finding.severity == "failure"]
        shown += map(str, failures)
        step = step_after(failures)
        last = [] if step is None else [Paragraph(f"Next: {step}.", hang="  ")]
        emit_document([[Answer(headline, "failed"), *(Paragraph(str(one)) for one in failures), *last]])
    text = str(error)
    if isinstance(error, NotConvergedError | DegenerateMotionError):  # its advice is for data with nothing else wrong
        text = f"{text.partition('. ')[0].rstrip('.')}."
    fail(f"{reasons[0][0].upper()}{reasons[0][1:]}. {text}")
    return ExitStatus.NOT_USABLE


def refused_as_not_usable(result: "Result", name: object, done: str) -> bool:
    """Return whether a result cannot be used, and say so: its headline, and that nothing was ``done`` with it."""
    if not result.reasons:
        return False
    fail(f"{name} is NOT USABLE, so nothing was {done}: {result.reasons[0].rstrip('.')}. Calibrate again.")
    return True


def json_of(result: "Result", verdicts: "Mapping[str, Verdict]") -> str:
    """Return the result as JSON text, with the verdict on the tolerance; of several cameras by their names."""
    from ..core.files.json_files import signed_text

    of_each = {name: one.to_dict() for name, one in verdicts.items()}
    more = {"verdicts": of_each} if len(of_each) > 1 else {"verdict": next(iter(of_each.values()))} if of_each else {}
    return signed_text(result.to_dict() | more)


def status_of(result: "Result", *verdicts: "Verdict") -> int:
    """Return the exit status of a result with a verdict on each camera."""
    if result.answered == "no":
        return ExitStatus.NOT_USABLE
    if any(not verdict.passed for verdict in verdicts):
        return ExitStatus.NOT_PASSED
    return ExitStatus.DONE if result.usable else ExitStatus.IN_PART


def deliver(directory: Path, files: "Mapping[str, str | bytes | Figure]") -> str:
    """Write files, and each figure by its stem as PNG and SVG, into a folder; return a line with their names."""
    from ..read import write_files

    written = rendered(files)
    write_files(directory, written)
    return wrote(directory, written)


def rendered(files: "Mapping[str, str | bytes | Figure]") -> dict[str, str | bytes]:
    """Return files by their names, figures as PNG and SVG."""
    found: dict[str, str | bytes] = {}
    for name, content in files.items():
        if isinstance(content, str | bytes):
            found[name] = content
        else:
            from ..core.presentation.ellipses import render  # Matplotlib is slow to import

            found |= {f"{name}.{kind}": render(content, kind) for kind in ("png", "svg")}
    return found


def deliver_answer(
    text: str,
    said: "str | Document",
    as_json: bool,
    output: Path | None,
    files: "Callable[[], Mapping[str, str | bytes | Figure]]",
) -> None:
    """Print a result, as JSON ``text`` or as the text ``said``; then write its files, and print their names."""
    if as_json:
        emit(text)
    elif isinstance(said, str):
        emit(said)
    else:
        emit_document(said)
    if output is not None:
        line = deliver(output, files())
        emit("" if as_json or quiet() else line)


def wrote(directory: Path, names: Iterable[str]) -> str:
    """Return ``Wrote a.json, a.png and a.svg to DIR``, wrapped, below an empty line."""
    from ..core.presentation.document import Paragraph, to_text

    *most, last = names
    listed = f"{', '.join(most)} and {last}" if most else last
    return "\n" + to_text([Paragraph(f"Wrote {listed} to {directory}", hang="  ")])


def deliver_camera_poses(
    found: "CameraCalibration | PointPoses | ScenePoses",
    text: Callable[[], str],
    output: Path | None,
    as_json: bool,
    example: str,
) -> int:
    """Write camera poses into the folder of -o, print them with the next command, and return the exit status.

    ``example`` is the folder that is named where none is given.
    """
    failed = any(finding.severity == "failure" for finding in found.findings)
    status = ExitStatus.NOT_USABLE if failed else ExitStatus.DONE
    if output is not None:
        with timed(f"writing {output}"), working(f"writing {output}", progress_wanted()):
            found.write(output)
    if as_json:
        emit(text())
        return status
    go_on = "uq-handeye calibrate robot.csv"
    if quiet():
        emit(found.summary().partition("\n\n")[0] + "\n")
    elif output is None:
        emit(f"{found.summary(verbose())}\nNothing was written: give -o {example} to go on with {go_on} {example}\n")
    else:
        emit(f"{found.summary(verbose())}\nWrote {output}. Next: {go_on} {output}\n")
    return status


class ReportOptions(NamedTuple):
    """Title block of the report, and how it is printed."""

    about: dict[str, str]  # title block, by the names of `files.about.ABOUT`
    details: bool = False  # whether the folded sections of the report are open
    paper: str = "a4"


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
    return ReportOptions(read_about(about or ()), full_report, one_of(paper, "--paper", PAPERS))


# Every figure that `report.figures` may draw.
FIGURES = ("ellipses", "rig", "residuals", "budget", "shared", "task_space", "workspace", "methods")

REPORTS = (".html", ".pdf")

NO_FILES: Mapping[str, str] = MappingProxyType({})
NO_VERDICTS: "Mapping[str, Verdict]" = MappingProxyType({})


@dataclass(frozen=True)
class Outputs:
    """Files of a result: a folder, whether with figures, and a report.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the result and exports. It holds result.json, poses.csv, and X for
        ROS, URDF, OpenCV and NumPy; with --figures also the figures.
    """

    report: Path | None = None
    no_compare: bool = False
    as_json: bool = False
    output: Path | None = None
    figures: bool = False

    def require_possible(self) -> None:
        """Raise `InputError`, before the work, for files that cannot be written or that need another option."""
        require_writable(self.report, "--report", REPORTS)
        if self.figures and self.output is None:
            raise InputError("--figures needs -o DIR. Add it.")
        for name in ("no_compare", "with_cross_check"):
            if getattr(self, name, False) and self.report is None:
                raise InputError(f"--{name.replace('_', '-')} needs --report FILE. Add it.")

    def write(
        self,
        result: "Result",
        verdicts: "Mapping[str, Verdict]",
        check: "CrossCheck | None" = None,
        wishes: ReportOptions | None = None,
        files: "Mapping[str, str]" = NO_FILES,
    ) -> str:
        """Write the files, and further ``files`` by their names; return what was written as a sentence."""
        wishes, comparison = wishes or ReportOptions({}), not self.no_compare
        methods: Compared | bool = comparison
        folded = self.report is not None and (self.report.suffix.lower() != ".pdf" or wishes.details)
        if comparison and (folded or (self.report is not None and self.figures)):  # two pages have none
            from ..report.comparison.compare import compare_result

            with timed("comparing the methods"), working("comparing the methods", progress_wanted()):
                methods = compare_result(result)
        names = []
        if self.output is not None:
            from ..report.files import figures_of

            compared = getattr(methods, "comparison", None)
            with timed(f"writing {self.output}"), working(f"writing {self.output}", progress_wanted()):
                drawn = figures_of(result, check, compared) if self.figures else {}
                names.append(_write_result(result, verdicts, self.output, {**drawn, **files}))
        if self.report is not None:
            write_report(result, self.report, methods, check, wishes, verdicts)
            names.append(str(self.report))
        return f"Wrote {' and '.join(names)}." if names else ""


@dataclass(frozen=True)
class AllOutputs(Outputs):
    """Further outputs of ``calibrate``.

    Options (Output):
      --threshold R <fraction>: Smallest correlation that is listed.
      --with-cross-check: Report with Monte Carlo and posterior; takes a minute.
    """

    threshold: float = MIN_SHOWN_CORRELATION
    with_cross_check: bool = False


@dataclass(frozen=True)
class DemoOutputs(Outputs):
    """Outputs of ``demo``."""

    no_compare: bool = field(default=False, init=False)


def deliver_result(
    result: "Result",
    outputs: Outputs,
    tolerance: "Tolerance | None",
    wishes: ReportOptions | None = None,
    *,
    check: "CrossCheck | None" = None,
    threshold: float = MIN_SHOWN_CORRELATION,
    more: str = "",
    files: "Mapping[str, str]" = NO_FILES,
) -> int:
    """Write the files, then print, with a paragraph ``more``: if a file cannot be written, nothing is printed."""
    from ..calibration.report.answer import closing_lines

    result = _with_command(result)
    verdicts = result.verdicts(tolerance)
    written = outputs.write(result, verdicts, check, wishes, files)
    last = closing_lines(result, written, None if outputs.report is None else str(outputs.report), more)
    return emit_result(result, verdicts, as_json=outputs.as_json, last=last, threshold=threshold)


def write_report(
    result: "Result",
    file: Path,
    comparison: "Compared | bool",
    check: "CrossCheck | None",
    wishes: ReportOptions | None = None,
    verdicts: "Mapping[str, Verdict]" = NO_VERDICTS,
) -> None:
    """Write the report, which names this command line."""
    wishes = wishes or ReportOptions({})
    with timed(f"writing {file}"), working(f"writing {file}", progress_wanted()):
        _with_command(result).report(
            file, comparison=comparison, cross_check=check, verdict=verdicts, details=wishes.details, paper=wishes.paper
        )


def _with_command(result: "Result") -> "Result":
    if result.provenance is None:
        return result
    return replace(result, provenance=replace(result.provenance, command=command_line()))


def _write_result(
    result: "Result", verdicts: "Mapping[str, Verdict]", directory: Path, more: "Mapping[str, str | bytes | Figure]"
) -> str:
    """Write the folder of -o with further files, and return what was written."""
    from ..core.files.json_files import RESULT_NAME
    from ..read import write_files
    from ..report.files import FILES, files_of, words_of_intrinsics

    files = {RESULT_NAME: json_of(result, verdicts)} | files_of(result, verdicts) | rendered(more)
    write_files(directory, files)
    for name in {*FILES, *(f"{stem}.{kind}" for stem in FIGURES for kind in ("png", "svg"))} - set(files):
        (directory / name).unlink(missing_ok=True)  # those of an earlier run are not of this result
    return f"{directory / RESULT_NAME} with {len(files) - 1} more files{words_of_intrinsics(result)}"
