"""Command ``bag``: what a ROS bag holds, and its poses as tables."""

from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from ..bag_files import info_of
from ..boards import read_length
from ..delivery import deliver
from ..messages import LOG, timed
from ..printing import emit

if TYPE_CHECKING:
    from ...model.poses.stream import Stream
    from ...read.rosbag.recording import Recording


def bag_command(
    files: list[Path],
    robot: str | None = None,
    camera: str | None = None,
    tag: str | None = None,
    camera_matrix: str | None = None,
    joints: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """List what a ROS bag holds, and the command to calibrate.

    Examples:
      uq-handeye bag cell.mcap
      # Poses as tables, for other commands and programs
      uq-handeye bag cell.mcap --robot base:tool0 --camera camera:tag36h11_0 \\
          --tag 40mm -o tables/
      # Then calibrate, from the bag or from the tables
      uq-handeye calibrate --bag cell.mcap --robot base:tool0 \\
          --camera camera:tag36h11_0 --tag 40mm

    Reads ROS 1 and ROS 2 bags and MCAP files without ROS: /tf and /tf_static,
    pose topics, joint states, tags, camera_info. It needs the extra rosbag:
    pip install '.[rosbag]'.

    Arguments:
      files = BAG: ROS bag: .bag, .mcap, .db3 or the folder of ros2 bag; several of a session.

    Options (Poses as tables):
      * --robot FRAMES: Robot poses to write with -o: frames such as base_link:tool0, or a topic.
      * --camera FRAMES: Camera poses to write with -o: frames such as camera:tag36h11_0, or a topic.
      * --tag LENGTH: Side of a tag that was detected by its corners, e.g. 40mm.
      --camera-matrix MATRIX: Intrinsics for the corners of a tag: fx,fy,cx,cy (px), a file, or of camera_info raw (K
        and D) or rectified (P), the picture in which it was detected. Default: camera_info, as the corners fit.
      * --joints TOPIC: Joint values to write with -o: a topic of JointState, e.g. /joint_states.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the poses as tables. It holds robot.csv, camera.csv and joints.csv,
        as far as they are named, and camera_info.yaml with a tag.
    """
    asked = {"--robot": robot, "--camera": camera, "--joints": joints}
    given = [name for name, value in asked.items() if value is not None]
    if given and output is None:
        raise InputError(f"{', '.join(given)}: the tables need a folder. Add -o DIR.")
    if output is not None and not given:
        raise InputError("-o writes tables. Add --robot, --camera or --joints.")
    if tag is not None and camera is None:
        raise InputError("--tag needs --camera. Add it.")
    if camera_matrix is not None and tag is None:
        raise InputError("--camera-matrix needs --tag. Add it.")
    from ...read import json_text
    from ...read.rosbag.listing import dict_of, text_of
    from ...read.rosbag.recording import read_recording

    with timed(f"reading {files[0]}"):
        recording = read_recording(files)
    if not sum(topic.count for topic in recording.topics.values()):
        raise InputError(f"{recording.name}: the bag holds no messages. Was the recording stopped too early?")
    written = _tables(recording, robot, camera, (tag, camera_matrix), joints)
    names = [str(file) for file in files]
    if not written:
        emit(json_text(dict_of(recording, names)) if as_json else text_of(recording, names))
        return
    assert output is not None
    said = deliver(output, written)
    emit(json_text({"folder": str(output), "files": list(written)}) if as_json else said.lstrip("\n"))


def _tables(
    recording: "Recording",
    robot: str | None,
    camera: str | None,
    of_tag: tuple[str | None, str | None],
    joints: str | None,
) -> dict[str, str]:
    """Return the requested tables, by the names of their files."""
    from ...read import pose_text
    from ...read.rosbag.camera_info import camera_info_yaml
    from ...read.rosbag.joints import joints_csv
    from ...read.rosbag.streams import camera_stream, robot_stream

    found: dict[str, str] = {}
    streams: dict[str, Stream] = {}
    if robot is not None:
        streams["robot"] = robot_stream(recording, robot)
    if camera is not None:
        tag, matrix = of_tag
        info = None if matrix is None else info_of(matrix)
        seen = camera_stream(recording, camera, tag=None if tag is None else read_length(tag, "--tag"), info=info)
        streams["camera"] = seen.stream
        if seen.hint:
            LOG.info("%s: %s", recording.name, seen.hint)
        if seen.info is not None:
            found["camera_info.yaml"] = camera_info_yaml(seen.info)
    for role, stream in streams.items():
        for note in () if stream.source is None else stream.source.notes:
            LOG.info("%s, %s: %s", recording.name, role, note)
        found[f"{role}.csv"] = pose_text(stream.poses, stream.timestamps)
    if joints is not None:
        track, *others = recording.joint_tracks(joints)
        found["joints.csv"] = joints_csv(track)
        for other in others:
            LOG.info("%s, %s: messages of %s alone are left out", recording.name, joints, ", ".join(other.names[:12]))
    return found
