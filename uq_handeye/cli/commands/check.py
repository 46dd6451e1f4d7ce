"""A stored result later on: ``check`` and ``update`` by new poses, ``verify`` by touches, ``diff`` of two results.

``check --log`` adds one line to the log of the checks of a calibration.
"""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...core.files.csv_text import csv_text
from ...core.files.json_files import json_text
from ...core.files.locks import held
from ...errors import InputError, NotConvergedError
from ..delivery import (
    Outputs,
    ReportOptions,
    Wanted,
    deliver_answer,
    deliver_result,
    emit_refusal,
    report_options_of,
    wanted_of,
)
from ..exit_status import ExitStatus
from ..messages import quiet, timed, withheld
from ..new_poses import NewPoses
from ..options import UNITS, one_of, shown
from ..rigs import NEW_VIEWS, deliver_rig, new_views, refuse, stored_rig
from ..touches import TouchOptions

if TYPE_CHECKING:
    from ...core.geometry.se3 import Array
    from ...rig.checks.check import RigCheck
    from ...use.maintenance.check_result import ChangeCheck
    from ...use.verification.result import Verification


@dataclass(frozen=True)
class Asked:
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
    asked: Asked,
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
      uq-handeye check result/rig.json today.toml
      uq-handeye check result/rig.json robot.csv --camera left=left.csv

      # Every day: a log, and a figure of the whole series
      uq-handeye check result/result.json robot.csv camera.csv \\
          --log checks.csv -o today/

    One pose is enough; three or more separate the causes. The exit status is 0
    if unchanged, 4 if changed, 3 if these poses cannot tell.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for check.json and check.txt; with --log also series.png and series.svg.
    """
    from ...calibration.result import Calibration
    from ...core.presentation.document import Paragraph, document_of
    from ...model.posterior.owners import THINGS
    from ...use.maintenance.check import check
    from ...use.maintenance.log import log_check

    if (rig := stored_rig(result)) is not None:
        refuse(*NEW_VIEWS, "--tolerance", "--level", "--same", "--log")

    stored: Any = rig or Calibration.from_json(result)
    poses: Any = files.read(stored, str(result)) if rig is None else new_views(rig, files)
    with timed("checking"):
        found = check(stored, poses, tolerance=asked.tolerance, level=asked.level, same=names_of(asked.same, THINGS))
        series = None if asked.log is None else log_check(asked.log, stored, poses, found)
    text, said = found.to_json(), [*shown(document_of(found))]
    if series is not None and not quiet():
        lines = [f"Check {len(series)} of the log {asked.log}.", *series.sentences]
        said.append([Paragraph(line, hang="  ") for line in lines])

    def written() -> dict[str, Any]:
        files: dict[str, Any] = {"check.json": text, "check.txt": found.summary()}
        if series is not None:
            from ...use.maintenance.series_figure import series_figure  # Matplotlib is slow to import

            files["series"] = series_figure(series, "X" if rig is None else "move")
        return files

    deliver_answer(text, said, as_json, output, written)
    return status_of(found)


def status_of(found: "ChangeCheck | RigCheck") -> int:
    """Return the exit status of a check."""
    from ...use.maintenance.check_result import UNCHANGED

    if found.changed:
        return ExitStatus.CONTRADICTED
    return ExitStatus.DONE if found.status == UNCHANGED else ExitStatus.NOT_USABLE


def update_command(
    result: Path,
    files: NewPoses,
    wishes: Annotated["ReportOptions", report_options_of],
    wanted: Annotated["Wanted", wanted_of],
    outputs: Outputs,
    although_changed: bool = False,
    same: list[str] | None = None,
) -> int:
    """Update a stored result by new poses, one or more.

    Examples:
      uq-handeye update result/result.json robot.csv camera.csv -o new/
      # New pictures; the camera is adjusted with all of them
      uq-handeye update result/result.json robot.csv --images 'img/*.png' \\
          --board 9x6 --square 20mm -o new/
      # A rig, by new views in a rig file
      uq-handeye update result/rig.json today.toml -o new/

    The new result is the calibration of all poses together, with the options
    of the stored one. The order of updates does not matter. New poses that
    contradict the result are refused.

    Options (Estimation):
      * --although-changed: Update even if the new poses contradict the result.
      * --same NAMES: What is that of the result, out of robot,camera,target, or none. Default: all.
    """
    if (rig := stored_rig(result)) is not None:
        refuse(
            *NEW_VIEWS, "--although-changed", "--report", "--about", "--full-report", "--paper", "--tolerance", "--at"
        )
    outputs.require_possible()
    from ...calibration.result import Calibration
    from ...model.posterior.owners import THINGS
    from ...use.maintenance.update import gain, update

    with _held_if_replaced(result, outputs.output):
        stored: Any = rig or Calibration.from_json(result)
        poses: Any = files.read(stored, str(result)) if rig is None else new_views(rig, files)
        with withheld() as said:
            try:
                with timed("updating"):
                    named = names_of(same, THINGS)
                    found: Any = update(stored, poses, although_changed=although_changed, same=named)
                said += [] if outputs.as_json else found.warnings
            except (InputError, NotConvergedError) as error:
                return emit_refusal(error, outputs.as_json, said)
        if rig is not None:
            return deliver_rig(found, wishes, wanted, outputs)
        found = replace(found, about=found.about | wishes.about)
        return deliver_result(found, outputs, wanted, wishes, more=gain(stored, found, poses.n))


def names_of(same: list[str] | None, otherwise: tuple[str, ...]) -> str | tuple[str, ...]:
    """Return the names of --same, once or several times."""
    return otherwise if same is None else ",".join(same)


def _held_if_replaced(result: Path, output: Path | None) -> AbstractContextManager[None]:
    """Return the lock of a result that its update replaces: of two at once, the second starts from the first."""
    replaced = None if output is None else output / result.name
    same = replaced is not None and replaced.is_file() and result.is_file() and replaced.samefile(result)
    return held(result) if same else nullcontext()


def diff_command(
    old: Path,
    new: Path,
    same: list[str] | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Print how far two results differ, with uncertainty.

    Examples:
      uq-handeye diff monday.json friday.json
      # Two sessions with the same robot and the same camera
      uq-handeye diff monday.json friday.json --same robot,camera

    The difference of X and of the target, its standard uncertainty, and the
    probability of one as large if nothing has changed. Results with poses in
    common are refused: add new poses by update.

    Options (Estimation):
      * --same NAMES: What is the same in both, out of robot,camera,target: its errors cancel in part. Default:
        none.

    Arguments:
      OLD: Result file of before: result.json.
      NEW: Result file of now: result.json.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for diff.json and diff.txt.
    """
    from ...calibration.result import Calibration
    from ...use.maintenance.difference import difference, difference_document

    found = difference(Calibration.from_json(old), Calibration.from_json(new), same=names_of(same, ()))
    text = found.to_json()
    deliver_answer(text, shown(difference_document(found)), as_json, output, lambda: {
        "diff.json": text, "diff.txt": found.summary()
    })  # fmt: skip


