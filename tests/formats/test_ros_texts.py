"""Texts that the tools of ROS print: tf_echo, topic echo and topic echo --csv, of ROS 1 and ROS 2."""

import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import random_transforms

from uq_handeye.errors import InputError
from uq_handeye.formats.contents import finished
from uq_handeye.formats.detect import read_contents
from uq_handeye.formats.ros_topic import is_ros_topic, read_ros_topic
from uq_handeye.formats.tf_echo import is_tf_echo, read_tf_echo
from uq_handeye.read import read_poses

BASE = 1_700_000_000


@pytest.fixture(name="poses")
def fixture_poses():
    return random_transforms(np.random.default_rng(5), (12,))


def seven(T):
    return [*T[:3, 3].tolist(), *Rotation.from_matrix(T[:3, :3]).as_quat().tolist()]


def read(contents, role="robot"):
    return finished(contents.only, role, "m", None, "base_T_gripper")


def tf_echo(poses, decimals=3, ros=2, matrix=True, angles=True):
    """Print as tf2_ros/src/tf2_echo.cpp and tf/src/tf_echo.cpp do."""
    text = "[INFO] [1700000000.1] [tf2_echo]: Waiting for transform base ->  tool0: Invalid frame ID\n"
    for k, T in enumerate(poses):
        show = lambda values: "[" + ", ".join(f"{v:.{decimals}f}" for v in values) + "]"  # noqa: E731
        x = seven(T)
        rpy = Rotation.from_matrix(T[:3, :3]).as_euler("xyz")
        nanoseconds = (k * 307_004_001) % 10**9
        text += f"At time {BASE + k}.{nanoseconds}\n" if ros == 2 else f"At time {BASE + k}.250\n"
        text += f"- Translation: {show(x[:3])}\n"
        text += f"- Rotation: in Quaternion {'(xyzw) ' if ros == 2 else ''}{show(x[3:])}\n"
        start = "- Rotation: in" if ros == 2 else "            in"
        if angles:
            text += f"{start} RPY (radian) {show(rpy)}\n{start} RPY (degree) {show(np.degrees(rpy))}\n"
        if matrix and ros == 2:
            rows = "\n".join("  " + "  ".join(f"{v:.{decimals}f}" for v in row) for row in T)
            text += f"- Matrix:\n{rows}\n"
    return text


@pytest.mark.parametrize("ros", [1, 2])
def test_tf_echo_with_many_digits(poses, ros):
    text = tf_echo(poses, 12, ros)
    assert is_tf_echo(text) and not is_ros_topic(text)
    contents = read_tf_echo(text, "tf.txt")
    np.testing.assert_allclose(read(contents), poses, atol=1e-11)
    times = [BASE + k + (0.25 if ros == 1 else 1e-9 * (k * 307_004_001 % 10**9)) for k in range(len(poses))]
    np.testing.assert_allclose(contents.only.timestamps, times, atol=1e-6)  # 7 nanoseconds are 0.000000007 s


def test_tf_echo_of_three_decimals_takes_the_degrees(poses):
    contents = read_tf_echo(tf_echo(poses), "tf.txt")
    found = read(contents)
    error = Rotation.from_matrix(np.swapaxes(found[:, :3, :3], 1, 2) @ poses[:, :3, :3]).magnitude()
    assert error.max() < np.radians(2e-3)
    np.testing.assert_allclose(found[:, :3, 3], poses[:, :3, 3], atol=5.01e-4)
    assert any("degrees" in note for note in contents.notes) and any("3 decimals" in note for note in contents.notes)
    coarse = read(read_tf_echo(tf_echo(poses, angles=False), "tf.txt"))  # normalised
    error = Rotation.from_matrix(np.swapaxes(coarse[:, :3, :3], 1, 2) @ poses[:, :3, :3]).magnitude()
    assert np.radians(0.01) < error.max() < 3e-3


