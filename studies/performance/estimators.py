"""Time of every method, against OpenCV on the same poses and against the goals for Nguyen and Pham's method.

    python -m studies.performance.estimators

One thread in BLAS; medians; ratios are of one run. OpenCV forms all pairs of n poses itself, so that its time is
compared with forming all pairs and solving. Needs OpenCV 4 (extra `bench`).
"""

from __future__ import annotations

import importlib
import time
from functools import partial
from typing import Any

from studies.performance.core import (  # before NumPy: it sets one thread  # isort: skip
    OPENCV_AT_30,
    median_ms,
    opencv_ms,
    random_motions,
)

import numpy as np  # isort: skip

import uq_handeye as uq  # isort: skip
from studies.common.study import version_of  # isort: skip

HAND_EYE = ("tsai", "park", "horaud", "andreff", "daniilidis")
ROBOT_WORLD = ("shah", "li")
NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def against_opencv(n: int) -> None:
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=0)
    G, C = poses.robot, poses.camera
    B = np.linalg.inv(G)
    cv2: Any = importlib.import_module("cv2")
    hand_eye = cv2.calibrateHandEye
    robot_world = cv2.calibrateRobotWorldHandEye
    for name in HAND_EYE:
        flag = getattr(cv2, f"CALIB_HAND_EYE_{name.upper()}")

        def theirs(flag: int = flag) -> None:
            hand_eye(G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3], method=flag)

        def ours(name: str = name) -> None:
            motions = uq.relative_motions(poses, "all")
            uq.solve(motions.A, motions.B, method=name)

        print_row(n, name, median_ms(theirs), median_ms(ours))
    for name in ROBOT_WORLD:
        flag = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name.upper()}")

        def theirs(flag: int = flag) -> None:
            robot_world(C[:, :3, :3], C[:, :3, 3], B[:, :3, :3], B[:, :3, 3], method=flag)

        print_row(n, name, median_ms(theirs), median_ms(partial(uq.ROBOT_WORLD_METHODS[name], poses)))


def print_row(n: int, name: str, theirs: float, ours: float) -> None:
    print(f"{n:5d}  {name:11s} {theirs:9.3f} {ours:9.3f} {theirs / ours:7.1f}", flush=True)


def main() -> None:
    rng = np.random.default_rng(0)
    opencv = opencv_ms(rng)
    machine = 1.0 if opencv is None else opencv / OPENCV_AT_30
    print(f"OpenCV {version_of('opencv-python-headless')}, NumPy {np.__version__}; goals scaled by {machine:.2f}\n")
    print("poses  method     OpenCV ms   ours ms   ratio")
    for n in (30, 60, 224, 500):
        against_opencv(n)

    print("\nmethod      solve, 60 pairs (ms)   solve + 6x6 (ms)")
    A, B = random_motions(60, rng)
    covariance = np.diag([1e-6] * 3 + [1e-7] * 3) + 1e-8
    noise = uq.PairNoise(covariance, covariance)
    a, b = (perturbed(T, covariance, rng) for T in (A, B))
    for name in uq.METHODS:
        solve = median_ms(partial(uq.solve, a, b, method=name))
        both = median_ms(partial(uq.propagate, a, b, noise, method=name))
        print(f"{name:11s} {solve:20.3f} {both:18.3f}", flush=True)

    nguyen = uq.METHODS["nguyen"]
    one = median_ms(lambda: nguyen.estimate(a, b, noise))
    print(f"\nnguyen, 60 pairs, X with Sigma_R and Sigma_t: {one:.3f} ms (goal {0.9 * machine:.3f})")
    many_A, many_B = (perturbed(np.broadcast_to(T, (10_000, *T.shape)), covariance, rng) for T in (A, B))
    start = time.perf_counter()
    estimate = nguyen.estimate(many_A, many_B, noise)
    seconds = time.perf_counter() - start
    print(f"nguyen, 10,000 trials of 60 pairs: {seconds:.2f} s (goal 20), {estimate.converged.mean():.2%} converged")


def perturbed(T: np.ndarray, covariance: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    from uq_handeye.core.geometry.se3 import perturb

    return perturb(T, rng.normal(size=(*T.shape[:-2], 6)) @ np.linalg.cholesky(covariance).T)


if __name__ == "__main__":
    main()
