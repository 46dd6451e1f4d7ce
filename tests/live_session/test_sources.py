"""Sources with stand-ins for what is not installed; guidance; the Python interface and the page of a stored result."""

from types import SimpleNamespace as Fields

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.geometry.se3 import inverse
from uq_handeye.live_session.folder import Folder
from uq_handeye.live_session.guide import enough, starting_views, words
from uq_handeye.live_session.question import Answer, Question
from uq_handeye.live_session.scene import ellipsoid, nice
from uq_handeye.live_session.session import Session
from uq_handeye.live_session.sources.bag import Playback
from uq_handeye.live_session.sources.ros import OLD, Tf, tf_source
from uq_handeye.live_session.sources.ur import Ur
from uq_handeye.planning.after_each import NextPose
from uq_handeye.statement.tolerance import Tolerance

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
    return Tf("base:tool0", "cam:tag", Buffer(known), None, lambda: now)


def test_a_pair_by_tf():
    pair = tf().take()
    np.testing.assert_allclose(pair.robot, POSES.robot[0], atol=1e-12)
    np.testing.assert_allclose(pair.camera, POSES.camera[0], atol=1e-12)
    assert pair.time == pytest.approx(10.1)


@pytest.mark.parametrize(
    ("source", "why"),
    [(tf((10.0, 10.5)), r"stamped 0\.50 s apart"), (tf(now=10.2 + OLD), "newest transforms are 2.1 s old"),
     (Tf("base:tool0", "cam:tag", Buffer({}), None, lambda: 0.0), "tf knows no robot pose base -> tool0")],
)  # fmt: skip
def test_what_tf_does_not_have(source, why):
    with pytest.raises(uq.InputError, match=why):
        source.take()


def test_frames_and_installations_that_are_missing():
    with pytest.raises(uq.InputError, match=r"parent:child, e\.g\. base_link:tool0, got 'base'"):
        Tf("base", "cam:tag", None, None, None)
    with pytest.raises(uq.MissingExtraError, match="needs rclpy"):
        tf_source("base:tool0", "cam:tag")
    with pytest.raises(uq.MissingExtraError, match="need ur_rtde"):
        Ur("192.168.0.2", lambda: np.eye(4))


def test_an_arm_by_rtde(tmp_path):
    G = POSES.robot[0]
    pose = [*G[:3, 3], *Rotation.from_matrix(G[:3, :3]).as_rotvec()]
    speed = [0.0] * 6
    closed = []
    arm = Fields(getActualTCPPose=lambda: pose, getActualTCPSpeed=lambda: speed, getTimestamp=lambda: 3.5,
                 disconnect=lambda: closed.append(True))  # fmt: skip
    source = Ur("robot", lambda: POSES.camera[0], arm)
    pair = source.take()
    np.testing.assert_allclose(pair.robot, G, atol=1e-12)
    assert Session(Folder(tmp_path)).add(*pair).n == 1
    speed[4] = 0.2
    with pytest.raises(uq.InputError, match="The arm moves"):
        source.take()
    source.close()
    assert closed == [True]


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
    from uq_handeye.live_session.view import ViewPage

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
