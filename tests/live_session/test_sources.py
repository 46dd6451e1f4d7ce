"""Sources with stand-ins for what is not installed; guidance; the Python interface and the page of a stored result."""

import io
import json
import sys
import threading
from types import SimpleNamespace as Fields
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.calibration.tolerance import Tolerance
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.model.poses.scene_facts import SceneFacts
from uq_handeye.use.live_session.folder import Folder
from uq_handeye.use.live_session.json_lines import Lines
from uq_handeye.use.live_session.nodes import ellipsoid, nice
from uq_handeye.use.live_session.playback import Playback
from uq_handeye.use.live_session.question import Answer, Question, enough, words
from uq_handeye.use.live_session.ros2 import MAX_AGE_S, Node, Tf, Topic
from uq_handeye.use.live_session.session import Session
from uq_handeye.use.live_session.sources import Side, Taken, feed
from uq_handeye.use.live_session.starting_views import starting_views
from uq_handeye.use.live_session.universal_robots import Ur
from uq_handeye.use.planning.after_each import NextPose

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
POSES = uq.simulate(n_poses=8, noise=NOISE, seed=3)


class Buffer:
    """Stands in for that of tf2: transforms by their frames, with a stamp (s)."""

    def __init__(self, known):
        self.known = known

    def lookup_transform(self, parent, child, newest):
        T, stamp = self.known[parent, child]
        x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
        move = Fields(x=T[0, 3], y=T[1, 3], z=T[2, 3])
        second = int(stamp)
        header = Fields(stamp=Fields(sec=second, nanosec=round(1e9 * (stamp - second))))
        return Fields(transform=Fields(translation=move, rotation=Fields(x=x, y=y, z=z, w=w)), header=header)


def tf(stamps=(10.0, 10.1), now=10.2):
    known = {("base", "tool0"): (POSES.robot[0], stamps[0]), ("cam", "tag"): (POSES.camera[0], stamps[1])}
    return Taken("tf", *(Tf(frames, Buffer(known), None, lambda: now) for frames in ("base:tool0", "cam:tag")))


def message(T, stamp):
    """A PoseStamped as ROS has it."""
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    header = Fields(stamp=Fields(sec=int(stamp), nanosec=round(1e9 * (stamp % 1))), frame_id="base")
    pose = Fields(position=Fields(x=T[0, 3], y=T[1, 3], z=T[2, 3]), orientation=Fields(x=x, y=y, z=z, w=w))
    return Fields(header=header, pose=pose)


def test_a_pair_by_tf():
    pair = tf().take()
    np.testing.assert_allclose(pair.robot, POSES.robot[0], atol=1e-12)
    np.testing.assert_allclose(pair.camera, POSES.camera[0], atol=1e-12)
    assert pair.time == pytest.approx(10.1)


def test_a_pair_by_topics():
    now = [20.0]
    sides = [Topic(name, lambda: now[0]) for name in ("/tcp_pose", "/tag_pose")]
    source = Taken("ROS", *sides)
    with pytest.raises(uq.InputError, match="Nothing has come on /tcp_pose yet"):
        source.take()
    for side, T in zip(sides, (POSES.robot[1], POSES.camera[1]), strict=True):
        side.receive(message(T, 19.5))
    pair = source.take()
    np.testing.assert_allclose(pair.robot, POSES.robot[1], atol=1e-12)
    np.testing.assert_allclose(pair.camera, POSES.camera[1], atol=1e-12)
    assert pair.time == pytest.approx(19.5)
    now[0] = 22.0
    with pytest.raises(uq.InputError, match=r"/tcp_pose: the newest pose is 2\.5 s old"):
        source.take()
    sides[0].receive(Fields(data=1.0))
    with pytest.raises(uq.InputError, match="/tcp_pose: expected a pose or a transform"):
        source.take()


