"""The robot by its joints and its chain, on the command line."""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..errors import InputError
from .options import made_of, one_of, option

if TYPE_CHECKING:
    from ..kinematics.chain import Kinematics
    from ..kinematics.kinematic_errors import KinematicErrors

# Panel of the help.
KINEMATICS = "Kinematics"
# Of kinematics.kinematic_errors, written down once more to be quick.
HOW = ("estimate", "declared", "exact")
ROBOT_CLASSES = ("industrial", "cobot", "hobby")
FLANGES = ("controller", "physical")
JOINT_UNITS = ("rad", "deg")

# Standard deviations, and what `KinematicErrors` calls them.
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
        panel=KINEMATICS,
        help="Unit of --joints: rad, deg, or e.g. deg,mm with prismatic joints. Default: what its header says.",
    ),
]


@dataclass(frozen=True)
class ChainOptions:
    """Joint values and the chain that they move, as the command line says."""

    joints: Annotated[
        Path | None,
        option(
            "--joints",
            metavar="FILE.csv",
            panel=KINEMATICS,
            help="Joint values, one column per joint by its name, rows as in ROBOT. ROBOT may then be left out, and a "
            "single file is CAMERA: the robot poses follow from the joints.",
        ),
    ] = None
    urdf: Annotated[
        Path | None,
        option("--urdf", metavar="FILE.urdf", panel=KINEMATICS, help="The arm that the joints move: its URDF."),
    ] = None
    base: Annotated[
        str | None,
        option(
            "--base",
            metavar="LINK",
            panel=KINEMATICS,
            help="Link that the robot poses start from. Default: the root of the URDF.",
        ),
    ] = None
    tip: Annotated[
        str | None,
        option(
            "--tip",
            metavar="LINK",
            panel=KINEMATICS,
            help="Link that they end at, e.g. tool0. Default: the only end of the URDF.",
        ),
    ] = None
    dh: Annotated[
        Path | None,
        option(
            "--dh",
            metavar="FILE",
            panel=KINEMATICS,
            help="Denavit-Hartenberg parameters in place of --urdf, CSV or TOML.",
        ),
    ] = None
    ur_calibration: Annotated[
        Path | None,
        option(
            "--ur-calibration",
            metavar="FILE.yaml",
            panel=KINEMATICS,
            help="Calibration of a Universal Robots arm, in place of --urdf or for it.",
        ),
    ] = None
    joint_units: JointUnits = None

    @property
    def given(self) -> list[str]:
        """Names of the options that were given."""
        return [f"--{f.name.replace('_', '-')}" for f in fields(self) if getattr(self, f.name) is not None]

    def require(self) -> None:
        """Raise `InputError` unless joints and one chain are given."""
        if self.joints is None:
            raise InputError(f"{', '.join(self.given)}: give the joint values, too: --joints joints.csv.")
        if self.urdf is self.dh is self.ur_calibration is None:
            raise InputError("--joints needs the arm that the joints move: give --urdf robot.urdf (or --dh FILE), too.")
        if self.dh is not None:
            others = ("--urdf", "--base", "--tip", "--ur-calibration")
            if wrong := [name for name in others if name in self.given]:
                raise InputError(f"{', '.join(wrong)}: not beside --dh, which says the whole arm; leave it out.")

    def kinematics(self) -> "Kinematics":
        """The chain."""
        from ..kinematics.chain import Kinematics

        if self.dh is not None:
            return Kinematics.from_dh(self.dh)
        if self.ur_calibration is not None:
            return Kinematics.from_ur_calibration(self.ur_calibration, self.urdf, self.base, self.tip)
        assert self.urdf is not None
        return Kinematics.from_urdf(self.urdf, self.base, self.tip)


