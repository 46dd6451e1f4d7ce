"""What a command is told of noise, X and W: groups of options (`made_of`) and how they are read."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from .options import made_of, option
from .shared_options import SharedOptions

if TYPE_CHECKING:
    from ..noise.estimate import NoisePrior
    from ..noise.models import Noise

# Panels of the help.
NOISE, KNOWN = "Noise", "Known beforehand"
BOTH_EXACT = "Both sides cannot be exact: give the standard deviations of one, or neither option."
# In place of standard deviations: a side that has no noise.
EXACT = "exact"


@dataclass(frozen=True)
class NoiseOptions:
    """What is known of the noise, as the command line says."""

    robot_noise: Annotated[
        str | None,
        option(
            "--robot-noise",
            metavar="ROT,TRANS|exact",
            panel=NOISE,
            help="Standard deviations, e.g. 0.02deg,0.05mm. Left out beside --camera-noise: estimated.",
        ),
    ] = None
    camera_noise: Annotated[
        str | None,
        option(
            "--camera-noise",
            metavar="ROT,TRANS|exact",
            panel=NOISE,
            help="Standard deviations, e.g. 0.1deg,0.5mm. Left out beside --robot-noise: estimated.",
        ),
    ] = None
    noise: Annotated[
        Path | None,
        option(
            "--noise",
            metavar="FILE.toml",
            panel=NOISE,
            help="Noise with full 6x6 covariances, instead; shared errors in its table [shared].",
        ),
    ] = None

    def read(self) -> "Noise | NoisePrior | None":
        """The noise of the three options, None if none of them says any; of one side alone what is known of it."""
        from ..io import read_noise_file
        from ..noise.estimate import NoisePrior
        from ..noise.models import PoseNoise

        if self.noise is not None:
            noise = read_noise_file(self.noise)
            if noise is not None and (self.robot_noise is not None or self.camera_noise is not None):
                raise InputError("Give either --noise FILE or --robot-noise and --camera-noise, not both.")
            if noise is not None:
                return noise
        if self.robot_noise is None and self.camera_noise is None:
            return None
        robot, camera = (
            None if value in (None, EXACT) else _deviations(value, name)
            for value, name in ((self.robot_noise, "--robot-noise"), (self.camera_noise, "--camera-noise"))
        )
        if self.robot_noise is None or self.camera_noise is None:
            robot, camera = (
                (0.0, 0.0) if value == EXACT else found
                for value, found in ((self.robot_noise, robot), (self.camera_noise, camera))
            )
            return NoisePrior(robot, camera, 1.0)
        if robot is None and camera is None:
            raise InputError(BOTH_EXACT)
        return PoseNoise.isotropic(robot, camera)


@dataclass(frozen=True)
class Given:
    """What is known of the noise and of what all poses share."""

    noise: "Noise | None"
    one_side: "NoisePrior | None"  # where that of one side alone is known
    shared: SharedOptions
    file: Path | None  # that may hold shared errors too


@made_of(options=NoiseOptions, shared=SharedOptions)
def given_of(options: "NoiseOptions", shared: "SharedOptions") -> Given:
    """Noise and shared errors of the options."""
    from ..noise.estimate import NoisePrior

    noise = options.read()
    one_side = noise if isinstance(noise, NoisePrior) else None
    return Given(None if isinstance(noise, NoisePrior) else noise, one_side, shared, options.noise)


def exact_beside(known: "NoisePrior") -> "Noise":
    """The noise of the side that is known, the other one without any."""
    from ..noise.models import PoseNoise

    rotation, translation, *camera = known.values.tolist()
    if not any(value > 0 for value in known.values.tolist()):
        raise InputError(BOTH_EXACT)
    robot = None if known.robot is None else (rotation, translation)
    return PoseNoise.isotropic(robot, None if known.camera is None else (camera[0], camera[1]))


def prior_of(
    robot_prior: Annotated[
        str | None,
        option(
            "--robot-prior",
            metavar="ROT,TRANS",
            panel=NOISE,
            help="Data sheet of the robot, for noise that is estimated, e.g. '?,0.05mm'; ? is unknown.",
        ),
    ] = None,
    camera_prior: Annotated[
        str | None,
        option("--camera-prior", metavar="ROT,TRANS", panel=NOISE, help="The same of the camera, e.g. '0.1deg,?'."),
    ] = None,
    prior_factor: Annotated[
        float,
        option("--prior-factor", panel=NOISE, help="The data sheet is right within this factor (1 sigma); 1: exact."),
    ] = 2.0,
) -> "NoisePrior | None":
    """What the data sheets say, or None if nothing is given."""
    from ..noise.estimate import NoisePrior

    if robot_prior is None and camera_prior is None:
        return None
    robot, camera = _partly_known(robot_prior, "--robot-prior"), _partly_known(camera_prior, "--camera-prior")
    return NoisePrior(robot, camera, prior_factor)


def pose_prior_of(
    prior_x: Annotated[
        Path | None,
        option(
            "--prior-x",
            metavar="FILE",
            panel=KNOWN,
            help="What is known of X: YAML or JSON with pose and covariance, or the result.json of an earlier run.",
        ),
    ] = None,
    prior_w: Annotated[
        Path | None, option("--prior-w", metavar="FILE", panel=KNOWN, help="The same of W, the pose of the target.")
    ] = None,
    known: Annotated[
        list[str] | None,
        option(
            "--known",
            metavar="TEXT",
            panel=KNOWN,
            help="A measured length, e.g. 'target z = 120mm +- 1mm' or 'camera x = 35mm +- 0.5mm'; repeatable.",
        ),
    ] = None,
) -> "dict[str, Any]":
    """What is known of X and W, as arguments of `calibrate`."""
    from ..io import read_prior
    from ..noise.known_values import known as known_values

    found: dict[str, Any] = dict(known_values(*known)) if known else {}
    for path, name, of in ((prior_x, "prior_X", "X"), (prior_w, "prior_W", "W")):
        if path is None:
            continue
        if name in found:
            raise InputError(f"Give either --prior-{of.lower()} or --known of the same pose, not both.")
        found[name] = read_prior(path, of)
    return found


def _deviations(value: str, name: str) -> tuple[float, float]:
    """Standard deviations (rad, m) of an option ROTATION,TRANSLATION."""
    from ..formatting.units import parse_deviations

    rotation, comma, translation = value.partition(",")
    if not comma or "," in translation:
        raise InputError(
            f"Expected {name} to be ROTATION,TRANSLATION such as 0.02deg,0.05mm, or {EXACT}, got {value!r}."
        )
    try:
        return parse_deviations((rotation, translation), name)
    except InputError as error:
        try:
            parse_deviations((translation, rotation), name)
        except InputError:
            raise error from None
        raise InputError(
            f"{name} {value}: rotation and translation look swapped; write {translation},{rotation}."
        ) from None


def _partly_known(value: str | None, name: str) -> tuple[str | None, str | None] | None:
    if value is None:
        return None
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != 2:
        raise InputError(f"Expected {name} to be ROTATION,TRANSLATION such as ?,0.05mm, got {value!r}.")
    rotation, translation = (None if part in ("", "?") else part for part in parts)
    return rotation, translation
