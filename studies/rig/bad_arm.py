"""Trials of two fixed cameras beside a bad arm: relative pose against the truth, over random rigs.

A board on an arm whose poses are off by a smooth error (6 mm, 12 mrad, the same at the same pose) and by noise (2 mm,
2 mrad); 5 % of the robot poses and 5 % of the views are wrong. Corners of 0.3 px; focal length and image centre of both
cameras and the squares of the board are 0.1 and 0.3 % other than told. About a third of the pictures of each camera
have none of the other at the same robot pose.

Run ``python -m studies.rig.bad_arm [RIGS]``.
"""

import sys

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse, perturb

from .consistency import error

FOCAL, PIXELS, POSES = 900.0, 0.3, 60
ARM, NOISE = np.repeat([12e-3, 6e-3], 3), np.repeat([2e-3, 2e-3], 3)
WRONG, COMMON, INTRINSICS, SQUARE = 0.05, 0.6, 1e-3, 3e-3
GRID = np.stack(np.meshgrid(0.025 * np.arange(7), 0.025 * np.arange(5)), axis=-1).reshape(-1, 2)
BOARD = np.pad(GRID - GRID.mean(axis=0), [(0, 0), (0, 1)])


def looking(at: np.ndarray, towards: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a pose at a point whose z axis looks towards another one, within 3 degrees."""
    z = (towards - at) / np.linalg.norm(towards - at)
    x = np.cross([0.0, 0.0, 1.0], z) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], z))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.c_[x, np.cross(z, x), z], at
    return np.asarray(perturb(T, np.r_[0.05 * rng.normal(size=3), np.zeros(3)]))


def picture(C: np.ndarray, focal: float, centre: np.ndarray, square: float, rng: np.random.Generator) -> np.ndarray:
    """Return the pose that OpenCV finds of a board at C, with the intrinsics as told."""
    p = BOARD @ C[:3, :3].T + C[:3, 3]
    pixels = focal * (p[:, :2] / p[:, 2:] + centre) + PIXELS * rng.normal(size=(len(p), 2))
    _, turn, shift = cv2.solvePnP(BOARD / square, pixels, np.diag([FOCAL, FOCAL, 1.0]), None)
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    return found


def drawn(seed: int) -> tuple[uq.Rig, np.ndarray]:
    """Return a rig, and the true pose of its second camera in the first."""
    rng = np.random.default_rng(seed)
    cameras = [looking(np.r_[1.2, 0.4 * side, 0.9] + 0.05 * rng.normal(size=3), np.r_[0, 0, 0.5], rng)
               for side in (-1, 1)]  # fmt: skip
    W = perturb(np.eye(4), np.r_[0.3 * rng.normal(size=3), 0.05 * rng.normal(size=3) + [0, 0, 0.08]])
    focal, centre = FOCAL * (1 + INTRINSICS * rng.normal(size=2)), INTRINSICS * rng.normal(size=(2, 2))
    square, of_arm = 1 + SQUARE * rng.normal(), rng.normal(size=(6, 12)) / 3.5
    robot: list[np.ndarray] = []
    views: list[list[tuple[int, np.ndarray]]] = [[], []]
    while len(robot) < POSES:
        at = np.r_[0, 0, 0.5] + rng.uniform(-1, 1, 3) * [0.3, 0.3, 0.25]
        board = looking(at, 0.5 * (cameras[0] + cameras[1])[:3, 3], rng)
        turn = Rotation.from_rotvec(0.45 * rng.normal(size=3)) * Rotation.from_rotvec([0, 0, rng.uniform(0, 6.3)])
        board[:3, :3] = board[:3, :3] @ np.diag([1.0, -1.0, -1.0]) @ turn.as_matrix()
        seen = []
        for k, X in enumerate(cameras):
            C = inverse(X) @ board
            p = BOARD @ C[:3, :3].T + C[:3, 3]
            if abs(C[2, 2]) > 0.4 and np.abs(p[:, :2] / p[:, 2:]).max() < 0.6:
                seen.append((k, C))
        if not seen:
            continue
        if len(seen) == 2 and rng.random() > COMMON:
            seen = [seen[int(rng.integers(2))]]
        true = board @ inverse(W)
        features = np.r_[np.sin(3 * true[:3, 3]), true[:3, 0], true[:3, 2], np.cos(5 * true[:3, 3])]
        measured = perturb(true, of_arm @ features * ARM + NOISE * rng.normal(size=6))
        if rng.random() < WRONG:
            measured = perturb(measured, np.r_[0.2 * rng.normal(size=3), 0.08 * rng.normal(size=3)])
        for k, C in seen:
            found = picture(C, focal[k], centre[k], square, rng)
            if rng.random() < WRONG:
                found = perturb(found, np.r_[0.5 * rng.normal(size=3), 0.08 * rng.normal(size=3)])
            views[k].append((len(robot), found))
        robot.append(measured)
    listed = [uq.View(name, "board", np.array([T for _, T in of]), tuple(k for k, _ in of))
              for name, of in zip(("one", "two"), views, strict=True)]  # fmt: skip
    rig = uq.Rig({"arm": np.array(robot)}, {"one": "world", "two": "world"}, {"board": "arm"}, tuple(listed))
    return rig, inverse(cameras[0]) @ cameras[1]


def run(count: int) -> None:
    """Print how far relative poses are off, and how often their covariance has them."""
    off, squares = [], []
    for seed in range(count):
        rig, true = drawn(seed)
        pair = uq.calibrate(rig).relative("one", "two")
        e = error(pair.pose, true)
        off.append(1e3 * float(np.linalg.norm(e[3:])))
        squares.append(float(e @ np.linalg.solve(pair.covariance, e)))
    print(
        f"{count} rigs: relative pose off by {np.sqrt(np.mean(np.square(off))):.2f} mm RMS, largest {max(off):.2f} mm, "
        f"{np.mean(np.array(off) < 6):.0%} below 6 mm; mean d^2/6 {np.mean(squares) / 6:.2f}, inside 99 % "
        f"{np.mean(np.array(squares) < 16.81):.0%}"
    )


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