@dataclass(frozen=True)
class ErrorOptions:
    """What is known of the kinematic errors, as the command line says."""

    robot_file: Annotated[
        Path | None,
        option(
            "--robot",
            metavar="FILE",
            panel=KINEMATICS,
            help="Beside --joints in place of ROBOT: poses of the controller, compared with those of the joints.",
        ),
    ] = None
    how: Annotated[
        str | None,
        option(
            "--kinematics",
            of=HOW,
            metavar="NAME",
            panel=KINEMATICS,
            help="Errors of the arm: estimate (the standard deviations are the least that is assumed), declared (as "
            "given) or exact (none). Default: estimate.",
        ),
    ] = None
    joint_noise: Annotated[
        str | None,
        option(
            "--joint-noise",
            metavar="SD",
            panel=KINEMATICS,
            help="Standard deviation of each joint in each pose, e.g. 0.01deg. Default: estimated.",
        ),
    ] = None
    joint_offset_sd: Annotated[
        str | None,
        option(
            "--joint-offset-sd",
            metavar="SD",
            panel=KINEMATICS,
            help="Standard deviation of the joint offsets, e.g. 0.1deg.",
        ),
    ] = None
    tilt_sd: Annotated[
        str | None,
        option("--tilt-sd", metavar="SD", panel=KINEMATICS, help="Of the tilts of the joint axes, e.g. 0.03deg."),
    ] = None
    length_sd: Annotated[
        str | None, option("--length-sd", metavar="SD", panel=KINEMATICS, help="Of the link lengths, e.g. 0.2mm.")
    ] = None
    transmission_sd: Annotated[
        str | None,
        option(
            "--transmission-sd",
            metavar="SD",
            panel=KINEMATICS,
            help="Of the error that a joint repeats once or twice per turn, e.g. 0.02deg.",
        ),
    ] = None
    sag_sd: Annotated[
        str | None,
        option(
            "--sag-sd",
            metavar="SD",
            panel=KINEMATICS,
            help="Of the deflection of a joint under its largest weight, e.g. 0.06deg.",
        ),
    ] = None
    robot_class: Annotated[
        str | None,
        option(
            "--robot-class",
            of=ROBOT_CLASSES,
            metavar="NAME",
            panel=KINEMATICS,
            help=f"Standard deviations not given: those of arms of this class, {', '.join(ROBOT_CLASSES)}. Default: "
            "industrial.",
        ),
    ] = None
    flange: Annotated[
        str | None,
        option(
            "--flange",
            of=FLANGES,
            metavar="NAME",
            panel=KINEMATICS,
            help="Flange that X belongs to: where the controller's joints put it, or the physical one, whose offset "
            "from that is then part of the uncertainty. Default: controller.",
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
        """What `calibrate` takes."""
        from ..kinematics.kinematic_errors import KinematicErrors

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
                raise InputError(f"{', '.join(wrong)}: --kinematics exact has no errors of the arm; leave it out.")
        for name, (known, value) in deviations.items():
            try:  # on its own, so that the message names the option
                KinematicErrors(**{known: value})
            except InputError as error:
                raise InputError(f"{name}: {error}") from None
            values[known] = value
        return KinematicErrors(**values)


@dataclass(frozen=True)
class Arm:
    """The robot by its joints."""

    chain: ChainOptions
    options: ErrorOptions

    @property
    def shown(self) -> str:
        """The file of joints."""
        return str(self.chain.joints)

    @cached_property
    def kinematics(self) -> "Kinematics":
        """The chain, read once."""
        return self.chain.kinematics()

    @property
    def of_files(self) -> dict[str, Any]:
        """Options of `read_poses` and `read_stream`."""
        return {"joints": self.chain.joints, "kinematics": self.kinematics, "joint_units": self.chain.joint_units}

    @property
    def of_calibrate(self) -> dict[str, Any]:
        """Options of `calibrate`; the joints are those of its poses."""
        return {"kinematics": self.kinematics, "kinematic_errors": self.options.errors()}


@made_of(chain=ChainOptions, options=ErrorOptions)
def arm_of(chain: "ChainOptions", options: "ErrorOptions") -> Arm | None:
    """The arm of the options, or None if none is given."""
    if not chain.given and not options.given:
        return None
    if chain.joints is None:
        given = ", ".join([*chain.given, *options.given])
        raise InputError(f"{given}: about the joints of the robot; give --joints joints.csv, too.")
    chain.require()
    return Arm(chain, options)
