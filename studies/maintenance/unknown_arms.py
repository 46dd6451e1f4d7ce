"""Checks of rigs whose arm nobody knows: p-values and power where nothing or little changed, and a shift of X of 2 mm.

    python -m studies.maintenance.unknown_arms [--draws 2000] [--leave-out] [--left 0.35] [--keep FILE.npz]

Sets of `studies.one_model.rigs`, local poses, in random order: 30 are calibrated with default settings (noise and sizes
of all errors estimated), 8 checked. Draws go round the arms, the accuracies and both setups.

- *p-values* of the 8 as they are: uniform if the check is right, 5 % of them below 0.05.
- *Power*: a shift of X in a random direction, as large as the theory finds with 30, 60 and 90 % probability
  (`NewRows`), moves the residuals; the share that is found.
- *2 mm*: every `MOVED`-th draw, the camera moves in a random direction before the 8 are taken; found, cause named.

``--leave-out``: the geometry of the arm is not in the population. ``--left``: another `population.LEFT_BESIDE`.
With ``--keep`` draws are added to those of a file, so that the study can run in pieces; ``--draws 0`` with several
files prints the table of all.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.stats import kstest

import uq_handeye as uq
from studies.one_model.chains import ARMS
from studies.one_model.rigs import SETUPS, arm_set
from uq_handeye.calibration.evidence.new_poses import evidence_of_poses
from uq_handeye.model.shared_errors import population

ACCURACIES = (0.0, 0.15, 0.6)  # mm; 0: an arm that only repeats
CALIBRATED, CHECKED, SHIFT = 30, 8, 2e-3
POWERS = (0.3, 0.6, 0.9)
MOVED = 4
POPULATION = population.ARMS


def drawn(number: int, leave_out: bool = False) -> np.ndarray:
    """Return accuracy (mm), setup, arm, p, what of `POWERS` is found, detectable (mm); 2 mm found, named (or nan)."""
    accuracy = ACCURACIES[number % len(ACCURACIES)]
    setup = number // len(ACCURACIES) % len(SETUPS)
    arm = number // (len(ACCURACIES) * len(SETUPS)) % len(ARMS)
    rng = np.random.default_rng([30, number])
    population.ARMS = tuple(name for name in POPULATION if not leave_out or not name.startswith(ARMS[arm]))
    sets = arm_set(ARMS[arm], 1e-3 * accuracy, rng, n=CALIBRATED + CHECKED, setup=SETUPS[setup])
    order = rng.permutation(CALIBRATED + CHECKED)
    result = uq.calibrate(sets.poses.rows(order[:CALIBRATED]))
    new = sets.poses.rows(order[CALIBRATED:])
    evidence = evidence_of_poses(result, new)
    reference = evidence.test.reference
    columns = evidence.whitened(evidence.linear.J[..., :6])
    direction = columns @ rng.standard_normal(6)
    direction /= np.linalg.norm(direction)
    sizes = [np.sqrt(reference.noncentrality(power, 0.05)) for power in POWERS]
    shown = [reference.p_value(float(np.sum((evidence.white + size * direction) ** 2))) < 0.05 for size in sizes]
    more = [np.nan, np.nan, np.nan]
    if number // (len(ACCURACIES) * len(SETUPS)) % MOVED == 0:
        along = rng.standard_normal(3)
        camera = np.array(new.camera)  # inv(X') inv(G) W with t' = t + d: moved by -R_X^T d in the camera frame
        camera[:, :3, 3] -= result.X[:3, :3].T @ (SHIFT * along / np.linalg.norm(along))
        moved = uq.check(result, uq.PosePairs(new.robot, camera, new.setup))
        more = [1e3 * moved.move("X").least_shift, moved.changed, moved.cause == "X"]
    return np.array([accuracy, setup, arm, evidence.test.p_value, *shown, *more], dtype=float)


def row(found: np.ndarray) -> str:
    """Return the columns of the Markdown table of draws."""
    p, moved = found[:, 3], found[~np.isnan(found[:, 7]), 7:]
    powers = ", ".join(f"{100 * share:.0f}" for share in found[:, 4:7].mean(axis=0))
    return (
        f"{len(p)} | {p.mean():.2f} | {100 * np.mean(p < 0.05):.1f} | {kstest(p, 'uniform').statistic:.3f} | {powers} "
        f"| {np.median(moved[:, 0]):.2f}, {moved[:, 0].max():.2f} | {100 * moved[:, 1].mean():.0f} "
        f"| {100 * moved[:, 2].mean():.0f} |"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=120)
    parser.add_argument("--leave-out", action="store_true", help="the geometry of the arm is not in the population")
    parser.add_argument("--left", type=float, help="share of what the population leaves of new poses that counts")
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--keep", type=Path, nargs="+", help="files of draws so far; to the first these are added")
    options = parser.parse_args(arguments)
    if options.left is not None:
        population.LEFT_BESIDE = options.left
    files = [path for path in options.keep or () if path.exists()]
    kept = [np.load(path)["draws"] for path in files]
    first = options.first + (len(kept[0]) if files and files[0] == options.keep[0] else 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        new = [drawn(number, options.leave_out) for number in range(first, first + options.draws)]
    if options.keep is not None and new:
        before = kept[:1] if files and files[0] == options.keep[0] else []
        np.savez(options.keep[0], draws=np.concatenate([*before, new]))
    found = np.concatenate([*kept, np.reshape(new, (-1, 10))])
    print("| arm mm | setup or arm | draws | mean p | p < 0.05, % | KS distance | found at 30, 60, 90 % | "
          "detectable mm: median, max | 2 mm found, % | named X, % |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|---|---|")
    cells = [(f"{accuracy:g} | {setup}", (found[:, 0] == accuracy) & (found[:, 1] == k))
             for accuracy in ACCURACIES for k, setup in enumerate(SETUPS)]  # fmt: skip
    cells += [(f"all | {name}", found[:, 2] == k) for k, name in enumerate(ARMS)]
    for words, rows in cells:
        if not np.isnan(found[rows, 7]).all():
            print(f"| {words} | {row(found[rows])}")
    print(f"| all | | {row(found)}")


if __name__ == "__main__":
    main()
