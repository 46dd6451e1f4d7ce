"""Topics by their messages: markers, older tags, joints, odometry, texts of topic echo; and what is guessed of them."""

from itertools import pairwise

import numpy as np
import pytest
from fixtures.bags import START, Writer
from support import random_transforms

from uq_handeye.errors import InputError
from uq_handeye.read.rosbag.guess import guess
from uq_handeye.read.rosbag.joints import JointTopic, joints_csv
from uq_handeye.read.rosbag.listing import command_of, text_of
from uq_handeye.read.rosbag.recording import Recording, read_recording
from uq_handeye.read.rosbag.streams import camera_stream, robot_stream

# AprilRobotics/apriltag_ros, which ROS 1 has: poses and no corners.
OLDER = {
    "apriltag_ros/msg/AprilTagDetection": (
        "int32[] id\nfloat64[] size\ngeometry_msgs/PoseWithCovarianceStamped pose\n"
    ),
    "apriltag_ros/msg/AprilTagDetectionArray": (
        "std_msgs/Header header\napriltag_ros/AprilTagDetection[] detections\n"
    ),
}


@pytest.fixture(name="poses", scope="module")
def fixture_poses():
    return random_transforms(np.random.default_rng(7), (5,))


def with_covariance(bag, T):
    return bag.type("geometry_msgs/msg/PoseWithCovariance")(bag.pose(T), np.zeros(36))


def test_tags_of_apriltag_ros_of_ros_1(tmp_path, poses):
    with Writer(tmp_path, "ros1", definitions=OLDER) as bag:
        for k, T in enumerate(poses):
            header = bag.header(START + k, "/camera")
            stamped = bag.type("geometry_msgs/msg/PoseWithCovarianceStamped")(header, with_covariance(bag, T))
            tag = bag.type("apriltag_ros/msg/AprilTagDetection")(np.array([3], np.int32), np.array([0.08]), stamped)
            message = bag.type("apriltag_ros/msg/AprilTagDetectionArray")(header, [tag] * (k != 2))
            bag.write("/tag_detections", message, START + k)
    recording = read_recording(bag.path)
    for spec in ("camera:tag_3", "/tag_detections", "tag_detections", "camera:3"):
        np.testing.assert_allclose(camera_stream(recording, spec).stream.poses, poses[[0, 1, 3, 4]], atol=1e-12)
    assert "/tag_detections  4 poses in camera" in text_of(recording, ["cell.bag"])
    assert guess(recording).camera == "/tag_detections"


@pytest.mark.slow
@pytest.mark.parametrize("named", ["aruco_ros", "ros2_aruco", "aruco_opencv"])
def test_markers(tmp_path, poses, named):
    with Writer(tmp_path, "sqlite3") as bag:
        for k, T in enumerate(poses):
            header = bag.header(START + k, "camera")
            if named == "aruco_ros":
                marker = bag.type("aruco_msgs/msg/Marker")
                found = [marker(header, n, with_covariance(bag, T @ T if n else T), 1.0) for n in (0, 26)]
                message = bag.type("aruco_msgs/msg/MarkerArray")(header, found)
            elif named == "aruco_opencv":
                marker = bag.type("aruco_opencv_msgs/msg/MarkerPose")
                markers = [marker(0, bag.pose(T)), marker(26, bag.pose(T @ T))]
                boards = [bag.type("aruco_opencv_msgs/msg/BoardPose")("plate", bag.pose(T))]
                message = bag.type("aruco_opencv_msgs/msg/ArucoDetection")(header, markers, boards)
            else:
                both = [bag.pose(T), bag.pose(T @ T)]
                message = bag.type("ros2_aruco_interfaces/msg/ArucoMarkers")(header, np.array([0, 26]), both)
            bag.write("/markers", message, START + k)
    recording = read_recording(bag.path)
    for spec, expected in (("camera:marker_0", poses), ("/markers:26", poses @ poses)):
        np.testing.assert_allclose(camera_stream(recording, spec).stream.poses, expected, atol=1e-12)
    if named == "aruco_opencv":
        np.testing.assert_allclose(camera_stream(recording, "camera:plate").stream.poses, poses, atol=1e-12)
        return
    with pytest.raises(InputError, match=r"poses of several frames. Choose one: /markers:marker_0, /markers:marker_26"):
        camera_stream(recording, "/markers")


