"""The command ``uq-handeye cross-check``: every covariance of one problem, and whether they agree."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..arm_options import Arm, arm_of
from ..delivery import deliver
from ..messages import progress_wanted, timed
from ..noise_options import Given, given_of
from ..options import (
    JsonOption,
    PairsOption,
    WorkersOption,
    cores,
    emit,
    flag,
    folder_option,
    made_of,
    option,
    require_writable,
)
from ..pose_files import PoseFiles, calibrated, problem_for
from ..views import views_of
from .calibrate import REPORTS, ReportFile, write_report
from .validate import INTERRUPTED, NOT_COMPLETE

if TYPE_CHECKING:
    from ..views import Views


@made_of(given=given_of, files=PoseFiles, views=views_of, arm=arm_of)
def cross_check_command(
    files: "PoseFiles",
    given: "Given",
    views: "Views | None",
    arm: "Arm | None",
    trials: Annotated[int, option("--trials", help="Monte Carlo trials of each method.")] = 10_000,
    posterior: Annotated[bool, flag("--posterior/--no-posterior", help="Sample the posterior too.")] = True,
    pairs: PairsOption = "all",
    seed: Annotated[int, option("--seed", help="The same seed gives the same numbers.")] = 0,
    workers: WorkersOption = None,
    as_json: JsonOption = False,
    output: Annotated[
        Path | None, folder_option("Write cross_check.json, cross_check.csv, cross_check.png, cross_check.svg here.")
    ] = None,
    report: ReportFile = None,
) -> int:
    """Formulas, Monte Carlo and posterior side by side: every covariance of X, and whether they agree as they must.

    Example: uq-handeye cross-check robot.csv camera.csv -o all/

    With known noise append --robot-noise 0.02deg,0.05mm and --camera-noise
    0.1deg,0.5mm. Without, it is estimated from the data.

    A broken relation is a result: exit status 0. Ctrl-C prints what there is so
    far (exit status 130); so does a run that lost its workers (exit status 1).
    """
    require_writable(report, "--report", REPORTS)
    poses, noise, shared = files.read(given, views, arm)
    from ...validation.cross_check.run import cross_check
    from ...validation.monte_carlo.sentences import INTERRUPTED as ENDED_BY_HAND

    result = calibrated(poses, noise, shared, pairs)
    with timed("cross-check"):
        check = cross_check(
            **problem_for(result, poses, noise, shared, pairs),
            pairs=pairs,
            trials=trials,
            seed=seed,
            workers=cores() if workers is None else workers,
            posterior=posterior,
            progress=progress_wanted(),
        )
    said = ""
    if output is not None:
        from ...validation.cross_check.figure import cross_check_figure  # Matplotlib is slow to import

        table = check.to_dataframe().to_csv(index=False, lineterminator="\n")
        written = {"cross_check.json": check.to_json(), "cross_check.csv": table}
        said = deliver(output, written, {"cross_check": cross_check_figure(check)})
    if report is not None and result is not None and check.complete:
        write_report(result, report, True, check)
    emit(check.to_json() if as_json else check.to_text() + said)
    if check.ended is None:
        return 0
    return INTERRUPTED if check.ended.code == ENDED_BY_HAND else NOT_COMPLETE
