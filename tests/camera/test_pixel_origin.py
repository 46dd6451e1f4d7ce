"""Poses and corners whose pixels are counted from the corner of the first one, as those of AprilTag's libraries."""

import json

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.pictures import CAMERA, SIZE, camera_to_board, seen_corners

import uq_handeye as uq
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.camera.pixel_origin import poses_from_centre
from uq_handeye.model.shared_errors.pixel_origin import pairs_from_centre

cv2 = pytest.importorskip("cv2")
POINTS = uq.tag_points("60mm")
TAG = ("--tag", "60mm", "--camera-matrix", "750,746,320,240")
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 200, 1e-15)
INTRINSICS = np.array([CAMERA[0, 0], CAMERA[1, 1], CAMERA[0, 2], CAMERA[1, 2]])


def poses_by_opencv(poses, shift):
    """camera_T_target by the other program: OpenCV's fit to exact pixels that are larger by ``shift``."""
    found = []
    for T in poses:
        _, _, pixels = seen_corners(POINTS, T[None], np.random.default_rng(0), noise=0.0)
        r, t = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3:].copy()
        # Its solvePnP stops after steps of float precision, elsewhere on each processor.
        r, t = cv2.solvePnPRefineLM(POINTS, pixels + shift, CAMERA, None, r, t, STOP)
        C = np.eye(4)
        C[:3, :3], C[:3, 3] = Rotation.from_rotvec(r.ravel()).as_matrix(), t.ravel()
        found.append(C)
    return np.array(found)


@pytest.fixture(scope="module")
def tag(tmp_path_factory):
    """Robot and camera poses of a tag, the latter by pixels counted from the corner, and the truth."""
    folder = tmp_path_factory.mktemp("origin")
    poses = uq.simulate(n_poses=12, noise=uq.PoseNoise.isotropic(robot=("0.002deg", "0.01mm")), seed=4)
    truth = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
    camera = poses.truth.camera @ truth  # the tag is seen from its front
    uq.write_pose_file(folder / "robot.csv", poses.robot)
    uq.write_pose_file(folder / "camera.csv", poses_by_opencv(camera, 0.5))
    return folder, camera, poses.truth.X


def test_poses_are_those_of_pixels_counted_from_the_centre(tag):
    _, camera, _ = tag
    shifted = poses_by_opencv(camera, 0.5)
    found = poses_from_centre(shifted, POINTS, "pinhole", INTRINSICS)
    before, after = (np.linalg.norm((each - camera)[:, :3, 3], axis=1).max() for each in (shifted, found))
    assert before > 2e-4 and after < 1e-6
    np.testing.assert_allclose(found, camera, atol=3e-6)
    pairs = pairs_from_centre(uq.PosePairs(camera, shifted), POINTS, "pinhole", INTRINSICS)
    assert "counted from the corner" in str(pairs.findings[-1])
    np.testing.assert_array_equal(pairs.camera, found)


@pytest.mark.slow
def test_the_option_of_finished_poses(tag):
    folder, _, X = tag
    views = ("--tag", "60mm", "--camera-matrix", ",".join(map(str, INTRINSICS)), "--intrinsics", "exact")
    off = {}
    for origin in ("centre", "corner"):
        done = run("calibrate", "robot.csv", "camera.csv", *views, "--pixel-origin", origin, "--json", cwd=folder)
        assert done.returncode in (0, 3), done.stderr
        off[origin] = np.linalg.norm((inverse(X) @ np.array(json.loads(done.stdout)["X"]))[:3, 3])
    assert off["corner"] < 5e-5 and off["centre"] > 5 * off["corner"]


@pytest.mark.slow
def test_the_option_of_a_table_of_corners(tmp_path, rng):
    board = uq.Board(9, 6, "20mm")
    T = camera_to_board(uq.simulate(n_poses=8, seed=5).truth.camera, board)
    corners = uq.Corners(*seen_corners(board.points, T, rng, noise=0.05), image_size=SIZE)
    (tmp_path / "corners.csv").write_text(corners_text(corners, np.ones(corners.m, dtype=bool)))
    centres = []
    for origin in ("centre", "corner"):
        how = ("--image-size", "640x480", "--model", "pinhole", "--board-shape", "flat", "--pixel-origin", origin)
        done = run("camera", "corners.csv", *how, "--json", cwd=tmp_path)
        found = json.loads(done.stdout)["parameters"]
        centres.append([found["cx"], found["cy"]])
    np.testing.assert_allclose(np.subtract(*centres), [0.5, 0.5], atol=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("camera.csv", "--pixel-origin", "corner"), "need --camera-matrix"),
        (("camera.csv", *TAG, "--pixel-origin", "edge"), "one of centre, corner"),
        (("--images", "*.png", "--tag", "60mm", "--pixel-origin", "corner"), "for finished camera poses"),
    ],
)
def test_what_is_refused(tag, options, message):
    done = run("calibrate", "robot.csv", *options, cwd=tag[0])
    assert done.returncode == 2 and message in done.stderr
