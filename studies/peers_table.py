"""OpenCV, GTSAM and uq-handeye on the same simulated poses: error, whether the covariance is true, time.

    python -m studies.peers_table [--trials 400]

Prints the measured table of README.md. 30 eye-in-hand poses of one geometry, noise of 0.02 deg and 0.05 mm of the robot
and 0.1 deg and 0.5 mm of the camera, drawn anew in each trial with a fixed seed. Error over bound: root mean square of
the six errors, each in units of its Cramer-Rao bound. NEES: mean of ``e^T Sigma^-1 e`` of the error e with the
covariance that the program gives itself; 6 if it is true. Time: median for one data set, one thread in BLAS; the time
of building GTSAM's graph, whose camera factor is a Python callback, is not counted. Needs OpenCV 4 and GTSAM (extra
`test`).
"""

from __future__ import annotations

from studies.performance.core import median_ms  # before NumPy: it sets one thread  # isort: skip

import argparse
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.stats import chi2

import uq_handeye as uq
from studies.against_gtsam import by_gtsam
from studies.efficiency import disturbed, errors, nees
from uq_handeye.all_pairs import solve_all_pairs
from uq_handeye.robot_world import mean_target

SEED = 2019
POSES = 30
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
Found = tuple[np.ndarray, np.ndarray | None]


def opencv(method: int) -> Callable[[uq.PosePairs], Found]:
    def solve(poses: uq.PosePairs) -> Found:
        G, C = poses.robot, poses.camera
        R, t = cv2.calibrateHandEye(G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=method)
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = R, t[:, 0]
        return X, None

    return solve


def gtsam(tests: Any) -> Callable[[uq.PosePairs], Found]:
    def solve(poses: uq.PosePairs) -> Found:
        X = solve_all_pairs(poses)
        X, _, covariance, _ = tests.by_gtsam(poses, NOISE, X, mean_target(poses, X))
        return X, covariance

    return solve


def toolkit(poses: uq.PosePairs) -> Found:
    found = uq.efficient(poses, NOISE)
    return found.X, found.covariance_X


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=400)
    trials = parser.parse_args().trials
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    tests = importlib.import_module("test_against_gtsam")
    exact = uq.simulate(POSES, seed=SEED)
    assert exact.truth is not None
    sd = np.sqrt(np.diag(uq.bound(exact, noise=NOISE)))
    rng = np.random.default_rng(SEED)
    G, C = (disturbed(rng, T, S, trials) for T, S in ((exact.robot, NOISE.robot), (exact.camera, NOISE.camera)))
    draws = [uq.PosePairs(robot, camera) for robot, camera in zip(G, C, strict=True)]
    rows: dict[str, tuple[Callable[[uq.PosePairs], Found], Callable[[], object]]] = {}
    for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"):
        solve = opencv(getattr(cv2, f"CALIB_HAND_EYE_{name}"))
        rows[f"OpenCV, {name.title()}"] = solve, lambda solve=solve: solve(draws[0])
    rows["GTSAM, latent poses"] = gtsam(tests), by_gtsam(tests, draws[0], NOISE)
    rows["uq-handeye, `efficient`"] = toolkit, lambda: toolkit(draws[0])
    low, high = chi2.ppf([0.0005, 0.9995], 6 * trials) / trials
    print(f"{trials} trials; 99.9 % of mean NEES of a true covariance lie between {low:.2f} and {high:.2f}\n")
    print("| program | error over bound | NEES | ms |\n|---|---|---|---|")
    for label, (solve, timed) in rows.items():
        found = [solve(poses) for poses in draws]
        e = errors(np.array([X for X, _ in found]), exact.truth.X)
        covariances = [S for _, S in found if S is not None]
        consistency = f"{nees(e, np.array(covariances)).mean():.2f}" if covariances else "no covariance"
        print(
            f"| {label} | {np.sqrt(np.mean((e / sd) ** 2)):.2f} | {consistency} | {median_ms(timed):.2f} |", flush=True
        )


if __name__ == "__main__":
    main()
