"""Input of the commands that calibrate first, and of those that compare new poses with a stored calibration.

New poses have the setup, the arm and the camera of the stored calibration.
"""

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from ..errors import InputError, NotConvergedError
from .arm import Arm, ChainOptions, ErrorOptions, arm_alone, split_sizes
from .bag_files import RobotGiven, given_of_robot
from .boards import KINDS as BOARDS
from .boards import BoardOptions
from .messages import given_options, timed, verbose, withheld
from .names import AT_THE_BOUND, COVARIANCE_NAMES, PUBLISHED, ROBOT_WORLD
from .noise import Given, given_of, noise_of
from .options import names_of_options
from .pictures import LensOptions, Pictures, Scene, pictures_of
from .pose_files import PoseFiles
from .pose_prior import pose_prior_of
from .rig_files import (
    OF_FILES,
    is_rig_file,
    named_camera,
    named_files,
    read_rig_file,
    reading_of_views,
    tolerance_of_views,
)
from .stored import EVERYWHERE, OneOfRig, is_result
from .touches import TouchesToUse
from .values import naming_option, one_of
from .views import Views, views_of

if TYPE_CHECKING:
    from ..calibration.load import Result
    from ..calibration.result import Calibration
    from ..calibration.rig_result import RigCalibration
    from ..model.errors.models import Noise
    from ..model.errors.sizes import Size
    from ..model.poses.pose_pairs import PosePairs
    from ..model.rig.description import Rig
    from ..model.shared_errors.shared_error import SharedError


class NewPoses(NamedTuple):
    """Options of the files of new poses.

    Options (Pose files):
      bag_camera = --camera NAME=FILE: Poses by one of the cameras of a rig, NAME:TARGET=FILE of one of its targets.
        Repeat it for each.

    Options (Pictures of a board):
      * --images 'PATTERN': New pictures in place of CAMERA, e.g. 'img/*.png'. One per row of ROBOT, by the camera of
        the calibration; for a calibration from pictures.
      * --scene: The pictures are of the scene of the calibration, no board.

    Options (Robot joints):
      * --joints FILE.csv: Joint values at the new poses, for a calibration with --joints. In place of ROBOT, or with
        it.
    """

    files: PoseFiles
    board: BoardOptions
    images: str | None = None
    scene: bool = False
    joints: Path | None = None
    joint_units: str | None = None
    bag_camera: list[str] | None = None

    @property
    def cameras(self) -> tuple[str, ...]:
        """NAME=FILE of several cameras."""
        return tuple(self.bag_camera or ())

    @property
    def nothing(self) -> bool:
        """Return whether no new poses are given."""
        return (self.files.robot, self.files.camera, self.images, self.joints) == (None,) * 4 and not self.cameras

    def read(self, stored: Any, name: str) -> "PosePairs | Rig":
        """Return the new measurements that a result in the file ``name`` is held against: poses, or views by names."""
        if stored.one_of_each is None:
            return new_views(stored, self)
        return self._side_by_side(stored, name)

    def _side_by_side(self, stored: "Calibration", name: str) -> "PosePairs":
        """Return the poses; the setup is that of the calibration unless one is given."""
        files, camera = named_camera(self.files, self.cameras)
        if camera not in (None, stored.names.camera):
            raise InputError(f"--camera {camera}: {name} has the camera {stored.names.camera!r}. Correct the name.")
        if is_rig_file(files.robot):
            from ..model.rig.single import poses_like

            return poses_like(read_rig_file(files)[0], stored.names)
        if files.setup is None and stored.setup is not None:
            files = replace(files, setup=stored.setup)
        return files.read_new(self._pictures(stored, name), self._arm(stored, name))

    def _arm(self, stored: "Calibration", name: str) -> Arm | None:
        if self.joints is None:
            if self.joint_units is not None:
                raise InputError("--joint-units needs --joints. Remove it.")
            return None
        if stored.kinematics is None:
            raise InputError(f"{name} holds no joints: it was not calibrated with --joints. Remove --joints.")
        chain = ChainOptions(joints=self.joints, joint_units=self.joint_units)
        return Arm(chain, ErrorOptions(), stored.kinematics.chain)

    def _pictures(self, stored: "Calibration", name: str) -> Pictures | None:
        if self.images is None:
            if given := [*self.board.given, *(["--scene"] if self.scene else [])]:
                raise InputError(f"{', '.join(given)}: needs pictures. Add --images 'PATTERN'.")
            return None
        if self.scene or getattr(stored.data, "scene", None) is not None:
            if given := self.board.given:
                raise InputError(f"{', '.join(given)}: {name} is by pictures of a scene, no board. Remove the option.")
            return Scene(self.images, self.board, LensOptions(), later_than=stored)
        camera = getattr(stored.data, "camera_calibration", None)
        if camera is None:
            raise InputError(
                f"{name} holds no camera: it was not calibrated from pictures. Give camera poses by the same "
                "intrinsics as then."
            )
        return Pictures(self.images, self.board, LensOptions(), of_result=camera)