def verify_command(
    result: Path,
    touching: TouchOptions,
    touches: Path | None = None,
    show: str = "0.5mm",
    candidates: Path | None = None,
    poses: tuple[Path, Path] | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Test a stored result by touching points that the camera saw.

    Examples:
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm
      # Touched with a tool whose offset is unknown; noise of the seen points
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm \\
          --point-sd 0.3mm --tool-sd unknown
      # How many touches until a bias of 1 mm would show
      uq-handeye verify result/result.json touches.csv --tcp-sd 0.2mm --show 1mm

    Exit status 4 if the touches contradict the result.

    Arguments:
      touches = TOUCHES.csv: Points seen and touched, one row each. Columns: see the page.

    Options (Touches):
      --poses ROBOT.csv CAMERA.csv: New poses in place of touches: an independent data set of the same cell.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for verification.json and points.csv (m).
      * --show LENGTH: Bias that should show, e.g. 0.5mm. The answer says how many touches it takes.
      --candidates FILE.csv: Points that could be touched next, x,y,z in the camera frame (m). Default: the region seen
        so far.
    """
    from ...calibration.result import Calibration
    from ...use.verification.verify import verify

    stored = Calibration.from_json(result)
    if (touches is None) == (poses is None):
        raise InputError("Give either TOUCHES.csv, points seen and touched, or --poses ROBOT.csv CAMERA.csv.")
    if poses is not None:
        return _by_poses(stored, poses, touching, as_json, output)
    assert touches is not None
    given = touching.read(touches, stored.kinematics)
    found = verify(stored, given, show=show, candidates=None if candidates is None else _points(candidates))
    return _deliver(found, as_json, output, {"points.csv": _csv(found)})


def _by_poses(stored: Any, poses: tuple[Path, Path], touching: TouchOptions, as_json: bool, output: Path | None) -> int:
    from ...read import read_poses
    from ...use.verification.verify_poses import verify_poses

    data = read_poses(*poses, setup=stored.setup, units=one_of(touching.units, "--units", UNITS))
    found = verify_poses(stored, data)
    return _deliver(found, as_json, output, {})


def _deliver(found: Any, as_json: bool, output: Path | None, tables: dict[str, str]) -> int:
    """Print a verification, write its files, and return the exit status."""
    from ...core.presentation.document import document_of

    text = json_text(found.to_dict())
    deliver_answer(text, shown(document_of(found)), as_json, output, lambda: {"verification.json": text, **tables})
    return ExitStatus.CONTRADICTED if found.contradicted else ExitStatus.DONE


def _points(path: Path) -> "Array":
    """Read points x, y, z (m, or the unit that the names say) of a table with a header, or of an array of NumPy."""
    import numpy as np

    from ...core.files.one_line import short
    from ...core.files.open import opened, shown
    from ...core.files.table import Places, Schema, read_table
    from ...core.formatting.units import LENGTH_UNITS
    from ...formats.columns import meaning_and_unit
    from ...formats.numpy_poses import read_one_array

    def places(names: list[str], line: str, where: str) -> Places:
        meant = [meaning_and_unit(name)[0] for name in names]
        if missing := [axis for axis in "xyz" if axis not in meant]:
            raise InputError(f"{where}: expected the header x,y,z (m), got {short(line)}: no {', '.join(missing)}.")
        return Places([meant.index(axis) for axis in "xyz"])

    with opened(path, 10_000_000) as file:
        if path.suffix == ".npy":
            return read_one_array(file.read(), shown(path))
        table = read_table(file, shown(path), Schema("the header x,y,z", "point", places))
    table.require_finite()
    units = (meaning_and_unit(table.column(k))[1] for k in range(3))
    return np.asarray(table.values * [LENGTH_UNITS[unit or "m"] for unit in units])


def _csv(found: "Verification") -> str:
    table = found.points
    head = "point,difference_x,difference_y,difference_z,distance,sd_x,sd_y,sd_z,p_value,differs"
    rows = [
        [name, *d, length, *sd, p, str(flag).lower()]
        for name, d, length, sd, p, flag in zip(
            table.names, table.difference.tolist(), table.distance.tolist(), table.std.tolist(),
            table.p_value.tolist(), table.flagged.tolist(), strict=True,
        )
    ]  # fmt: skip
    return csv_text([head.split(","), *rows])