@pytest.mark.parametrize(
    ("source", "why"),
    [(tf((10.0, 10.5)), r"stamped 0\.50 s apart"), (tf(now=10.2 + MAX_AGE_S), "newest pose is 2.2 s old"),
     (Tf("base:tool0", Buffer({}), None, lambda: 0.0), "tf knows no pose base -> tool0")],
)  # fmt: skip
def test_what_tf_does_not_have(source, why):
    with pytest.raises(uq.InputError, match=why):
        source.take() if isinstance(source, Taken) else source.newest()


def test_a_node_of_ros_by_stand_ins(monkeypatch):
    """The modules of ROS as `Node` uses them: a topic for the robot, tf for the camera."""
    subscribed, ended = {}, []
    known = {("cam", "tag"): (POSES.camera[2], 5.0)}
    node = Fields(
        get_topic_names_and_types=lambda: [("/tcp_pose", ["geometry_msgs/msg/PoseStamped"])],
        create_subscription=lambda kind, topic, receive, depth: subscribed.update({topic: (kind, receive)}),
        get_clock=lambda: Fields(now=lambda: Fields(nanoseconds=5_100_000_000)),
    )
    parts = {
        "rclpy": Fields(init=lambda: None, create_node=lambda name: node, spin=lambda node: None,
                        shutdown=lambda: ended.append(True)),
        "rclpy.time": Fields(Time=lambda: None),
        "tf2_ros": Fields(Buffer=lambda: Buffer(known), TransformListener=lambda buffer, node: None),
        "rosidl_runtime_py": Fields(), "rosidl_runtime_py.utilities": Fields(get_message=lambda name: name),
    }  # fmt: skip
    for name, module in parts.items():
        monkeypatch.setitem(sys.modules, name, module)
    ros = Node()
    source = Taken("ROS", ros.side("/tcp_pose"), ros.side("cam:tag"))
    kind, receive = subscribed["/tcp_pose"]
    receive(message(POSES.robot[2], 5.05))
    pair = source.take()
    np.testing.assert_allclose(pair.robot, POSES.robot[2], atol=1e-12)
    np.testing.assert_allclose(pair.camera, POSES.camera[2], atol=1e-12)
    assert kind == "geometry_msgs/msg/PoseStamped"
    with pytest.raises(uq.InputError, match=r"There is no topic /pose\. Topics: /tcp_pose"):
        ros.side("/pose")
    ros.close()
    assert ended == [True]


def test_frames_and_installations_that_are_missing():
    with pytest.raises(uq.InputError, match=r"parent:child, e\.g\. base_link:tool0, or a /topic, got 'base'"):
        Tf("base", None, None, None)
    with pytest.raises(uq.MissingExtraError, match="needs rclpy"):
        Node()
    with pytest.raises(uq.MissingExtraError, match="need ur_rtde"):
        Ur("192.168.0.2")


class Still(Side):
    """A side whose pose does not change."""

    def newest(self):
        return POSES.camera[0], None


def arm(pose=POSES.robot[0], speed=0.0, closed=None):
    """An arm that stands in for that of ur_rtde."""
    numbers = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_rotvec()]
    return Fields(getActualTCPPose=lambda: numbers, getActualTCPSpeed=lambda: [0.0] * 5 + [speed],
                  disconnect=lambda: closed.append(True))  # fmt: skip


def test_an_arm_by_rtde(tmp_path):
    closed = []
    source = Taken("UR", Ur("robot", arm(closed=closed)), Still())
    pair = source.take()
    np.testing.assert_allclose(pair.robot, POSES.robot[0], atol=1e-12)
    assert Session(Folder(tmp_path)).add(*pair).n == 1
    with pytest.raises(uq.InputError, match="The arm moves"):
        Taken("UR", Ur("robot", arm(speed=0.2)), Still()).take()
    source.close()
    assert closed == [True]