# Options of new views of a rig.
NEW_VIEWS = (
    "ROBOT",
    "--joints",
    "--joint-units",
    *sorted(OF_FILES - {"--setup", "--noise", "--robot-noise", "--camera-noise"}),
)


def new_views(stored: "RigCalibration", new: NewPoses) -> "Rig":
    """Return new views of a rig file, or of a file for each camera."""
    from ..read.rig.pose_rows import read_rows, views_of_files
    from ..read.rig.rig_file import read_rig
    from ..read.rig.sources import arm_poses, joint_rows

    of_files = names_of_options(NewPoses) | {"CAMERA"}
    if wrong := [name for name in given_options() if name in of_files - {*NEW_VIEWS, *EVERYWHERE}]:
        raise InputError(f"{', '.join(wrong)}: not for the result of a rig. Remove it.")
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
    tolerance = tolerance_of_views(new.files)
    reading = reading_of_views(new.files, [name.partition(":")[0] for name in named])
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


class Session(NamedTuple):
    """The poses of a command that calibrates first, with the declared noise and shared errors."""

    files: PoseFiles
    given: Annotated[Given, given_of]
    views: Annotated[Views | None, views_of]
    arm: Annotated[Arm | None, arm_alone]
    chosen: OneOfRig

    def of_camera(self, name: str) -> "Session":
        """Return the same of one camera of the result of a rig."""
        return self._replace(chosen=self.chosen._replace(of_camera=name))

    def each(self) -> list[str]:
        """Return the cameras of the result of a rig in place of ROBOT, where it has several and none is chosen."""
        return self.chosen.each(self.files.robot)

    def whole(self) -> "Result | None":
        """Return the result in place of ROBOT with all its cameras; None for files of poses."""
        from ..calibration.load import load

        file = self.files.robot
        return load(file) if file is not None and is_result(file) else None

    def stored(self) -> "Calibration | None":
        """Return the result in place of ROBOT, of a rig one camera; None for files of poses."""
        file = self.files.robot
        if file is None or not is_result(file):
            if self.chosen != OneOfRig():
                raise InputError("--camera and --target need the result of a rig in place of ROBOT. Remove them.")
            return None
        of_data = names_of_options(PoseFiles, given_of, views_of, arm_alone, pose_prior_of) | {"CAMERA"}
        if wrong := [name for name in given_options() if name in of_data]:
            raise InputError(f"{', '.join(wrong)}: a stored result has its poses and noise. Remove it.")
        found = self.chosen.read(file)
        if found.counted is None or found.noise is None:
            raise InputError(f"{file} holds no poses with their noise. Calibrate again.")
        return found

    def read(self) -> "tuple[PosePairs, Noise | None, list[SharedError] | None]":
        """Return poses, noise and shared errors; those of a result in place of ROBOT."""
        if (found := self.stored()) is not None:
            poses: Any = found.counted
            return poses, found.noise, None
        return self.files.read(self.given, self.views, self.arm)

    def calibrated(
        self, pairs: str, of_motions: str | None = None, *, shows_checks: bool = True, **beforehand: Any
    ) -> "tuple[Calibration | None, dict[str, Any]]":
        """Calibrate the poses; return the result, and the arguments of a computation from X (`problem_for`).

        ``shows_checks``: the text of the command contains the checks of the calibration, in place of warnings.
        ``of_motions``: the value of ``pairs`` where the noise is that of motions.
        ``beforehand``: priors of X or W. With them an error of `calibrate` is raised; without, the result is None.
        """
        from ..calibration.calibrate import calibrate

        if (stored := self.stored()) is not None:
            return stored, {"data": stored}
        poses, noise, shared = self.read()
        pairs = of_motions if of_motions is not None and noise is not None and noise.ITEM == "motion" else pairs
        result: Calibration | None = None
        refused = () if beforehand else (InputError, NotConvergedError)
        with timed("calibrating"), suppress(*refused), withheld() as shown:
            result = calibrate(poses, noise=noise, pairs=pairs, shared=shared, **beforehand)
            if result.noise is not None and shows_checks and not verbose():
                shown += result.warnings
        return result, problem_for(result, poses, noise, shared, pairs)


