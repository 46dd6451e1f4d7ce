"""A stored result in other forms: ``export`` for programs, ``report`` for people, ``certificate`` for the file."""

from pathlib import Path
from typing import Any

from ...core.files.about import read_about
from ...core.runtime.progress import working
from ...errors import InputError
from ..delivery import (
    NOT_PASSED,
    NOT_USABLE,
    REPORTS,
    Outputs,
    ReportOptions,
    Wanted,
    deliver,
    emit_answer,
    emit_result,
    report_options_of,
    status_of,
    wanted_of,
)
from ..messages import LOG, fail, progress_wanted, quiet, timed
from ..options.common import CONTROLLER_NAMES, PAPERS, emit, emit_document, made_of, one_of, require_writable

# Names of export.FORMATS, repeated here so that help and completion load quickly.
EXPORT_NAMES = (
    *("json", "ros", "launch", "urdf", "opencv", "npz"),
    *CONTROLLER_NAMES,
    *("matrix", "franka", "zivid", "halcon"),
)


def export_command(
    result: Path,
    file: Path,
    format: str | None = None,
    corrects: Path | None = None,
) -> int:
    """Export X for ROS, URDF, OpenCV, NumPy, or as a robot writes it.

    Examples:
      uq-handeye export result/result.json x.urdf
      uq-handeye export result/result.json handeye.yaml --format ros
      # ROS 2 launch file that publishes X as a static transform
      uq-handeye export result/result.json handeye.launch.py
      # As a KUKA writes a frame: X, Y, Z in mm, A, B, C in deg
      uq-handeye export result/result.json x.dat --format kuka
      # All poses of a rig, with the relative poses of its cameras
      uq-handeye export result/rig.json cameras.launch.py
      # URDF of the arm, with the estimated errors corrected
      uq-handeye export result/result.json new.urdf --corrects robot.urdf

    Arguments:
      FILE: File to write, e.g. x.urdf.

    Options (Output):
      * --format NAME <EXPORT_NAMES>: Format: {EXPORT_NAMES}; of a rig json, ros, launch, urdf, opencv, toml or npz.
        Default: by the suffix of FILE.
      * --corrects ROBOT.urdf: URDF of the calibrated arm, to write with its errors corrected. Corrects the errors that
        are known (standard deviation below half of the prior) and writes their covariance as JSON.
    """
    from ...calibration.result import Calibration, load
    from ...rig.result import RigCalibration

    require_writable(file, "FILE")
    if corrects is not None:
        if format is not None:
            raise InputError("--format applies to X, not to the URDF of --corrects. Remove it.")
        found = Calibration.from_json(result).export_urdf(file, corrects)
        emit(f"Wrote {file} and {file.with_suffix('.corrections.json')}. {found.summary}\n")
        return 0
    name = None if format is None else one_of(format, "--format", (*EXPORT_NAMES, "toml"))
    stored = load(result)
    if isinstance(stored, RigCalibration):
        emit(f"Wrote {stored.export(file, name)}\n")
        return 0
    if stored.reasons:
        fail(f"{result} is not usable, so nothing was exported: {stored.reasons[0]}. Calibrate again.")
        return NOT_USABLE
    emit(f"Wrote {stored.export(file, name)}\n")
    if not stored.usable:
        LOG.warning(
            "X is known in part. Not determined: %s. What was written holds one of all X that fit.",
            "; ".join(stored.open_words),
        )
    return status_of(stored, None)


@made_of(wishes=report_options_of, wanted=wanted_of)
def report_command(
    result: Path,
    wishes: "ReportOptions",
    wanted: "Wanted",
    file: Path | None = None,
    no_compare: bool = False,
) -> int:
    """Print a stored result, or write its report.

    Examples:
      uq-handeye report result/result.json report.html
      uq-handeye report result/rig.json report.html
      # Print the result again, and whether it meets a tolerance
      uq-handeye report result/result.json --tolerance 1mm,0.1deg

    Without FILE, prints what calibrate prints. The report equals that of
    calibrate --report, except for the cross-check: the result file holds the
    poses. A result file of an older version holds none; its report lacks the
    rig and the comparison of methods.

    Arguments:
      FILE: Report to write, .html or .pdf. Default: none, print only.
    """
    from ...calibration.result import load
    from ...rig.result import RigCalibration

    require_writable(file, "FILE", REPORTS)
    stored = load(result)
    if isinstance(stored, RigCalibration):
        from ..rigs import deliver_rig

        return deliver_rig(stored, wishes, wanted, Outputs(file))
    verdict = wanted.verdict(stored)
    if file is None:
        return emit_result(stored, verdict)
    with timed(f"writing {file}"), working(f"writing {file}", progress_wanted()):
        written = stored.report(
            file, comparison=not no_compare, about=wishes.about, verdict=verdict, **wishes.of_report
        )
    return emit_answer(stored, verdict, f"Wrote {written}")


