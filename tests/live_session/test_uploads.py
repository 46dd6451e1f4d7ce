"""Pictures, a bag, touches and joints of a session, without a browser: what the buttons of the page do."""

import io
import time
import zipfile

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.model.camera import board
from uq_handeye.model.camera.description import board_of
from uq_handeye.read import write_pose_file
from uq_handeye.use.live_session import uploads
from uq_handeye.use.live_session.folder import Folder, board_text
from uq_handeye.use.live_session.session import CHOICE, Session
from uq_handeye.use.live_session.uploads import keep_bag, keep_picture, keep_upload

pytest.importorskip("viser", reason="viser (extra live) is not installed")
from uq_handeye.use.live_session.page import Page

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
POSES = uq.simulate(n_poses=8, noise=NOISE, seed=3)


@pytest.fixture
def page(tmp_path):
    shown = Page(Session(Folder(tmp_path / "session")), port=0)
    yield shown
    shown.close()


def pictures(n=10, seed=1):
    """Return robot poses and pictures (PNG) of a chessboard with 9 x 6 inner corners of 30 mm."""
    cv2 = pytest.importorskip("cv2", reason="OpenCV (extra camera) is not installed")
    poses = uq.simulate(n_poses=n, distance=("0.5m", "0.7m"), tilt="20deg", roll="40deg", seed=seed)
    squares = np.pad(np.kron(np.indices((7, 10)).sum(axis=0) % 2 * 255, np.ones((60, 60))), 60, constant_values=255)
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    on_board = np.array([[5e-4, 0, -0.18], [0, 5e-4, -0.135], [0, 0, 1]])
    found = []
    for T in poses.camera:
        H = K @ T[:3, [0, 1, 3]] @ on_board
        seen = cv2.warpPerspective(squares.astype(np.uint8), H, (640, 480), borderValue=140)
        found.append(cv2.imencode(".png", cv2.GaussianBlur(seen, (3, 3), 0))[1].tobytes())
    return poses, found


@pytest.mark.slow
def test_pictures_in_place_of_camera_poses(page, tmp_path):
    poses, seen = pictures()
    write_pose_file(tmp_path / "r.csv", poses.robot)
    page._add(keep_upload, "robot", "r.csv", (tmp_path / "r.csv").read_bytes())
    page._board.value, page._square.value = "9x6", "30mm"
    for content in seen[:-1]:
        keep_picture(page.session.folder.path, "picture.png", content)
    page._add_picture("picture.png", seen[-1])
    answer = page.session.update()
    assert answer.result is not None and answer.poses.n >= 7, page.session.problem
    turn, shift = np.abs(answer.result.X - poses.truth.X)[:3, :3].max(), answer.result.X - poses.truth.X
    assert turn < 0.02 and np.linalg.norm(shift[:3, 3]) < 0.02
    drawn = page._extras(answer.poses, answer.result).pictures
    assert len(drawn) == answer.poses.n and drawn[3][1]().shape == (180, 240, 3)
    again = Session(Folder(page.session.folder.path))  # the board is remembered
    assert again.update().n == answer.n and (page.session.folder.path / CHOICE).exists()
    np.testing.assert_array_equal(again.answer.result.X, answer.result.X)


@pytest.mark.slow
def test_a_picture_is_looked_at_once(page, tmp_path, monkeypatch):
    poses, seen = pictures(4)
    write_pose_file(tmp_path / "r.csv", poses.robot)
    page._add(keep_upload, "robot", "r.csv", (tmp_path / "r.csv").read_bytes())
    page._square.value = "30mm"
    looked = []
    monkeypatch.setattr(board, "_decoded", lambda *given, look=board._decoded: looked.append(given[1]) or look(*given))
    board._LOOKS.clear()
    for content in seen:
        page._add_picture("picture.png", content)
    assert len(looked) == 4
    monkeypatch.setattr(board, "_LOOKS", type(board._LOOKS)())
    fresh = Session(Folder(page.session.folder.path)).update()
    assert len(looked) == 8
    np.testing.assert_array_equal(fresh.result.X, page.session.answer.result.X)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (("chessboard", "9x6", "20mm"), "kind=chessboard columns=9 rows=6 square=0.02"),
        (("charuco", "5x7", "30mm", "22mm", "5X5_100"), "kind=charuco marker=0.022 dictionary=5X5_100"),
        (("aprilgrid", "6x6", "40mm", "12mm"), "kind=aprilgrid dictionary=APRILTAG_36H11 spacing=0.3"),
        (("aruco", "4x3", "40mm", "1cm"), "kind=aruco dictionary=4X4_50 spacing=0.01"),
        (("apriltag", "9x6", "40mm", "15mm", "tag25h9"), "kind=apriltag dictionary=APRILTAG_25H9 columns=1"),
    ],
)
def test_boards_of_every_kind(given, text):
    found = board_text(*given)
    assert set(text.split()) <= set(found.split()) and board_of(found).text == found
    with pytest.raises(uq.InputError):
        board_text(given[0], "x", "-1mm")
    with pytest.raises(uq.InputError):
        board_text("circles", "9x6", "20mm")


