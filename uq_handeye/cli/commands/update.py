"""Commands ``update`` and ``diff``: a stored result with new poses, and how far two results differ."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from ...core.files.atomic import held
from ...errors import InputError, NotConvergedError
from ..delivery import Outputs, ReportOptions, deliver, deliver_result, report_options_of
from ..messages import quiet, timed, withheld
from ..new_poses import NewPoses, new_poses_of
from ..options.common import emit, emit_document, made_of
from ..outcome import Wanted, emit_refusal, wanted_of
from ..rigs.in_use import stored_rig, update_stored_rig


@made_of(files=new_poses_of, wishes=report_options_of, wanted=wanted_of, outputs=Outputs)
def update_command(
    result: Path,
    files: "NewPoses",
    wishes: "ReportOptions",
    wanted: "Wanted",
    outputs: "Outputs",
    although_changed: bool = False,
    same: str | None = None,
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
        return update_stored_rig(rig, files.files.robot, although_changed, wishes, wanted, outputs)
    outputs.require_possible()
    from ...calibration.result import Calibration
    from ...model.posterior.owners import THINGS
    from ...use.maintenance.update import gain, update

    with _held_if_replaced(result, outputs.output):
        stored = Calibration.from_json(result)
        poses = files.read(stored, str(result))
        with withheld() as shown:
            try:
                with timed("updating"):
                    found = update(stored, poses, although_changed=although_changed, same=names_of(same) or THINGS)
                shown += [] if outputs.as_json else found.warnings
            except (InputError, NotConvergedError) as error:
                return emit_refusal(error, outputs.as_json, shown)
        found = replace(found, about=found.about | wishes.about)
        return deliver_result(found, outputs, wanted, wishes, more=gain(stored, found, poses.n))


def names_of(same: str | None) -> list[str]:
    """Return the names of --same."""
    return [] if same is None else [name.strip() for name in same.split(",") if name.strip()]


def _held_if_replaced(result: Path, output: Path | None) -> AbstractContextManager[None]:
    """Return the lock of a result that its update replaces: of two at once, the second starts from the first."""
    replaced = None if output is None else output / "result.json"
    same = replaced is not None and replaced.is_file() and result.is_file() and replaced.samefile(result)
    return held(result) if same else nullcontext()


def diff_command(
    old: Path,
    new: Path,
    same: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Print how far two results differ, with uncertainty.

    Examples:
      uq-handeye diff old/result.json new/result.json
      # Two sessions with the same robot and the same camera
      uq-handeye diff monday.json friday.json --same robot,camera

    The difference of X and of the target, its standard uncertainty, and the
    probability of one as large if nothing has changed. Poses that both results
    hold count once.

    Options (Estimation):
      * --same NAMES: What is the same in both, out of robot,camera,target: its errors cancel in part. Default: all
        three if the results have poses in common.

    Arguments:
      OLD: Result file of before: result.json.
      NEW: Result file of now: result.json.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for diff.json and diff.txt.
    """
    from ...calibration.result import Calibration
    from ...use.maintenance.difference import difference, difference_document

    found = difference(Calibration.from_json(old), Calibration.from_json(new), same=names_of(same))
    if as_json:
        emit(found.to_json())
    else:
        document = list(difference_document(found))
        first = document[0]
        emit_document([[first[0]]] if quiet() and isinstance(first, list) else document)
    if output is not None:
        written = deliver(output, {"diff.json": found.to_json(), "diff.txt": found.summary()})
        if not as_json:
            emit(written)
