"""Options of the pose files, and how they are read."""

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, InputWarning
from .messages import LOG, timed
from .options.arm import Arm
from .options.common import CAMERA_FRAMES, PAIRINGS, ROBOT_FRAMES, one_of
from .options.noise import EXACT, Given
from .stream_files import StreamFiles, missing_robot

if TYPE_CHECKING:
    from ..model.noise.camera_noise import CameraNoise
    from ..model.noise.estimate import NoisePrior
    from ..model.noise.models import Noise, PoseNoise
    from ..model.poses.pose_pairs import PosePairs, Selection
    from ..model.shared_errors.shared_error import SharedError
    from .pictures import Pictures
    from .views import Views


@dataclass(frozen=True)
class PoseFiles(StreamFiles):
    """Options of the files of robot and camera poses, and of their pairing.

    Options (Pose files):
      * --pair HOW <PAIRINGS>: Pairing: rows, time or async. rows: row k with row k (default; if given, whatever
        timestamps say); time: nearest timestamps; async: unsynchronised streams, put on one clock as by uq-handeye
        sync.
      --time-tolerance SECONDS: Largest time difference of a pair (s), for --pair time. Default: 0.02.
      --exclude POSES: Poses to exclude, e.g. 12,14-16, numbered as in the report (paired poses, from 0). The report
        shows them with their residuals. The intrinsics stay those of all pictures.
      --only POSES: Poses to use. All others are excluded, as by --exclude.
    """

    pair: str | None = None
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
        if arm is not None:
            return poses, _noise_of_arm(poses, given.prior, noise, shared, arm), []
        if given.prior is None and views is None:
            return poses, noise, shared
        return poses, *_complete_noise(poses, given.prior, noise, shared)

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
        self, given: Given, seen: "Pictures | Views | None", arm: Arm | None = None
    ) -> "tuple[PosePairs, Any, list[SharedError] | None]":
        """Return poses, noise and shared errors as `calibrate` takes them."""
        from .views import Views

        of_all = given.shared if arm is None else replace(given.shared, robot_class=None)  # it is that of the arm
        files = self if arm is None else self._beside_arm(arm, seen is not None and not isinstance(seen, Views))
        if files.robot is None and (arm is None or not arm.by_joints):
            raise missing_robot()
        if self.offset is not None and "," in self.offset and given.shared.offset_sd is not None:
            raise InputError(
                f"The standard deviation of the offset is given twice, by --offset {self.offset} and --offset-sd. Give "
                "one of them."
            )
        noise: Any
        if isinstance(seen, Views):
            poses, _ = files._poses_and_noise(None, None, arm)
            noise = seen.beside(poses, given.noise, given.prior)
            shared = of_all.errors(poses, None, given.file, seen)
        else:
            poses, noise = files._poses_and_noise(given.noise, seen, arm)
            if poses.camera_calibration is not None:
                from ..fit.input_checks.pose_ambiguity import CODE, resolve_pose_ambiguity

                poses = resolve_pose_ambiguity(poses)
                seen_by = poses.camera_calibration
                for finding in () if seen_by is None else seen_by.findings:
                    if finding.code == CODE:
                        LOG.info("%s", finding)
            shared = of_all.errors(poses, noise, given.file)
        return poses, noise, shared

    def read_new(self, pictures: "Pictures | None" = None, arm: Arm | None = None) -> "PosePairs":
        """Return one or more pairs of poses, to be held against a calibration, without those left out by request."""
        files = self if arm is None else self._beside_arm(arm, pictures is not None)
        if files.robot is None and arm is None:
            raise missing_robot(", or --joints" if arm is None else "")
        poses, _ = files._poses_and_noise(None, pictures, arm, fewest=1)
        selection = self.selection(poses, fewest=1)
        return poses if selection is None else poses.rows(selection.kept)

    def selection(self, poses: "PosePairs", fewest: int = 3) -> "Selection | None":
        """Return which of the poses --exclude and --only leave; None: all."""
        from ..model.poses.pose_pairs import select_poses

        return select_poses(poses.n, self.exclude, self.only, ("--exclude", "--only"), fewest)

    def _beside_arm(self, arm: Arm, pictures: bool) -> "PoseFiles":
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
        if files.robot is None:
            of_robot = ("robot_format", "robot_units", "robot_rotation", "robot_quaternion")
            wrong = [f"--{name.replace('_', '-')}" for name in of_robot if getattr(files, name) is not None]
            if wrong := wrong + ["--robot-frame"] * (files.robot_frame != ROBOT_FRAMES[0]):
                raise InputError(f"{', '.join(wrong)}: for a file of robot poses, not for --joints. Remove the option.")
        return files

    def _poses_and_noise(
        self, noise: "Noise | None", pictures: "Pictures | None", arm: Arm | None, fewest: int = 3
    ) -> "tuple[PosePairs, Noise | None]":
        """Return the poses, and their noise if that of the samples is given."""
        how = None if self.pair is None else one_of(self.pair, "--pair", PAIRINGS)
        if pictures is not None or (self.camera is not None and _is_camera_folder(self.camera)):
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
        with timed(f"reading {self._shown(arm)}"):
            if how == "async":
                poses, noise = self._synchronised_poses(noise, arm)
            else:
                poses = self._read(how, pictures, arm)
        LOG.debug("%d pairs of poses, %s", poses.n, poses.setup)
        if poses.n < fewest:
            raise InputError(
                f"{self._shown(arm)} hold{'s' if self.camera is None else ''} {poses.n} poses. At least 3 are needed "
                "(2 motions)."
            )
        return poses, noise

    def _synchronised_poses(self, noise: "Noise | None", arm: Arm | None) -> "tuple[PosePairs, Noise | None]":
        """Return interpolated poses with their noise, which is less than that of the samples."""
        from ..core.formatting.numbers import concise

        found = self.synchronised(arm, noise=noise)
        if found.offset_std > 0.0:
            offset = concise(1e3 * found.offset, 1e3 * found.offset_std, "ms")
        else:
            offset = f"{1e3 * found.offset:.6g} ms, as given"
        LOG.info("The clocks differ by %s (robot minus camera); details: uq-handeye sync.", offset)
        return found.poses, found.noise

    def _refuse_of_files(self, what: str, how: str | None) -> None:
        """Raise `InputError` if options of a file of camera poses are given for something else."""
        given = {
            "--pair": how not in (None, "rows"),
            "--camera-format": self.camera_format is not None,
            "--camera-units": self.camera_units is not None,
            "--camera-rotation": self.camera_rotation is not None,
            "--camera-quaternion": self.camera_quaternion is not None,
            "--camera-frame": self.camera_frame != CAMERA_FRAMES[0],
        }
        if wrong := [name for name, value in given.items() if value]:
            raise InputError(f"{', '.join(wrong)}: for files of camera poses, not for {what}. Remove the option.")

    def _read(self, how: str | None, pictures: "Pictures | None", arm: Arm | None) -> "PosePairs":
        from ..read import read_poses

        of_arm: dict[str, Any] = {} if arm is None else arm.of_files
        if self.time_tolerance is not None:
            of_arm |= {"tolerance": self.time_tolerance}
        if pictures is None:
            return read_poses(self.robot, self.camera, pair=how, **self.reading, **of_arm)
        reading = {name: value for name, value in self.reading.items() if name != "camera_frame"}
        return pictures.poses(self.robot, **reading, **of_arm)