def test_the_page_asks_for_what_a_kind_of_board_has(page):
    for kind, shown in (("chessboard", (1, 0, 0)), ("charuco", (1, 1, 1)), ("apriltag", (0, 0, 1))):
        page._kind.value = kind
        page._of_kind()
        assert (page._board.visible, page._second.visible, page._words.visible) == tuple(map(bool, shown))


@pytest.mark.slow
def test_pictures_of_a_charuco_board(page, tmp_path):
    cv2 = pytest.importorskip("cv2", reason="OpenCV (extra camera) is not installed")
    poses = uq.simulate(n_poses=8, distance=("0.5m", "0.7m"), tilt="20deg", roll="40deg", seed=1)
    drawn = cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100))
    flat = cv2.copyMakeBorder(drawn.generateImage((700, 500)), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    on_board = np.array([[4e-4, 0, -0.164], [0, -4e-4, 0.124], [0, 0, 1]])
    write_pose_file(tmp_path / "r.csv", poses.robot)
    page._add(keep_upload, "robot", "r.csv", (tmp_path / "r.csv").read_bytes())
    page._kind.value, page._board.value, page._square.value = "charuco", "7x5", "40mm"
    page._second.value, page._words.value = "30mm", "5x5_100"
    for T in poses.camera:
        H = K @ T[:3, [0, 1, 3]] @ on_board
        seen = cv2.GaussianBlur(cv2.warpPerspective(flat, H, (640, 480), borderValue=140), (3, 3), 0)
        keep_picture(page.session.folder.path, "picture.png", cv2.imencode(".png", seen)[1].tobytes())
    page._add_picture("picture.png", cv2.imencode(".png", seen)[1].tobytes())
    answer = page.session.answer
    assert answer.n == 8, page.session.problem
    assert np.abs(answer.result.X - poses.truth.X).max() < 0.03
    assert "kind=charuco" in (page.session.folder.path / CHOICE).read_text()


def zipped(files, **how):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, data in files.items():
            packed.writestr(name, data)
    return content.getvalue()


@pytest.mark.slow
def test_the_folder_of_a_bag_as_zip(page, tmp_path):
    pytest.importorskip("rosbags", reason="rosbags (extra rosbag) is not installed")
    from fixtures.bags import START, Writer

    with Writer(tmp_path, "mcap") as bag:
        for k in range(8):
            edges = ("base", "tool0", POSES.robot[k]), ("camera", "tag0", POSES.camera[k])
            bag.tf(START + k, *edges)
            bag.tf(START + k + 0.5, *edges)  # it stands still
    files = {f"cell/{path.name}": path.read_bytes() for path in bag.path.iterdir()}
    path = keep_bag(page.session.folder.path, "cell.zip", zipped({**files, "cell/notes.txt": b"x", "../up.mcap": b"x"}))
    assert sorted(one.name for one in path.iterdir()) == sorted(one.name for one in bag.path.iterdir())
    assert len(uq.read_bag(path, robot="base:tool0", camera="camera:tag0")[0].poses) == 16


@pytest.mark.slow
@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"PK\x03\x04rubbish", "not a .zip"),
        (zipped({}), "expected the folder of one bag"),
        (zipped({"a/x.mcap": b"1", "b/y.mcap": b"2"}), "expected the folder of one bag"),
        (zipped({"../../x.mcap": b"1", "/etc/y.mcap": b"1", "a\\..\\z.db3": b"1"}), "expected the folder of one bag"),
        (zipped({"a/x.mcap": bytes(3_000_000)}), "more than 2 MB"),
        (zipped({"a/x.mcap": b"abc" * 100})[:-40], "not a .zip"),
        (zipped({"a/x.mcap": b"no bag"}), "not a bag that can be read"),
    ],
    ids=["no zip", "empty", "two bags", "paths", "large", "cut off", "no bag"],  # the bytes hold the time of day
)
def test_hostile_bags_through_the_page(page, monkeypatch, content, words):
    monkeypatch.setattr(uploads, "MAX_UPLOAD_BYTES", 200_000)
    monkeypatch.setattr(uploads, "MAX_TABLE_BYTES", 2_000_000)
    page._frames.value = "base:tool0,cam:tag"
    page._tried(lambda: page._play("cell.zip", content))
    assert words in page.session.notes[-1] and len(page.session.notes[-1]) < 300
    inside = [path for path in page.session.folder.path.rglob("*") if path.is_file()]
    assert all(page.session.folder.path in path.resolve().parents for path in inside)


