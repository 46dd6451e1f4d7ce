"""Command ``update``: a stored result with new poses added."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...core.files.locks import held
from ...errors import InputError, NotConvergedError
from ..delivery import (
    Outputs,
    ReportOptions,
    deliver_result,
    emit_refusal,
    report_options_of,
    tolerance_of,
)
from ..messages import timed, withheld
from ..new_poses import NewPoses

if TYPE_CHECKING:
    from ...calibration.tolerance import Tolerance


def update_command(
    result: Path,
    files: NewPoses,
    wishes: Annotated["ReportOptions", report_options_of],
    tolerance: Annotated["Tolerance | None", tolerance_of],
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
      uq-handeye update result/result.json today.toml -o new/

    The new result is the calibration of all poses together, with the options
    of the stored one. The order of updates does not matter. New poses that
    contradict the result are refused.

    With --about and no new poses, only the notes of the result change.

    Options (Estimation):
      * --although-changed: Update even if the new poses contradict the result.
      * --same NAMES: What is that of the result, out of robot,camera,target, or none. Default: all.
    """
    outputs.require_possible()
    from ...calibration.evidence.same_things import THINGS
    from ...calibration.load import load
    from ...use.maintenance.update import gain, update

    with _held_if_replaced(result, outputs.output):
        stored: Any = load(result)
        if wishes.about and files.nothing:
            return deliver_result(replace(stored, about=stored.about | wishes.about), outputs, tolerance, wishes)
        poses: Any = files.read(stored, str(result))
        with withheld() as said:
            try:
                with timed("updating"):
                    named = names_of(same, THINGS)
                    found: Any = update(stored, poses, although_changed=although_changed, same=named)
                said += [] if outputs.as_json else found.warnings
            except (InputError, NotConvergedError) as error:
                return emit_refusal(error, outputs.as_json, said)
        found = replace(found, about=found.about | wishes.about)
        return deliver_result(found, outputs, tolerance, wishes, more=gain(stored, found))


def names_of(same: list[str] | None, otherwise: tuple[str, ...]) -> str | tuple[str, ...]:
    """Return the names of --same, once or several times."""
    return otherwise if same is None else ",".join(same)


def _held_if_replaced(result: Path, output: Path | None) -> AbstractContextManager[None]:
    """Return the lock of a result that its update replaces: of two at once, the second starts from the first."""
    replaced = None if output is None else output / result.name
    same = replaced is not None and replaced.is_file() and result.is_file() and replaced.samefile(result)
    return held(result) if same else nullcontext()