def _is_camera_folder(path: Path) -> bool:
    """Return whether a folder is that of camera -o or points -o, not one of pose files."""
    if not path.is_dir():
        return False
    from ..read.known_camera import is_folder_of_poses

    return is_folder_of_poses(path)


def _complete_noise(
    poses: "PosePairs",
    prior: "NoisePrior | None",
    given: "CameraNoise | PoseNoise | None",
    shared: "list[SharedError] | None",
) -> "tuple[Noise, list[SharedError]]":
    """Return the noise with its unknown part estimated as `calibrate` does, and the shared errors."""
    from ..calibration.calibrate import calibrate
    from ..model.noise.models import PoseNoise
    from ..model.shared_errors.shared_error import replace_defaults, settled_errors, without_shared

    with timed("estimating the other noise"), warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # they are raised again where the noise is used
        found = calibrate(poses, noise=given, prior=prior, shared=shared)
    if not isinstance(found.noise, PoseNoise):
        open_side = "--robot-noise" if prior is not None and prior.camera is not None else "--camera-noise"
        raise InputError(
            f"The residuals are at rounding level, so the other noise cannot be estimated. Give {open_side}, or "
            f"{open_side} {EXACT}."
        )
    known = given is not None or poses.camera_known
    listed = replace_defaults((), known) if shared is None else shared
    errors = settled_errors(listed, {error.name: error.prior_sd for error in found.shared}, poses)
    return without_shared(found.noise, errors), list(errors)


def _noise_of_arm(
    poses: "PosePairs",
    prior: "NoisePrior | None",
    given: "CameraNoise | PoseNoise | None",
    shared: "list[SharedError] | None",
    arm: Arm,
) -> "Noise":
    """Return the noise as `calibrate` estimates it, with kinematic and other shared errors."""
    from ..calibration.calibrate import calibrate
    from ..findings import warn

    with timed("estimating the errors of the arm"), warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # they are raised again where the noise is used
        found = calibrate(poses, noise=given, prior=prior, shared=shared, **arm.of_calibrate)
    warn(finding for finding in found.findings if finding.code.startswith("kinematics."))  # but for these
    if found.noise is None:
        raise InputError(
            "The residuals are at rounding level, so no noise can be estimated. Give --robot-noise and --camera-noise."
        )
    return found.noise
