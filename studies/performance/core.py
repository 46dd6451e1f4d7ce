"""Time of `solve`, `propagate` and `calibrate` against goals and reference points of the same run.

    python -m studies.performance.core

Goals (milliseconds) were set on a machine on which OpenCV's calibrateHandEye (Tsai) took 1.6 ms at 30 poses; where
OpenCV is installed (extra `bench`), they are scaled by its time here. One thread in BLAS; medians.
"""

from __future__ import annotations

import importlib
import os

for variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import statistics  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import threading  # noqa: E402
import timeit  # noqa: E402
import warnings  # noqa: E402
from collections.abc import Callable  # noqa: E402
from functools import partial  # noqa: E402
from typing import Any  # noqa: E402

import numpy as np  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

import uq_handeye as uq  # noqa: E402
from uq_handeye.methods.all_pairs import AllPairs  # noqa: E402

OPENCV_AT_30 = 1.6  # ms, on the machine of the goals


def median_ms(function: Callable[[], object], seconds: float = 0.4) -> float:
    """Median over at least five repeats of a loop that takes some milliseconds."""
    function()
    once = timeit.timeit(function, number=1)
    number = max(1, int(0.01 / max(once, 1e-7)))
    repeats = min(200, max(5, int(seconds / max(once * number, 1e-7))))
    return 1e3 * statistics.median(timeit.repeat(function, number=number, repeat=repeats)) / number


