"""Time and memory of `uq-handeye calibrate` as the data grow, and the size of the result file.

    python -m studies.performance.growth [--full]

Simulated poses: one camera with 1,000 and 10,000 poses (``--full``: 100,000), without timestamps, with them, and with
the noise given; eight cameras on one hand with 1,000 robot poses. Each command is a process of its own, with one thread
in BLAS. Seconds are those of the CPU, memory is the largest resident set. The file is that of ``-o DIR``, up to 10,000
poses. Prints a Markdown table.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import Array, inverse

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
GIVEN = ("--robot-noise", "0.02deg,0.05mm", "--camera-noise", "0.1deg,0.5mm")
COUNTS, MOST, CAMERAS, POSES_OF_RIG = (1_000, 10_000), 100_000, 8, 1_000


def beside(poses: uq.PosePairs, k: int, seed: int) -> Array:
    """Camera poses (n, 4, 4) of another camera on the same hand, 100 mm further, with noise of its own."""
    drawn = uq.simulate(n_poses=poses.n, noise=NOISE, seed=seed)
    assert poses.truth is not None and drawn.truth is not None  # simulated poses carry it
    moved = np.eye(4)
    moved[0, 3] = 0.1 * k  # m
    return np.asarray(inverse(moved) @ poses.truth.camera @ inverse(drawn.truth.camera) @ drawn.camera)


def written(folder: Path, name: str, poses: Array, timed: bool) -> str:
    """Write a pose file, with seconds or with names of the rows, and return its name."""
    times = 0.5 * np.arange(len(poses)) + 0.25
    uq.write_pose_file(folder / name, poses, times)
    if not timed:
        head, *rows = (folder / name).read_text().splitlines()
        plain = [head.partition(",")[2], *(row.partition(",")[2] for row in rows)]
        (folder / name).write_text("\n".join(plain) + "\n")
    return name


def measured(folder: Path, arguments: Sequence[str]) -> tuple[float, float]:
    """Seconds of CPU and megabytes of a command."""
    command = [sys.executable, "-m", "uq_handeye", "calibrate", *arguments]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    child = os.fork()
    if not child:
        os.chdir(folder)
        for stream in (1, 2):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
        os.execvpe(command[0], command, environment)
    _, status, usage = os.wait4(child, 0)
    if code := os.waitstatus_to_exitcode(status):
        raise SystemExit(f"{' '.join(command)} ended with exit status {code}.")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1e3


def row(name: str, folder: Path, arguments: Sequence[str], with_file: bool) -> None:
    """Print one row."""
    seconds, memory = measured(folder, arguments)
    size = ""
    if with_file:
        measured(folder, [*arguments, "-o", "out"])
        size = f"{max(one.stat().st_size for one in (folder / 'out').glob('*.json')) / 1e6:.1f} MB"
    print(f"| {name} | {seconds:.1f} s | {memory:.0f} MB | {size} |", flush=True)


def main() -> None:
    """Print the table."""
    print("| data | CPU | memory | result file |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for n in (*COUNTS, MOST) if "--full" in sys.argv else COUNTS:
            poses = uq.simulate(n_poses=n, noise=NOISE, seed=1)
            for timed, given in ((False, ()), (True, ()), (True, GIVEN)):
                folder = root / f"{n}_{timed}_{len(given)}"
                folder.mkdir()
                both = [written(folder, f"{side}.csv", getattr(poses, side), timed) for side in ("robot", "camera")]
                words = f"{'with' if timed else 'without'} timestamps, noise {'given' if given else 'estimated'}"
                row(f"one camera, {n:,} poses {words}", folder, [*both, *given], n < MOST)
        poses = uq.simulate(n_poses=POSES_OF_RIG, noise=NOISE, seed=1)
        arguments = [written(root, "robot.csv", poses.robot, True)]
        for k in range(CAMERAS):
            camera = written(root, f"camera{k}.csv", beside(poses, k, 1 + k), True)
            arguments += ["--camera", f"c{k}={camera}"]
        row(f"{CAMERAS} cameras, {POSES_OF_RIG:,} robot poses", root, arguments, True)


if __name__ == "__main__":
    main()