def test_camera_poses_on_lines_and_the_robot_by_rtde(tmp_path):
    """Ask the arm when a line comes: ``--rtde HOST --stdin``."""
    text = json.dumps({"camera": POSES.camera[0].tolist()}) + "\n"
    session = Session(Folder(tmp_path))
    feed(session, Lines(io.StringIO(text + text), robot=Ur("robot", arm())), threading.Event())
    assert session.answer.n == 2 and not session.notes
    feed(session, Lines(io.StringIO(text), robot=Ur("robot", arm(speed=0.2))), threading.Event())
    assert session.answer.n == 2 and "The arm moves" in session.notes[-1]
    feed(session, Lines(io.StringIO('{"robot": 1}\n'), robot=Ur("robot", arm())), threading.Event())
    assert session.answer.n == 2 and len(session.notes) == 2


def test_a_bag_played_back():
    times, waited = np.arange(0.0, 8.0), []
    streams = [uq.Stream(times, side) for side in (POSES.robot, POSES.camera)]
    source = Playback(*streams, interval=0.5, how={"offset": 0.0}, pause=waited.append)
    pairs = []
    while (pair := source.take()) is not None:
        pairs.append(pair)
    assert len(pairs) >= 7 and waited == [0.5] * (len(pairs) - 1)
    assert [pair.time for pair in pairs] == sorted(pair.time for pair in pairs)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_ten_starting_views_work(setup):
    """X of the ten views is about as accurate as that of ten random poses, and no check on motion speaks."""
    C = starting_views()
    W, X = POSES.robot[0] @ POSES.camera[0], np.eye(4)
    X[:3, 3] = 0.03, 0.02, 0.1
    G = W @ inverse(C) @ inverse(X) if setup == "eye-in-hand" else X @ C @ inverse(W)
    bound = uq.bound(uq.PosePairs(G, C, setup), noise=NOISE)
    random = [uq.bound(uq.simulate(n_poses=10, noise=NOISE, seed=k), noise=NOISE) for k in range(5)]
    for part in (slice(0, 3), slice(3, 6)):
        sizes = [np.sqrt(np.linalg.eigvalsh(S[part, part])[-1]) for S in (bound, *random)]
        assert sizes[0] < 1.5 * max(sizes[1:])
    assert ((C[:, :3, :3] @ [0, 0, 1])[:, 2] < -0.8).all()  # the board's front is seen


def test_when_it_is_enough():
    assert not enough(Answer(5, ())) and words(Answer(0, ())).startswith("Start with ten poses")
    assert enough(Answer(9, (), ahead=NextPose(np.eye(4), 0.02))) and 1 - 0.98**5 < 0.1
    assert not enough(Answer(9, (), ahead=NextPose(np.eye(4), 0.022))) and 1 - 0.978**5 > 0.1
    assert not enough(Answer(9, (), ahead=NextPose(np.eye(4), float("nan"))))
    loose = Question(tolerance=Tolerance.read("5cm,5deg"))
    assert words(loose.ask(8, POSES)) == "The tolerance is shown to be met: you can finish."


def test_shapes_of_the_scene():
    S = np.diag([4.0, 1.0, 9.0])
    points, faces = ellipsoid(S, 10.0)
    np.testing.assert_allclose(np.einsum("ki,ij,kj->k", points, np.linalg.inv(S), points), 100.0)
    assert faces.max() < len(points) and [nice(x) for x in (0.3, 1.0, 7.0, 49.0, 1234.0)] == [1, 1, 5, 20, 1000]


def test_the_python_interface(tmp_path):
    pytest.importorskip("viser", reason="viser (extra live) is not installed")
    with uq.live(tmp_path / "session", tolerance="1mm,0.1deg", port=0, noise=NOISE) as session:
        for robot, camera in zip(POSES.robot, POSES.camera, strict=True):
            answer = session.add(robot, camera)
        assert answer.n == 8 and session.url.startswith("http://127.0.0.1:")
        expected = uq.calibrate(uq.read_poses(tmp_path / "session" / "poses.jsonl"), noise=NOISE)
        np.testing.assert_array_equal(session.result.X, expected.X)
        assert session.leave_out(2).left_out == (2,) and session.take_back(2).left_out == ()
        assert sorted(path.name for path in session.finish().iterdir()) == ["report.html", "result.json"]


