"""Command ``cross-check``: every covariance of one problem, and the relations between them."""

from dataclasses import dataclass
from pathlib import Path

from ...core.files.csv_text import frame_text
from ..delivery import REPORTS, deliver, write_report
from ..messages import progress_wanted, timed, verbose
from ..new_poses import Session, calibrated, problem_for, session_of
from ..options.common import (
    cores,
    emit,
    emit_document,
    made_of,
    require_writable,
)
from .validate import INTERRUPTED, NOT_COMPLETE


@dataclass(frozen=True)
class Work:
    """Options of the simulation and the sampling.

    Options:
      * --trials N: Monte Carlo trials of each method.
      * --posterior/--no-posterior: Sampling of the posterior. Default: on.
      --seed N: Seed of the random numbers.
    """

    trials: int = 10_000
    posterior: bool = True
    pairs: str = "all"
    seed: int = 0
    workers: int | None = None


@made_of(session=session_of, asked=Work)
def cross_check_command(
    session: "Session",
    asked: "Work",
    as_json: bool = False,
    output: Path | None = None,
    report: Path | None = None,
) -> int:
    r"""Compare all covariances of X: formulas, simulation, posterior.

    Examples:
      uq-handeye cross-check robot.csv camera.csv -o cross_check/
      # Quick: no posterior, fewer trials
      uq-handeye cross-check robot.csv camera.csv --no-posterior --trials 1000
      # With known noise
      uq-handeye cross-check robot.csv camera.csv \
          --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm

    Computes every covariance of X of the same problem and tests the relations
    that must hold between them. A broken relation is a result: the exit status
    is 0. Ctrl-C prints what is finished (exit status 130); so does a run that
    lost its workers (exit status 1).

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for cross_check.json, .csv, .png and .svg.
    """
    require_writable(report, "--report", REPORTS)
    poses, noise, shared = session.read()
    from ...core.presentation.document import document_of
    from ...trials.validation.cross_check.run import cross_check
    from ...trials.validation.monte_carlo.sentences import INTERRUPTED as ENDED_BY_HAND

    result = calibrated(poses, noise, shared, asked.pairs)
    how = vars(asked) | {"workers": cores() if asked.workers is None else asked.workers}
    with timed("cross-check"):
        problem = problem_for(result, poses, noise, shared, asked.pairs)
        check = cross_check(**problem, **how, progress=progress_wanted())
    said = ""
    if output is not None:
        from ...trials.validation.cross_check.figure import cross_check_figure  # Matplotlib is slow to import

        table = frame_text(check.to_dataframe())
        written = {"cross_check.json": check.to_json(), "cross_check.csv": table}
        said = deliver(output, written, {"cross_check": cross_check_figure(check)})
    if report is not None and result is not None and check.complete:
        write_report(result, report, True, check)
    if as_json:
        emit(check.to_json())
    else:
        emit_document(document_of(check, verbose=verbose()))
        emit(said)
    if check.ended is None:
        return 0
    return INTERRUPTED if check.ended.code == ENDED_BY_HAND else NOT_COMPLETE
