"""Command ``compare``: the published methods side by side."""

from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from ..delivery import deliver_answer
from ..messages import fail, progress_wanted, timed, verbose, withheld
from ..names import EVERY_METHOD
from ..new_poses import Session
from ..stored import run_each
from ..values import methods_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...report.comparison.result import Comparison


def compare_command(
    session: Session,
    methods: str | None = None,
    reference: str = "efficient",
    pairs: str = "all",
    as_json: bool = False,
    as_csv: bool = False,
    output: Path | None = None,
) -> int:
    r"""Compare the estimate of X with the published methods.

    Examples:
      uq-handeye compare robot.csv camera.csv -o comparison/
      # Three methods only, differences from Park's
      uq-handeye compare robot.csv camera.csv --methods tsai,park,4dpa \
          --reference park
      # A stored result, one camera of a rig, or without --camera each
      uq-handeye compare result/result.json --camera left

    A method that fails keeps its row, with the reason. The exit status is 2 if
    every method fails.

    Options (Estimation):
      * --methods NAMES <EVERY_METHOD>: Methods to compare. Some of {EVERY_METHOD}. Default: efficient (the answer of
        calibrate) and the 15 methods for AX = XB.
      * --reference NAME <EVERY_METHOD>: Method that differences are relative to.

    Options (Output):
      * as_csv = --csv: Print the table as CSV.
      * -o, --output DIR <named_folder>: Folder for comparison.json, .csv, .png and .svg.
    """
    if as_json and as_csv:
        raise InputError("Give either --json or --csv, not both.")
    if cameras := session.each():
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: compare_command(
                session.of_camera(name), methods, reference, pairs, as_json, as_csv, folder
            ),
        )
    names = None if methods is None else methods_of(methods, "--methods", EVERY_METHOD)
    (base,) = methods_of(reference, "--reference", EVERY_METHOD, most=1)
    poses, noise, shared = session.read()
    from ...core.presentation.document import document_of
    from ...report.comparison.compare import compare

    with timed("comparing"), withheld() as shown:
        result = compare(
            poses, noise=noise, methods=names, pairs=pairs, reference=base, progress=progress_wanted(), shared=shared
        )
        if not (as_json or as_csv):  # the text has them, in short or in full
            shown += [
                *result.warnings,
                *result.own_warnings,
                *(str(f) for check in result.checks for f in check.findings),
            ]
    text = result.to_json() if as_json or not as_csv else result.to_csv()
    said = document_of(result, verbose=verbose())
    deliver_answer(text, said, as_json or as_csv, output, lambda: _files_of(result))
    if result.reference is None:
        some = any(row.X is not None for row in result.rows)
        what = "No method gave a usable result" if some else "Every method failed"
        return fail(f"{what}. The table lists the reasons.")
    return 0


def _files_of(result: "Comparison") -> "dict[str, str | Figure]":
    from ...report.comparison.figure import comparison_picture  # Matplotlib is slow to import

    picture = comparison_picture(result)
    drawn = {} if picture is None else {"comparison": picture.figure}
    return {"comparison.json": result.to_json(), "comparison.csv": result.to_csv(), **drawn}