def test_a_point_of_a_stored_result(tmp_path):
    pytest.importorskip("viser", reason="viser (extra live) is not installed")
    from uq_handeye.use.live_session.view import ViewPage

    uq.calibrate(POSES, noise=NOISE).save(tmp_path / "result.json")
    result = uq.load(tmp_path / "result.json")
    page = ViewPage(result, port=0)
    try:
        page._point.position = (0.5, 0.1, 0.3)
        seen = inverse(POSES.robot[7] @ result.X) @ [0.5, 0.1, 0.3, 1.0]
        expected = result.predict(seen[:3], robot=POSES.robot[7]).covariance
        np.testing.assert_allclose(page.predict(), expected, rtol=1e-9)
        assert "500.0, 100.0, 300.0 mm" in page._words.content
    finally:
        page.close()


class SceneOfTwelve(NamedTuple):
    """Pictures of a scene whose camera poses are known."""

    images: str
    camera: np.ndarray
    facts: SceneFacts | None = None

    def paired(self, paths, robot, setup):
        return uq.PosePairs(robot, self.camera[: len(paths)], setup, scene=self.facts)


def test_pictures_of_a_scene_are_paired_with_the_robot_poses_that_are_there(tmp_path):
    poses = uq.simulate(n_poses=12, seed=3)
    folder = Folder(tmp_path, {"setup": "eye-in-hand"}, SceneOfTwelve(f"{tmp_path}/*.png", poses.camera))
    assert folder.read() == (0, None)
    for k in range(9):
        (tmp_path / f"img{k}.png").write_bytes(b"")
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot[:5])
    assert folder.read() == (5, None)  # a scene needs six
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot[:8])
    n, found = folder.read()
    assert n == 8 and np.allclose(found.robot, poses.robot[:8]) and np.array_equal(found.camera, poses.camera[:8])
    assert found.sources[0].format == "csv"


@pytest.mark.slow
def test_a_scene_is_drawn_as_its_points_and_not_as_a_board(tmp_path, monkeypatch):
    pytest.importorskip("viser", reason="viser (extra live) is not installed")
    from uq_handeye.use.live_session import scene as drawing
    from uq_handeye.use.live_session.page import Page

    points = np.random.default_rng(0).normal(scale=0.1, size=(50, 3))
    monkeypatch.setattr(drawing, "_points_of", lambda known: points)
    facts = SceneFacts(12, 50, 30.0, 0.5, 600.0, 1.0, known="a")
    for setup, board, ball in (("eye-in-hand", "/target/board", None), ("eye-to-hand", None, "/poses/0")):
        poses = uq.simulate(n_poses=8, noise=NOISE, setup=setup, seed=3)
        seen = SceneOfTwelve(f"{tmp_path}/{setup}/*.png", poses.camera, facts)
        page = Page(Session(Folder(tmp_path / setup, {"setup": setup}, seen)), port=0)
        try:
            assert "the scene in the middle" in page._summary.content and "board" not in page._summary.content
            assert ("/sketch/fixed" in page._scene.nodes._nodes) and "/scene" not in page._scene.nodes._nodes
            for k in range(8):
                (tmp_path / setup / f"img{k}.png").write_bytes(b"")
            uq.write_pose_file(tmp_path / setup / "robot.csv", poses.robot)
            answer = page.session.update()
            nodes = page._scene.nodes
            assert answer.result is not None and "/scene" in nodes._nodes and board not in nodes._nodes
            at = answer.result.W if setup == "eye-in-hand" else poses.robot[-1] @ answer.result.W
            shown = np.frombuffer(nodes._made["/scene"][0]).reshape(-1, 3)
            np.testing.assert_allclose(shown, points @ at[:3, :3].T + at[:3, 3])
            assert ball is None or type(nodes._nodes[ball]).__name__ == "IcosphereHandle"
        finally:
            page.close()
