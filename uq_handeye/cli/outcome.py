"""The outcome of a calibration on the command line: what is printed of it, the tolerance it meets, the exit status."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..errors import DegenerateMotionError, InputError, NotConvergedError
from .messages import LOG, fail, quiet, styled, terminal_width, verbose
from .options.common import emit, emit_document

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..calibration.statement.tolerance import Tolerance, Verdict

# Exit statuses.
NOT_USABLE, NOT_PASSED, IN_PART = 3, 5, 6


@dataclass(frozen=True)
class Wanted:
    """The tolerance that is asked for; None: none."""

    tolerance: "Tolerance | None"

    def verdict(self, result: "Calibration") -> "Verdict | None":
        """Return whether a result meets the tolerance."""
        return None if self.tolerance is None else result.verdict(self.tolerance)


def wanted_of(tolerance: str | None = None, at: str | None = None) -> Wanted:
    """Read the tolerance.

    Options (Output):
      * --tolerance MM,DEG: Accepted error of X, e.g. 1mm,0.1deg: PASS or FAIL. A length, an angle or both. NOT SHOWN if
        the data cannot decide. Exit status 5 unless PASS.
      * --at LENGTH: Point distance for --tolerance. The length applies to a point so far ahead of the camera, e.g.
        0.5m. Default: X itself.
    """
    if tolerance is None:
        if at is not None:
            raise InputError("--at needs a tolerance. Add, for example, --tolerance 1mm.")
        return Wanted(None)
    from ..calibration.statement.tolerance import Tolerance

    return Wanted(Tolerance.read(tolerance, at))


def emit_result(
    result: "Calibration",
    verdict: "Verdict | None" = None,
    *,
    as_json: bool = False,
    last: tuple[str, ...] = (),
    threshold: float = 0.5,
) -> int:
    """Print a calibration as asked for, and return the exit status: JSON, the 4x4 (-q), everything (-v) or one screen.

    ``last`` are paragraphs below the text.
    """
    if as_json:
        emit(json_of(result, verdict))
    elif quiet():
        emit("".join(" ".join(map(repr, row)) + "\n" for row in result.X.tolist()))
    else:
        _emit_text(result, verdict, last, threshold)
    if quiet() and not result.usable:
        LOG.error("%s", result.headline)
    return status_of(result, verdict)


def emit_answer(result: "Calibration", verdict: "Verdict | None", written: str) -> int:
    """Print the headline and the verdict of a calibration and what was written; return the exit status."""
    from ..calibration.report.first_screen import answer_blocks
    from ..core.presentation.document import Answer, Paragraph

    if not quiet():
        answers = [block for block in answer_blocks(result, verdict) if isinstance(block, Answer)]
        emit_document([[*answers, Paragraph(written, hang="  ")]])
    return status_of(result, verdict)


def emit_refusal(error: InputError | NotConvergedError, as_json: bool, shown: list[str]) -> int:
    """Print why there is no X, where it is known what looked wrong with the data; return the exit status.

    Otherwise raise the error. Sentences that are printed are added to ``shown``.
    """
    from ..calibration.report.next_step import step_after
    from ..calibration.statement.checks import failures_in_words
    from ..calibration.statement.headline import NOT_USABLE as HEADLINE
    from ..core.files.atomic import json_text
    from ..core.presentation.document import Answer, Paragraph

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
    return NOT_USABLE


def _emit_text(result: "Calibration", verdict: "Verdict | None", last: tuple[str, ...], threshold: float) -> None:
    from ..calibration.report.first_screen import first_screen
    from ..calibration.report.text import long_document
    from ..core.presentation.document import Document, Paragraph, to_text

    width = terminal_width()
    document: Document
    if verbose():
        document = [*long_document(result, threshold, verdict), [Paragraph(text, hang="  ") for text in last]]
    else:
        document = first_screen(result, verdict=verdict, last=last, width=width)
    emit(to_text(document, width, styled))


def json_of(result: "Calibration", verdict: "Verdict | None") -> str:
    """Return the result as JSON text, with the verdict on the tolerance."""
    from ..core.files.atomic import json_text

    more: dict[str, Any] = {} if verdict is None else {"verdict": verdict.to_dict()}
    return json_text(result.to_dict() | more)


def status_of(result: "Calibration", verdict: "Verdict | None") -> int:
    """Return the exit status of a calibration."""
    if result.answered == "no":
        return NOT_USABLE
    if verdict is not None and not verdict.passed:
        return NOT_PASSED
    return 0 if result.usable else IN_PART