def problem_for(
    result: "Calibration | None",
    poses: "PosePairs",
    noise: "Noise | None",
    shared: "list[SharedError] | None",
    pairs: str,
) -> dict[str, Any]:
    """Return the arguments ``data`` and ``noise`` of a computation from X: of the calibration, or else as read."""
    from ..model.errors.models import PairNoise
    from ..model.poses.motions import relative_motions
    from ..model.shared_errors.in_noise import shared_columns, with_shared

    if result is not None and result.noise is not None:
        return {"data": result}
    if isinstance(noise, PairNoise):
        return {"data": relative_motions(poses, pairs), "noise": noise}
    if noise is not None and shared:
        noise = with_shared(noise, shared_columns(shared, poses))
    return {"data": poses, "noise": noise}


METHODS = (*AT_THE_BOUND, *PUBLISHED, *ROBOT_WORLD)
OF_DATA = COVARIANCE_NAMES[1:]


class Data(NamedTuple):
    """Data of a calibration, as they are given.

    Options (Pose files):
      --watch DIR: Folder in which poses arrive one by one: an answer after each, with the pose to take next. Growing
        files robot.csv and camera.csv, or files robot* and camera* with a pose each, or files that hold both sides
        (JSON); with --images 'DIR/*.png' robot* alone. Ends at PASS of --tolerance, or with Ctrl-C.
    """

    files: PoseFiles
    pictures: Annotated[Pictures | Views | None, pictures_of]
    given: Annotated[Given, noise_of]
    robot: Annotated[RobotGiven, given_of_robot]
    touched: TouchesToUse
    watch: Path | None = None


class Estimation(NamedTuple):
    """Options of the estimate.

    Options (Estimation):
      * --method NAME <METHODS>: Estimator. One of {METHODS}. Default: efficient.

      --scale D: Scaling factor d of 4dpa. Default: its limit, in closed form.
      --kind NAME <poses|pairs|literal>: Noise propagation of published methods: poses, pairs, or literal (noise of
        pairs).
      --covariance NAME <COVARIANCE_NAMES>: Covariance of X: model, or one that needs no noise model: {OF_DATA}.
      --robust/--no-robust: Down-weighting of outliers. Default: on from 5 poses.
      --correlation NAME <auto|none>: Correlated errors of neighbouring poses (drift): auto (estimated and included in
        the covariance) or none (independent poses).
      --camera-scale NAME <unknown>: Scale of the camera poses: unknown for visual SLAM and structure from motion, whose
        lengths have no unit. Default: metres.
      --seed N: Seed of random subsets, bootstrap and cross-check.
    """

    method: str | None = None
    size: list[str] | None = None
    pairs: str = "all"
    scale: float | None = None
    kind: str | None = None
    covariance: str = "model"
    robust: bool | None = None
    correlation: str = "auto"
    camera_scale: str | None = None
    seed: int = 0

    def options(self) -> dict[str, Any]:
        """Return the options as arguments of `calibrate`."""
        if self.kind in BOARDS:
            raise InputError(
                f"--kind is that of the noise propagation. Name the kind of the board as --pattern {self.kind}."
            )
        scale = None if self.camera_scale is None else one_of(self.camera_scale, "--camera-scale", ("unknown",))
        found = {name: getattr(self, name) for name in ("pairs", "scale", "kind", "robust", "seed")}
        return found | {
            "method": None if self.method is None else one_of(self.method, "--method", METHODS),
            "covariance": one_of(self.covariance, "--covariance", COVARIANCE_NAMES),
            "correlation": one_of(self.correlation, "--correlation", ("auto", "none")),
            "camera_scale": scale,
            "sizes": _sizes_of(split_sizes(self.size)[1]),
        }


def _sizes_of(texts: list[str]) -> "dict[str, Size] | None":
    """Return the sizes of --size by name."""
    from ..model.errors.sizes import parse_size

    with naming_option("--size"):
        found = dict(parsed := [parse_size(text) for text in texts])
        if len(found) < len(parsed):
            raise InputError("Expected one size of each error, got two of one name.")
    return found or None
