"""Pictures of boards, and corners as a known camera sees them; the references are OpenCV's own functions."""

from functools import cache

import numpy as np
import pytest

import uq_handeye as uq
from studies.common.pictures import Camera
from studies.common.pictures import picture as taken
from uq_handeye.read import write_pose_file

NOISE = uq.PoseNoise.isotropic(robot=("0.005deg", "0.02mm"), camera=("0.1deg", "0.5mm"))
SIZE = (640, 480)
CAMERA = np.array([[750.0, 0, 320], [0, 746, 240], [0, 0, 1]])


def camera_to_board(camera_T_target, board):
    """camera_T_board for a target whose origin is the middle of the board and whose z points to the camera."""
    seen = camera_T_target @ np.diag([1.0, -1, -1, 1])
    middle = board.points.mean(axis=0)
    seen[..., :3, 3] -= (seen[..., :3, :3] @ middle[:, None])[..., 0]
    return seen


def facing(board, roll=0.0, tilt=(0.3, -0.25), distance=0.45):
    """camera_T_board: its middle on the optical axis, tilted, and the camera rolled by so many degrees."""
    c, s = np.cos(np.radians(roll)), np.sin(np.radians(roll))
    cv2 = pytest.importorskip("cv2")
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ cv2.Rodrigues(np.array([*tilt, 0.0]))[0]
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = [0, 0, distance] - R @ board.points.mean(axis=0)
    return T


def projected(board, T):
    """Return the pixels of the corners of the board."""
    p = (board.points @ T[:3, :3].T + T[:3, 3]) @ CAMERA.T
    return p[:, :2] / p[:, 2:]


def save(folder, *pictures):
    """Write pictures ``img0.png``, ...; return their pattern."""
    cv2 = pytest.importorskip("cv2")
    for k, one in enumerate(pictures):
        cv2.imwrite(str(folder / f"img{k}.png"), one)
    return str(folder / "img*.png")


@cache
def pinhole(focal, centre, size):
    """A camera without distortion, once for all its pictures."""
    return Camera("pinhole", np.array([*focal, *centre]), size)


def picture(board, camera_T_board, rng, K=CAMERA, size=SIZE, noise=2.0):
    """Return the picture of a camera without distortion, with noise and a rim of neither white nor black."""
    pytest.importorskip("cv2")
    camera = pinhole((K[0, 0], K[1, 1]), (K[0, 2], K[1, 2]), size)
    return taken(camera, board, camera_T_board, rng, noise=noise)


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
