"""Checks of rigs whose arm nobody knows: p-values where nothing changed, detectable shifts, a shift of X of 2 mm.

    python -m studies.maintenance.unknown_arms [--sets 20]

Sets of `studies.one_model.rigs`, local poses, in random order: 30 are calibrated with default settings, 8 checked. The
shift of X moves the camera in a random direction before the 8 are taken.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence

import numpy as np
from scipy.stats import kstest

import uq_handeye as uq
from studies.one_model.rigs import arm_set

ACCURACIES = (0.0, 0.15, 0.6)  # mm; 0: an arm that only repeats
ARMS = ("ur5", "irb120", "panda")
CALIBRATED, CHECKED, SHIFT = 30, 8, 2e-3


def row(accuracy: float, sets: int) -> str:
    """Return one row of the Markdown table."""
    p, detectable, found, named = [], [], [], []
    for k in range(sets):
        rng = np.random.default_rng([30, int(1e3 * accuracy), k])
        drawn = arm_set(ARMS[k % len(ARMS)], 1e-3 * accuracy, rng, n=CALIBRATED + CHECKED)
        order = rng.permutation(CALIBRATED + CHECKED)
        result = uq.calibrate(drawn.poses.rows(order[:CALIBRATED]))
        new = drawn.poses.rows(order[CALIBRATED:])
        same = uq.check(result, new)
        p.append(same.p_value)
        detectable.append(1e3 * same.detectable.X_translation)
        direction = rng.standard_normal(3)
        camera = np.array(new.camera)  # inv(X') inv(G) W with t' = t + d: moved by -R_X^T d in the camera frame
        camera[:, :3, 3] -= result.X[:3, :3].T @ (SHIFT * direction / np.linalg.norm(direction))
        moved = uq.check(result, uq.PosePairs(new.robot, camera, new.setup))
        found.append(moved.changed)
        named.append(moved.cause == "X")
    values = np.array(p)
    return (
        f"| {accuracy:g} | {sets} | {values.mean():.2f} | {np.mean(values < 0.05):.2f} | "
        f"{kstest(values, 'uniform').pvalue:.2g} | {np.median(detectable):.2f}, {np.max(detectable):.2f} | "
        f"{np.mean(found):.2f} | {np.mean(named):.2f} |"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=20)
    sets = parser.parse_args(arguments).sets
    print("| arm mm | sets | mean p | p < 0.05 | KS p | detectable mm: median, max | 2 mm found | named X |")
    print("|---|---|---|---|---|---|---|---|")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for accuracy in ACCURACIES:
            print(row(accuracy, sets), flush=True)


if __name__ == "__main__":
    main()
