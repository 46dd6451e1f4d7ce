"""Options of a ROS bag, whose streams take the place of pose files."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..errors import InputError
from .arm import Arm, ChainOptions, ErrorOptions, arm_of
from .boards import read_length
from .messages import LOG, timed
from .pictures import Pictures, either
from .pose_files import PoseFiles
from .views import Views, camera_of

if TYPE_CHECKING:
    from ..model.camera.adjustment.two_minima import Minima
    from ..model.poses.stream import Stream
    from ..read.rosbag.camera_info import CameraInfo
    from ..read.rosbag.recording import Recording
    from ..read.rosbag.sensors import Sensors

# Names of the pictures of `rosbag.lens`, repeated here so that help loads quickly.
CHOICES = ("raw", "rectified")


class BagOptions(NamedTuple):
    """Options of a bag.

    Options (Pose files):
      --bag FILE: ROS bag (.bag, .mcap, .db3 or folder) in place of ROBOT and CAMERA, with --robot and --camera.
        uq-handeye bag lists its content. Repeat it for several.
      bag_camera = --camera FRAMES: Camera poses of --bag: frames such as camera:tag36h11_0 (optical frame and target),
        or a topic. Without --bag: NAME=FILE, the poses of one of several cameras. Repeat it for each (rig.md). Five
        kinds of options are not for several cameras: published methods with --pairs, --scale and --kind (they solve
        one A X = X B); --camera-scale (several cameras need one unit); --touches, --with-cross-check and --watch
        (they are of one camera: verify, cross-check); pictures, bags and --offset (rig.toml names those of each
        camera); --correlation (steps of cameras and targets are tested, drifts are not estimated).
      --still: One mean pose pair per stop of --bag, if the robot stops.
    """

    bag: list[Path] | None = None
    bag_camera: list[str] | None = None
    still: bool = False


class RobotGiven(NamedTuple):
    """Robot of joint values, and the bag, as far as they are given."""

    arm: Arm | None
    bag: "BagGiven | None"
    cameras: tuple[str, ...] = ()  # NAME=FILE of several cameras


@dataclass(frozen=True)
class BagGiven:
    """Bag with the names of robot and camera in it."""

    paths: list[Path]
    robot: str | None
    camera: str | None
    still: bool
    chain: ChainOptions | None = None  # of an arm whose joint values are in the bag
    errors: ErrorOptions = field(default_factory=ErrorOptions)

    def sensors_with(
        self, files: PoseFiles, seen: "Pictures | Views | None", arm: Arm | None
    ) -> tuple["Sensors", Views | None, Arm | None]:
        """Return the streams of the bag, and of ``files`` for the side that it does not give.

        And the views of tags seen by their corners, and the arm.
        """
        pictures, views = either(seen)
        if pictures is not None:
            raise InputError(
                "--images with --bag: pictures have no times. Write robot poses with uq-handeye bag -o DIR."
            )
        if files.pair == "time":
            raise InputError("--pair time: poses of a --bag are interpolated. For one clock give --offset 0.")
        by_joints = arm is not None and arm.by_joints
        if by_joints and self.robot:
            raise InputError(f"The robot is given twice, by --joints and --robot {self.robot}. Remove one of them.")
        spare = files.robot
        if files.camera is not None or (spare is not None and (self.robot or by_joints) and self.camera):
            raise InputError(
                f"--bag with the pose file {files.camera or spare}: both sides are given twice. Remove the file, or "
                "--robot or --camera."
            )
        if spare is None and not ((self.robot or by_joints) and self.camera):
            lacks = "--robot BASE:TOOL" if self.camera else "--camera OPTICAL_FRAME:TARGET"
            lacks = lacks if self.robot or self.camera else "--robot BASE:TOOL and --camera OPTICAL_FRAME:TARGET"
            raise InputError(f"--bag needs {lacks}. uq-handeye bag {self.paths[0]} lists what there is.")
        from ..read.rosbag.recording import read_recording
        from ..read.rosbag.sensors import Sensors

        with timed(f"reading {self.paths[0]}"):
            recording = read_recording(self.paths)
        if len(self.paths) > 1:
            LOG.info(
                "%d bags are read as one session: camera, target and robot base must not move between them",
                len(self.paths),
            )
        if self.chain is not None:
            arm = self._arm_of_topic(recording, self.chain)
        of_robot = None if arm is not None and arm.by_joints else self.robot
        sides, views, minima = self._streams(recording, of_robot, files, views)
        for role, stream in sides.items():
            for note in () if stream.source is None else stream.source.notes:
                LOG.info("%s, %s: %s", recording.name, role, note)
        recorded = tuple(sides)
        for role in {"robot", "camera"} - sides.keys():
            sides[role] = files.stream(role, spare, arm if role == "robot" else None)
        return Sensors(recording.name, **sides, recorded=recorded, minima=minima, still=self.still), views, arm

    def _arm_of_topic(self, recording: "Recording", chain: ChainOptions) -> Arm | None:
        """Return the arm that a topic of joint values moves; that of the kinematics alone where --robot names poses."""
        import numpy as np

        from ..model.kinematics.joints_file import NamedJoints

        topic = self.robot or ""
        if topic not in recording.joints and f"/{topic}" not in recording.joints:
            return arm_of(chain, self.errors)
        track = recording.joint_tracks(topic)[0]  # of an arm; others may be of its gripper
        times, *values = track.values.T
        joints: Any = NamedJoints(f"{topic} in {recording.name}", tuple(track.names), times, np.array(values).T)
        return arm_of(replace(chain, joints=joints), self.errors)

    def _streams(
        self, recording: "Recording", robot: str | None, files: PoseFiles, seen: Views | None
    ) -> "tuple[dict[str, Stream], Views | None, Minima | None]":
        from ..read.rosbag.streams import camera_stream, robot_stream

        sides: dict[str, Stream] = {}
        for role in ("robot", "camera"):
            wrong = [name for name in files.given_of(role) if not name.endswith("-frame")]
            if wrong and getattr(self, role):
                raise InputError(f"{', '.join(wrong)}: for pose files, not for --bag. Remove the option.")
        if robot:
            sides["robot"] = robot_stream(recording, robot, frame=files.robot_frame)
        if not self.camera:
            return sides, seen, None
        text = None if seen is None else seen.options.tag
        side = None if text is None else read_length(text, "--tag")
        matrix = None if seen is None else seen.options.camera_matrix
        info = None if matrix is None else info_of(matrix)
        found = camera_stream(recording, self.camera, tag=side, info=info, frame=files.camera_frame)
        if found.by_corners and seen is not None and seen.options.pixel_origin is not None:
            raise InputError(
                "--pixel-origin: for finished poses. The corners of tags in a bag are read as their detector counts "
                "pixels. Remove the option."
            )
        sides["camera"] = found.stream
        if found.hint:
            LOG.info("%s: %s", recording.name, found.hint)
        if seen is not None and (matrix is None or matrix in CHOICES) and found.info is not None:
            seen = seen._replace(options=replace(seen.options, camera_matrix=found.info.text()))
        return sides, seen, found.minima


def info_of(text: str) -> "CameraInfo | str":
    """Return the intrinsics of --camera-matrix in the form of a camera_info, or the word that selects among its own."""
    import numpy as np

    from ..model.camera.models import LINEAR, MODELS
    from ..read.rosbag.camera_info import CameraInfo

    if text in CHOICES:
        return text
    camera = camera_of(text)
    values = camera.values
    if missing := [name for name in LINEAR if name not in values]:
        raise InputError(f"--camera-matrix {text}: expected {', '.join(LINEAR)}, got no {missing[0]}.")
    model = camera.model or "pinhole"
    D = np.array([values.get(name, 0.0) for name in MODELS[model].coefficients])
    known = {"brown": "plumb_bob", "fisheye": "fisheye", "pinhole": ""}[model]
    return CameraInfo("", (0, 0), known, np.array([values[name] for name in LINEAR]), D, np.zeros(4))


def given_of_robot(chain: ChainOptions, options: ErrorOptions, bag: BagOptions) -> RobotGiven:
    """Return the arm and the bag of the options; --robot names the robot in a bag if there is one."""
    if not bag.bag:
        cameras = tuple(bag.bag_camera or ())
        if cameras and not all("=" in text for text in cameras):
            raise InputError("--camera needs --bag FILE, or is NAME=FILE for each of several cameras.")
        if bag.still:
            raise InputError("--still needs --bag FILE. Add it.")
        file = options.robot_file
        if file is not None and chain.joints is None and not file.exists():
            raise InputError(f"--robot {file}: names the robot in a bag, or poses beside --joints. Add --bag FILE.")
        return RobotGiven(arm_of(chain, options), None, cameras)
    robot = None if options.robot_file is None else str(options.robot_file)
    if chain.given and chain.joints is None and robot is None:
        raise InputError(
            f"{', '.join(chain.given)} with --bag: add --robot TOPIC, the joint values or the poses in the bag."
        )
    options = replace(options, robot_file=None)
    if len(bag.bag_camera or ()) > 1:
        raise InputError("--camera is given twice: a bag gives the poses of one camera. Remove one of them.")
    given = BagGiven(bag.bag, robot, next(iter(bag.bag_camera or ()), None), bag.still)
    if (chain.given or options.given) and chain.joints is None and robot is not None:
        return RobotGiven(None, replace(given, chain=chain, errors=options))
    return RobotGiven(arm_of(chain, options), given)
