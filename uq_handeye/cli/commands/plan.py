"""Command ``plan``: the robot poses to measure next."""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from ...errors import InputError
from ..arm import Arm, arm_alone
from ..delivery import deliver_answer
from ..exit_status import ExitStatus
from ..messages import fail, timed
from ..names import CONTROLLER_NAMES
from ..noise import Given, given_of, require_of_poses
from ..options import names_of_options
from ..pose_files import PoseFiles
from ..stored import OneOfRig, is_result, refuse
from ..values import one_of

if TYPE_CHECKING:
    from ...use.planning.result import Plan

# The poses to take, in the folder of -o.
NEXT = "next.csv"


# The same as the controller writes them.
NEXT_AS = "next.txt"


# Further formats of several poses.
MATRICES = ("matrix", "franka")


FORMS = (*CONTROLLER_NAMES, *MATRICES)


CRITERIA = ("trace", "logdet", "point", "prediction")


class Planning(NamedTuple):
    """Options of the plan.

    Options (Planning):
      * k = -k, --count N: Number of poses to choose.
      * --candidates FILE.csv: Robot poses to choose from, or joint values with --joints. In the units of the robot
        file. Default: drawn, see --sample.
      --sample N: Number of candidates to draw, without --candidates. They view the target from near the poses so far
        (0.8 to 1.2 times the distances, 15 deg more tilt, 30 deg more roll), with the robot inside the box of its
        positions, enlarged by 15 % of its diagonal, because its reach is not known. With --joints: anywhere inside the
        joint limits.
      --seed N: Seed of the candidates drawn.
      * --criterion NAME <CRITERIA>: Criterion to minimise: trace, logdet, point or prediction. trace: mean squared
        error of points at --length from the camera; logdet: volume of the ellipsoid; point: mean squared error of
        --point; prediction (with --joints): of the target seen from the postures of --task. Default: trace, with
        --joints prediction.
      --point X,Y,Z: Point in camera coordinates, for --criterion point, e.g. 0mm,0mm,300mm.
      --length LENGTH: Distance of the points of --criterion trace. Default: RMS distance of camera and target so far.

    Options (Robot joints):
      --task FILE.csv: Joint values at which the calibration will be used. Default: postures spread over the joint
        limits.

    Options (Planning):
      --repeat: Allow a candidate to be chosen more than once.
      * --floor HEIGHT: Height in the robot's base that nothing goes below, such as 50mm or -0.2m: joints, flange,
        and what the flange carries. Default: unknown.
      * --tolerance TOLERANCE: Tolerance of X, such as 0.5mm or 1mm,0.1deg: says after how many poses X meets it
        (PASS).
    """

    k: int = 5
    candidates: Path | None = None
    sample: int = 200
    seed: int = 0
    criterion: str | None = None
    point: str | None = None
    length: str | None = None
    task: Path | None = None
    repeat: bool = False
    floor: str | None = None
    tolerance: str | None = None

    @property
    def of_plan(self) -> dict[str, Any]:
        """Arguments of `plan` that all ways to plan have."""
        point = None if self.point is None else self.point.split(",")
        names = ("criterion", "length", "sample", "seed", "repeat", "floor", "tolerance")
        return {name: getattr(self, name) for name in names} | {"point": point}

    def require_possible(self, arm: "Arm | None") -> None:
        """Raise `InputError` for options that are impossible or exclude each other."""
        for name, value, least in (("-k", self.k, 1), ("--sample", self.sample, 1), ("--seed", self.seed, 0)):
            if value < least:
                raise InputError(f"Expected {name} to be at least {least}, got {value}.")
        if self.point is not None and self.point.count(",") != 2:
            raise InputError(f"Expected --point to be X,Y,Z with units such as 0mm,0mm,300mm, got {self.point!r}.")
        if self.point is not None and self.criterion != "point":
            raise InputError(f"--point needs --criterion point, got --criterion {self.criterion or 'trace'}.")
        if arm is None and (self.task is not None or self.criterion == "prediction"):
            raise InputError("--task and --criterion prediction need --joints and --urdf.")


