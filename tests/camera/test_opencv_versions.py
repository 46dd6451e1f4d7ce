"""The same X by every version of OpenCV: chessboard, ChArUco, AprilGrid and discs, in the same pictures.

The gate runs this with OpenCV 5 and with OpenCV 4; the numbers kept here are those of 4.14. By hand over further
environments, interpreters with this package's requirements and another OpenCV:
``UQ_HANDEYE_OPENCV=/a/bin/python:/b/bin/python pytest -m slow tests/camera/test_opencv_versions.py``.
"""

import json
import os
import subprocess
import sys
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from fixtures.pictures import save

import uq_handeye as uq
from studies.common.pictures import Camera, picture
from uq_handeye.core.geometry.rotations import Rotation
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.fit.diagnostics.board_rotation import resolve_board_rotation
from uq_handeye.fit.graph.gauss_helmert import efficient

ROOT = Path(__file__).parents[2]
BOARDS = {
    "chessboard": uq.Board(9, 6, 0.02),
    "charuco": uq.Board(9, 6, 0.02, "charuco", marker=0.015),
    "aprilgrid": uq.Board(4, 3, 0.04, "aprilgrid", spacing=0.3),
    "circles": uq.Board(7, 5, 0.025, "circles", diameter=0.015),
}
POSES, SIZE = 8, (640, 480)
CAMERA = Camera("brown", np.array([700.0, 702.0, 322.0, 238.0, -0.1, 0.02, 0, 0, 0, 0, 0, 0]), SIZE)
# Translation of X (m) by OpenCV 4.14.
KEPT = {
    "chessboard": (0.0299996058, -0.0199912602, 0.0499473120),
    "charuco": (0.0299831112, -0.0203726801, 0.0510549371),
    "aprilgrid": (0.0299949050, -0.0200005290, 0.0499952538),
    "circles": (0.0299954031, -0.0199910640, 0.0499674290),
}
# Largest difference between versions (m).
MAX_DIFFERENCE_M = 2e-5


def translation(board):
    """X by the OpenCV that is installed, from the same pictures in every version."""
    rng, middle = np.random.default_rng(4814), board.points.mean(axis=0)
    X, W = np.eye(4), np.eye(4)
    X[:3, 3], W[:3, 3] = (0.03, -0.02, 0.05), (0.4, 0.1, 0.0)
    X[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix()
    C = np.tile(np.eye(4), (POSES, 1, 1))
    for k, T in enumerate(C):
        a = 2 * np.pi * k / POSES
        turn = Rotation.from_rotvec([0.55 * np.cos(a), 0.55 * np.sin(a), 0.0]) * Rotation.from_euler(
            "z", 0.6 * np.sin(3 * a)
        )
        T[:3, :3] = turn.as_matrix()
        T[:3, 3] = np.array([0.01 * np.sin(a), 0.01 * np.cos(a), 0.42 + 0.01 * k]) - turn.as_matrix() @ middle
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        images = save(Path(folder), *(picture(CAMERA, board, T, rng, noise=2.0, blur=0.7) for T in C))
        corners = uq.detect_board(images, board)
        seen = uq.calibrate_camera(corners, SIZE, "brown", coefficients=("k1", "k2"), shape="flat")
        robot = W @ inverse(X @ C)
        pairs = uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen)
        pairs = resolve_board_rotation(pairs, board)
    return efficient(pairs, uq.PoseNoise(None, pairs.camera_calibration.covariance)).X[:3, 3]


@pytest.mark.slow
@pytest.mark.parametrize("kind", BOARDS)
def test_x_is_that_of_other_versions(kind):
    pytest.importorskip("cv2")
    assert np.abs(translation(BOARDS[kind]) - KEPT[kind]).max() < MAX_DIFFERENCE_M


@pytest.mark.slow
@pytest.mark.skipif("UQ_HANDEYE_OPENCV" not in os.environ, reason="by hand, see the module")
@pytest.mark.parametrize("python", os.environ.get("UQ_HANDEYE_OPENCV", "").split(os.pathsep))
def test_x_by_further_environments(python):
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [python, __file__], capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": path}
    )
    found = json.loads(done.stdout)
    print(found.pop("version"))
    for kind, t in found.items():
        assert np.abs(np.subtract(t, KEPT[kind])).max() < MAX_DIFFERENCE_M, kind


if __name__ == "__main__":
    import cv2

    found = {kind: translation(board).tolist() for kind, board in BOARDS.items()}
    sys.stdout.write(json.dumps({"version": cv2.__version__} | found) + "\n")