def test_degrees_of_another_convention_are_not_used(poses):
    text = tf_echo(poses)
    wrong = re.sub(r"(RPY \(degree\)) \[(.*), (.*), (.*)\]", r"\1 [\4, \3, \2]", text)
    contents = read_tf_echo(wrong, "tf.txt")
    assert not any("degrees" in note for note in contents.notes)


def test_tf_echo_repeated_static_and_cut_off(poses):
    text = tf_echo(poses[:4], 12)
    blocks = ["At time" + part for part in text.split("At time")[1:]]
    twice = read_tf_echo("".join(block * 3 for block in blocks), "tf.txt")
    assert len(twice.only) == 4 and any("8 rows that repeat" in note for note in twice.notes)
    static = re.sub(r"At time \S+", "At time 0.0", text)
    contents = read_tf_echo(static, "tf.txt")
    assert contents.only.timestamps is None and len(contents.only) == 4
    cut = text[: text.rindex("in Quaternion") + 30]
    assert len(read_tf_echo(cut, "tf.txt").only) == 3
    with pytest.raises(InputError, match="line 2: expected the line Rotation: in Quaternion after it"):
        read_tf_echo(text.replace("- Rotation: in Quaternion", "- Rotation:", 1), "tf.txt")


def stamped(T, k, kind, ros=2, parent="base", child="tool0"):
    """One message as ``topic echo`` prints it."""
    x = seven(T)
    stamp = ("sec", "nanosec") if ros == 2 else ("secs", "nsecs")
    space = "" if ros == 2 else " "
    header = [f"header:{space}"] + ([] if ros == 2 else [f"  seq: {k}"]) + [f"  stamp:{space}"]
    width = "" if ros == 2 else f">{9}"
    header += [f"    {stamp[0]}: {BASE + k}", f"    {stamp[1]}: {250000000:{width}}"]
    header += [f"  frame_id: {parent}" if ros == 2 else f'  frame_id: "{parent}"']
    names = ("position", "orientation") if "Pose" in kind or kind == "Odometry" else ("translation", "rotation")
    body = [f"{names[0]}:{space}", *(f"  {a}: {v!r}" for a, v in zip("xyz", x[:3], strict=True))]
    body += [f"{names[1]}:{space}", *(f"  {a}: {v!r}" for a, v in zip("xyzw", x[3:], strict=True))]

    def within(name, lines):
        return [f"{name}:{space}", *("  " + line for line in lines)]

    covariance = ["covariance:", *["- 0.0"] * 36] if ros == 2 else [f"covariance: [{', '.join(['0.0'] * 36)}]"]
    child_line = [f"child_frame_id: {child}" if ros == 2 else f'child_frame_id: "{child}"']
    lines = {
        "Pose": lambda: body,
        "PoseStamped": lambda: header + within("pose", body),
        "PoseWithCovarianceStamped": lambda: header + within("pose", within("pose", body) + covariance),
        "TransformStamped": lambda: header + child_line + within("transform", body),
        "Odometry": lambda: header + child_line + within("pose", within("pose", body) + covariance),
    }
    if kind != "TFMessage":
        return lines[kind]()
    one = lines["TransformStamped"]()
    if ros == 2:
        return [("- " if k == 0 else "  ") + line for k, line in enumerate(one)]
    return ["  - ", *("    " + line for line in one)]


def echo(poses, kind, ros=2, **names):
    first = ["transforms:" + ("" if ros == 2 else " ")] if kind == "TFMessage" else []
    return "".join("\n".join(first + stamped(T, k, kind, ros, **names)) + "\n---\n" for k, T in enumerate(poses))


KINDS = ["Pose", "PoseStamped", "PoseWithCovarianceStamped", "TransformStamped", "Odometry", "TFMessage"]


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_topic_echo(poses, kind, ros):
    for text in (echo(poses, kind, ros), echo(poses, kind, ros).replace("\n", "\r\n")):
        assert is_ros_topic(text) and not is_tf_echo(text)
        contents = read_ros_topic(text, "pose.txt")
        np.testing.assert_allclose(read(contents), poses, atol=1e-14)
        times = contents.only.timestamps
        assert times is None if kind == "Pose" else times.tolist() == [BASE + k + 0.25 for k in range(len(poses))]


