"""Command ``certificate``: the statement of a stored result for the file."""

from pathlib import Path

from ...core.files.about import read_about
from ...errors import InputError
from ..delivery import deliver
from ..messages import quiet, timed
from ..options.common import PAPERS, emit, emit_document, made_of, one_of, require_writable
from ..outcome import NOT_USABLE, Wanted, status_of, wanted_of

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
    from ...calibration.result import Calibration
    from ...core.presentation.document import Answer, Paragraph
    from ...core.presentation.pdf import to_pdf
    from ...report.certificate.certificate import make_certificate

    one_of(paper, "--paper", PAPERS)
    require_writable(file, "FILE", CERTIFICATES)
    if pdf and output is None:
        raise InputError("--pdf needs a folder. Add -o DIR, or name the file: certificate.pdf.")
    found = make_certificate(Calibration.from_json(result), tolerance=wanted.tolerance, about=read_about(about or ()))
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
    return status_of(found.result, None if found.decision is None else found.decision.verdict)
