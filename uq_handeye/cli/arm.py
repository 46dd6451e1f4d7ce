"""Options of the arm: its kinematic model, its joint values, and the errors of both."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ..errors import InputError
from .names import ROBOT_CLASSES
from .options import Options
from .values import naming_option, one_of

if TYPE_CHECKING:
    from ..model.kinematics.chain import Kinematics
    from ..model.kinematics.kinematic_errors import KinematicErrors

# Names of kinematics.kinematic_errors and kinematics.arms.known_arms, repeated here so that help loads quickly.
HOW = ("estimate", "declared", "exact")
FLANGES = ("workspace", "controller", "physical")
ROBOT_MODELS = (
    *("ur3e", "ur5e", "ur10e", "ur16e", "ur5", "ur10", "ur7e", "ur12e", "ur15", "ur20", "ur30", "irb120"),
    *("irb1200", "irb2600", "irb4600", "kr6r900", "kr10r1100", "kr10r1100-2", "iiwa7", "iiwa14"),
    *("lrmate200id", "m10ia", "crx3ia", "crx5ia", "crx10ia", "crx10ial", "crx20ial", "crx30ia", "gp7"),
    *("hc10", "tx260", "rs007n", "vs060", "panda", "fr3", "gen3", "xarm6", "xarm7", "m1013", "meca500"),
    "so101",
)

# Errors of an arm whose standard deviation --size declares, and the parameter of `KinematicErrors` that takes it.
SIZES_OF_ARM = {
    "joint noise": "joint_sd",
    "joint offsets": "offset_sd",
    "joint tilts": "tilt_sd",
    "link lengths": "length_sd",
    "transmission": "transmission_sd",
    "sag": "sag_sd",
}


def split_sizes(texts: list[str] | None) -> tuple[dict[str, str], list[str]]:
    """Return the texts of --size that declare an error of the arm, by its name, and the other texts.

    Joint noise with a factor belongs to the others: its size is then estimated like those of the other errors.
    """
    of_arm: dict[str, str] = {}
    others = []
    for text in texts or []:
        name, _, value = (part.strip() for part in text.partition("="))
        known_within = "," in value
        if name not in SIZES_OF_ARM or (known_within and name == "joint noise"):
            others.append(text)
        elif known_within:
            raise InputError(
                f"--size {text}: errors of the arm take no factor. --kinematics estimate (the default) knows them "
                "within a factor of 2, declared exactly. Remove the factor."
            )
        elif name in of_arm:
            raise InputError(f"--size gives {name!r} twice. Remove one of them.")
        else:
            of_arm[name] = value
    return of_arm, others


@dataclass(frozen=True)
class ChainOptions(Options):
    """Options of the joint values and the kinematic chain.

    Options (Robot joints):
      * --joints FILE.csv: Joint values in place of ROBOT, with --urdf. One column per joint, named as in the URDF (of
        other arms numbered, e.g. J1, or as their driver names them), and one row per pose. The robot poses follow from
        the joints; a single file argument is CAMERA.
      * --robot-model NAME <ROBOT_MODELS>: Arm by its name, e.g. ur5e, or MJCF model FILE.xml. Not with --urdf. The
        nominal kinematics are used, with or without --joints. Names: {ROBOT_MODELS}.
      * --urdf FILE.urdf: Robot model (URDF), of --joints or of ROBOT. Without --joints the joint values follow from the
        poses in ROBOT by inverse kinematics.
      --base LINK: Base link of the robot poses. Default: the root of the URDF, the world of an MJCF model.
      --tip LINK: Flange or tool link (MJCF: body or site) of the robot poses, e.g. tool0. Default: the only leaf.
      --dh FILE: Denavit-Hartenberg parameters (CSV or TOML), in place of --urdf, with or without --joints.
      --ur-calibration FILE.yaml: Kinematic calibration of a Universal Robots arm, in place of --urdf or applied to it.
    """

    joints: Path | None = None
    robot_model: str | None = None
    urdf: Path | None = None
    base: str | None = None
    tip: str | None = None
    dh: Path | None = None
    ur_calibration: Path | None = None
    joint_units: str | None = None

    def require(self, others: list[str]) -> None:
        """Raise `InputError` unless the options name one robot model; ``others`` need it, too."""
        from ..model.kinematics.descriptions.mjcf import is_mjcf

        whole = [name for name in ("--dh", "--robot-model") if name in self.given]
        if not whole and self.urdf is self.ur_calibration is None:
            if self.joints is not None:
                raise InputError(
                    "--joints needs a robot model. Add --urdf robot.urdf (or --dh FILE, --robot-model NAME)."
                )
            given = ", ".join([*self.given, *others])
            raise InputError(f"{given}: needs a robot model. Add --urdf robot.urdf or --robot-model NAME.")
        ends = () if self.robot_model is not None and is_mjcf(self.robot_model) else ("--base", "--tip")
        parts = ("--urdf", *ends, "--ur-calibration", *whole[1:])
        if whole and (wrong := [name for name in parts if name in self.given]):
            raise InputError(
                f"{', '.join(wrong)}: not used with {whole[0]}, which describes the whole arm. Remove one of them."
            )
        if self.joint_units is not None and self.joints is None:
            raise InputError("--joint-units needs --joints. Remove it.")
        if self.robot_model is not None:
            self.kinematics()  # before the work, so that a wrong name is reported at once

    def kinematics(self) -> "Kinematics":
        """Read the kinematic chain."""
        from ..model.kinematics.chain import Kinematics
        from ..model.kinematics.descriptions.mjcf import is_mjcf

        if self.robot_model is not None:
            with naming_option("--robot-model"):
                if is_mjcf(self.robot_model):
                    return Kinematics.from_mjcf(self.robot_model, self.base, self.tip)
                return Kinematics.from_name(self.robot_model)
        if self.dh is not None:
            return Kinematics.from_dh(self.dh)
        if self.ur_calibration is not None:
            return Kinematics.from_ur_calibration(self.ur_calibration, self.urdf, self.base, self.tip)
        assert self.urdf is not None
        return Kinematics.from_urdf(self.urdf, self.base, self.tip)


@dataclass(frozen=True)
class ErrorOptions(Options):
    """Options of the kinematic errors.

    Options (Robot joints):
      robot_file = --robot FILE: Poses reported by the controller, compared with those from --joints. With calibrate
        --bag: the robot's frames, e.g. base:tool0, or its topic.
      how = --kinematics NAME <HOW>: Treatment of the kinematic errors: estimate, declared or exact. estimate: their
        standard deviations are known within a factor; declared: as given; exact: no errors. Default: estimate.
      --flange NAME <FLANGES>: Flange that X refers to: workspace (the frames in which the arm agrees best with its
        model), controller (as computed from the joints) or physical (its deviation from that is part of the
        uncertainty). Default: workspace.
    """

    _called: ClassVar[dict[str, str]] = {"robot_file": "--robot", "how": "--kinematics"}

    robot_file: Path | None = None
    how: str | None = None
    robot_class: str | None = None
    size: list[str] | None = None
    flange: str | None = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given for the arm; --size only where it declares one of its errors."""
        of_arm, _ = split_sizes(self.size)
        return [name for name in super().given if name != "--size" or of_arm]

    def errors(self) -> "KinematicErrors":
        """Return the errors as an argument of `calibrate`."""
        from ..model.kinematics.kinematic_errors import KinematicErrors

        values: dict[str, Any] = {}
        for name, of in (("how", HOW), ("robot_class", ROBOT_CLASSES), ("flange", FLANGES)):
            if (value := getattr(self, name)) is not None:
                shown = "--kinematics" if name == "how" else f"--{name.replace('_', '-')}"
                values[name] = one_of(value, shown, of)
        of_arm, _ = split_sizes(self.size)
        if values.get("how") == "exact":
            wrong = [f"--size {name!r}" for name in of_arm if name != "joint noise"]
            wrong += [name for name in ("--robot-class", "--flange") if name in self.given]
            if wrong:
                raise InputError(f"{', '.join(wrong)}: not used with --kinematics exact. Remove the option.")
        for name, value in of_arm.items():
            parameter = SIZES_OF_ARM[name]
            with naming_option(f"--size {name!r}"):
                KinematicErrors(**{parameter: value})
            values[parameter] = value
        return KinematicErrors(**values)


