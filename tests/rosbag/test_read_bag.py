"""Bags of ROS 1 and ROS 2 read without ROS: chains of frames, topics, tags; and what is refused."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from fixtures.bags import CENTRE, FOCAL, KINDS, START, Writer, pixels_of, stamped
from fixtures.streams import motion, streams
from scipy.spatial.transform import Rotation
from support import random_transforms

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.read import write_pose_file
from uq_handeye.read.rosbag.camera_info import CameraInfo
from uq_handeye.read.rosbag.listing import command_of, text_of
from uq_handeye.read.rosbag.recording import read_recording
from uq_handeye.read.rosbag.streams import camera_stream, read_bag, robot_stream
from uq_handeye.read.rosbag.tags import TagTrack, decide_stream, tag_poses

OFFSET = 0.037


@pytest.fixture(name="hand_held", scope="module")
def fixture_hand_held():
    """Return X, W and two streams as of a hand-held camera with a clock of its own."""
    rng = np.random.default_rng(11)
    X, W, robot, camera = streams(rng, motion(rng, 8.0), OFFSET, 8.0, rates=(60.0, 15.0))
    return X, W, robot, camera


def write_poses(folder, kind, robot, camera):
    with Writer(folder, kind) as bag:
        for t, T in zip(START + robot.timestamps, robot.poses, strict=True):
            bag.pose_stamped("/tcp_pose", t, "base", T)
        for t, T in zip(START + camera.timestamps, camera.poses, strict=True):
            bag.pose_stamped("/marker/pose", t, "camera", T)
    return bag.path


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_a_stream_with_a_clock_offset_is_that_of_the_table(tmp_path, hand_held, kind):
    X, _, robot, camera = hand_held
    path = write_poses(tmp_path, kind, robot, camera)
    found = read_bag(path, robot="/tcp_pose", camera="/marker/pose")
    tables = []
    for name, stream in (("robot", robot), ("camera", camera)):
        times = stamped(START + stream.timestamps)
        write_pose_file(tmp_path / f"{name}.csv", stream.poses, times)
        tables.append(uq.read_stream(tmp_path / f"{name}.csv", name))
    for one, table in zip(found, tables, strict=True):
        np.testing.assert_array_equal(one.timestamps, table.timestamps)
        np.testing.assert_array_equal(one.poses, table.poses)  # exactly
    if kind != "mcap":
        return
    both = uq.synchronise(*found)
    assert abs(both.offset - OFFSET) < 4 * both.offset_std
    result = uq.calibrate(both.poses)
    error = np.concatenate(
        [
            uq_log(result.X[:3, :3] @ X[:3, :3].T),
            result.X[:3, 3] - X[:3, 3],
        ]
    )
    assert error @ np.linalg.solve(result.covariance, error) < 25  # chi-square of 6, one in 3000


def uq_log(R):
    from uq_handeye.core.geometry.se3 import logarithm

    return logarithm(R)


def links(rng, n):
    """Return times, moving links of two rates, static links, and what they make of base and tool."""
    slow, fast = START + np.arange(n) * 0.1, START - 0.2 + np.arange(12 * n) * 0.01
    rail, arm = motion(rng, n * 0.1), motion(rng, n * 0.1)
    base, flange = random_transforms(rng, (2,))
    return slow, fast, rail, arm, base, flange


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_chain_with_static_links_and_links_of_two_rates(tmp_path, kind):
    rng = np.random.default_rng(3)
    slow, fast, rail, arm, mount, flange = links(rng, 20)
    with Writer(tmp_path, kind) as bag:
        # world -> rail (slow), rail -> base (static), base -> wrist (fast), tool -> wrist (static, upwards)
        bag.tf(START, ("rail", "base", mount), ("tool0", "wrist", np.linalg.inv(flange)), static=True)
        for t in fast:
            bag.tf(t, ("base", "wrist", arm(np.array([t - START]))[0]))
        for t in slow:
            bag.tf(t, ("world", "rail", rail(np.array([t - START]))[0]), ("world", "table", mount))
    robot = robot_stream(read_recording(bag.path), "world:tool0")
    slow = stamped(slow)
    np.testing.assert_array_equal(robot.timestamps, slow)
    expected = rail(slow - START) @ mount @ arm(slow - START) @ flange
    np.testing.assert_allclose(robot.poses, expected, atol=1e-4)  # second order in 10 ms
    assert any("4 transforms, 2 of which move" in note for note in robot.source.notes)
    back = robot_stream(read_recording(bag.path), "tool0:world")
    np.testing.assert_allclose(back.poses, np.linalg.inv(robot.poses), atol=1e-12)
    for spec, words in (
        ("world:tool", "no frame tool in the transforms. Did you mean tool0"),
        ("world:table", "never moves in world"),
        ("world:world", "Expected two frames, got world twice"),
        ("/odom", r"has no topic of this name that is read; there are .*/tf"),
        ("/tf", "holds transforms. Name two frames"),
    ):
        with pytest.raises(InputError, match=words) as error:
            robot_stream(read_recording(bag.path), spec)
        assert "\n" not in str(error.value) and "uq-handeye bag" in str(error.value)


@pytest.mark.slow
def test_gaps_and_repeated_transforms(tmp_path):
    rng = np.random.default_rng(4)
    slow, fast, rail, arm, _, _ = links(rng, 30)
    with Writer(tmp_path, "mcap") as bag:
        for t in fast:
            if not 1.0 < t - START < 1.5:
                for _ in range(2):
                    bag.tf(t, ("base", "wrist", arm(np.array([t - START]))[0]))
        for t in slow:
            bag.tf(t, ("world", "base", rail(np.array([t - START]))[0]))
    robot = robot_stream(read_recording(bag.path), "world:wrist")
    inside = (robot.timestamps - START > 1.0) & (robot.timestamps - START < 1.5)
    assert not inside.any() and len(robot) == len(slow) - 4
    notes = " ".join(robot.source.notes)
    assert "4 poses are left out" in notes and "that repeat a time are left out" in notes


SIDE = 0.08


def write_tags(folder, kind, X, W, *, noise=0.0, n=24, tf=False, info=True):
    rng = np.random.default_rng(8)
    times = START + 0.4 * np.arange(n)
    C = np.tile(np.eye(4), (n, 1, 1))
    tilt = Rotation.from_euler("xyz", rng.uniform(-0.5, 0.5, (n, 3))).as_matrix()
    C[:, :3, :3] = tilt @ np.diag([1.0, -1.0, -1.0])
    C[:, :3, 3] = rng.uniform([-0.08, -0.05, 0.3], [0.08, 0.05, 0.45], (n, 3))
    G = W @ np.linalg.inv(C) @ np.linalg.inv(X)
    pixels = pixels_of(C, SIDE, noise, rng)
    with Writer(folder, kind) as bag:
        for t, T, p, seen in zip(times, G, pixels, C, strict=True):
            bag.tf(t, ("base", "tool0", T))
            if info:
                bag.camera_info("/camera/camera_info", t, "camera")
            bag.detections("/detections", t, "camera", [(0, p), (3, p + 50.0)])
            if tf:
                bag.tf(t, ("camera", "tag36h11:0", seen))
    return bag.path, times, G, C


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_tags_by_their_corners(tmp_path, kind):
    X, W = random_transforms(np.random.default_rng(2), (2,))
    path, times, G, C = write_tags(tmp_path, kind, X, W)
    recording = read_recording(path)
    specs = ("camera:tag36h11_0", "camera:tag36h11:0", "/detections:tag36h11_0", "/detections:0")
    for spec in specs if kind == "mcap" else specs[:1]:
        seen = camera_stream(recording, spec, tag=SIDE)
        np.testing.assert_allclose(seen.stream.poses, C, atol=1e-7)
        np.testing.assert_array_equal(seen.stream.timestamps, stamped(times))
    assert seen.info.text() == "900.0,900.0,640.0,360.0" and seen.tag == SIDE
    robot, camera = read_bag(path, robot="base:tool0", camera="camera:tag36h11_0", tag="80mm")
    np.testing.assert_allclose(robot.poses, G, atol=1e-12)
    result = uq.calibrate(uq.PosePairs(robot.poses, camera.poses))
    np.testing.assert_allclose(result.X, X, atol=1e-6)
    for spec, tag, words in (
        ("camera:tag36h11_0", None, "holds corners of the tag in pixels, not its poses.*--tag 40mm"),
        ("/detections", SIDE, "several tags were detected. Choose one: /detections:tag36h11_0, /detections:tag36h11_3"),
        (
            "camera:tag36h11_7",
            SIDE,
            "has no such frames or tag. The tags that were detected are camera:tag36h11_0, camera",
        ),
        ("cam:tag36h11_0", SIDE, "has no such frames or tag. The tags that were detected are camera:tag36h11_0"),
        ("tag36h11_3", SIDE, r"with the frame of its camera. The tags that were detected are camera:tag36h11_3\.$"),
        ("board", SIDE, "The tags that were detected are camera:tag36h11_0, camera:tag36h11_3"),
    ):
        with pytest.raises(InputError, match=words):
            camera_stream(recording, spec, tag=tag)


@pytest.mark.slow
def test_a_bag_of_ros_2_without_definitions_and_frames_with_slashes(tmp_path):
    X, W = random_transforms(np.random.default_rng(2), (2,))
    path, _, G, C = write_tags(tmp_path, "sqlite3", X, W, n=6)
    with closing(sqlite3.connect(next(path.glob("*.db3")))) as data, data:
        data.execute("DELETE FROM message_definitions")
    inverse = {"robot_frame": "gripper_T_base", "camera_frame": "target_T_camera"}
    turned = read_bag(path, robot="base:tool0", camera="camera:tag36h11_0", tag=SIDE, **inverse)
    robot, camera = read_bag(path, robot="/base:/tool0", camera="/camera:tag36h11_0", tag=SIDE)
    for one, other in zip(turned, (robot, camera), strict=True):
        np.testing.assert_allclose(one.poses @ other.poses, np.tile(np.eye(4), (6, 1, 1)), atol=1e-12)
    with pytest.raises(InputError, match="Expected `robot_frame`"):
        read_bag(path, robot="base:tool0", camera="camera:tag36h11_0", tag=SIDE, robot_frame="base")
    np.testing.assert_allclose(robot.poses, G, atol=1e-12)
    np.testing.assert_allclose(camera.poses, C, atol=1e-7)


@pytest.mark.slow
def test_poses_of_tf_are_taken_until_the_tag_has_a_side(tmp_path):
    X, W = random_transforms(np.random.default_rng(2), (2,))
    path, _, _, C = write_tags(tmp_path, "mcap", X, W, noise=0.3, tf=True, n=20)
    recording = read_recording(path)
    by_tf = camera_stream(recording, "camera:tag36h11:0")
    np.testing.assert_allclose(by_tf.stream.poses, C, atol=1e-12)
    assert "/detections holds corners of this tag" in by_tf.hint
    by_corners = camera_stream(recording, "camera:tag36h11:0", tag=SIDE)
    assert 1e-5 < np.abs(by_corners.stream.poses - C).max() < 0.2 and not by_corners.hint


@pytest.mark.slow
def test_frames_without_a_name_and_frames_the_other_way_round(tmp_path):
    X, W = random_transforms(np.random.default_rng(2), (2,))
    _, times, _, C = write_tags(tmp_path, "mcap", X, W, n=5)
    with Writer(tmp_path, "mcap", "other") as bag:
        for t, T, corners in zip(times, C, pixels_of(C, SIDE), strict=True):
            bag.detections("/tags", t, "", [(0, corners)])
            bag.camera_info("/camera_info", t, "")
            bag.pose_stamped("/tcp", t, "base", T)
            bag.write("/seen", bag.transform(t, "cam", "plate", T), t)
    recording = read_recording(bag.path)
    assert "--camera /tags:tag36h11_0 --tag" in command_of(recording, ["other"])
    assert "  /tags:tag36h11_0  5 detections" in text_of(recording, ["other"])
    np.testing.assert_allclose(camera_stream(recording, "/tags:tag36h11_0", tag=SIDE).stream.poses, C, atol=1e-7)
    turned = camera_stream(recording, "plate:cam").stream.poses
    np.testing.assert_allclose(turned @ C, np.tile(np.eye(4), (5, 1, 1)), atol=1e-12)


@pytest.mark.slow
def test_no_camera_info_asks_for_the_matrix(tmp_path):
    X, W = random_transforms(np.random.default_rng(2), (2,))
    path, *_ = write_tags(tmp_path, "mcap", X, W, n=5, info=False)
    with pytest.raises(InputError, match=r"no camera_info belongs to /detections.*--camera-matrix"):
        camera_stream(read_recording(path), "camera:tag36h11_0", tag=SIDE)


def test_second_solutions_of_a_small_tag_are_decided_by_the_robot():
    rng = np.random.default_rng(6)
    X, W = random_transforms(rng, (2,))
    C = np.tile(np.eye(4), (80, 1, 1))
    tilt = Rotation.from_euler("xyz", rng.uniform(-0.6, 0.6, (80, 3))).as_matrix()
    C[:, :3, :3] = tilt @ np.diag([1.0, -1.0, -1.0])
    C[:, :3, 3] = rng.uniform([-0.1, -0.1, 0.75], [0.1, 0.1, 0.85], (80, 3))
    track = TagTrack("tag")
    for k, pixels in enumerate(pixels_of(C, 0.03, 0.3, rng)):
        track.add(float(k), pixels.ravel().tolist())
    info = CameraInfo("", (0, 0), "", np.array([FOCAL, FOCAL, *CENTRE]), np.zeros(0), np.zeros(4))
    found = tag_poses(track, info, 0.03)
    turned = lambda poses: Rotation.from_matrix(np.swapaxes(C[:, :3, :3], 1, 2) @ poses[:, :3, :3]).magnitude()  # noqa: E731
    assert (turned(found.poses) > np.radians(15)).sum() >= 5
    stream = uq.Stream(found.times, found.poses)
    pairs = uq.PosePairs(W @ np.linalg.inv(C) @ np.linalg.inv(X), stream.poses)
    decided = decide_stream(pairs, stream, found.minima)
    assert (turned(decided.stream.poses) > np.radians(15)).sum() <= 1
    assert decided.changed >= 5 and decided.doubtful > 60 and decided.undecided < 5
    others = uq.PosePairs(pairs.robot, C)  # not the poses of the stream
    assert decide_stream(others, stream, found.minima) is None
