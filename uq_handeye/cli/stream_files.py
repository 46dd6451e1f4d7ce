"""Options of two files of poses, and how they are read as streams."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import LOG, command_line
from .options.arm import Arm
from .options.common import CAMERA_FRAMES, ROBOT_FRAMES, SETUP_NAMES

if TYPE_CHECKING:
    from ..model.poses.stream import Stream
    from ..read.synchronisation.result import Synchronised


@dataclass(frozen=True)
class StreamFiles:
    """Options of the files of robot and camera poses.

    Arguments:
      ROBOT: Robot poses: file, folder or 'PATTERN' as the robot writes it, or CSV. The format is told by the content or
        by --robot-format; CSV is timestamp,x,y,z,qx,qy,qz,qw in m. Poses are base_T_gripper unless --robot-frame says
        otherwise. Or one file that holds both sides.
      CAMERA: Camera poses, or folder of camera -o or points -o. camera_T_target, row by row as in ROBOT unless --pair
        says otherwise.

    Options (Pose files):
      * --setup NAME <SETUP_NAMES>: Camera mount: eye-in-hand (default) or eye-to-hand. eye-in-hand: on the gripper;
        eye-to-hand: in the cell. A pose file may state it, too.
      --format NAME <FORMAT_NAMES>: Format of both files: {FORMAT_NAMES}. Default: detected.
      --robot-format NAME <FORMAT_NAMES>: Format of the robot file. Default: --format.
      --camera-format NAME <FORMAT_NAMES>: Format of the camera file. Default: --format.
      * --units UNIT <UNITS>: Length unit of both files. One of {UNITS}. Default: of the format. If that says none: m.
      --robot-units UNIT <UNITS>: Length unit of the robot file. Default: --units.
      --camera-units UNIT <UNITS>: Length unit of the camera file. Default: --units.
      --rotation FORM: Rotations of both files, e.g. ZYX-deg. Euler angles by their axes and unit (ZYX-deg: rotated
        axes; xyz-rad: fixed axes), rotvec-rad, rotvec-deg, xyzw, wxyz, or transposed matrices. Default: as the format
        says.
      --robot-rotation FORM: Rotations of the robot file. Default: --rotation.
      --camera-rotation FORM: Rotations of the camera file. Default: --rotation.
      --quaternion ORDER <xyzw|wxyz>: Quaternion order of both files: xyzw, or wxyz (scalar first). Default: that of the
        format.
      --robot-quaternion ORDER <xyzw|wxyz>: Quaternion order of the robot file. Default: --quaternion.
      --camera-quaternion ORDER <xyzw|wxyz>: Quaternion order of the camera file. Default: --quaternion.
      --robot-frame FRAME <ROBOT_FRAMES>: Direction of the robot poses: base_T_gripper or gripper_T_base.
      --camera-frame FRAME <CAMERA_FRAMES>: Direction of the camera poses: camera_T_target or target_T_camera.
      --offset SECONDS: Clock offset of unsynchronised streams (robot minus camera, s), taken as exact, or OFFSET,STD.
        Default: estimated.
    """

    robot: Path | None = None
    camera: Path | None = None
    setup: str | None = None
    format: str | None = None
    robot_format: str | None = None
    camera_format: str | None = None
    units: str | None = None
    robot_units: str | None = None
    camera_units: str | None = None
    rotation: str | None = None
    robot_rotation: str | None = None
    camera_rotation: str | None = None
    quaternion: str | None = None
    robot_quaternion: str | None = None
    camera_quaternion: str | None = None
    robot_frame: str = ROBOT_FRAMES[0]
    camera_frame: str = CAMERA_FRAMES[0]
    offset: str | None = None

    def synchronised(self, arm: Arm | None = None, **options: Any) -> "Synchronised":
        """Return both sides as streams on one clock; ``options`` are further arguments of `synchronise`."""
        from ..read.synchronisation.synchronise import synchronise

        streams = self.streams(arm)
        LOG.debug("%d poses of the robot, %d of the camera", len(streams["robot"]), len(streams["camera"]))
        setup = SETUP_NAMES[0] if self.setup is None else self.setup
        return synchronise(streams["robot"], streams["camera"], setup=setup, offset=self._offset(), **options)

    def streams(self, arm: Arm | None = None) -> "dict[str, Stream]":
        """Return the streams of robot and camera."""
        if self.robot is None and arm is None:
            raise missing_robot("")
        if self.camera is None:
            raise InputError("Synchronisation needs two streams. Give the robot file and the camera file.")
        return {"robot": self.stream("robot", self.robot, arm), "camera": self.stream("camera", self.camera)}

    def stream(self, role: str, file: Path | None, arm: Arm | None = None) -> "Stream":
        """Return the stream of one side from a file, or the joint values of ``arm``."""
        from ..read import read_stream

        k = ("robot", "camera").index(role)
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
        try:
            numbers = [float(part) for part in self.offset.split(",")]
        except ValueError:
            numbers = []
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
        return self.robot_units or self.units, self.camera_units or self.units

    @property
    def formats(self) -> tuple[str | None, str | None]:
        """Formats of the robot file and the camera file; None: detected."""
        return self.robot_format or self.format, self.camera_format or self.format

    @property
    def rotations(self) -> tuple[str | None, str | None]:
        """Forms of the rotations of the robot file and the camera file; None: as the format says."""
        return (
            self._one_form("robot", self.robot_rotation, self.robot_quaternion),
            self._one_form("camera", self.camera_rotation, self.camera_quaternion),
        )

    def _one_form(self, role: str, form: str | None, order: str | None) -> str | None:
        """Return what --rotation or --quaternion says of one side; its own options win."""
        if form is not None and order is not None:
            raise InputError(f"--{role}-rotation and --{role}-quaternion are both given. Remove one of them.")
        if self.rotation is not None and self.quaternion is not None:
            raise InputError("--rotation and --quaternion are both given. Remove one of them.")
        return form or order or self.rotation or self.quaternion

    def _shown(self, arm: Arm | None = None) -> str:
        robot = arm.shown if self.robot is None and arm is not None else str(self.robot)
        return robot if self.camera is None else f"{robot} and {self.camera}"


def missing_robot(instead: str = ", or --joints and --urdf") -> InputError:
    """Return the error of missing robot poses."""
    command = " ".join(command_line().split()[:2])
    return InputError(f"Missing argument 'ROBOT'{instead} (see {command} --help).")
