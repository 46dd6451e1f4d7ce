"""Options of the noise and of prior knowledge of X and W.

Options of the errors that all poses share.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from .options import ACCURACY_CLASSES, one_of, said_of

if TYPE_CHECKING:
    from ..model.noise.estimate import NoisePrior
    from ..model.noise.models import Noise, PoseNoise
    from ..model.poses.pose_pairs import PosePairs
    from ..model.shared_errors.shared_error import SharedError
    from .views import Views

# Values of --shared.
DEFAULTS = ("defaults", "none")


@dataclass(frozen=True)
class SharedOptions:
    """Options of the errors that all poses share.

    Options (Shared errors):
      --shared NAME <DEFAULTS>: Shared errors that are not declared: defaults or none. defaults, for camera poses
        without corners and estimated noise: focal length 0.1%, principal point 0.001, target scale 0.03% (within a
        factor of 4), lens, view and robot accuracy. Default: defaults.
      --focal-sd SD: Relative standard deviation of the focal length, e.g. 0.1%, or exact. Default: by --shared.
      --principal-point-sd SD: Standard deviation of the principal point per axis, relative to the focal length, e.g.
        0.001; in pixels, e.g. 1px, if the focal length is known; or exact. Default: by --shared.
      --target-scale-sd SD: Relative standard deviation of the target size, e.g. 0.02%, or exact. Default: by --shared.
      --robot-scale-sd SD: Relative standard deviation of the robot's length scale, e.g. 0.01%, or exact.
      * --robot-accuracy MM[,DEG]: Robot accuracy by its data sheet. Translation and rotation, e.g. 0.5mm,0.05deg, RMS
        over the workspace; or exact. Where it is not declared it is known within a factor of 3, or as --robot-class
        says. Default: 0.6 mm.
      --offset-sd SD: Standard deviation of the clock offset, e.g. 1ms, or exact. Default with --pair async: estimated.
    """

    shared: str | None = None
    focal_sd: str | None = None
    principal_point_sd: str | None = None
    target_scale_sd: str | None = None
    robot_scale_sd: str | None = None
    robot_accuracy: str | None = None
    offset_sd: str | None = None
    robot_class: str | None = None

    def errors(
        self, poses: "PosePairs", noise: "Noise | None", file: Path | None = None, views: "Views | None" = None
    ) -> "list[SharedError] | None":
        """Return the declared errors of options and noise file with the remaining defaults, or None."""
        from ..model.shared_errors.assumed import assumed_accuracy, replace_defaults
        from ..model.shared_errors.shared_error import SharedError, checked_errors
        from ..read import read_shared_errors

        focal_length_px = None if views is None else views.focal_length_px
        if poses.camera_calibration is not None:
            found = poses.camera_calibration.intrinsics
            focal_length_px = 0.5 * (found["fx"] + found["fy"])
        in_file = () if file is None else read_shared_errors(file, focal_length_px=focal_length_px)
        declared = {error.name: error for error in in_file}
        for name, text, make in (
            ("--focal-sd", self.focal_sd, SharedError.focal_length),
            (
                "--principal-point-sd",
                self.principal_point_sd,
                lambda sd: SharedError.principal_point(sd, focal_length_px=focal_length_px),
            ),
            ("--target-scale-sd", self.target_scale_sd, SharedError.target_scale),
            ("--robot-scale-sd", self.robot_scale_sd, SharedError.robot_scale),
            ("--robot-accuracy", self.robot_accuracy, SharedError.robot_accuracy),
            ("--offset-sd", self.offset_sd, SharedError.clock_offset),
        ):
            if text is not None:
                with said_of(name):
                    error = make(text)
                declared[error.name] = error
        if self.robot_class is not None:
            if self.robot_accuracy is not None:
                raise InputError("--robot-class and --robot-accuracy both give the accuracy. Remove one of them.")
            accuracy = assumed_accuracy(one_of(self.robot_class, "--robot-class", ACCURACY_CLASSES))
            declared[accuracy.name] = replace(accuracy, default=False)
        none = self.shared is not None and one_of(self.shared, "--shared", DEFAULTS) == "none"
        if not declared and not none:
            return None
        if noise is not None and noise.ITEM == "motion" and declared:
            raise InputError("Shared errors need noise of poses ([robot], [camera]), got noise of motions ([A], [B]).")
        errors = list(declared.values())
        if declared and noise is None:
            errors = replace_defaults(declared.values(), views is not None or poses.camera_known, not none)
        return list(checked_errors(errors, poses))


BOTH_EXACT = "Robot and camera cannot both be exact. Give the standard deviations of one, or neither option."
# Value in place of standard deviations: that side has no noise.
EXACT = "exact"


@dataclass(frozen=True)
class NoiseOptions:
    """Options of the noise of robot and camera poses.

    Options (Noise):
      * --robot-noise ROT,TRANS: Robot noise (1 sigma). Standard deviations of one pose per axis, e.g. 0.02deg,0.05mm,
        or exact. Default: estimated.
      * --camera-noise ROT,TRANS: Camera noise (1 sigma). Standard deviations of one pose per axis, e.g. 0.1deg,0.5mm,
        or exact. Default: estimated.
      --noise FILE.toml: Noise file with full 6x6 covariances, in place of --robot-noise and --camera-noise. Its table
        [shared] holds shared errors.
    """

    robot_noise: str | None = None
    camera_noise: str | None = None
    noise: Path | None = None

    def read(self) -> "tuple[Noise | None, NoisePrior | None]":
        """Return the noise of the options, or a prior if they name one side only."""
        from ..model.noise.estimate import NoisePrior
        from ..model.noise.models import PoseNoise
        from ..read import read_noise_file

        if self.noise is not None:
            noise = read_noise_file(self.noise)
            if noise is not None and (self.robot_noise is not None or self.camera_noise is not None):
                raise InputError("Give either --noise FILE or --robot-noise and --camera-noise, not both.")
            if noise is not None:
                return noise, None
        if self.robot_noise is None and self.camera_noise is None:
            return None, None
        robot, camera = (
            None if value in (None, EXACT) else _deviations(value, name)
            for value, name in ((self.robot_noise, "--robot-noise"), (self.camera_noise, "--camera-noise"))
        )
        if self.robot_noise is None or self.camera_noise is None:
            robot, camera = (
                (0.0, 0.0) if value == EXACT else found
                for value, found in ((self.robot_noise, robot), (self.camera_noise, camera))
            )
            return None, NoisePrior(robot, camera, 1.0)
        if robot is None and camera is None:
            raise InputError(BOTH_EXACT)
        return PoseNoise.isotropic(robot, camera), None


@dataclass(frozen=True)
class Given:
    """Noise and shared errors as given."""

    noise: "Noise | None"
    prior: "NoisePrior | None"  # what is known beforehand: one side as given, or data sheets
    shared: SharedOptions
    file: Path | None  # noise file, which may hold shared errors too


def given_of(options: NoiseOptions, shared: SharedOptions) -> Given:
    """Return noise and shared errors of the options."""
    return Given(*options.read(), shared, options.noise)


def require_of_poses(noise: "Noise | None", command: str) -> "PoseNoise | None":
    """Return the noise if it is that of poses; raise `InputError` for that of motions."""
    if noise is not None and noise.ITEM == "motion":
        raise InputError(f"{command} needs noise on poses ([robot], [camera]), got noise on motions ([A], [B]).")
    return noise


def exact_beside(known: "NoisePrior") -> "PoseNoise":
    """Return the noise with the side that is not given taken as exact."""
    from ..model.noise.models import PoseNoise

    rotation, translation, *camera = known.values.tolist()
    if not any(value > 0 for value in known.values.tolist()):
        raise InputError(BOTH_EXACT)
    robot = None if known.robot is None else (rotation, translation)
    return PoseNoise.isotropic(robot, None if known.camera is None else (camera[0], camera[1]))


def prior_of(
    robot_prior: str | None = None, camera_prior: str | None = None, prior_factor: float = 2.0
) -> "NoisePrior | None":
    """Return the prior of the data sheets, or None if none is given.

    Options (Noise):
      --robot-prior ROT,TRANS: Robot noise by its data sheet, as a prior of the estimate, e.g. '?,0.05mm' (? is
        unknown).
      --camera-prior ROT,TRANS: Camera noise by its data sheet, as a prior of the estimate, e.g. '0.1deg,?'.
      --prior-factor FACTOR: Uncertainty of --robot-prior and --camera-prior as a factor (1 sigma). 1: exact.
    """
    from ..model.noise.estimate import NoisePrior

    if robot_prior is None and camera_prior is None:
        return None
    robot, camera = _partly_known(robot_prior, "--robot-prior"), _partly_known(camera_prior, "--camera-prior")
    return NoisePrior(robot, camera, prior_factor)


def noise_of(given: Annotated["Given", given_of], prior: Annotated["NoisePrior | None", prior_of]) -> Given:
    """Return noise and shared errors of the options, with the prior of the data sheets."""
    if prior is None:
        return given
    if given.prior is not None:
        raise InputError("The noise and a prior of it are both given. Give one of them.")
    return replace(given, prior=prior)


def pose_prior_of(
    prior_x: Path | None = None, prior_w: Path | None = None, known: list[str] | None = None
) -> "dict[str, Any]":
    """Return the priors of X and W as arguments of `calibrate`.

    Options (Prior knowledge):
      --prior-x FILE: Prior of X: YAML or JSON with pose and covariance, or the result.json of an earlier run.
      --prior-w FILE: Prior of the target pose W, likewise.
      --known TEXT: Measured coordinate of camera or target, e.g. 'target z = 120mm +- 1mm'. Repeatable.
    """
    from ..model.noise.known_values import parse_known_values as known_values
    from ..read import read_prior

    found: dict[str, Any] = dict(known_values(*known)) if known else {}
    for path, name, of in ((prior_x, "prior_X", "X"), (prior_w, "prior_W", "W")):
        if path is None:
            continue
        if name in found:
            raise InputError(f"--prior-{of.lower()} and --known describe the same pose. Give one of them.")
        found[name] = read_prior(path, of)
    return found


def _deviations(value: str, name: str) -> tuple[float, float]:
    """Return the standard deviations (rad, m) of an option ROTATION,TRANSLATION."""
    from ..core.formatting.units import parse_deviations

    rotation, comma, translation = value.partition(",")
    if not comma or "," in translation:
        raise InputError(
            f"Expected {name} to be ROTATION,TRANSLATION such as 0.02deg,0.05mm, or {EXACT}, got {value!r}."
        )
    swapped = False
    with suppress(InputError):
        swapped = bool(parse_deviations((translation, rotation), name))
    try:
        return parse_deviations((rotation, translation), name)
    except InputError:
        if not swapped:
            raise
    raise InputError(f"{name} {value}: rotation and translation seem to be swapped. Write {translation},{rotation}.")


def _partly_known(value: str | None, name: str) -> tuple[str | None, str | None] | None:
    if value is None:
        return None
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != 2:
        raise InputError(f"Expected {name} to be ROTATION,TRANSLATION such as ?,0.05mm, got {value!r}.")
    rotation, translation = (None if part in ("", "?") else part for part in parts)
    return rotation, translation