@pytest.mark.slow
def test_odometry_joints_and_the_guess(tmp_path, poses):
    with Writer(tmp_path, "mcap") as bag:
        for k, T in enumerate(poses):
            t = START + k
            zero = bag.type("geometry_msgs/msg/Vector3")(0.0, 0.0, 0.0)
            twist = bag.type("geometry_msgs/msg/TwistWithCovariance")(
                bag.type("geometry_msgs/msg/Twist")(zero, zero), np.zeros(36)
            )
            odometry = bag.type("nav_msgs/msg/Odometry")(bag.header(t, "odom"), "tcp", with_covariance(bag, T), twist)
            bag.write("/arm/odometry", odometry, t)
            bag.pose_stamped("/board_pose", t, "rgb_camera", T)
            bag.joints("/joint_states", t, ["a", "b"] if k != 3 else ["gripper"], [k, -k] if k != 3 else [0.1])
    recording = read_recording(bag.path)
    np.testing.assert_allclose(robot_stream(recording, "/arm/odometry").poses, poses, atol=1e-12)
    np.testing.assert_allclose(robot_stream(recording, "odom:tcp").poses, poses, atol=1e-12)
    assert command_of(recording, ["my cell"]) == (
        "uq-handeye calibrate --bag 'my cell' --robot /arm/odometry --camera /board_pose"
    )
    track, gripper = recording.joint_tracks("joint_states")
    table = joints_csv(track).splitlines()
    assert table[0] == "timestamp,a,b" and len(table) == 5 and table[2] == f"{START + 1},1.0,-1.0"
    assert gripper.names == ["gripper"]
    text = text_of(recording, ["cell"])
    assert "/joint_states  4 rows of a, b\n  /joint_states  1 rows of gripper\n" in text
    with pytest.raises(InputError, match="no such topic of JointState; there are: /joint_states"):
        recording.joint_tracks("/joints")


@pytest.mark.parametrize(
    ("links", "more", "robot"),
    [
        (["base_0", *(f"link{k}" for k in range(1, 7))], [], "base_0:link6"),
        (["link_base", *(f"link{k}" for k in range(1, 7))], [("link6", "left_finger")], "link_base:link6"),
        (["base_link", "shoulder_link", "forearm_link", "bracelet_link", "tool_frame"], [], "base_link:tool_frame"),
        (["meca_base_link", "meca_axis_1_link", "meca_axis_2_link"], [], "meca_base_link:meca_axis_2_link"),
        (["map", "odom", "base_link", "arm_1_link", "arm_2_link"], [("phoxi", "calib")], "base_link:arm_2_link"),
    ],
)
def test_the_robot_is_the_whole_chain_that_moves(links, more, robot):
    recording = Recording("cell")
    edges = [*pairwise(links), ("camera_optical_frame", "tag36h11:0"), ("camera_optical_frame", "tag36h11:1"), *more]
    for pair in edges:
        for k in range(2):
            recording.tree.track(pair).add(float(k), (0.1 * k, 0, 0, 0, 0, 0, 1))
    recording.tree.track((links[-1], "flange_camera")).add(0.0, (0, 0, 0, 0, 0, 0, 1))
    assert guess(recording).robot == robot


def test_joint_values_alone_are_the_robot():
    recording = Recording("cell", joints={"/joint_states": JointTopic()})
    for names in (["finger"], ["a", "b"], ["b", "a"]):
        recording.joints["/joint_states"].add(1.0, names, [1.0] * len(names))
    assert "--robot /joint_states --urdf robot.urdf --camera OPTICAL_FRAME:TARGET" in command_of(recording, ["cell"])
    assert [len(track) for track in recording.joints["/joint_states"].tracks] == [2, 1]


def test_poses_with_a_receipt_time_and_several_bags(tmp_path, poses):
    for name, part in (("first", poses[:2]), ("second", poses[2:])):
        with Writer(tmp_path, "ros1", name) as bag:
            for k, T in enumerate(part):
                t = START + k + (2 if name == "second" else 0)
                bag.write("/tcp", bag.pose(T), t)
    stream = robot_stream(read_recording([tmp_path / "first.bag", tmp_path / "second.bag"]), "/tcp")
    np.testing.assert_allclose(stream.poses, poses, atol=1e-12)
    np.testing.assert_allclose(stream.timestamps, START + np.arange(5))


def test_a_text_of_topic_echo_in_place_of_a_bag(tmp_path, poses):
    def block(k, parent, child, T):
        return (
            f"- header:\n    stamp:\n      sec: {k}\n      nanosec: 5\n    frame_id: {parent}\n"
            f"  child_frame_id: {child}\n"
            "  transform:\n    translation:\n"
            + "".join(f"      {a}: {v!r}\n" for a, v in zip("xyz", T[:3, 3].tolist(), strict=True))
            + "    rotation:\n      x: 0.0\n      y: 0.0\n      z: 0.0\n      w: 1.0\n"
        )

    path = tmp_path / "tf.txt"
    path.write_text(
        "".join(
            f"transforms:\n{block(k, 'base', 'wrist', T)}{block(k, 'wrist', 'tool0', np.eye(4))}---\n"
            for k, T in enumerate(poses, start=1)
        )
    )
    stream = robot_stream(read_recording(path), "base:tool0")
    np.testing.assert_allclose(stream.poses[:, :3, 3], poses[:, :3, 3], atol=1e-14)
    assert guess(read_recording(path)).robot == "base:tool0"
    path.write_text("position:\n  x: 1\n  y: 1\n  z: 1\norientation:\n  x: 0\n  y: 0\n  z: 0\n  w: 1\n---\n")
    with pytest.raises(InputError, match="Give the file as ROBOT or CAMERA"):
        read_recording(path)