def plan_command(
    files: PoseFiles,
    given: Annotated["Given", given_of],
    arm: Annotated["Arm | None", arm_alone],
    planning: Planning,
    chosen: OneOfRig,
    form: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> int:
    """Choose the robot poses to measure next.

    Examples:
      uq-handeye plan robot.csv camera.csv -k 5 -o plan/
      # From poses that the robot can reach
      uq-handeye plan robot.csv camera.csv --candidates reachable.csv
      # In joint values within their limits, for predictions over the workspace
      uq-handeye plan camera.csv --joints joints.csv --urdf robot.urdf
      # Which view of a rig next, and by which camera
      uq-handeye plan result/result.json -k 5
      # Next poses of a stored result, or of one camera of a rig
      uq-handeye plan result/result.json --camera left --criterion logdet

    Prints the standard deviations of X predicted after each pose, to first
    order in the noise.

    Reach and obstacles are not known. Check each pose before you drive there.
    Poses that contradict each other are no start of a plan: the exit status is 3.

    Options (Planning):
      form = --as NAME <FORMS>: Controller in whose form the poses are printed and written: {CONTROLLER_NAMES}; or
        matrix or franka, written as matrices. Default: the format of the robot file.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for {NEXT} and plan.json. {NEXT} holds the robot poses in order (m),
        with --joints the joints (rad). {NEXT_AS} holds them as the controller writes them, where --as or the robot file
        names one.
    """
    if files.robot is not None and is_result(files.robot):
        return _plan_of_result(files.robot, chosen, planning, form, as_json, output)
    if chosen != OneOfRig():
        raise InputError("--camera and --target need the result of a rig in place of ROBOT. Remove them.")
    from ...calibration.findings import check_input
    from ...findings import warn
    from ...model.kinematics.joints_file import read_joints
    from ...read.robot_poses import read_robot_poses
    from ...use.planning.plan import plan

    planning.require_possible(arm)
    poses, noise, shared = files.read_kept(given, None, arm)
    of_arm: dict[str, Any] = {}
    if arm is None:
        like = poses.sources[0].format if poses.sources else None
        of_robot = {"units": files.both_units[0], "format": files.formats[0], "rotation": files.rotations[0]}
        rows = None if planning.candidates is None else read_robot_poses(planning.candidates, like, **of_robot)[1]
    else:
        units, chain = arm.chain.joint_units, arm.kinematics
        rows = None if planning.candidates is None else read_joints(planning.candidates, chain, units).q
        of_arm = {
            "task": None if planning.task is None else read_joints(planning.task, chain, units).q
        } | arm.of_calibrate
    noise = require_of_poses(noise, "plan")
    with timed("checking the input"), suppress(InputError):  # plan() may do with what calibrate() refuses
        warn(check_input(poses, noise))
    with timed("planning"):
        found = plan(
            poses,
            rows,
            planning.k,
            noise=noise,
            shared=shared,
            prior=given.prior,
            **planning.of_plan,
            **of_arm,
        )
    if found.contradictions:
        return _not_usable("The calibration of these poses", found.contradictions)
    return _deliver(found, form, as_json, output)


def _not_usable(name: object, contradictions: tuple[str, ...]) -> int:
    """Say why nothing is planned, and return the exit status."""
    fail(f"{name} is NOT USABLE, so nothing was planned: {contradictions[0].rstrip('.')}. Calibrate again.")
    return ExitStatus.NOT_USABLE


def _plan_of_result(
    file: Path, chosen: OneOfRig, planning: Planning, form: str | None, as_json: bool, output: Path | None
) -> int:
    """Plan from the posterior of a stored result: of all cameras together, or of the one that was chosen."""
    from ...calibration.load import load
    from ...read.robot_poses import read_robot_poses
    from ...use.planning.plan import plan

    refuse("--as", *names_of_options(Planning), what="a stored result")
    planning.require_possible(None)
    stored = load(file)
    if stored.contradictions:
        return _not_usable(file, stored.contradictions)
    known = stored if chosen == OneOfRig() else chosen.of(stored, file)
    rows: Any = None
    if planning.candidates is not None:
        arm, *others = known.arms
        if others:
            raise InputError("--candidates: the rig has several arms; plan in Python with the candidates of each.")
        rows = {arm: read_robot_poses(planning.candidates, None)[1]}
    with timed("planning"):
        found = plan(known, rows, planning.k, **planning.of_plan)
    return _deliver(found, form, as_json, output)


def _deliver(found: "Plan", form: str | None, as_json: bool, output: Path | None) -> int:
    if form is not None:
        if found.joints is not None:
            raise InputError("--as applies to poses, not to joints. Remove it.")
        found = replace(found, form=one_of(form, "--as", FORMS))

    def written() -> dict[str, str]:
        more = {} if found.form is None else {NEXT_AS: found.to_controller()}
        several = len(found.robots) > 1
        poses = {f"next_{arm}.csv" if several else NEXT: found.to_csv(arm=arm) for arm in found.robots}
        return {**poses, "plan.json": found.to_json(), **more}

    deliver_answer(found.to_json(), found.to_text(), as_json, output, written)
    return ExitStatus.DONE
