"""Command ``check``: whether a stored result still holds, by new poses; ``--log`` adds a line to a log of checks."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..delivery import deliver_answer, refused_as_not_usable
from ..exit_status import ExitStatus
from ..messages import quiet, timed
from ..new_poses import NewPoses
from ..printing import shown
from .update import names_of

if TYPE_CHECKING:
    from ...use.maintenance.check_result import ChangeCheck


class CheckOptions(NamedTuple):
    """Options of the question.

    Options (Output):
      * --tolerance MM,DEG: Change of X that matters, e.g. 1mm,0.1deg. Poses that would miss it cannot tell. Default: 1
        % of the target distance, and 0.57 deg.
      * --level P: Probability of a false alarm.
      --same NAMES: What is the same as at the calibration, out of robot,camera,target: its errors are the same too. Of
        a rig also its own names. Default: all.

    Options (Series of checks):
      * --log FILE.csv: Log of the checks of this calibration, to which one line is added. Made if there is none.
    """

    tolerance: str | None = None
    level: float = 0.05
    log: Path | None = None
    same: list[str] | None = None


def check_command(
    result: Path,
    files: NewPoses,
    wanted: CheckOptions,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Check whether a stored calibration still holds, by new poses.

    Examples:
      uq-handeye check result/result.json robot.csv camera.csv
      # Must a change of 1 mm or 0.1 deg show?
      uq-handeye check result/result.json robot.csv camera.csv \\
          --tolerance 1mm,0.1deg
      # New pictures, with the intrinsics of the calibration
      uq-handeye check result/result.json robot.csv --images 'img/*.png' \\
          --board 9x6 --square 20mm
      # A rig, by new views in a rig file, or in a file for each camera
      uq-handeye check result/result.json today.toml
      uq-handeye check result/result.json robot.csv --camera left=left.csv

      # Every day: a log, and a figure of the whole series
      uq-handeye check result/result.json robot.csv camera.csv \\
          --log checks.csv -o today/

    One pose is enough; three or more separate the causes. The exit status is 0
    if unchanged, 4 if changed, 3 if these poses cannot tell, or something moved
    among them.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for check.json and check.txt; with --log also series.png and series.svg.
    """
    from ...calibration.evidence.same_things import THINGS
    from ...calibration.load import load
    from ...core.presentation.document import Paragraph, document_of
    from ...use.maintenance.check import check
    from ...use.maintenance.log import log_check

    stored = load(result)
    if refused_as_not_usable(stored, result, "checked"):
        return ExitStatus.NOT_USABLE
    poses = files.read(stored, str(result))
    with timed("checking"):
        found = check(stored, poses, tolerance=wanted.tolerance, level=wanted.level, same=names_of(wanted.same, THINGS))
        series = None if wanted.log is None else log_check(wanted.log, stored, poses, found)
    text, said = found.to_json(), [*shown(document_of(found))]
    if series is not None and not quiet():
        lines = [f"Check {len(series)} of the log {wanted.log}.", *series.sentences]
        said.append([Paragraph(line, hang="  ") for line in lines])

    def written() -> dict[str, Any]:
        files: dict[str, Any] = {"check.json": text, "check.txt": found.summary()}
        if series is not None:
            from ...use.maintenance.series_figure import series_figure  # Matplotlib is slow to import

            files["series"] = series_figure(series, "move" if stored.one_of_each is None else "X")
        return files

    deliver_answer(text, said, as_json, output, written)
    return status_of(found)


def status_of(found: "ChangeCheck") -> int:
    """Return the exit status of a check."""
    from ...use.maintenance.check_result import UNCHANGED

    if found.changed and found.moved_since is None:
        return ExitStatus.CONTRADICTED
    return ExitStatus.DONE if found.status == UNCHANGED else ExitStatus.NOT_USABLE