def random_motions(N: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """N noise-free pairs with random rotations and translations of about a metre."""
    B = np.zeros((N + 1, 4, 4))
    B[:, :3, :3] = Rotation.random(N + 1, rng=rng).as_matrix()
    B[:, :3, 3] = rng.normal(size=(N + 1, 3))
    B[:, 3, 3] = 1.0
    X = B[-1]
    return X @ B[:-1] @ np.linalg.inv(X), B[:-1]


def opencv_ms(rng: np.random.Generator) -> float | None:
    try:
        cv2: Any = importlib.import_module("cv2")  # by its name, because the stubs of OpenCV 4 and 5 differ
        solve = cv2.calibrateHandEye
    except (ImportError, AttributeError):  # OpenCV 5.0 has it not
        return None
    G, C = random_motions(30, rng)
    R_G, t_G, R_C, t_C = G[:, :3, :3], G[:, :3, 3], C[:, :3, :3], C[:, :3, 3]
    return median_ms(lambda: solve(R_G, t_G, R_C, t_C, method=cv2.CALIB_HAND_EYE_TSAI))


def import_ratio(runs: int = 15) -> float:
    """Median of (NumPy + scipy.spatial.transform + uq_handeye) / (NumPy + scipy.spatial.transform), whole imports."""
    program = (
        "import time; a = time.perf_counter(); import numpy, scipy.spatial.transform; b = time.perf_counter();"
        "import uq_handeye; c = time.perf_counter(); print((c - a) / (b - a))"
    )
    command = [sys.executable, "-c", program]
    return statistics.median(
        float(subprocess.run(command, capture_output=True, check=True, text=True).stdout) for _ in range(runs)
    )


def peak_extra_mb(function: Callable[[], object]) -> float:
    """Growth of the resident memory while ``function`` runs, sampled every millisecond (Linux only)."""

    def resident() -> float:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    start = peak = resident()
    done = threading.Event()

    def watch() -> None:
        nonlocal peak
        while not done.wait(0.001):
            peak = max(peak, resident())

    watcher = threading.Thread(target=watch)
    watcher.start()
    function()
    done.set()
    watcher.join()
    return peak - start


def calibrated(poses: uq.PosePairs, options: dict[str, Any]) -> uq.Calibration:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(poses, **options)


def main() -> None:
    rng = np.random.default_rng(0)
    covariance = np.diag([1e-6] * 3 + [1e-7] * 3) + 1e-8
    noise = uq.PairNoise(A=covariance, B=covariance)
    rows: list[tuple[str, float, float, str]] = []

    opencv = opencv_ms(rng)
    machine = 1.0 if opencv is None else opencv / OPENCV_AT_30

    for N, goal in ((30, 0.06),):
        A, B = random_motions(N, rng)
        reference = "" if opencv is None else "OpenCV Tsai, 30 poses"
        rows.append((f"solve, N = {N}", median_ms(partial(uq.solve, A, B)), goal * machine, reference))
    for N, goal in ((60, 0.25), (1000, 1.2), (10_000, float("nan")), (100_000, float("nan"))):
        A, B = random_motions(N, rng)

        def both(A: np.ndarray = A, B: np.ndarray = B) -> None:
            uq.propagate(A, B, noise, X=uq.solve(A, B))

        rows.append((f"solve + propagate, N = {N}", median_ms(both), goal * machine, ""))
    motions = uq.Motions(*random_motions(60, rng))
    by_4dpa = median_ms(lambda: uq.calibrate(motions, noise=noise, method="4dpa"))
    rows.append(("calibrate by 4dpa, N = 60 motions", by_4dpa, machine, ""))
    poses_noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    poses = uq.simulate(n_poses=61, noise=poses_noise, seed=0)
    rows.append(
        (
            "calibrate by 4dpa, 61 poses, consecutive",
            median_ms(lambda: uq.calibrate(poses, noise=poses_noise, method="4dpa", pairs="consecutive")),
            machine,
            "",
        )
    )
    many = uq.simulate(n_poses=500, noise=poses_noise, seed=0)
    for n, goal in ((60, 1.0), (600, float("nan")), (6000, float("nan"))):
        session = uq.simulate(n_poses=n, noise=poses_noise, seed=0)
        time = median_ms(partial(uq.efficient, session, poses_noise))
        rows.append((f"efficient with 12x12, {n} poses", time, goal * machine, "goal: GTSAM 8.3" if n == 60 else ""))
    session = uq.simulate(n_poses=60, noise=poses_noise, seed=0)
    cases: tuple[tuple[str, dict[str, Any]], ...] = (
        ("noise given", {"noise": poses_noise}),
        ("noise estimated, robust", {}),
    )
    for label, options in cases:
        time = median_ms(partial(calibrated, session, options))
        rows.append((f"calibrate, 60 poses, {label}", time, float("nan"), ""))
    rows.append(
        (
            "X and covariance of all 124,750 pairs, O(n)",
            median_ms(lambda: AllPairs(many).propagate(poses_noise, AllPairs(many).solve())),
            1000 * machine,
            "",
        )
    )
    motions = uq.relative_motions(uq.simulate(n_poses=500, noise=poses_noise, seed=0), "all")
    X = uq.solve(motions.A, motions.B)
    rows.append(
        (
            "pose-aware covariance, 124,750 pairs",
            median_ms(lambda: uq.propagate(motions, poses_noise, X=X)),
            1000 * machine,
            "",
        )
    )
    A, B = random_motions(1_000_000, rng)
    one_pass = median_ms(lambda: (A.sum(), B.sum()))
    rows.append(
        (
            "solve, 1,000,000 pairs",
            median_ms(lambda: uq.solve(A, B)),
            3 * one_pass,
            "three passes A.sum(), B.sum()",
        )
    )
    memory = peak_extra_mb(lambda: uq.solve(A, B))
    trials = (A[:600_000].reshape(10_000, 60, 4, 4), B[:600_000].reshape(10_000, 60, 4, 4))
    rows.append(("solve, 10,000 trials of N = 60", median_ms(lambda: uq.solve(*trials)), 150 * machine, ""))

    opencv_text = "not installed" if opencv is None else f"{opencv:.3f} ms"
    print(f"OpenCV Tsai, 30 poses: {opencv_text}; goals scaled by {machine:.2f}; NumPy {np.__version__}\n")
    print(f"{'work':42s} {'ms':>10s} {'goal':>10s} {'ratio':>7s}")
    for name, value, goal, note in rows:
        print(f"{name:42s} {value:10.3f} {goal:10.3f} {value / goal:7.2f}  {note}")
    print(f"\nextra memory, solve of 1,000,000 pairs: {memory:.1f} MB (goal 50)")
    print(f"import uq_handeye / import numpy, scipy.spatial.transform: {import_ratio():.2f} (goal 1.3)")


if __name__ == "__main__":
    main()
