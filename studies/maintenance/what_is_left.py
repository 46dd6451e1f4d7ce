r"""Errors that a population of arms leaves unexplained at new poses, against those of arms: `population.LEFT_BESIDE`.

    python -m studies.maintenance.what_is_left [--sets 70] [--leave-out]

Sets of `studies.one_model.rigs` as in `unknown_arms`, the errors of the robot poses alone, without noise: those of 30
poses are told exactly by the columns of the population bound to them (``e = K z`` with z ~ N(0, I), base and flange
free), and what they predict of 8 others is off by d. The population says ``Cov d = left`` (`BoundPopulation`), the mean
over its arms. Per arm: the mean of ``d^T left^-1 d / 6`` and the RMS of the translations of d and of ``left`` (mm), all
for the size of the errors that the 30 poses show (``|z|^2 / m`` times that of the data sheet).
"""

from __future__ import annotations

import argparse

import numpy as np

from studies.one_model.chains import ARMS, chain
from studies.one_model.rigs import SETUPS, arm_set
from uq_handeye.core.geometry.se3 import difference
from uq_handeye.model.kinematics.workspace_gauge import twists
from uq_handeye.model.shared_errors import population

ACCURACY, CALIBRATED, NEW = 0.6e-3, 30, 8
EXACT = np.repeat([1e-6, 2e-7], 3)  # rad, m: noise beside which the errors are told
FREE = 10.0  # deviations of base and flange, in those of the population
POPULATION = population.ARMS


def left_of(number: int, leave_out: bool = False) -> tuple[float, float, float, float]:
    """Return ``d^T left^-1 d / 6``, RMS translations of d and of left (mm), and ``|z|^2 / m`` of one set."""
    arm = ARMS[number % len(ARMS)]
    rng = np.random.default_rng([31, number])
    kept = tuple(name for name in POPULATION if not leave_out or not name.startswith(arm))
    sets = arm_set(arm, ACCURACY, rng, n=CALIBRATED + NEW, setup=SETUPS[number // len(ARMS) % 2], repeatable=False)
    assert sets.joints is not None and sets.true_arm is not None
    nominal = chain(arm).poses(sets.joints)
    e = difference(sets.true_arm.poses(sets.joints), nominal)
    order = rng.permutation(CALIBRATED + NEW)
    told, new = order[:CALIBRATED], order[CALIBRATED:]
    of = population.BoundPopulation.of(nominal[told], arms=kept)

    def columns(robot: np.ndarray) -> np.ndarray:
        return np.concatenate([ACCURACY * of.columns(robot)[..., :-12], FREE * twists(robot)], axis=-1)

    A = (columns(nominal[told]) / EXACT[:, None]).reshape(6 * CALIBRATED, -1)
    z = np.linalg.solve(A.T @ A + np.eye(A.shape[1]), A.T @ (e[told] / EXACT).ravel())
    d = e[new] - columns(nominal[new]) @ z
    size = float(np.mean(z[:-12] ** 2))
    left = size * ACCURACY**2 * of.left_at(nominal[new])
    square = np.einsum("ni,nij,nj->n", d, np.linalg.inv(left + 1e-16 * np.eye(6)), d) / 6
    off, all_left = ((d[:, 3:] ** 2).sum(axis=1).mean(), np.trace(left.mean(axis=0)[3:, 3:]))
    return float(square.mean()), 1e3 * float(np.sqrt(off)), 1e3 * float(np.sqrt(all_left)), size


def main() -> None:
    """Print a row for each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=70)
    parser.add_argument("--leave-out", action="store_true", help="the family of the arm is not in the population")
    options = parser.parse_args()
    found = np.array([left_of(number, options.leave_out) for number in range(options.sets)])
    print("| arm | d^2 / 6 | d, mm | left, mm | share of variance | size^2 |\n|---|---|---|---|---|---|")
    for k, name in enumerate((*ARMS, "all")):
        of = found if name == "all" else found[k :: len(ARMS)]
        rms = np.sqrt((of[:, 1:3] ** 2).mean(axis=0))
        numbers = f"{np.median(of[:, 0]):.2f} | {rms[0]:.3f} | {rms[1]:.3f} | {(rms[0] / rms[1]) ** 2:.2f}"
        print(f"| {name} | {numbers} | {of[:, 3].mean():.1f} |")


if __name__ == "__main__":
    main()
