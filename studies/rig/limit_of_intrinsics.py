r"""Bound of what four rendered cameras can tell of their relative poses, by how well their intrinsics are known.

Bound of Cramer and Rao, of everything that the pictures hold: an exact robot, an exact board, all corners with Gaussian
noise as large as it is, and nothing else unknown than the poses of the cameras, that of the board, and focal length
and image centre of each camera, known beforehand to a share of the focal length. No estimate from poses or corners
that is right on average can be better.

Run ``UQ_HANDEYE_DATA=DIR python -m studies.rig.limit_of_intrinsics``; the folder holds ``metric_medium``.
"""

import os
from itertools import combinations
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import approx_fprime

import uq_handeye as uq
from uq_handeye.calibration.rig_poses import relative_pose
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.read import read_pose_file

FOCAL, CENTRE, NOISE = 1371.0227, (959.5, 539.5), 0.061  # px; the noise is that of the corners about the best fit


def information(G: np.ndarray, X: np.ndarray, W: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(15, 15) of the corners of one camera by its pose, that of the board and three relative intrinsics."""

    def seen(x: np.ndarray) -> np.ndarray:
        T = np.linalg.inv(perturb(X, x[:6])) @ G @ perturb(W, x[6:12])
        p = np.einsum("nij,kj->nki", T[:, :3, :3], points) + T[:, None, :3, 3]
        return np.asarray(FOCAL * ((1 + x[12]) * p[..., :2] / p[..., 2:] + x[13:])).ravel()

    J = approx_fprime(np.zeros(15), seen, 1e-6)
    return np.asarray(J.T @ J / NOISE**2)


def run(folder: Path) -> None:
    """Print a line for each standard deviation of the intrinsics."""
    robot = uq.read_stream(folder / "robot.csv", "robot")
    place = {int(time): k for k, time in enumerate(robot.timestamps)}
    truth = [np.asarray(read_pose_file(folder / f"truth_{k}.csv")[1])[0] for k in range(1, 5)]
    corners = [pd.read_csv(folder / f"corners_{k}.csv") for k in range(1, 5)]
    first = uq.read_stream(folder / "camera_1.csv", "camera")
    W = np.linalg.inv(robot.poses[place[int(first.timestamps[0])]]) @ truth[0] @ first.poses[0]
    H = np.zeros((42, 42))
    for k, (X, seen) in enumerate(zip(truth, corners, strict=True)):
        points = seen[["x", "y", "z"]].to_numpy()[: len(seen) // seen["row"].nunique()]
        G = robot.poses[[place[row] for row in seen["row"].unique()]]
        numbers = np.r_[6 * k : 6 * k + 6, 24:30, 30 + 3 * k : 33 + 3 * k]
        H[np.ix_(numbers, numbers)] += information(G, X, W, points)
    for sd in (0.0, 1e-4, 2e-4, 5e-4, 1e-3, np.inf):
        free = H[:30, :30] if sd == 0 else H + np.diag(np.repeat([0.0, sd**-2], [30, 12]))
        C, squares = np.linalg.inv(free), []
        for i, j in combinations(range(4), 2):
            _, by_i, by_j = relative_pose(truth[i], truth[j])
            D = np.zeros((6, len(C)))
            D[:, 6 * i : 6 * i + 6], D[:, 6 * j : 6 * j + 6] = by_i, by_j
            squares.append(np.diag(D @ C @ D.T).reshape(2, 3).sum(axis=1))
        turn, shift = 1e3 * np.sqrt(np.mean(squares, axis=0))
        print(f"intrinsics known to {100 * sd:g} %: at best {turn:.3f} mrad {shift:.3f} mm")


if __name__ == "__main__":
    run(Path(os.environ["UQ_HANDEYE_DATA"]) / "metric_medium")
