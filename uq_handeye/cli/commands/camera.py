"""Poses of the camera and of streams, for ``calibrate``.

``camera`` makes them from pictures or corners of a board, ``points`` from points of a target measured in 3-D; ``bag``
lists a ROS bag and writes its poses as tables, ``sync`` puts two streams on one clock.
"""

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from ...core.runtime.progress import working
from ...errors import InputError, InputWarning
from ..bag_files import info_of
from ..boards import BoardOptions, read_length, read_two_numbers
from ..delivery import deliver, deliver_answer, deliver_camera_poses
from ..messages import LOG, progress_wanted, timed
from ..options import UNITS, emit, one_of
from ..pictures import LensOptions
from ..pose_files import StreamFiles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...model.poses.stream import Stream
    from ...read.rosbag.recording import Recording

TABLES = (".csv", ".txt", ".tsv")


def camera_command(
    files: list[str],
    board: BoardOptions,
    lens: LensOptions,
    image_size: str | None = None,
    units: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Calibrate a camera from pictures of a board.

    Examples:
      uq-handeye camera 'img/*.png' --board 9x6 --square 20mm -o camera/
      # Then estimate X from the robot poses and this camera
      uq-handeye calibrate robot.csv camera/ -o result/
      # Corners found by another program, with the header row,x,y,z,u,v
      uq-handeye camera corners.csv --image-size 1920x1080 -o camera/

    Estimates the intrinsics, the shape of the board, the pose of the camera at
    each picture, and the joint covariance of all of them.

    Picture k, from 0 in the order of the names (img2 before img10), belongs to
    row k of the robot poses.

    Arguments:
      files = PICTURES: Pictures, e.g. 'img/*.png', or one table of corners (.csv).

    Options (Table of corners):
      * --image-size WxH: Size of the pictures (px), e.g. 1920x1080.
      --units UNIT <UNITS>: Length unit of the table of corners. Default: m.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses, intrinsics and report. It holds camera.csv,
        camera_covariance.npz, intrinsics.json, intrinsics.yaml (OpenCV), corners.csv, board.csv (the board as measured)
        and the report.
    """
    if len(files) == 1 and Path(files[0]).suffix.lower() in TABLES:
        if board.given and board.file is None:
            raise InputError(
                f"{', '.join(board.given)}: for pictures, but {files[0]} is a table of corners. Remove it."
            )
        from ...model.camera.corners_file import read_corners

        size = None if image_size is None else read_two_numbers(image_size, "--image-size", "1920x1080")
        with timed(f"reading {files[0]}"):
            corners = read_corners(files[0], "m" if units is None else one_of(units, "--units", UNITS))
    else:
        for name, value in (("--image-size", image_size), ("--units", units)):
            if value is not None:
                raise InputError(f"{name} applies to a table of corners (.csv), not to pictures. Remove the option.")
        from ...model.camera.board import detect_board

        size = None
        with timed("looking for the board"):
            corners = detect_board(files, board.read(), progress=progress_wanted())
    with warnings.catch_warnings():
        if not as_json:
            warnings.simplefilter("ignore", InputWarning)  # the summary has them
        found = lens.calibrate(corners, size, board.shape())
    from ...model.camera.calibration_files import to_dict
    from ...read import json_text

    deliver_camera_poses(found, lambda: json_text(to_dict(found)), output, as_json, "camera/")


def points_command(
    points: Path,
    target: Path | None = None,
    noise: str | None = None,
    units: str | None = None,
    target_units: str | None = None,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Compute camera poses from points of a target measured in 3-D.

    Examples:
      uq-handeye points points.csv --target target.csv -o seen/
      # Then estimate X from the robot poses and these poses
      uq-handeye calibrate robot.csv seen/ -o result/
      # Tracker with a noise of 0.1 mm in all directions
      uq-handeye points points.csv --target target.csv --noise 0.1mm -o seen/

    For depth cameras, structured light and trackers. Each pose needs three
    points that are not in a line. Outliers are left out and named.

    Arguments:
      POINTS: Points in the frame of the camera, CSV with the header pose,point,x,y,z (m). Pose k, from 0, belongs to
        row k of the robot poses.

    Options:
      * --target FILE: Points in the frame of the target, CSV with the header point,x,y,z (m). Required.
      * --noise SD: Standard deviations of a point across and along the line of sight, e.g. 0.1mm,0.5mm, or one for all
        directions (trackers). Default: both follow from the residuals.
      * --units UNIT <UNITS>: Length unit of POINTS. Default: m.
      --target-units UNIT <UNITS>: Length unit of the target. Default: m.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for camera poses and their covariance. It holds camera.csv,
        points_covariance.npz, points.json, points.csv, target.csv and residuals.png, and takes the place of CAMERA in
        the other commands.
    """
    from ...model.points.estimate import poses_from_points
    from ...model.points.point_file import read_points, read_target
    from ...model.points.result import to_dict
    from ...read import json_text

    if target is None:
        raise InputError(
            "--target is missing: give the points of the target in its own frame, from its drawing or a measurement. "
            "If its shape is unknown, measure it with the camera at rest: docs/how-to/points.md, unknown target."
        )
    of_points, of_target = (
        None if unit is None else one_of(unit, name, UNITS)
        for unit, name in ((units, "--units"), (target_units, "--target-units"))
    )
    with timed(f"reading {points}"):
        measured = read_points(points, of_points)
        known = read_target(target, of_target)
    with timed("fitting poses"), working("fitting poses", progress_wanted()), warnings.catch_warnings():
        if not as_json:
            warnings.simplefilter("ignore", InputWarning)  # the summary has them
        found = poses_from_points(measured, known, noise)
    deliver_camera_poses(found, lambda: json_text(to_dict(found)), output, as_json, "seen/")


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
    """Return the tables that are asked for, by the names of their files."""
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


INTERPOLATIONS = ("so4", "geodesic")


def sync_command(
    files: StreamFiles,
    max_offset: float | None = None,
    still: bool = False,
    max_gap: float | None = None,
    interpolation: str = INTERPOLATIONS[0],
    seed: int = 0,
    as_json: bool = False,
    output: Path | None = None,
) -> None:
    """Put two unsynchronised pose streams on one clock.

    Examples:
      uq-handeye sync robot.csv camera.csv -o paired/
      # A robot that stops for each picture: one mean pose per stop
      uq-handeye sync robot.csv camera.csv --still -o paired/
      # Synchronise and calibrate in one command
      uq-handeye calibrate robot.csv camera.csv --pair async -o result/

    Writes pose pairs at the same moments, and the offset between the clocks.
    The streams need timestamps in seconds; the offset is found from the motion.

    The written files hold no uncertainty of the offset. Use uq-handeye
    calibrate --pair async to include it in the uncertainty of X.

    Options (Synchronisation):
      * --max-offset SECONDS: Largest clock offset (s) to search; inf for unrelated clocks. Default: a quarter of the
        overlap of the streams.
      * --still: One mean pose pair per stop, if the robot stops for each picture.
      * --max-gap SECONDS: Longest gap (s) that is interpolated. Default: three times the median interval.
      --interpolation NAME <INTERPOLATIONS>: Interpolation of poses: so4 or geodesic.
      --seed N: Seed of random subsets.

    Options (Output):
      * -o, --output DIR <named_folder>: Folder for the paired poses and figures. It holds robot.csv and camera.csv
        (paired by row), sync.json, sync.png and sync.svg.
    """
    kind = one_of(interpolation, "--interpolation", INTERPOLATIONS)
    with timed("synchronising"):
        found = files.synchronised(max_offset=max_offset, still=still, max_gap=max_gap, interpolation=kind, seed=seed)
    from ...read import pose_text

    def written() -> "dict[str, str | Figure]":
        sides = {"robot.csv": found.poses.robot, "camera.csv": found.poses.camera}
        tables = {name: pose_text(poses, found.poses.timestamps) for name, poses in sides.items()}
        return {**tables, "sync.json": found.to_json(), "sync": found.figure()}

    deliver_answer(found.to_json(), found.summary(), as_json, output, written)
    if output is not None and found.offset_std > 0:
        LOG.info("The files hold no uncertainty of the offset. uq-handeye calibrate --pair async includes it.")
