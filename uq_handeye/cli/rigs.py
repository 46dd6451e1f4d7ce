"""The commands for a rig of several cameras, targets and arms: calibrate, check, update, predict and plan."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from ..core.progress import working
from ..errors import InputError, NotConvergedError
from .delivery import deliver, deliver_answer, emit_refusal, status_of
from .messages import LOG, given_options, progress_wanted, quiet, timed, verbose, withheld
from .names import AT_THE_BOUND, PAIRINGS, ROBOT_CLASSES, SETUP_NAMES
from .noise import noise_of_rig, without_poses
from .pictures import Scene
from .pose_files import OF_FILE, values_of_files
from .printing import emit, emit_document
from .rig_files import OF_FILES, named_files
from .stored import refuse
from .values import by_names, coordinates, one_of

if TYPE_CHECKING:
    from ..calibration.rig_result import RigCalibration
    from ..calibration.tolerance import Tolerance
    from ..core.files.json_values import JsonObject
    from ..model.errors.models import Noise
    from ..model.rig.description import Rig
    from ..model.rig.noise_by_name import NoiseOfOne
    from .delivery import Outputs, ReportOptions
    from .new_poses import Data, Estimation, NewPoses
    from .pose_files import PoseFiles
    from .pose_prior import PosePriors
    from .rig_files import Described


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
    from ..calibration.rig_result import RigCalibration

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
    assert isinstance(result, RigCalibration)  # of several cameras, targets or arms
    return deliver_rig(result, wishes, tolerance, outputs, more)


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
    tolerance, named = _tolerance(files), named_files(cameras)
    reading = _reading(files, list(named))
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
    rows = read_rows(files.robot, "robot", **_reading(files, list(named))["robot"])
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


def _tolerance(files: "PoseFiles") -> float:
    """Seconds by which the time of a view may differ from that of its robot pose."""
    how = None if files.pair is None else one_of(files.pair, "--pair", PAIRINGS)
    if how == "async":
        raise InputError(
            "--pair async: not for several cameras. Put each on the clock of the robot with uq-handeye sync."
        )
    if how == "rows":
        raise InputError("--pair rows: several cameras are matched by time or pose name. Remove it.")
    if files.time_tolerance is not None and how != "time":
        raise InputError("--time-tolerance needs --pair time. Add it.")
    return 0.0 if how is None else 0.02 if files.time_tolerance is None else files.time_tolerance


def _reading(files: "PoseFiles", cameras: list[str]) -> dict[str, dict[str, Any]]:
    """Return how files are read, by robot and the names of cameras."""
    of_files = {name: values_of_files(getattr(files, name), f"--{name}", cameras) for name in OF_FILE}
    frames = values_of_files(files.camera_frame, "--camera-frame", cameras) | {"robot": files.robot_frame}
    found = {}
    for name, frame in frames.items():
        form, order = of_files["rotation"][name], of_files["quaternion"][name]
        if form is not None and order is not None:
            raise InputError(f"--rotation and --quaternion are both given for the file of {name}. Remove one of them.")
        found[name] = {"units": of_files["units"][name], "format": of_files["format"][name], "rotation": form or order,
                       "frame": frame}  # fmt: skip
    return found


def deliver_rig(
    result: "RigCalibration",
    wishes: "ReportOptions",
    tolerance: "Tolerance | None",
    outputs: "Outputs",
    more: Mapping[str, str] = MappingProxyType({}),
) -> int:
    """Print the result of a rig, write its files with ``more`` by their names, and return the exit status."""
    from ..core.files.json_files import signed_text
    from ..core.presentation.document import Paragraph, document_of
    from ..report.decision import badges_of, verdicts_of_rig

    verdicts = verdicts_of_rig(result, tolerance)
    said = [f"{name}: {verdict}" for name, verdict in verdicts.items()]
    text = "\n".join([result.text(), *said]) + "\n"
    document = [*document_of(result, verbose=verbose()), [Paragraph(one, hang="  ") for one in said]]
    written = ""
    badges = badges_of(verdicts)
    if (output := outputs.output) is not None:
        from ..report.rig_page import rig_html

        html = rig_html(result, about=wishes.about, verdicts=badges, details=wishes.details)
        files: dict[str, str | bytes] = {
            "rig.json": signed_text(result.to_dict()),
            "rig.txt": text,
            "report.html": html,
            **more,
        }
        if outputs.figures:
            from ..report.rig_page import rig_sketch

            files["rig.svg"] = rig_sketch(result).svg
        with timed(f"writing {output}"):
            written = deliver(output, files)
    if outputs.report is not None:
        with timed(f"writing {outputs.report}"):
            how = {"details": wishes.details, "paper": wishes.paper}
            written += f"\nWrote {result.report(outputs.report, about=wishes.about, verdicts=badges, **how)}\n"
    if outputs.as_json:
        from ..calibration.report.rig_sections import headline

        more_of: JsonObject = {"headline": headline(result)[0], "usable": result.usable}
        more_of |= {"answered": result.answered, "reasons": list(result.reasons)}
        more_of |= {"verdicts": {name: one.to_dict() for name, one in verdicts.items()}} if verdicts else {}
        emit(signed_text(result.to_dict() | more_of))
    elif quiet():
        rows = ((name, " ".join(map(repr, one.pose.ravel().tolist()))) for name, one in result.cameras.items())
        emit("".join(f"{name} {row}\n" for name, row in rows))
    else:
        emit_document(document)
        emit(written)
    return status_of(result, *verdicts.values())


# Options of new views of a rig.
NEW_VIEWS = (
    "ROBOT",
    "--joints",
    "--joint-units",
    *sorted(OF_FILES - {"--setup", "--noise", "--robot-noise", "--camera-noise"}),
)


def new_views(stored: "RigCalibration", new: "NewPoses") -> "Rig":
    """Return new views of a rig file, or of a file for each camera."""
    from ..read.rig.pose_rows import read_rows, views_of_files
    from ..read.rig.rig_file import read_rig
    from ..read.rig.sources import arm_poses, joint_rows

    robot, rig = new.files.robot, stored.rig
    if any(view.scene for view in rig.views):
        raise InputError(
            "The rig is by pictures of a scene, whose frame is that of one run. Calibrate the new pictures with "
            "--scene, and compare the relative poses of the cameras; or add them to the old ones."
        )
    if robot is not None and robot.suffix.lower() == ".toml":
        if new.cameras or new.joints is not None:
            raise InputError(f"{robot} names all files of the new views. Remove --camera and --joints.")
        return read_rig(robot)[0]
    if not new.cameras:
        raise InputError(
            "New views of a rig come as a rig file, e.g. today.toml, or as robot poses with --camera NAME=FILE."
        )
    arm, *others = rig.arms
    if others:
        raise InputError("The rig has several arms: give the new views as a rig file, e.g. today.toml.")
    named = named_files(new.cameras)
    tolerance, reading = _tolerance(new.files), _reading(new.files, [name.partition(":")[0] for name in named])
    rows = None if robot is None else read_rows(robot, "robot", **reading["robot"])
    if new.joints is not None:
        if (chain := rig.arms[arm].kinematics) is None:
            raise InputError(f"The arm {arm!r} was calibrated without a robot model. Remove --joints.")
        rows = joint_rows(new.joints, chain, new.joint_units, rows)
    if rows is None:
        raise InputError("--camera NAME=FILE needs the file of robot poses. Add it, e.g. robot.csv.")
    files = {}
    for name, file in named.items():
        camera, _, target = name.partition(":")
        if camera not in rig.cameras:
            raise InputError(f"--camera {name}: the rig has {', '.join(rig.cameras)}. Correct the name.")
        seen = list(dict.fromkeys(view.target for view in rig.views if view.camera == camera))
        if not target and len(seen) > 1:
            raise InputError(f"The camera {camera!r} sees {', '.join(seen)}. Give --camera {camera}:{seen[0]}=FILE.")
        files[camera, target or seen[0]] = file
    found = views_of_files(rows, arm, files, rig.cameras, rig.targets, tolerance, reading)
    if rows.joints is None:
        return found
    return replace(found, arms={arm: arm_poses(rows, rig.arms[arm].kinematics, rig.arms[arm].errors)})


def predict_into(stored: "RigCalibration", asked: Any, robot: Path | None, as_json: bool, output: Path | None) -> None:
    """Predict points of one camera of a rig in the frame of another, for ``predict``."""
    import numpy as np

    from ..read import json_text
    from ..read.rig.pose_rows import read_rows

    refuse("--of", "--into", "--point", "--robot", "--units", "--format")
    camera, point = asked.of, asked.point
    if camera is None or not point:
        raise InputError("--into needs --of CAMERA and --point X,Y,Z in the frame of that camera. Add them.")
    arms = list(stored.rig.arms)
    if robot is not None and len(arms) > 1:
        raise InputError("--robot: the rig has several arms; predict in Python with the poses of each.")
    at = None if robot is None else {arms[0]: read_rows(robot, "robot").poses}
    points = np.array([coordinates(text, "--point") for text in point])
    found = stored.predict(camera, points, at, asked.into)
    data = json_text(found.to_dict())
    head = " ".join([*(f"{name:>11}" for name in "xyz"), *(f"{f'sd {name}':>8}" for name in "xyz")])
    lines = [f"Points of {camera} in the frame {found.frame}", f"{'row':>4} {'point':>5} {head}  (mm)"]
    for i in range(len(found.points)):
        for j, (x, sd) in enumerate(zip(1e3 * found.points[i], 1e3 * found.std[i], strict=True)):
            numbers = " ".join([*(f"{value:>11.3f}" for value in x), *(f"{value:>8.3f}" for value in sd)])
            lines.append(f"{i:>4} {j:>5} {numbers}")
    deliver_answer(data, "\n".join(lines) + "\n", as_json, output, lambda: {"predictions.json": data})