def test_lines_between_messages_and_a_message_cut_off(poses):
    text = echo(poses, "PoseStamped")
    said = "WARNING: topic [/pose] does not appear to be published yet\n" + text.replace(
        "---\n", "---\nA message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n", 2
    )
    assert is_ros_topic(said) and len(read_ros_topic(said, "pose.txt").only) == len(poses)
    contents = read_ros_topic(text[:-120], "pose.txt")
    assert len(contents.only) == len(poses) - 1 and "cut off" in contents.notes[0]


def test_several_pairs_of_frames_are_refused_by_their_names(poses):
    text = echo(poses, "TFMessage") + echo(poses[:3], "TFMessage", parent="camera", child="tag36h11_0")
    with pytest.raises(InputError, match=r"base:tool0 \(12\), camera:tag36h11_0 \(3\).*--bag tf.txt --robot PARENT"):
        read_ros_topic(text, "tf.txt")


def test_repeated_messages_of_one_time_are_read_once(poses):
    parts = echo(poses, "TransformStamped").split("---\n")[:-1]
    contents = read_ros_topic("".join(f"{part}---\n" * 2 for part in parts), "tf.txt")
    assert len(contents.only) == len(poses) and "12 rows that repeat a time" in contents.notes[-1]


@pytest.mark.parametrize("kind", ["PoseStamped", "PoseWithCovarianceStamped", "TransformStamped"])
def test_csv_of_topic_echo(poses, kind):
    more = {"PoseStamped": [], "PoseWithCovarianceStamped": [0.0] * 36, "TransformStamped": []}[kind]
    frames = "base,tool0" if kind == "TransformStamped" else "base"
    text = "".join(
        f"{BASE + k},250000000,{frames},{','.join(map(repr, seven(T) + more))}\n" for k, T in enumerate(poses)
    )
    assert is_ros_topic(text)
    contents = read_ros_topic(text, "pose.csv")
    np.testing.assert_allclose(read(contents), poses, atol=1e-14)
    assert not is_ros_topic(text.replace(",base", ",0.5"))
    with pytest.raises(InputError, match="line 13: expected sec,nanosec"):
        read_ros_topic(text + "1,2,base\n", "pose.csv")


