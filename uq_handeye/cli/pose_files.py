"""Options of two files of poses, and how they are read: as streams, or paired."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core.files.lines import floats
from ..core.limits import MIN_POSES
from ..errors import InputError, InputWarning
from .arm import Arm
from .messages import LOG, command_line, timed
from .names import CAMERA_CONVENTIONS as CONVENTIONS
from .names import CAMERA_FRAMES, PAIRINGS, ROBOT_FRAMES, SETUP_NAMES
from .noise import EXACT, Given, without_poses
from .values import one_of

if TYPE_CHECKING:
    from ..core.geometry.conventions import CovarianceReading
    from ..model.errors.models import Noise
    from ..model.poses.pose_numbers import Selection
    from ..model.poses.pose_pairs import PosePairs
    from ..model.poses.stream import Stream
    from ..model.shared_errors.shared_error import SharedError
    from ..read.rosbag.sensors import Sensors
    from ..read.synchronisation.result import Synchronised
    from .pictures import Pictures
    from .views import Views


# Options that may name a value for each of the two files.
OF_FILE = ("format", "units", "rotation", "quaternion")
SIDES = ("robot", "camera")


def values_of_files(text: str | None, option: str, cameras: Sequence[str]) -> dict[str, str | None]:
    """Return the values of an option for the robot file and the files of cameras by name.

    ``VALUE`` is for all files, ``camera=VALUE`` for all cameras, ``NAME=VALUE`` for the camera of that name.
    """
    if text is None or "=" not in text:
        return dict.fromkeys(("robot", *cameras), text)
    found: dict[str, str | None] = {}
    for part in text.split(","):
        side, _, value = (word.strip() for word in part.partition("="))
        if side not in (*SIDES, *cameras) or side in found or not value:
            raise InputError(
                f"Expected {option} to be VALUE or NAME=VALUE of {', '.join(('robot', *cameras))}, got {text!r}."
            )
        found[side] = value
    return {"robot": found.get("robot")} | {name: found.get(name, found.get("camera")) for name in cameras}


def of_sides(text: str | None, option: str) -> tuple[str | None, str | None]:
    """Return the values for the robot file and the camera file of an option: ``VALUE`` or ``robot=VALUE,camera=VALUE``.

    A side that is not named has None. Raises `InputError` for another side, or one that is named twice.

    >>> of_sides("mm", "--units"), of_sides("camera=mm", "--units")
    (('mm', 'mm'), (None, 'mm'))
    """
    if text is None or "=" not in text:
        return text, text
    found: dict[str, str] = {}
    for part in text.split(","):
        side, _, value = (word.strip() for word in part.partition("="))
        if side not in SIDES or side in found or not value:
            raise InputError(f"Expected {option} to be VALUE or robot=VALUE,camera=VALUE, got {text!r}.")
        found[side] = value
    return found.get("robot"), found.get("camera")


@dataclass(frozen=True)
class StreamFiles:
    """Options of the files of robot and camera poses.

    Arguments:
      ROBOT: Robot poses: file, folder or 'PATTERN' as the robot writes it, or CSV. The format is told by the content or
        by --format; CSV is timestamp,x,y,z,qx,qy,qz,qw in m. Poses are base_T_gripper unless --robot-frame says
        otherwise. Or one file that holds both sides.
      CAMERA: Camera poses, or folder of camera -o or points -o. camera_T_target, row by row as in ROBOT unless --pair
        says otherwise.

    Options (Pose files):
      * --setup NAME <SETUP_NAMES>: Camera mount: eye-in-hand (default) or eye-to-hand. eye-in-hand: on the gripper;
        eye-to-hand: in the cell. A pose file may state it, too.
      --format NAME <FORMAT_NAMES>: Format of both files, or of each: robot=tum,camera=csv. One of {FORMAT_NAMES}.
        Default: detected.
      * --units UNIT <UNITS>: Length unit of both files. Or of each: robot=mm,camera=m. One of {UNITS}. Default: of the
        format. If that says none: m.
      --rotation FORM: Rotations of both files, or of each: robot=ZYX-deg,camera=wxyz. Euler angles by their axes and
        unit (ZYX-deg: rotated axes; xyz-rad: fixed axes), rotvec-rad, rotvec-deg, xyzw, wxyz, or transposed matrices.
        Default: as the format says.
      --quaternion ORDER <xyzw|wxyz>: Quaternion order of both files, or of each: robot=wxyz. xyzw, or wxyz (scalar
        first). Default: that of the format.
      --robot-frame FRAME <ROBOT_FRAMES>: Direction of the robot poses: base_T_gripper or gripper_T_base.
      --camera-frame FRAME <CAMERA_FRAMES>: Direction of the camera poses: camera_T_target or target_T_camera.
      --offset SECONDS: Clock offset of unsynchronised streams (robot minus camera, s), taken as exact, or OFFSET,STD.
        Default: estimated.
    """

    robot: Path | None = None
    camera: Path | None = None
    setup: str | None = None
    format: str | None = None
    units: str | None = None
    rotation: str | None = None
    quaternion: str | None = None
    robot_frame: str = ROBOT_FRAMES[0]
    camera_frame: str = CAMERA_FRAMES[0]
    offset: str | None = None

    def synchronised(self, sensors: "Sensors | None" = None, **options: Any) -> "Synchronised":
        """Return both sides, by default those of the files, on one clock; ``options`` are those of `synchronise`."""
        sensors = sensors or self.sensors()
        LOG.debug("%d poses of the robot, %d of the camera", len(sensors.robot), len(sensors.camera))
        setup = SETUP_NAMES[0] if self.setup is None else self.setup
        return sensors.synchronised(setup=setup, offset=self._offset(), **options)

    def sensors(self, arm: Arm | None = None) -> "Sensors":
        """Return the streams of robot and camera."""
        from ..read.rosbag.sensors import Sensors

        if self.robot is None and arm is None:
            raise missing_robot("")
        if self.camera is None:
            raise InputError("Synchronisation needs two streams. Give the robot file and the camera file.")
        streams = self.stream("robot", self.robot, arm), self.stream("camera", self.camera)
        return Sensors(self._shown(arm), *streams)

    def stream(self, role: str, file: Path | None, arm: Arm | None = None) -> "Stream":
        """Return the stream of one side from a file, or the joint values of ``arm``."""
        from ..read import read_stream

        k = SIDES.index(role)
        return read_stream(
            file,
            role,
            units=self.both_units[k],
            format=self.formats[k],
            rotation=self.rotations[k],
            frame=(self.robot_frame, self.camera_frame)[k],
            **({} if arm is None else arm.of_files),
        )

    def _offset(self) -> float | tuple[float, float] | None:
        if self.offset is None:
            return None
        numbers = floats(self.offset.split(",")) or []
        if len(numbers) not in (1, 2):
            raise InputError(f"Expected --offset to be seconds such as -0.015 or -0.015,0.002, got {self.offset!r}.")
        return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])

    @property
    def reading(self) -> dict[str, Any]:
        """Arguments of `read_poses` that say how the files are read."""
        return {
            "setup": self.setup,
            "units": self.both_units,
            "format": self.formats,
            "rotation": self.rotations,
            "robot_frame": self.robot_frame,
            "camera_frame": self.camera_frame,
        }

    @property
    def both_units(self) -> tuple[str | None, str | None]:
        """Length units of the robot file and the camera file; None: as the format says, else m."""
        return of_sides(self.units, "--units")

    @property
    def formats(self) -> tuple[str | None, str | None]:
        """Formats of the robot file and the camera file; None: detected."""
        return of_sides(self.format, "--format")

    @property
    def rotations(self) -> tuple[str | None, str | None]:
        """Forms of the rotations of the robot file and the camera file; None: as the format says."""
        forms, orders = of_sides(self.rotation, "--rotation"), of_sides(self.quaternion, "--quaternion")
        for side, form, order in zip(SIDES, forms, orders, strict=True):
            if form is not None and order is not None:
                raise InputError(f"--rotation and --quaternion are both given for the {side} file. Remove one of them.")
        return forms[0] or orders[0], forms[1] or orders[1]

    def given_of(self, side: str) -> list[str]:
        """Return the options that were given for the file of one side."""
        given = [
            f"--{option}"
            for option in OF_FILE
            if "=" in (text := getattr(self, option) or "") and of_sides(text, f"--{option}")[SIDES.index(side)]
        ]
        usual = {"robot": ROBOT_FRAMES, "camera": CAMERA_FRAMES}[side][0]
        return given + [f"--{side}-frame"] * (getattr(self, f"{side}_frame") != usual)

    def _shown(self, arm: Arm | None = None) -> str:
        robot = arm.shown if self.robot is None and arm is not None else str(self.robot)
        return robot if self.camera is None else f"{robot} and {self.camera}"


def missing_robot(instead: str = ", or --joints and --urdf") -> InputError:
    """Return the error of missing robot poses."""
    command = " ".join(command_line().split()[:2])
    return InputError(f"Missing argument 'ROBOT'{instead} (see {command} --help).")


@dataclass(frozen=True)
class PoseFiles(StreamFiles):
    """Options of the files of robot and camera poses, and of their pairing.

    Options (Pose files):
      * --pair HOW <PAIRINGS>: Pairing: rows, time or async. rows: row k with row k (default; if given, whatever
        timestamps say); time: nearest timestamps; async: unsynchronised streams, put on one clock as by uq-handeye
        sync.
      * --camera-convention NAME <CONVENTIONS>: Frame of the camera poses: optical (z ahead), opengl (looks along
        -z), ros or wpilib (x ahead). Converted to optical. Default: optical, tested.
      --time-tolerance SECONDS: Largest time difference of a pair (s), for --pair time. Default: 0.02.
      --exclude POSES: Poses to exclude, e.g. 12,14-16, numbered as in the report (paired poses, from 0). The report
        shows them with their residuals. The intrinsics stay those of all pictures.
      --only POSES: Poses to use. All others are excluded, as by --exclude.
    """

    pair: str | None = None
    camera_convention: str | None = None
    time_tolerance: float | None = None
    exclude: str | None = None
    only: str | None = None

    def read(
        self, given: Given, views: "Views | None" = None, arm: Arm | None = None
    ) -> "tuple[PosePairs, Noise | None, list[SharedError] | None]":
        """Return at least three pairs of poses, their noise if given, and the argument `shared` of `calibrate`.

        If the noise is given for one side, or by the views of the camera, the rest is estimated. The noise of an arm
        includes its kinematic errors. Poses of --exclude are left out.
        """
        poses, noise, shared = self.read_kept(given, views, arm)
        if arm is None and given.prior is None and views is None:
            return poses, noise, shared
        from ..calibration.calibrate import calibrate
        from ..findings import warn
        from ..model.errors.models import PoseNoise
        from ..model.shared_errors.assumed import replace_defaults
        from ..model.shared_errors.in_noise import settled_errors, without_shared

        of_arm = {} if arm is None else arm.of_calibrate
        what = "the other noise" if arm is None else "the errors of the arm"
        with timed(f"estimating {what}"), warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)  # they are raised again where the noise is used
            found = calibrate(poses, noise=noise, prior=given.prior, shared=shared, **of_arm)
        exact = "The residuals are at rounding level, so"
        if arm is not None:
            warn(finding for finding in found.findings if finding.code.startswith("kinematics."))  # but for these
            if found.noise is None:
                raise InputError(f"{exact} no noise can be estimated. Give --robot-noise and --camera-noise.")
            return poses, found.noise, []
        if not isinstance(found.noise, PoseNoise):
            of_camera = any(key.owner == "camera" for key in given.prior or ())
            side = "--robot-noise" if of_camera else "--camera-noise"
            raise InputError(f"{exact} the other noise cannot be estimated. Give {side}, or {side} {EXACT}.")
        known = noise is not None or poses.intrinsics_covered
        listed = replace_defaults((), known) if shared is None else shared
        errors = settled_errors(listed, {error.key: error.size for error in found.shared}, poses)
        return poses, without_shared(found.noise, errors), list(errors)

    def read_kept(
        self, given: Given, views: "Views | None" = None, arm: Arm | None = None
    ) -> "tuple[PosePairs, Any, list[SharedError] | None]":
        """Return what `read_open` reads, without the poses of --exclude."""
        poses, noise, shared = self.read_open(given, views, arm)
        if (selection := self.selection(poses)) is not None:
            kept, n = selection.kept, poses.n
            poses, noise = poses.rows(kept), None if noise is None else noise.rows(kept)
            shared = None if shared is None else [error.rows(kept, n) for error in shared]
        return poses, noise, shared

    def read_open(
        self,
        given: Given,
        seen: "Pictures | Views | None",
        arm: Arm | None = None,
        sensors: "Sensors | None" = None,
    ) -> "tuple[PosePairs, Any, list[SharedError] | None]":
        """Return poses, noise and shared errors as `calibrate` takes them; ``sensors`` in place of the files."""
        from .pictures import either

        of_all = given.shared if arm is None else given.shared._replace(robot_class=None)  # it is that of the arm
        pictures, views = either(seen)
        files = self
        if sensors is None:
            files = self if arm is None else self._with_arm(arm, pictures is not None)
            if files.robot is None and (arm is None or not arm.by_joints):
                raise missing_robot()
        if self.offset is not None and "," in self.offset and "clock offset" in given.shared.declared:
            raise InputError(
                f"The standard deviation of the offset is given twice, by --offset {self.offset} and --shared. Give "
                "one of them."
            )
        noise: Any
        if views is not None:
            poses, _ = files._poses_and_noise(None, None, arm, sensors)
            poses = views.poses_from_centre(poses)
            noise = views.noise_with(poses, given.noise_at(poses), given.prior)
            shared = of_all.errors(poses, None, given.file, views)
        else:
            poses, noise = files._poses_and_noise(given, pictures, arm, sensors)
            if poses.camera_calibration is not None:
                from ..fit.diagnostics.pose_ambiguity import CODE, resolve_pose_ambiguity

                poses = resolve_pose_ambiguity(poses)
                seen_by = poses.camera_calibration
                for finding in () if seen_by is None else seen_by.findings:
                    if finding.code == CODE:
                        LOG.info("%s", finding)
            shared = of_all.errors(poses, noise, given.file)
        return poses, noise, shared

    def read_new(self, pictures: "Pictures | None" = None, arm: Arm | None = None) -> "PosePairs":
        """Return one or more pairs of poses, to be held against a calibration, without those left out by request."""
        files = self if arm is None else self._with_arm(arm, pictures is not None)
        if files.robot is None and arm is None:
            raise missing_robot(", or --joints" if arm is None else "")
        poses, _ = files._poses_and_noise(None, pictures, arm, fewest=1)
        selection = self.selection(poses, fewest=1)
        return poses if selection is None else poses.rows(selection.kept)

    def selection(self, poses: "PosePairs", fewest: int = MIN_POSES) -> "Selection | None":
        """Return which of the poses --exclude and --only leave; None: all."""
        from ..model.poses.pose_numbers import select_poses

        return select_poses(poses.n, self.exclude, self.only, ("--exclude", "--only"), fewest)

    def _with_arm(self, arm: Arm, pictures: bool) -> "PoseFiles":
        """Return the files as their arguments are read with an arm: a single one is that of the camera."""
        robot, first, second = arm.options.robot_file, self.robot, self.camera
        if robot is not None:
            if second is not None:
                raise InputError(f"Robot poses are given twice, {first} and --robot {robot}. Give one of them.")
            return replace(self, robot=robot, camera=first)
        if not arm.by_joints:
            return self
        files = self
        if second is None and not pictures:
            if first is None:
                raise InputError("--joints needs camera poses. Add their file, or the folder of uq-handeye camera.")
            files = replace(self, robot=None, camera=first)
        if files.robot is None and (wrong := files.given_of("robot")):
            raise InputError(f"{', '.join(wrong)}: for a file of robot poses, not for --joints. Remove the option.")
        return files

    def _poses_and_noise(
        self,
        given: Given | None,
        pictures: "Pictures | None",
        arm: Arm | None,
        sensors: "Sensors | None" = None,
        fewest: int = MIN_POSES,
    ) -> "tuple[PosePairs, Noise | None]":
        """Return the poses, and their noise if that of the samples is given."""
        from ..read.camera_covariance import read_again

        how = None if self.pair is None else one_of(self.pair, "--pair", PAIRINGS)
        how, shown = (how, self._shown(arm)) if sensors is None else ("async", sensors.name)
        seen = self.camera if sensors is None else None
        if pictures is not None or (seen is not None and _is_camera_folder(seen)):
            self._refuse_of_files("--images" if pictures is not None else f"the folder {self.camera}", how)
        if pictures is not None and self.camera is not None:
            raise InputError(
                f"Both a file of camera poses, {self.camera}, and --images are given. Give one of them. Quote a "
                "pattern (--images 'img/*.png'), or the shell expands it to many files."
            )
        for name, value, needed in (
            ("--time-tolerance", self.time_tolerance, "time"),
            ("--offset", self.offset, "async"),
        ):
            if value is not None and how != needed:
                raise InputError(f"{name} needs --pair {needed}, got --pair {how or PAIRINGS[0]}.")
        with timed(f"reading {shown}"):
            if how == "async":
                noise = None if given is None else without_poses(given.noise, "--pair async")
                poses, noise = self._synchronised_poses(noise, sensors or self.sensors(arm))
                poses = read_again(poses, None if given is None else given.reading)
                if self.camera_convention is not None:
                    from ..read.poses import in_convention

                    poses = in_convention(poses, one_of(self.camera_convention, "--camera-convention", CONVENTIONS))
            else:
                poses = self._read(how, pictures, arm, None if given is None else given.reading)
                noise = None if given is None else given.noise_at(poses)
        if given is not None and given.reading is not None and not given.is_stated and poses.camera_read_as is None:
            raise InputError(
                "--covariance-convention: neither a noise file nor the camera poses hold a covariance that it applies "
                "to. Remove it."
            )
        LOG.debug("%d pairs of poses, %s", poses.n, poses.setup)
        if poses.n < fewest:
            raise InputError(
                f"{shown} hold{'s' if seen is None else ''} {poses.n} poses. At least 3 are needed (2 motions)."
            )
        return poses, noise

    def _synchronised_poses(self, noise: "Noise | None", sensors: "Sensors") -> "tuple[PosePairs, Noise | None]":
        """Return interpolated poses with their noise, which is less than that of the samples."""
        from ..core.presentation.numbers import concise

        if self.offset is None:
            single = sensors.taken_one_by_one(SETUP_NAMES[0] if self.setup is None else self.setup)
            if single is not None:
                return single, noise
        found = self.synchronised(sensors, noise=noise)
        if found.origin == "open within the stops":
            LOG.info("%s", next(note for note in found.notes if "stood still" in note))
            return found.poses, found.noise
        if found.offset_std > 0.0:
            offset = concise(1e3 * found.offset, 1e3 * found.offset_std, "ms")
        else:
            offset = f"{1e3 * found.offset:.6g} ms, as given"
        LOG.info("The clocks differ by %s (robot minus camera); details: uq-handeye sync.", offset)
        return found.poses, found.noise

    def _refuse_of_files(self, what: str, how: str | None) -> None:
        """Raise `InputError` if options of a file of camera poses are given for something else."""
        wrong = [*(["--pair"] if how not in (None, "rows") else []), *self.given_of("camera")]
        if wrong:
            raise InputError(f"{', '.join(wrong)}: for files of camera poses, not for {what}. Remove the option.")

    def _read(
        self,
        how: str | None,
        pictures: "Pictures | None",
        arm: Arm | None,
        covariance: "CovarianceReading | None" = None,
    ) -> "PosePairs":
        from ..read import read_poses

        of_arm: dict[str, Any] = {} if arm is None else arm.of_files
        if self.time_tolerance is not None:
            of_arm |= {"tolerance": self.time_tolerance}
        if pictures is None:
            return read_poses(
                self.robot,
                self.camera,
                pair=how,
                covariance_convention=covariance,
                camera_convention=self.camera_convention,
                **self.reading,
                **of_arm,
            )
        if self.camera_convention not in (None, "optical"):
            raise InputError("--camera-convention: for files of camera poses, not for --images. Remove it.")
        reading = {name: value for name, value in self.reading.items() if name != "camera_frame"}
        return pictures.poses(self.robot, **reading, **of_arm)


def _is_camera_folder(path: Path) -> bool:
    """Return whether a folder is that of camera -o or points -o, not one of pose files."""
    if not path.is_dir():
        return False
    from ..read.known_camera import is_folder_of_poses

    return is_folder_of_poses(path)
