"""Command ``calibrate``: X with its uncertainty, as text, files and report."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from ...core.threads import cores
from ...errors import InputError, NotConvergedError
from ..delivery import (
    AllOutputs,
    ReportOptions,
    deliver_result,
    emit_refusal,
    report_options_of,
    tolerance_of,
)
from ..messages import fail, progress_wanted, timed, withheld
from ..new_poses import Data, Estimation, problem_for
from ..pose_prior import PosePriors
from ..rig_files import is_rig_file, named_camera, poses_of_rig_file, read_rig_file, several_cameras
from ..rigs import calibrate_rig_files
from ..watching import Watch, question_of, watched

if TYPE_CHECKING:
    from ...calibration.tolerance import Tolerance
    from ...trials.validation.cross_check.result import CrossCheck


def calibrate_command(
    data: Data,
    estimation: Estimation,
    beforehand: PosePriors,
    wishes: Annotated["ReportOptions", report_options_of],
    tolerance: Annotated["Tolerance | None", tolerance_of],
    outputs: AllOutputs,
) -> int:
    r"""Estimate the camera pose X and its uncertainty.

    Examples:
      # Pictures of a chessboard with 9x6 inner corners, one per robot pose
      uq-handeye calibrate robot.csv --images 'img/*.png' --board 9x6 --square 20mm
      # Camera poses from another program; joint values; a ROS bag; several cameras
      uq-handeye calibrate robot.csv camera.csv --report report.html -o result/
      uq-handeye calibrate camera.csv --joints joints.csv --urdf robot.urdf
      uq-handeye calibrate --bag cell.mcap --robot base:tool0 --camera cam:tag
      uq-handeye calibrate robot.csv --camera left=left.csv --camera right=right.csv
      uq-handeye calibrate rig.toml -o result/

    X is gripper_T_camera for eye-in-hand and base_T_camera for eye-to-hand.
    Noise that is not given is estimated from the data.

    CAMERA may be the folder written by uq-handeye camera -o. Its joint
    covariance of all camera poses is used.

    For camera poses from another program, name the target and the camera
    matrix: the camera noise then follows from the view of each pose, e.g.
    --board 9x6 --square 20mm --camera-matrix 1080,1080,960,540.

    With joint values and a robot model, the kinematic errors of the robot are
    part of the covariance. Add --robot robot.csv to compare with the controller.
    """
    given, robot, described = data.given, data.robot, None
    if is_rig_file(data.files.robot):
        described = read_rig_file(data.files)
    if several_cameras(described, robot.cameras):
        return calibrate_rig_files(described, data, estimation, beforehand, wishes, tolerance, outputs)
    outputs.require_possible()
    files, name = named_camera(data.files, robot.cameras)
    data = data._replace(files=files)
    if data.watch is not None:
        return _watch(data, estimation.options() | beforehand.options(), wishes, tolerance, outputs)
    pictures, arm, sensors = data.pictures, robot.arm, None
    if robot.bag is not None:
        sensors, pictures, arm = robot.bag.sensors_with(files, pictures, arm)
    options = estimation.options() | beforehand.options() | {"prior": given.prior}
    from ...calibration.calibrate import calibrate

    with withheld() as shown:
        if described is None:
            poses, noise, shared = files.read_open(given, pictures, arm, sensors)
            poses = replace(poses, names=poses.names if name is None else poses.names._replace(camera=name))
            options |= {} if arm is None else arm.of_calibrate
        else:
            poses, noise, shared, more = poses_of_rig_file(described, given)
            if twice := [name for name in more if options.get(name) is not None]:
                raise InputError(f"{twice[0]} is in the rig file and among the options. Remove one of them.")
            options |= more
        selection = files.selection(poses)
        try:
            with timed("calibrating"):
                result = calibrate(
                    poses,
                    noise=noise,
                    shared=shared,
                    exclude=None if selection is None else selection.excluded.tolist(),
                    **options,
                )
            result, last = data.touched.included_in(result)
            shown += [] if outputs.as_json else result.warnings
        except (InputError, NotConvergedError) as error:
            return emit_refusal(error, outputs.as_json, shown)
    result = replace(result, about=wishes.about)
    check = None
    if outputs.with_cross_check:
        check = _cross_check(problem_for(result, poses, noise, shared, estimation.pairs), estimation.seed)
    return deliver_result(result, outputs, tolerance, wishes, check=check, threshold=outputs.threshold, more=last)


def _watch(
    data: Data, options: dict[str, Any], wishes: ReportOptions, tolerance: "Tolerance | None", outputs: AllOutputs
) -> int:
    """Answer after each pose that arrives in the folder of --watch, and deliver the last result."""
    if data.robot.bag is not None:
        raise InputError("--watch takes pose files, not --bag. Calibrate the bag afterwards.")
    if data.robot.arm is not None:
        raise InputError("--watch takes no joints and no robot model. Calibrate with them afterwards.")
    if data.touched.touches is not None:
        raise InputError("--watch takes no --touches. Calibrate with the touches afterwards.")
    assert data.watch is not None
    question = question_of(data.given, data.pictures, options, tolerance)
    folder = watched(data.watch, data.files, data.pictures, outputs.output)
    found = Watch(folder, question, outputs.output, outputs.as_json).run()
    if found is None:
        return fail("No X: the poses that arrived do not determine it.")
    found = replace(found, about=wishes.about)
    return deliver_result(found, outputs, tolerance, wishes, threshold=outputs.threshold)


def _cross_check(problem: dict[str, Any], seed: int) -> "CrossCheck":
    from ...trials.validation.cross_check.run import cross_check

    with timed("cross-check"):
        check = cross_check(**problem, seed=seed, workers=cores(), progress=progress_wanted())
    if not check.complete:
        raise KeyboardInterrupt
    return check
