"""Results of data that contradict an assumption: how many are usable although X is outside its 99.9 % region.

    python -m studies.one_model.usable [--sets 300] [--first 0]

Sets of 12 to 40 poses in both setups, of one kind in turn: noise given three times too small, a declared size of the
target that is wrong by 1 %, 40 to 70 % outliers, two sessions with another X in the second half, a few poses with a
wrong row. A set is *wrong* if the result is usable and the true X of the kept poses is outside the region that holds
99.9 % of all errors. Prints a Markdown table.
"""

from __future__ import annotations

import argparse
import warnings
from collections import Counter
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.one_model.moves import NOISE, moved_poses
from studies.one_model.rigs import SETUPS
from uq_handeye.core.geometry.se3 import difference

KINDS = ("noise too small", "wrong target size", "most rejected", "halves disagree", "wrong rows")
OUTSIDE = 0.999


def drawn(kind: str, k: int) -> tuple[uq.PosePairs, dict[str, Any], Any]:
    """Return poses, arguments of `calibrate`, and the true X."""
    rng = np.random.default_rng([31, k])
    n, setup = int(rng.integers(12, 41)), SETUPS[k // len(KINDS) % 2]
    poses = uq.simulate(n_poses=n, noise=NOISE, seed=[31, k], setup=setup)
    assert poses.truth is not None
    X, robot, camera = poses.truth.X, poses.robot, poses.camera.copy()
    options: dict[str, Any] = {}
    if kind == "noise too small":
        third = uq.PoseNoise.isotropic(robot=("0.0033deg", "0.01mm"), camera=("0.017deg", "0.1mm"))
        options = {"noise": third}
    elif kind == "wrong target size":
        camera[:, :3, 3] *= 1.01
        options = {"noise": NOISE, "shared": []}
    elif kind == "most rejected":
        bad = rng.permutation(n)[: int(n * rng.uniform(0.4, 0.7))]
        camera[bad, :3, 3] += rng.normal(size=(len(bad), 3)) * rng.uniform(3e-3, 0.1)
        turn = Rotation.from_rotvec(rng.normal(size=(len(bad), 3)) * rng.uniform(0.01, 0.3)).as_matrix()
        camera[bad, :3, :3] = turn @ camera[bad, :3, :3]
    elif kind == "halves disagree":
        part = ("camera", "target")[k // len(KINDS) // 2 % 2]
        size = float(np.exp(rng.uniform(np.log(1.0), np.log(10.0))))
        shares = (np.arange(n) >= n // 2).astype(float)
        camera = moved_poses(poses, part, 1e-3 * size, np.radians(0.1) * size, shares, k).camera
    else:
        bad = rng.permutation(n)[: max(2, n // 6)]
        camera[bad] = camera[np.roll(bad, 1)]
    return uq.PosePairs(robot, camera, setup), options, X


def answered(k: int) -> tuple[str, str]:
    """Return kind and answer of one set."""
    kind = KINDS[k % len(KINDS)]
    poses, options, X = drawn(kind, k)
    try:
        result = uq.calibrate(poses, **options)
    except (uq.InputError, uq.NotConvergedError):
        return kind, "refused"
    if not result.usable:
        return kind, "not usable"
    xi = difference(result.X, X)
    inside = result.covariance is not None and xi @ np.linalg.solve(result.covariance, xi) <= result.quantile(OUTSIDE)
    return kind, "usable, inside" if inside else "usable, outside"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    warnings.simplefilter("ignore", uq.InputWarning)
    found, counts = [], Counter[tuple[str, str]]()
    for k in range(options.first, options.first + options.sets):
        kind, answer = answered(k)
        counts[kind, answer] += 1
        if answer == "usable, outside":
            found.append(k)
    answers = ("refused", "not usable", "usable, inside", "usable, outside")
    print(f"| data | {' | '.join(answers)} |\n|{' --- |' * 5}")
    for kind in KINDS:
        print(f"| {kind} | {' | '.join(str(counts[kind, answer]) for answer in answers)} |")
    print(f"\nUsable and outside: {', '.join(map(str, found)) or 'none'}.")


if __name__ == "__main__":
    main()
