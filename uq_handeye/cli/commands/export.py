"""Command ``export``: X for other programs."""

from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from ..delivery import refused_as_not_usable, status_of
from ..exit_status import ExitStatus
from ..messages import LOG
from ..names import CONTROLLER_NAMES, CONVENTION_NAMES
from ..printing import emit
from ..values import one_of, require_writable

if TYPE_CHECKING:
    from ...calibration.load import Result

# Names of export.FORMATS, repeated here so that help and completion load quickly.
EXPORT_NAMES = (
    *("json", "ros", "launch", "urdf", "opencv", "npz"),
    *CONTROLLER_NAMES,
    *("matrix", "franka", "zivid", "halcon"),
)


def export_command(
    result: Path,
    file: Path,
    format: str | None = None,
    corrects: Path | None = None,
    covariance_convention: str | None = None,
    camera: str | None = None,
    target: str | None = None,
) -> int:
    """Export X for ROS, URDF, OpenCV, NumPy, or as a robot writes it.

    Examples:
      uq-handeye export result/result.json x.urdf
      uq-handeye export result/result.json handeye.yaml --format ros
      # ROS 2 launch file that publishes X as a static transform
      uq-handeye export result/result.json handeye.launch.py
      # As a KUKA writes a frame: X, Y, Z in mm, A, B, C in deg
      uq-handeye export result/result.json x.dat --format kuka
      # All poses of a rig, with the relative poses of its cameras
      uq-handeye export result/result.json cameras.launch.py
      # One camera of a rig, or X after a move that was found from pose 13 on
      uq-handeye export result/result.json left.urdf --camera left
      uq-handeye export result/result.json x.urdf --camera camera@13
      # URDF of the arm, with the estimated errors corrected
      uq-handeye export result/result.json new.urdf --corrects robot.urdf

    Arguments:
      FILE: File to write, e.g. x.urdf.

    Options (Output):
      * --format NAME <EXPORT_NAMES>: Format: {EXPORT_NAMES}; of a rig json, ros, launch, urdf, opencv, toml or npz.
        Default: by the suffix of FILE.
      * --corrects ROBOT.urdf: URDF of the calibrated arm, to write with its errors corrected. Corrects the errors that
        are known (standard deviation below half of the prior) and writes their covariance as JSON.
      * --camera NAME: Camera to write, of a rig or of the fit before and after a move. Default: all, or X.
      * --target NAME: Target to write, in place of a camera.
      --covariance-convention NAME <CONVENTION_NAMES>: Convention of the covariances in files of OpenCV and NPZ, e.g.
        gtsam. Default: toolkit.
    """
    from ...calibration.load import load
    from ...calibration.result import Calibration

    require_writable(file, "FILE")
    if corrects is not None:
        if format is not None:
            raise InputError("--format applies to X, not to the URDF of --corrects. Remove it.")
        found = Calibration.from_json(result).export_urdf(file, corrects)
        emit(f"Wrote {file} and {file.with_suffix('.corrections.json')}. {found.summary}\n")
        return 0
    name = None if format is None else one_of(format, "--format", (*EXPORT_NAMES, "toml"))
    stored = load(result)
    if camera is not None or target is not None:
        return _write_one(stored, result, file, name, camera, target, covariance_convention)
    convention = one_of(covariance_convention or "toolkit", "--covariance-convention", CONVENTION_NAMES)
    if refused_as_not_usable(stored, result, "exported"):
        return ExitStatus.NOT_USABLE
    emit(f"Wrote {stored.export(file, name, covariance_convention=convention)}\n")
    if not stored.usable:
        LOG.warning(
            "X is known in part. Not determined: %s. What was written holds one of all X that fit.",
            "; ".join(stored.open_words),
        )
    return status_of(stored)


def _write_one(
    stored: "Result",
    result: Path,
    file: Path,
    format: str | None,
    camera: str | None,
    target: str | None,
    convention: str | None,
) -> int:
    """Write one camera or target: of the fit before and after a move where there was one."""
    from ...calibration.one_pose import OnePose
    from ...formats.export import write_export

    if camera is not None and target is not None:
        raise InputError("--camera and --target are both given. Remove one of them.")
    what, asked = ("camera", camera) if target is None else ("target", target)
    of_kind = stored.cameras if what == "camera" else stored.targets
    if not stored.split and refused_as_not_usable(stored, result, "exported"):
        return ExitStatus.NOT_USABLE
    known = {one.name: one for one in stored.split if one.name.partition("@")[0] in of_kind} or dict(of_kind)
    if asked not in known:
        raise InputError(f"Expected --{what} to be one of {', '.join(known)}, got {asked!r}.")
    chosen = one_of(convention or "toolkit", "--covariance-convention", CONVENTION_NAMES)
    emit(f"Wrote {write_export(OnePose(known[asked]), file, format, chosen)}\n")
    return ExitStatus.DONE