def test_csv_of_tf_with_several_transforms_and_flow_style(poses):
    line = lambda k, T, child: f"{BASE + k},0,base,{child},{','.join(map(repr, seven(T)))}"  # noqa: E731
    one = "".join(line(k, T, "tool0") + "\n" for k, T in enumerate(poses))
    np.testing.assert_allclose(read(read_ros_topic(one, "tf.csv")), poses, atol=1e-14)
    two = "".join(f"{line(k, T, 'tool0')},{line(k, T, 'tag')}\n" for k, T in enumerate(poses))
    assert is_ros_topic(two)
    with pytest.raises(InputError, match=r"base:tool0 \(12\), base:tag \(12\)"):
        read_ros_topic(two, "tf.csv")
    flow = ""
    for k, T in enumerate(poses):
        x = seven(T)
        place = ", ".join(f"{a}: {v!r}" for a, v in zip("xyz", x[:3], strict=True))
        turn = ", ".join(f"{a}: {v!r}" for a, v in zip("xyzw", x[3:], strict=True))
        header = f"{{stamp: {{sec: {BASE + k}, nanosec: 0}}, frame_id: base}}"
        flow += f"header: {header}\npose: {{position: {{{place}}}, orientation: {{{turn}}}}}\n---\n"
    whole = "".join("{" + part.strip().replace("\n", ", ") + "}\n---\n" for part in flow.split("---\n")[:-1])
    for text in (flow, whole, f"me@cell:~$ ros2 topic echo --flow-style /pose\n{flow}^C"):
        assert is_ros_topic(text)
        np.testing.assert_allclose(read(read_ros_topic(text, "pose.txt")), poses, atol=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "parameters:\n  name: cell\nsamples:\n- robot:\n    translation: {x: 0.4, y: 0, z: 0}\n",
        "timestamp,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n",
        '{"pose": {"position": {}}}',
        "- effector_wrt_world: [1, 0]\n",
        "",
    ],
)
def test_other_formats_are_not_taken_for_these(text):
    assert not is_ros_topic(text) and not is_tf_echo(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "header:\n  stamp:\n    sec: 1\n    nanosec: 2\ndata: 5\n---\n",
            "expected a pose or a transform, got the fie",
        ),
        ("pose:\n  position:\n    x: a\n    y: 1\n    z: 2\n  orientation:\n    x: 0\n", "expected a number in"),
        ("pose:\n  position:\n    x: 1\n    x: 1\n---\n", "line 4: the field 'x' is given twice"),
        (
            "pose:\n  position:\n    x: 1\n y: 3\n---\n",
            "line 4: expected name: value, indented below its field, got 'y: 3'",
        ),
        ("position:\n" + "".join("  " * k + "a:\n" for k in range(1, 50)), "at most 30 levels"),
        ("- 3\npose:\n", "line 2: expected name: value, indented below its field, got 'pose:'"),
        ("pose: position\nwhat is this\n", "line 2: expected name: value"),
        ("# nothing\n", "expected messages with poses"),
    ],
)
def test_what_is_wrong_is_one_line(text, expected):
    with pytest.raises(InputError, match=expected) as error:
        read_ros_topic(text, "pose.txt")
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_file_per_pose(poses, tmp_path):
    for k, T in enumerate(poses):
        (tmp_path / f"a{k}.txt").write_text(tf_echo([T, T, T], 12))
        (tmp_path / f"b{k}.yaml").write_text("\n".join(stamped(T, k, "PoseStamped")))
    found = read_poses(str(tmp_path / "a*.txt"), str(tmp_path / "b*.yaml"), setup="eye-in-hand")
    np.testing.assert_allclose(found.robot, poses, atol=1e-11)
    np.testing.assert_allclose(found.camera, poses, atol=1e-14)
    assert any("the same pose 3 times, taken once" in note for note in found.sources[0].notes)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_texts_are_told_from_all_other_formats(poses, tmp_path, kind):
    for ros in (1, 2):
        for name, text in (("ros-topic", echo(poses, kind, ros)), ("tf-echo", tf_echo(poses, 6, ros))):
            (tmp_path / "poses.txt").write_text(text)
            assert read_contents(tmp_path / "poses.txt", None)[1].format == name


def printed_by_rclpy(T):
    x, y, z, qx, qy, qz, qw = seven(T)
    return (
        "geometry_msgs.msg.PoseStamped(header=std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=7, nanosec=0), "
        f"frame_id='base'), pose=geometry_msgs.msg.Pose(position=geometry_msgs.msg.Point(x={x!r}, y={y!r}, z={z!r}), "
        f"orientation=geometry_msgs.msg.Quaternion(x={qx!r}, y={qy!r}, z={qz!r}, w={qw!r})))"
    )


def test_messages_as_python_prints_them(poses):
    """rospy prints fields without a line between messages, rclpy one line per message, maybe behind a log's prefix."""
    rospy = echo(poses, "Pose", 1).replace("---\n", "")
    rclpy = "".join(f"{printed_by_rclpy(T)}\n" for T in poses)
    logged = "".join(f"[INFO] [17.3] [cell]: {printed_by_rclpy(T)}\n" for T in poses)
    for text in (rospy, rclpy, logged):
        assert is_ros_topic(text)
        np.testing.assert_allclose(read(read_ros_topic(text, "pose.txt")), poses, atol=1e-14)
    array = "geometry_msgs.msg.PoseWithCovariance(pose=geometry_msgs.msg.Pose(position=geometry_msgs.msg.Point(x=1.0, "
    array += "y=0.0, z=0.0), orientation=geometry_msgs.msg.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)), "
    array += "covariance=array([0., 0.]))\n"
    assert read(read_ros_topic(array, "pose.txt"))[0, 0, 3] == 1.0
