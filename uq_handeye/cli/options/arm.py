"""Options of the robot's joints and kinematics."""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ...errors import InputError
from ..groups import JOINTS
from .common import made_of, one_of, option

if TYPE_CHECKING:
    from ...kinematics.chain import Kinematics
    from ...kinematics.kinematic_errors import KinematicErrors

# Names of kinematics.kinematic_errors, repeated here so that help and completion load quickly.
HOW = ("estimate", "declared", "exact")
ROBOT_CLASSES = ("industrial", "cobot", "hobby")
FLANGES = ("controller", "physical")
JOINT_UNITS = ("rad", "deg")

# Options of standard deviations: field here, parameter of `KinematicErrors`.
_DEVIATIONS = {
    "--joint-noise": ("joint_noise", "joint_sd"),
    "--joint-offset-sd": ("joint_offset_sd", "offset_sd"),
    "--tilt-sd": ("tilt_sd", "tilt_sd"),
    "--length-sd": ("length_sd", "length_sd"),
    "--transmission-sd": ("transmission_sd", "transmission_sd"),
    "--sag-sd": ("sag_sd", "sag_sd"),
}

JointUnits = Annotated[
    str | None,
    option(
        "--joint-units",
        of=JOINT_UNITS,
        metavar="UNIT",
        panel=JOINTS,
        help="Unit of the joint values: rad, deg, or e.g. deg,mm with prismatic joints. Default: as the header says.",
    ),
]


@dataclass(frozen=True)
class ChainOptions:
    """Options of the joint values and the kinematic chain."""

    joints: Annotated[
        Path | None,
        option(
            "--joints",
            metavar="FILE.csv",
            panel=JOINTS,
            common=True,
            help="Joint values in place of ROBOT, with --urdf. One column per joint, named as in the URDF, and one row "
            "per pose. The robot poses follow from the joints; a single file argument is CAMERA.",
        ),
    ] = None
    urdf: Annotated[
        Path | None,
        option("--urdf", metavar="FILE.urdf", panel=JOINTS, common=True, help="Robot model (URDF) for --joints."),
    ] = None
    base: Annotated[
        str | None,
        option(
            "--base",
            metavar="LINK",
            panel=JOINTS,
            help="Base link of the robot poses. Default: the root of the URDF.",
        ),
    ] = None
    tip: Annotated[
        str | None,
        option(
            "--tip",
            metavar="LINK",
            panel=JOINTS,
            help="Flange or tool link of the robot poses, e.g. tool0. Default: the only leaf of the URDF.",
        ),
    ] = None
    dh: Annotated[
        Path | None,
        option(
            "--dh",
            metavar="FILE",
            panel=JOINTS,
            help="Denavit-Hartenberg parameters (CSV or TOML), in place of --urdf.",
        ),
    ] = None
    ur_calibration: Annotated[
        Path | None,
        option(
            "--ur-calibration",
            metavar="FILE.yaml",
            panel=JOINTS,
            help="Kinematic calibration of a Universal Robots arm, in place of --urdf or applied to it.",
        ),
    ] = None
    joint_units: JointUnits = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [f"--{f.name.replace('_', '-')}" for f in fields(self) if getattr(self, f.name) is not None]

    def require(self) -> None:
        """Raise `InputError` unless the options name joint values and one robot model."""
        if self.joints is None:
            raise InputError(f"{', '.join(self.given)}: these options need the joint values. Add --joints joints.csv.")
        if self.urdf is self.dh is self.ur_calibration is None:
            raise InputError("--joints needs a robot model. Add --urdf robot.urdf (or --dh FILE).")
        if self.dh is not None:
            others = ("--urdf", "--base", "--tip", "--ur-calibration")
            if wrong := [name for name in others if name in self.given]:
                raise InputError(
                    f"{', '.join(wrong)}: not used with --dh, which describes the whole arm. Remove one of them."
                )

    def kinematics(self) -> "Kinematics":
        """Read the kinematic chain."""
        from ...kinematics.chain import Kinematics

        if self.dh is not None:
            return Kinematics.from_dh(self.dh)
        if self.ur_calibration is not None:
            return Kinematics.from_ur_calibration(self.ur_calibration, self.urdf, self.base, self.tip)
        assert self.urdf is not None
        return Kinematics.from_urdf(self.urdf, self.base, self.tip)