@pytest.mark.slow
def test_touches_are_drawn_beside_each_answer(page):
    for robot, camera in zip(POSES.robot, POSES.camera, strict=True):
        page.session.add(robot, camera, ask=False)
    page.session.update()
    points = np.array([[0.4, 0.1, 0.2], [0.5, -0.1, 0.2], [0.4, 0.0, 0.25]])
    rows = ["seen_x,seen_y,seen_z,touched_x,touched_y,touched_z,touched_sd,"
            + ",".join(f"seen_at_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw"))]  # fmt: skip
    for G, point in zip(POSES.robot, points, strict=False):
        seen = (inverse(G @ POSES.truth.X) @ np.append(point, 1.0))[:3]
        moved = point + np.array([0.0, 0.0, 0.05])
        numbers = [*seen, *moved, 2e-4, *G[:3, 3], *Rotation.from_matrix(G[:3, :3]).as_quat()]
        rows.append(",".join(f"{x:.9g}" for x in numbers))
    page._add_touches("t.csv", "\n".join(rows).encode())
    drawn = page._extras(page.session.answer.poses, page.session.answer.result).touched
    np.testing.assert_allclose(drawn.points, points + np.array([0.0, 0.0, 0.05]), atol=1e-8)
    np.testing.assert_allclose(drawn.misses, np.tile([0.0, 0.0, 0.05], (3, 1)), atol=0.01)
    assert drawn.flagged.all() and "CONTRADICTED" in page._said.content
    page._add_touches("t.csv", b"a,b\n1,2\n")
    assert "expected a header with seen_x" in page._said.content


@pytest.mark.slow
def test_a_bag_is_played_into_the_session(page, monkeypatch):
    """The streams of a bag, which a stand-in reads, come as pairs of poses."""
    times = np.linspace(0.0, 20.0, 401)
    phases = np.sin(times[:, None] * [0.9, 1.1, 1.3] + [0.0, 1.0, 2.0])
    robot = np.tile(np.eye(4), (401, 1, 1))
    robot[:, :3, :3] = Rotation.from_rotvec(0.6 * phases).as_matrix()
    robot[:, :3, 3] = 0.2 * phases[:, ::-1]
    streams = [uq.Stream(times, T) for T in (robot, inverse(robot @ POSES.truth.X) @ POSES.truth.W)]
    asked = []

    def read_bag(path, **names):
        asked.append((path.name, names))
        return streams

    monkeypatch.setattr("uq_handeye.read.rosbag.streams.read_bag", read_bag)
    page._frames.value = "base:tool0, cam:tag"
    page._play("cell.mcap", b"bag")
    until = time.monotonic() + 60.0
    while page.session.answer.result is None and time.monotonic() < until:
        time.sleep(0.1)
    np.testing.assert_allclose(page.session.answer.result.X, POSES.truth.X, atol=1e-3)
    assert asked == [("bag.mcap", {"robot": "base:tool0", "camera": "cam:tag"})]
