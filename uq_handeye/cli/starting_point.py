"""The calibration that a command starts from, and the data of its question."""

from contextlib import suppress
from typing import TYPE_CHECKING, Any

from ..errors import InputError, NotConvergedError
from .messages import timed, verbose, withheld

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..noise.models import Noise
    from ..poses.pose_pairs import PosePairs
    from ..shared_errors.shared_error import SharedError


def calibrated(
    poses: "PosePairs",
    noise: "Noise | None",
    shared: "list[SharedError] | None",
    pairs: str = "all",
    *,
    shows_checks: bool = True,
    **beforehand: Any,
) -> "Calibration | None":
    """Calibrate, with its warnings: every other command starts from its poses, noise and X.

    ``shows_checks``: the text of the command has the checks of the calibration, in place of warnings.

    Return None if `calibrate` refuses the data, unless X or W are known ``beforehand``: then raise its error.
    """
    from ..calibration.calibrate import calibrate

    with timed("calibrating"), suppress(*(() if beforehand else (InputError, NotConvergedError))), withheld() as shown:
        result = calibrate(poses, noise=noise, pairs=pairs, shared=shared, **beforehand)
        if result.noise is not None and shows_checks and not verbose():
            shown += result.warnings
        return result
    return None


def problem_for(
    result: "Calibration | None",
    poses: "PosePairs",
    noise: "Noise | None",
    shared: "list[SharedError] | None",
    pairs: str,
) -> dict[str, Any]:
    """Return the arguments ``data`` and ``noise`` of a question about X: the calibration, or else what was read."""
    from ..noise.models import PairNoise, PoseNoise
    from ..poses.motions import relative_motions
    from ..shared_errors.shared_error import shared_columns, with_shared

    if result is not None and result.noise is not None:
        return {"data": result}
    if isinstance(noise, PoseNoise) and shared:
        noise = with_shared(noise, shared_columns(shared, poses))
    return {"data": relative_motions(poses, pairs) if isinstance(noise, PairNoise) else poses, "noise": noise}