CERTIFICATES = (".html", ".pdf", ".json")
NAME = "certificate"


@made_of(wanted=wanted_of)
def certificate_command(
    result: Path,
    wanted: "Wanted",
    file: Path | None = None,
    output: Path | None = None,
    pdf: bool = False,
    about: list[str] | None = None,
    paper: str = "a4",
    as_json: bool = False,
) -> int:
    """Write the certificate of a stored result, for the file.

    Examples:
      uq-handeye certificate result/result.json certificate.pdf
      # The page and the machine-readable form, with a decision on a tolerance
      uq-handeye certificate result/result.json -o certificate/ \\
          --tolerance 1mm,0.1deg --about cell.toml
      # All poses of a rig, with a decision on each camera
      uq-handeye certificate result/rig.json rig.pdf --tolerance 1mm,0.1deg

    A result that is not usable or has no uncertainty is not certified: the
    files say so and state no X, and the exit status is 3.

    Arguments:
      FILE: Certificate to write, .html, .pdf or .json. Default: none, or -o.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for certificate.html and certificate.json. With --pdf also
        certificate.pdf.
      --pdf: Write certificate.pdf too, with -o.
    """
    from ...calibration.report.first_screen import status_of as colour_of
    from ...calibration.result import load
    from ...core.presentation.document import Answer, Paragraph
    from ...core.presentation.pdf import to_pdf
    from ...report.certificate.certificate import make_certificate
    from ...report.certificate.of_rig import RigCertificate

    one_of(paper, "--paper", PAPERS)
    require_writable(file, "FILE", CERTIFICATES)
    if pdf and output is None:
        raise InputError("--pdf needs a folder. Add -o DIR, or name the file: certificate.pdf.")
    stored: Any = load(result)
    found: Any = make_certificate(stored, tolerance=wanted.tolerance, about=read_about(about or ()))
    written = ""
    if file is not None:
        with timed(f"writing {file}"):
            written = f"Wrote {found.write(file, paper=paper)}"
    if output is not None:
        page = found.to_html()
        files: dict[str, str | bytes] = {f"{NAME}.html": page, f"{NAME}.json": found.to_json()}
        if pdf:
            files[f"{NAME}.pdf"] = to_pdf(page, paper)
        written = f"{written}{deliver(output, files)}".strip()
    if as_json:
        emit(found.to_json())
    elif isinstance(found, RigCertificate):
        lines = [*found.refusals, *(f"{name}: {verdict}" for name, verdict in found.verdicts.items())]
        head = f"{'' if found.certified else 'NOT CERTIFIED. '}Certificate {found.identifier}. {written}".strip()
        emit("" if quiet() else "\n".join([head, *lines]) + "\n")
    elif not quiet():
        verdict = None if found.decision is None else found.decision.verdict
        blocks = [Answer(found.result.headline, colour_of(found.result))]
        if not found.certified:
            blocks = [Answer(f"NOT CERTIFIED. {found.result.headline}", "failed")]
        elif verdict is not None:
            blocks.append(Answer(str(verdict), {"PASS": "ok", "FAIL": "failed"}.get(verdict.word, "caution")))
        number = f"Certificate {found.identifier}."
        emit_document([[*blocks, Paragraph(f"{number} {written}".strip(), hang="  ")]])
    if not found.certified:
        return NOT_USABLE
    if isinstance(found, RigCertificate):
        return NOT_PASSED if any(not verdict.passed for verdict in found.verdicts.values()) else 0
    return status_of(found.result, None if found.decision is None else found.decision.verdict)
