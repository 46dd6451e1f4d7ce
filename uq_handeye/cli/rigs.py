"""Calibration of several cameras, targets and arms by the command line: their rig, from files of each or a rig file."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from ..core.progress import working
from ..errors import InputError, NotConvergedError
from .delivery import deliver_result, emit_refusal
from .messages import LOG, given_options, progress_wanted, timed, withheld
from .names import AT_THE_BOUND, ROBOT_CLASSES, SETUP_NAMES
from .noise import noise_of_rig, without_poses
from .pictures import Scene
from .rig_files import named_files, reading_of_views, tolerance_of_views
from .values import by_names, one_of

if TYPE_CHECKING:
    from ..calibration.tolerance import Tolerance
    from ..model.errors.models import Noise
    from ..model.rig.description import Rig
    from ..model.rig.noise_by_name import NoiseOfOne
    from .delivery import Outputs, ReportOptions, deliver_result, emit_refusal
    from .new_poses import Data, Estimation
    from .pose_prior import PosePriors
    from .rig_files import Described, named_files, reading_of_views, tolerance_of_views


# Options that are not for several cameras, by the reason.
NOT_FOR_RIGS = {
    "published methods solve one A X = X B; compare RESULT --camera NAME has them": ("--pairs", "--scale", "--kind"),
    "the poses of several cameras need one unit": ("--camera-scale",),
    "they are of one camera: verify or cross-check RESULT --camera NAME, --watch on its files": (
        "--touches", "--tcp-sd", "--point-sd", "--tool", "--tool-sd", "--with-cross-check",
        "--watch", "CAMERA",
    ),
    "a rig file (rig.toml) names corners, bags and clock offsets of each camera": (
        "--images", "--board", "--square", "--pattern", "--spacing", "--marker", "--diameter", "--dictionary",
        "--first-id", "--camera-matrix", "--tag", "--pixel-noise", "--model", "--coefficients", "--intrinsics", "--roi",
        "--board-shape", "--bag", "--still", "--offset", "--image-size", "--camera-convention",
    ),
    "steps of cameras and targets are tested, drifts are not estimated": ("--correlation",),
}  # fmt: skip


def calibrate_rig_files(
    described: "Described | None",
    data: "Data",
    asked: "Estimation",
    beforehand: "PosePriors",
    wishes: "ReportOptions",
    tolerance: "Tolerance | None",
    outputs: "Outputs",
) -> int:
    """Calibrate several cameras, targets or arms, print the result and write its files; return the exit status.

    ``described``: rig and noise of a rig file; None: a file for each camera.
    """
    from ..calibration.calibrate import calibrate

    given, files = data.given, data.files
    _refuse_others()
    outputs.require_possible()
    options = asked.options()
    if options["method"] not in (None, *AT_THE_BOUND):
        raise InputError(f"--method {options['method']}: published methods solve one A X = X B. Use efficient or ml.")
    with withheld() as shown, timed("reading"):
        more: dict[str, str] = {}
        if described is None and isinstance(data.pictures, Scene):
            rig, noise, more = _of_scene(data, data.pictures)
        elif described is None:
            rig, noise = _of_cameras(data)
        else:
            rig, noise = described
            rig = _with_class(rig, given.shared.robot_class)
        rig = beforehand.of_rig(rig)
        try:
            with timed("calibrating"):
                result = calibrate(
                    rig,
                    noise=noise,
                    shared=given.shared.errors_of_rig(rig, given.file),
                    prior=given.prior,
                    exclude=files.exclude,
                    only=files.only,
                    **{name: options[name] for name in ("method", "robust", "seed", "sizes", "covariance")},
                )
        except (InputError, NotConvergedError) as error:
            return emit_refusal(error, outputs.as_json, shown)
        shown += [] if outputs.as_json else result.warnings
    result = replace(result, about=wishes.about)
    return deliver_result(result, outputs, tolerance, wishes, files=more)


def _refuse_others() -> None:
    given = given_options()
    for reason, names in NOT_FOR_RIGS.items():
        if wrong := [name for name in given if name in names]:
            raise InputError(f"{', '.join(wrong)}: not for several cameras: {reason}. Remove it.")


def _with_class(rig: "Rig", text: str | None) -> "Rig":
    """Return a rig whose arms with kinematics are of the class of --robot-class."""
    found = dict(rig.arms)
    for name, value in by_names(text, list(rig.arms), "--robot-class").items():
        for arm in [name] if name else rig.arms:
            if found[arm].kinematics is not None:
                errors = replace(found[arm].errors, robot_class=one_of(value, "--robot-class", ROBOT_CLASSES))
                found[arm] = replace(found[arm], errors=errors)
    return replace(rig, arms=found)


def _of_cameras(data: "Data") -> "tuple[Rig, Noise | Mapping[str, NoiseOfOne] | None]":
    """Return the rig of a file for each camera, and its noise."""
    from ..read.rig.pose_rows import read_rows, rig_of_files
    from ..read.rig.sources import arm_poses, joint_rows

    files, given, cameras, arm = data.files, data.given, data.robot.cameras, data.robot.arm
    setup = SETUP_NAMES[0] if files.setup is None else one_of(files.setup, "--setup", SETUP_NAMES)
    tolerance, named = tolerance_of_views(files), named_files(cameras)
    reading = reading_of_views(files, list(named))
    robot = files.robot if arm is None or arm.options.robot_file is None else arm.options.robot_file
    rows = None if robot is None else read_rows(robot, "robot", **reading["robot"])
    chain = None if arm is None else arm.kinematics
    if arm is not None and chain is not None and arm.chain.joints is not None:
        rows = joint_rows(arm.chain.joints, chain, arm.chain.joint_units, rows)
    if rows is None:
        raise InputError("--camera NAME=FILE needs the file of robot poses, or --joints. Add it, e.g. robot.csv.")
    rig = rig_of_files(rows, named, setup=setup, tolerance=tolerance, reading=reading)
    if arm is not None:
        (name,) = rig.arms
        rig = replace(rig, arms={name: arm_poses(rows, chain, arm.options.errors())})
    noise = noise_of_rig(given, list(rig.arms), list(rig.cameras))
    return rig, without_poses(given.noise, "calibrate of a rig") if noise is None else noise


def _of_scene(data: "Data", scene: Scene) -> "tuple[Rig, Noise | Mapping[str, NoiseOfOne] | None, dict[str, str]]":
    """Return the rig of cameras that see one scene, its noise, and files of the intrinsics."""
    from ..calibration.rig_by_scene import ARM, scene_rig
    from ..model.rig.description import ArmPoses
    from ..read.rig.pose_rows import read_rows
    from ..read.rig.sources import arm_poses
    from ..scene.result import intrinsics_yaml

    files, given, arm = data.files, data.given, data.robot.arm
    if scene.mask is not None:
        raise InputError("--mask: not for several cameras, whose pictures differ. Remove it.")
    if files.robot is None:
        raise InputError("--scene needs the file of robot poses. Add it, e.g. robot.csv.")
    setup = SETUP_NAMES[0] if files.setup is None else one_of(files.setup, "--setup", SETUP_NAMES)
    named = named_files(data.robot.cameras)
    rows = read_rows(files.robot, "robot", **reading_of_views(files, list(named))["robot"])
    rows = replace(rows, times=None, numbers=())  # picture k belongs to row k
    with working("the scene", progress_wanted()) as say:
        found = scene_rig({name: str(file) for name, file in named.items()}, rows.poses, setup=setup, say=say)
    for finding in found.findings:
        LOG.info("%s", finding)
    poses = ArmPoses(rows.poses, source=rows.name)
    if arm is not None:
        poses = arm_poses(rows, arm.kinematics, arm.options.errors())
    rig = replace(found.rig, arms={ARM: poses})
    noise = noise_of_rig(given, list(rig.arms), list(rig.cameras))
    texts = {f"{name}.yaml": intrinsics_yaml(found.intrinsics[name], found.image_sizes[name]) for name in named}
    return rig, without_poses(given.noise, "calibrate of a rig") if noise is None else noise, texts
