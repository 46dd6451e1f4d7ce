"""Command ``diff``: how far two results differ, with the uncertainty of the difference."""

from pathlib import Path

from ..delivery import deliver_answer, refused_as_not_usable
from ..exit_status import ExitStatus
from ..printing import shown
from ..stored import OneOfRig, run_each
from .update import names_of


def diff_command(
    old: Path,
    new: Path,
    chosen: OneOfRig,
    same: list[str] | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Print how far two results differ, with uncertainty.

    Examples:
      uq-handeye diff monday.json friday.json
      # Two sessions with the same robot and the same camera
      uq-handeye diff monday.json friday.json --same robot,camera
      # One camera of a rig, or without --camera each
      uq-handeye diff monday/result.json friday/result.json --camera left

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
    from ...calibration.load import load
    from ...use.maintenance.difference import difference, difference_document

    stored = [(file, load(file)) for file in (old, new)]  # which may be one file
    if any(refused_as_not_usable(found, file, "compared") for file, found in stored):
        return ExitStatus.NOT_USABLE
    if cameras := chosen.each(old):
        return run_each(
            cameras,
            as_json,
            output,
            lambda name, folder: diff_command(old, new, chosen._replace(of_camera=name), same, as_json, folder),
        )
    found = difference(*(chosen.of(found, file) for file, found in stored), same=names_of(same, ()))
    text = found.to_json()
    deliver_answer(text, shown(difference_document(found)), as_json, output, lambda: {
        "diff.json": text, "diff.txt": found.summary()
    })  # fmt: skip
    return ExitStatus.DONE
