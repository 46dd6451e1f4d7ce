"""Options of the noise of robot and camera poses, also as a prior by data sheets."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

from ..errors import InputError
from .shared_errors import SharedOptions
from .stored import of_rig
from .values import by_names, naming_option

if TYPE_CHECKING:
    from ..core.geometry.conventions import CovarianceReading
    from ..model.errors.key import ErrorKey
    from ..model.errors.models import Noise, PoseNoise
    from ..model.errors.sizes import Size
    from ..model.errors.stated_noise import StatedNoise
    from ..model.poses.pose_pairs import PosePairs

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
        or exact. Of several cameras by name, e.g. 'left:0.1deg,0.5mm;right:0.2deg,1mm', like all options of a camera.
        Default: estimated.
      --noise FILE.toml: Noise file with full 6x6 covariances, in place of --robot-noise and --camera-noise. Its table
        [shared] holds shared errors.
      --covariance-convention NAME <CONVENTION_NAMES>: Convention of the covariances in the noise file and in files of
        poses. The library that wrote them, e.g. gtsam; with commas information, inverse (of the inverse poses) or
        pixel_sd=0.2. Default: as the file says.
    """

    robot_noise: str | None = None
    camera_noise: str | None = None
    noise: Path | None = None
    covariance_convention: str | None = None

    @property
    def by_name(self) -> dict[str, str]:
        """Texts that name arms or cameras, by their options."""
        both = {"--robot-noise": self.robot_noise, "--camera-noise": self.camera_noise}
        return {option: text for option, text in both.items() if text is not None and ":" in text}

    @property
    def reading(self) -> "CovarianceReading | None":
        """Reading of the covariances of poses, in place of what the files say."""
        from ..core.geometry.conventions import CovarianceReading

        if self.covariance_convention is None:
            return None
        with naming_option("--covariance-convention"):
            return CovarianceReading.parse(self.covariance_convention)

    def read(self) -> "tuple[Noise | StatedNoise | None, Mapping[ErrorKey, Size] | None]":
        """Return the noise of the options, or a prior if they name one side only."""
        from ..model.errors.models import PoseNoise
        from ..model.errors.noise_toml import read_stated_noise
        from ..model.errors.sizes import NoisePrior

        if self.noise is not None:
            noise = read_stated_noise(self.noise, self.reading)
            if noise is not None and (self.robot_noise is not None or self.camera_noise is not None):
                raise InputError("Give either --noise FILE or --robot-noise and --camera-noise, not both.")
            if noise is not None:
                return noise, None
        if (self.robot_noise is None and self.camera_noise is None) or self.by_name:  # by names: `noise_of_rig`
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


class Given(NamedTuple):
    """Noise and shared errors as given."""

    noise: "Noise | StatedNoise | None"
    prior: "Mapping[ErrorKey, Size] | None"  # what is known beforehand: one side as given, or data sheets
    shared: SharedOptions
    file: Path | None  # noise file, which may hold shared errors too
    reading: "CovarianceReading | None" = None  # of covariances that come with poses
    options: NoiseOptions | None = None  # as given

    @property
    def is_stated(self) -> bool:
        """True if the noise has a covariance in a convention that depends on the poses."""
        from ..model.errors.stated_noise import StatedNoise

        return isinstance(self.noise, StatedNoise)

    def noise_at(self, poses: "PosePairs") -> "Noise | None":
        """Return the noise of these poses."""
        from ..model.errors.stated_noise import StatedNoise

        return self.noise.at(poses) if isinstance(self.noise, StatedNoise) else self.noise


def given_of(options: NoiseOptions, shared: SharedOptions) -> Given:
    """Return noise and shared errors of the options."""
    if options.by_name and not of_rig():
        raise InputError(f"{next(iter(options.by_name))}: names belong to a rig (--camera NAME=FILE). Remove the name.")
    return Given(*options.read(), shared, options.noise, options.reading, options)


def noise_of_rig(
    given: Given, arms: Sequence[str], cameras: Sequence[str]
) -> dict[str, str | tuple[float, float]] | None:
    """Return noise by the names of arms and cameras, None where it is given for none or all of them alike."""
    options = given.options
    if options is None or not options.by_name:
        return None
    found: dict[str, str | tuple[float, float]] = {}
    for option, names, text in (
        ("--robot-noise", arms, options.robot_noise),
        ("--camera-noise", cameras, options.camera_noise),
    ):
        values = by_names(text, names, option)
        for name in names:
            if (value := values.get(name, values.get(""))) is None:
                raise InputError(f"{option} of {name!r} is not given. Add {name}:ROTATION,TRANSLATION, or exact.")
            found[name] = EXACT if value == EXACT else _deviations(value, option)
    return found


def without_poses(noise: "Noise | StatedNoise | None", command: str) -> "Noise | None":
    """Return the noise; raise `InputError` if it is stated in a convention that needs the poses."""
    from ..model.errors.stated_noise import StatedNoise

    if isinstance(noise, StatedNoise):
        raise InputError(
            f"{command} takes covariances as the toolkit has them: those of another convention depend on the poses. "
            "Remove --covariance-convention, and `convention` from the noise file."
        )
    return noise


def require_of_poses(noise: "Noise | None", command: str) -> "PoseNoise | None":
    """Return the noise if it is that of poses; raise `InputError` for that of motions."""
    if noise is not None and noise.ITEM == "motion":
        raise InputError(f"{command} needs noise on poses ([robot], [camera]), got noise on motions ([A], [B]).")
    return noise


def exact_other_side(known: "Mapping[ErrorKey, Size]") -> "PoseNoise":
    """Return the noise with the side that is not given taken as exact."""
    from ..model.errors.models import PoseNoise
    from ..model.errors.sizes import OF_SHEETS

    if not any(size.median > 0 for size in known.values()):
        raise InputError(BOTH_EXACT)
    robot, camera = (
        (known[rotation].median, known[translation].median) if rotation in known else None
        for rotation, translation in (OF_SHEETS["robot"], OF_SHEETS["camera"])
    )
    return PoseNoise.isotropic(robot, camera)


def prior_of(
    robot_prior: str | None = None, camera_prior: str | None = None, prior_factor: float = 2.0
) -> "Mapping[ErrorKey, Size] | None":
    """Return the prior of the data sheets, or None if none is given.

    Options (Noise):
      --robot-prior ROT,TRANS: Robot noise by its data sheet, as a prior of the estimate, e.g. '?,0.05mm' (? is
        unknown).
      --camera-prior ROT,TRANS: Camera noise by its data sheet, as a prior of the estimate, e.g. '0.1deg,?'.
      --prior-factor FACTOR: Uncertainty of --robot-prior and --camera-prior as a factor (1 sigma). 1: exact.
    """
    from ..model.errors.sizes import NoisePrior

    if robot_prior is None and camera_prior is None:
        return None
    robot, camera = _partly_known(robot_prior, "--robot-prior"), _partly_known(camera_prior, "--camera-prior")
    return NoisePrior(robot, camera, prior_factor)


def noise_of(
    given: Annotated["Given", given_of], prior: Annotated["Mapping[ErrorKey, Size] | None", prior_of]
) -> Given:
    """Return noise and shared errors of the options, with the prior of the data sheets."""
    if prior is None:
        return given
    if given.prior is not None:
        raise InputError("The noise and a prior of it are both given. Give one of them.")
    return given._replace(prior=prior)


def _deviations(value: str, name: str) -> tuple[float, float]:
    """Return the standard deviations (rad, m) of an option ROTATION,TRANSLATION."""
    from ..core.presentation.units import parse_deviations

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