@dataclass(frozen=True)
class ErrorOptions:
    """Options of the kinematic errors."""

    robot_file: Annotated[
        Path | None,
        option(
            "--robot",
            metavar="FILE",
            panel=JOINTS,
            help="Poses reported by the controller, compared with those from --joints. With calibrate --bag: the "
            "robot's frames, e.g. base:tool0, or its topic.",
        ),
    ] = None
    how: Annotated[
        str | None,
        option(
            "--kinematics",
            of=HOW,
            metavar="NAME",
            panel=JOINTS,
            help="Treatment of the kinematic errors: estimate, declared or exact. estimate: the standard deviations "
            "given are a lower bound; declared: as given; exact: no errors. Default: estimate.",
        ),
    ] = None
    joint_noise: Annotated[
        str | None,
        option(
            "--joint-noise",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of a joint value in one pose, e.g. 0.01deg. Default: estimated.",
        ),
    ] = None
    joint_offset_sd: Annotated[
        str | None,
        option(
            "--joint-offset-sd",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of the joint offsets, e.g. 0.1deg. Default: by --robot-class.",
        ),
    ] = None
    tilt_sd: Annotated[
        str | None,
        option(
            "--tilt-sd",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of the tilts of the joint axes, e.g. 0.03deg. Default: by --robot-class.",
        ),
    ] = None
    length_sd: Annotated[
        str | None,
        option(
            "--length-sd",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of the link lengths, e.g. 0.2mm. Default: by --robot-class.",
        ),
    ] = None
    transmission_sd: Annotated[
        str | None,
        option(
            "--transmission-sd",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of the periodic transmission error (one or two periods per revolution), e.g. "
            "0.02deg. Default: by --robot-class.",
        ),
    ] = None
    sag_sd: Annotated[
        str | None,
        option(
            "--sag-sd",
            metavar="SD",
            panel=JOINTS,
            help="Standard deviation of the deflection of a joint under its largest gravity load, e.g. 0.06deg. "
            "Default: by --robot-class.",
        ),
    ] = None
    robot_class: Annotated[
        str | None,
        option(
            "--robot-class",
            of=ROBOT_CLASSES,
            metavar="NAME",
            panel=JOINTS,
            help=f"Class of the arm ({', '.join(ROBOT_CLASSES)}), which sets the standard deviations not given. "
            "Default: industrial.",
        ),
    ] = None
    flange: Annotated[
        str | None,
        option(
            "--flange",
            of=FLANGES,
            metavar="NAME",
            panel=JOINTS,
            help="Flange that X refers to: controller (as computed from the joints) or physical (its deviation from "
            "that is part of the uncertainty). Default: controller.",
        ),
    ] = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        names = {"robot_file": "--robot", "how": "--kinematics"}
        return [
            names.get(f.name, f"--{f.name.replace('_', '-')}")
            for f in fields(self)
            if getattr(self, f.name) is not None
        ]

    def errors(self) -> "KinematicErrors":
        """Return the errors as an argument of `calibrate`."""
        from ...kinematics.kinematic_errors import KinematicErrors

        values: dict[str, Any] = {}
        for name, of in (("how", HOW), ("robot_class", ROBOT_CLASSES), ("flange", FLANGES)):
            if (value := getattr(self, name)) is not None:
                shown = "--kinematics" if name == "how" else f"--{name.replace('_', '-')}"
                values[name] = one_of(value, shown, of)
        deviations = {
            name: (known, value)
            for name, (field, known) in _DEVIATIONS.items()
            if (value := getattr(self, field)) is not None
        }
        if values.get("how") == "exact":
            kept = [name for name in (*deviations, "--robot-class", "--flange") if name in self.given]
            if wrong := [name for name in kept if name != "--joint-noise"]:
                raise InputError(f"{', '.join(wrong)}: not used with --kinematics exact. Remove the option.")
        for name, (known, value) in deviations.items():
            try:  # on its own, so that the message names the option
                KinematicErrors(**{known: value})
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            values[known] = value
        return KinematicErrors(**values)


@dataclass(frozen=True)
class Arm:
    """Robot described by its joint values and its kinematic chain."""

    chain: ChainOptions
    options: ErrorOptions

    @property
    def shown(self) -> str:
        """Name of the file of joint values."""
        return str(self.chain.joints)

    @cached_property
    def kinematics(self) -> "Kinematics":
        """Kinematic chain, read once."""
        return self.chain.kinematics()

    @property
    def of_files(self) -> dict[str, Any]:
        """Arguments of `read_poses` and `read_stream`."""
        return {"joints": self.chain.joints, "kinematics": self.kinematics, "joint_units": self.chain.joint_units}

    @property
    def of_calibrate(self) -> dict[str, Any]:
        """Arguments of `calibrate`, which takes the joints from the poses."""
        return {"kinematics": self.kinematics, "kinematic_errors": self.options.errors()}


@made_of(chain=ChainOptions, options=ErrorOptions)
def arm_of(chain: "ChainOptions", options: "ErrorOptions") -> Arm | None:
    """Return the arm of the options, or None if none is given."""
    return arm_of_parts(chain, options)


def arm_of_parts(chain: ChainOptions, options: ErrorOptions) -> Arm | None:
    """Return the arm of both groups of options, or None if none is given."""
    if not chain.given and not options.given:
        return None
    if chain.joints is None:
        given = ", ".join([*chain.given, *options.given])
        raise InputError(f"{given}: these options need the joint values. Add --joints joints.csv.")
    chain.require()
    return Arm(chain, options)
