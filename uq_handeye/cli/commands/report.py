"""Command ``report``: a stored result as text or as a page; ``certificate`` is its preset for the file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ...core.files.about import read_about
from ...core.progress import working
from ..delivery import REPORTS, ReportOptions, emit_answer, emit_result, report_options_of, status_of, tolerance_of
from ..exit_status import ExitStatus
from ..messages import progress_wanted, quiet, timed
from ..names import PAPERS
from ..printing import emit_document
from ..values import one_of, require_writable

if TYPE_CHECKING:
    from ...calibration.load import Result
    from ...calibration.tolerance import Tolerance


# Suffixes of a certificate.
CERTIFICATES = (*REPORTS, ".json")


def report_command(
    result: Path,
    wishes: Annotated["ReportOptions", report_options_of],
    tolerance: Annotated["Tolerance | None", tolerance_of],
    file: Path | None = None,
    no_compare: bool = False,
    certificate: bool = False,
) -> int:
    """Print a stored result, or write its report.

    Examples:
      uq-handeye report result/result.json report.html
      uq-handeye report result/result.json report.html
      # Print the result again, and whether it meets a tolerance
      uq-handeye report result/result.json --tolerance 1mm,0.1deg
      # The certificate: the pages that are signed and filed
      uq-handeye report result/result.json certificate.pdf --certificate

    Without FILE, prints what calibrate prints. The report equals that of
    calibrate --report, except for the cross-check: the result file holds the
    poses.

    Arguments:
      FILE: Report to write, .html or .pdf, with --certificate also .json. Default: none, print only.

    Options (Output):
      --certificate: Certificate in place of the report: measurand, result, uncertainty budget, conditions,
        traceability and validity, without the comparison of methods.
    """
    from ...calibration.load import load

    require_writable(file, "FILE", CERTIFICATES if certificate else REPORTS)
    stored = load(result)
    if certificate:
        return _deliver_certificate(stored, file, tolerance, wishes.about, wishes.paper)
    verdicts = stored.verdicts(tolerance)
    if file is None:
        last = [] if stored.remedy is None else [f"Next: {stored.remedy}."]
        return emit_result(stored, verdicts, last=last)
    with timed(f"writing {file}"), working(f"writing {file}", progress_wanted()):
        written = stored.report(
            file,
            comparison=not no_compare,
            about=wishes.about,
            verdict=verdicts,
            details=wishes.details,
            paper=wishes.paper,
        )
    return emit_answer(stored, verdicts, f"Wrote {written}")


def certificate_command(
    result: Path,
    tolerance: Annotated["Tolerance | None", tolerance_of],
    file: Path | None = None,
    about: list[str] | None = None,
    paper: str = "a4",
) -> int:
    """Write the certificate of a result: report --certificate.

    Examples:
      uq-handeye certificate result/result.json certificate.pdf
      # The machine-readable form, with a decision on a tolerance
      uq-handeye certificate result/result.json certificate.json \\
          --tolerance 1mm,0.1deg --about cell.toml
      # All poses of a rig, with a decision on each camera
      uq-handeye certificate result/result.json rig.pdf --tolerance 1mm,0.1deg

    A result that is not usable or has no uncertainty is not certified: the
    file says so and states no X, and the exit status is 3.

    Arguments:
      FILE: Certificate to write, .html, .pdf or .json. Default: none, print the headline only.
    """
    from ...calibration.load import load

    one_of(paper, "--paper", PAPERS)
    require_writable(file, "FILE", CERTIFICATES)
    return _deliver_certificate(load(result), file, tolerance, read_about(about or ()), paper)


def _deliver_certificate(
    stored: "Result",
    file: Path | None,
    tolerance: "Tolerance | None",
    about: dict[str, str],
    paper: str,
) -> int:
    """Write a certificate, print its headline, and return the exit status."""
    from ...calibration.report.answer import verdict_blocks
    from ...core.presentation.document import Answer, Paragraph
    from ...report.certificate import make_certificate
    from ...report.certificate_sheets import NOT_CERTIFIED

    found = make_certificate(stored, tolerance=tolerance, about=about)
    written = ""
    if file is not None:
        with timed(f"writing {file}"):
            written = f"Wrote {found.write(file, paper=paper)}"
    result, verdicts = found.result, {name: one.verdict for name, one in found.decisions.items()}
    if not quiet():
        blocks = [Answer(result.headline, result.status), *verdict_blocks(result, verdicts)]
        if not found.certified:
            blocks = [Answer(f"{NOT_CERTIFIED}. {result.headline}", "failed")]
            blocks += [Paragraph(reason, hang="  ") for reason in found.refusals if reason not in result.headline]
        number = f"Certificate {found.identifier}."
        emit_document([[*blocks, Paragraph(f"{number} {written}".strip(), hang="  ")]])
    return status_of(result, *verdicts.values()) if found.certified else ExitStatus.NOT_USABLE
