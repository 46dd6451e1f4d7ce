"""Print the table of docs/how-to/few_poses.md: what 5, 8, 12, 20 and 30 poses are worth.

    python docs/figures/few_poses.py [SETS]

Simulated sets with noise of 0.02 deg and 0.05 mm (robot), 0.05 deg and 0.3 mm (camera), which `calibrate` estimates.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

import uq_handeye as uq

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.05deg", "0.3mm"))


def main(sets: int) -> None:
    """Print a row for each number of poses."""
    warnings.simplefilter("ignore", uq.InputWarning)
    print("| poses | error, RMS (mm) | stated, median (mm) | inside the 95 % interval | no X |\n|---|---|---|---|---|")
    for n in (5, 8, 12, 20, 30):
        errors, stated, inside, none = [], [], [], 0
        for seed in range(sets):
            poses = uq.simulate(n, noise=NOISE, seed=seed)
            try:
                result = uq.calibrate(uq.PosePairs(poses.robot, poses.camera))
            except (uq.InputError, uq.NotConvergedError):
                none += 1
                continue
            if not result.usable or result.accuracy is None:
                none += 1
                continue
            error = float(np.linalg.norm(result.X[:3, 3] - poses.truth.X[:3, 3]))
            errors.append(1e3 * error)
            stated.append(1e3 * result.accuracy.translation)
            interval = (
                result.accuracy.translation_95 / result.accuracy.translation * np.sqrt(np.diag(result.covariance)[3:])
            )
            inside.append(np.mean(np.abs(result.X[:3, 3] - poses.truth.X[:3, 3]) < interval))
        rms = float(np.sqrt(np.mean(np.square(errors))))
        print(
            f"| {n} | {rms:.2f} | {np.median(stated):.2f} | {100 * np.mean(inside):.0f} % | {none} of {sets} |",
            flush=True,
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