@dataclass(frozen=True)
class Arm:
    """Robot described by its kinematic chain, and its joint values if they are given."""

    chain: ChainOptions
    options: ErrorOptions
    of_result: "Kinematics | None" = None  # that of a calibration, at new joint values

    @property
    def by_joints(self) -> bool:
        """True if joint values replace the robot poses."""
        return self.chain.joints is not None

    @property
    def shown(self) -> str:
        """Name of the file of joint values."""
        return str(self.chain.joints)

    @cached_property
    def kinematics(self) -> "Kinematics":
        """Kinematic chain, read once."""
        return self.of_result or self.chain.kinematics()

    @property
    def of_files(self) -> dict[str, Any]:
        """Arguments of `read_poses` and `read_stream`."""
        if not self.by_joints:
            return {}
        return {"joints": self.chain.joints, "kinematics": self.kinematics, "joint_units": self.chain.joint_units}

    @property
    def of_calibrate(self) -> dict[str, Any]:
        """Arguments of `calibrate`, which takes the joints from the poses."""
        return {"kinematics": self.kinematics, "kinematic_errors": self.options.errors()}


def arm_alone(chain: ChainOptions, options: ErrorOptions) -> Arm | None:
    """Return the arm of a command that estimates no other sizes; raises `InputError` for sizes of other errors."""
    if others := split_sizes(options.size)[1]:
        raise InputError(
            f"--size {others[0]}: this command takes sizes of the arm's errors only: {', '.join(SIZES_OF_ARM)}."
        )
    return arm_of(chain, options)


def arm_of(chain: ChainOptions, options: ErrorOptions) -> Arm | None:
    """Return the arm of both groups of options, or None without kinematics."""
    if not chain.given and options.given in ([], ["--robot-class"]):  # the class of an unknown arm: `SharedOptions`
        return None
    chain.require(options.given)
    return Arm(chain, options)
