"""The same numbers on every processor: calibrations by the kernels of OpenBLAS, each in a process of its own.

    python -m studies.performance.processors

prints, for each kernel against the first one, the largest difference of X in standard deviations, that of the standard
deviations relative to them, and the number of simulated rigs whose headline differs. Rigs of one camera have 15 to 60
poses, some with outliers and timestamps; the last ones have two cameras.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings

import numpy as np

import uq_handeye as uq

KERNELS = ("Haswell", "Sandybridge", "Nehalem", "Zen")  # which run on any x86-64 with AVX2
ONE_CAMERA, TWO_CAMERAS = 12, 6


def one_camera(seed: int) -> uq.Calibration:
    """Return the calibration of a simulated rig with one camera."""
    rng = np.random.default_rng(seed)
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
    n = (15, 20, 30, 60)[seed % 4]
    drawn = uq.simulate(n_poses=n, noise=noise, seed=seed, setup=("eye-in-hand", "eye-to-hand")[seed % 2])
    camera = drawn.camera.copy()
    if seed % 3 == 2:
        camera[rng.choice(n, 2, replace=False), :3, 3] += [0.05, -0.03, 0.1]
    times = np.linspace(0.25, 7.3 * n, n, dtype=np.float64) if seed % 3 == 0 else None
    return uq.calibrate(uq.PosePairs(drawn.robot, camera, drawn.setup, times))


def two_cameras(seed: int) -> uq.RigCalibration:
    """Return the calibration of a simulated rig with two cameras."""
    noise = {"left": ("1mrad", "0.5mm"), "right": ("1mrad", "0.5mm"), "arm": ("0.3mrad", "0.2mm")}
    rig, _ = uq.simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=15, seed=seed, noise=noise)
    found = uq.calibrate(rig)
    assert isinstance(found, uq.RigCalibration)
    return found


def numbers() -> list[tuple[list[float], list[float], str]]:
    """Return X (or all poses), standard deviations and the headline of each rig."""
    found = []
    for seed in range(ONE_CAMERA):
        one = one_camera(seed)
        assert one.std is not None
        found.append((one.X[:3].ravel().tolist(), one.std.tolist(), one.headline))
    for seed in range(TWO_CAMERAS):
        rig = two_cameras(seed)
        sd = np.sqrt(np.diag(rig.covariance))
        found.append((rig.poses[:, :3].ravel().tolist(), sd.tolist(), rig.text()))
    return found


def by_kernel(kernel: str) -> list[tuple[list[float], list[float], str]]:
    """Return `numbers` of a process with that kernel."""
    environment = os.environ | {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "studies.performance.processors", "--numbers"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True)
    found: list[tuple[list[float], list[float], str]] = json.loads(done.stdout)
    return found


def main() -> None:
    """Print the largest differences of each kernel from the first one."""
    first, *others = map(by_kernel, KERNELS)
    print(f"{'':<12} {'X (sd)':>10} {'sd':>10}  other headlines of {len(first)}, compared with {KERNELS[0]}")
    for kernel, other in zip(KERNELS[1:], others, strict=True):
        rows = []
        for (X, sd, headline), (Y, again, same) in zip(first, other, strict=True):
            off = np.abs(np.subtract(X, Y)).max() / min(sd)
            rows.append((off, np.abs(np.subtract(again, sd) / sd).max(), same != headline))
        move, change, differ = np.array(rows, dtype=float).T
        print(f"{kernel:<12} {move.max():>10.1e} {change.max():>10.1e}  {int(differ.sum())}")
        if "--each" in sys.argv:
            for k, row in enumerate(rows):
                print("  ", k, *(f"{value:.1e}" for value in row))


if __name__ == "__main__":
    if "--numbers" in sys.argv:
        warnings.simplefilter("ignore")
        print(json.dumps(numbers()))
    else:
        main()
