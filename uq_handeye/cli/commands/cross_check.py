"""Command ``cross-check``: the covariance compared with formulas, simulation and posterior."""

from pathlib import Path
from typing import NamedTuple

from ...core.threads import cores
from ...errors import InputError
from ..delivery import REPORTS, deliver_answer, write_report
from ..exit_status import ExitStatus
from ..messages import progress_wanted, timed, verbose
from ..new_poses import Session
from ..stored import run_each
from ..values import require_writable
from .validate import _files_of


class Work(NamedTuple):
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


def cross_check_command(
    session: Session,
    work: Work,
    as_json: bool = False,
    output: Path | None = None,
    report: Path | None = None,
    resume: bool = False,
) -> int:
    r"""Compare all covariances of X: formulas, simulation, posterior.

    Examples:
      uq-handeye cross-check robot.csv camera.csv -o cross_check/
      # Quick: no posterior, fewer trials
      uq-handeye cross-check robot.csv camera.csv --no-posterior --trials 1000
      # With known noise
      uq-handeye cross-check robot.csv camera.csv \
          --robot-noise 0.02deg,0.05mm --camera-noise 0.1deg,0.5mm
      # One camera of a rig, or without --camera each
      uq-handeye cross-check result/result.json --camera left

    Computes every covariance of X of the same problem and tests the relations
    that must hold between them. A broken relation is a result: the exit status
    is 0. Ctrl-C prints what is finished (exit status 130); so does a run that
    lost its workers (exit status 1). With -o DIR, --resume continues it.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the results and the run. It holds cross_check.json, .csv, .png and
        .svg, and the trials and the chain (run/), for --resume.
      * --resume: Continue the cross-check in -o DIR, or add trials to it.
    """
    if resume and output is None:
        raise InputError("--resume needs the folder of the run. Add -o DIR.")
    require_writable(report, "--report", REPORTS)
    if cameras := session.each():
        if report is not None:
            raise InputError(f"--report is of one camera. Add --camera {cameras[0]}.")
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: cross_check_command(session.of_camera(name), work, as_json, folder, None, resume),
        )
    from ...core.presentation.document import document_of
    from ...trials.validation.cross_check.run import cross_check
    from ...trials.validation.sentences import INTERRUPTED

    result, problem = session.calibrated(work.pairs)
    how = work._asdict() | {"workers": cores() if work.workers is None else work.workers}
    how |= {"directory": None if output is None else output / "run", "resume": resume}
    with timed("cross-check"):
        check = cross_check(**problem, **how, progress=progress_wanted())
    said = document_of(check, verbose=verbose())
    deliver_answer(check.to_json(), said, as_json, output, lambda: _files_of(check, "cross_check"))
    if report is not None and result is not None and check.complete:
        write_report(result, report, True, check)
    if check.ended is None:
        return 0
    return ExitStatus.INTERRUPTED if check.ended.code == INTERRUPTED else ExitStatus.INTERNAL_ERROR
