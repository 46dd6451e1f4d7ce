"""Pictures of boards, and corners as a known camera sees them; the references are OpenCV's own functions."""

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.io import write_pose_file

NOISE = uq.PoseNoise.isotropic(robot=("0.005deg", "0.02mm"), camera=("0.1deg", "0.5mm"))
SIZE = (640, 480)
CAMERA = np.array([[750.0, 0, 320], [0, 746, 240], [0, 0, 1]])
UP = 60  # pixels of a drawn square
FINE = 2  # pictures are drawn so many times as large


def camera_to_board(camera_T_target, board):
    """camera_T_board for a target whose origin is the middle of the board and whose z points to the camera."""
    seen = camera_T_target @ np.diag([1.0, -1, -1, 1])
    middle = board.points.mean(axis=0)
    seen[..., :3, 3] -= (seen[..., :3, :3] @ middle[:, None])[..., 0]
    return seen


def drawing(board):
    """The board with a white rim, and board_from_pixel (3, 3)."""
    cv2 = pytest.importorskip("cv2")
    if board.kind == "chessboard":
        j, i = np.indices((board.rows + 1, board.columns + 1))
        squares = np.kron(((i + j) % 2 * 255).astype(np.uint8), np.ones((UP, UP), np.uint8))
        first = 2  # squares before the origin: the rim and the first square
    else:
        words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}"))
        layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, board.marker, words)
        squares = layout.generateImage((board.columns * UP, board.rows * UP))
        first = 1
    scale = board.square / UP
    shift = 0.5 * scale - first * board.square  # the edge of a pixel is half a pixel before its centre
    return np.pad(squares, UP, constant_values=255), np.array([[scale, 0, shift], [0, scale, shift], [0, 0, 1]])


def picture(board, camera_T_board, rng, K=CAMERA, size=SIZE, noise=2.0):
    """What a camera without distortion sees, with noise and a rim of neither white nor black."""
    cv2 = pytest.importorskip("cv2")
    texture, board_from_pixel = drawing(board)
    fine = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1]])
    H = fine @ K @ camera_T_board[:3, [0, 1, 3]] @ board_from_pixel
    large = cv2.warpPerspective(texture, H, (FINE * size[0], FINE * size[1]), borderValue=200)
    small = cv2.resize(large, size, interpolation=cv2.INTER_AREA)
    return np.clip(20 + 0.8 * small + noise * rng.normal(size=small.shape), 0, 255).astype(np.uint8)


def write_pictures(folder, board, rng, n=10, blank=(), seed=3):
    """``folder/img0.png`` ... and robot.csv of a rig; those of ``blank`` show no board. Gives the poses, with truth."""
    cv2 = pytest.importorskip("cv2")
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=seed)
    (folder / "img").mkdir()
    for k, T in enumerate(poses.truth.camera):
        seen = picture(board, camera_to_board(T, board), rng)
        cv2.imwrite(str(folder / "img" / f"img{k}.png"), np.full_like(seen, 180) if k in blank else seen)
    write_pose_file(folder / "robot.csv", poses.robot)
    return poses


def seen_corners(points, poses, rng, noise=0.1, K=CAMERA, distortion=(), fisheye=False, rows=None):
    """Corners (row, points, pixels) of poses (n, 4, 4) with pixel noise."""
    cv2 = pytest.importorskip("cv2")
    pixels = []
    for T in poses:
        turn, shift = cv2.Rodrigues(T[:3, :3])[0], T[:3, 3].copy()
        d = np.array(distortion or [0.0] * 4)
        if fisheye:
            pixels.append(cv2.fisheye.projectPoints(points[None], turn, shift, K, d)[0][0])
        else:
            pixels.append(cv2.projectPoints(points, turn, shift, K, d)[0][:, 0])
    rows = np.arange(len(poses)) if rows is None else np.asarray(rows)
    exact = np.concatenate(pixels)
    return np.repeat(rows, len(points)), np.tile(points, (len(poses), 1)), exact + noise * rng.normal(size=exact.shape)


def simulated_rig(board, rng, n=15, seed=3, **camera):
    """Poses with truth, and the corners that their camera sees."""
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=seed)
    return poses, uq.Corners(
        *seen_corners(board.points, camera_to_board(poses.truth.camera, board), rng, **camera), image_size=SIZE
    )
