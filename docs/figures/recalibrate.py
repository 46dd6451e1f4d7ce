"""Number of poses that a check needs until a shift of the camera shows: the table of docs/how-to/recalibrate.md.

Run: python docs/figures/recalibrate.py

A calibration of 30 poses, noise estimated, camera noise 0.5 mm and 0.1 deg, robot noise 0.05 mm and 0.02 deg. For each
number of new poses: the shift that shows with 95 % probability as `check` states it (median of the sets), how often
checks of an unchanged rig alarm at the level of 5 %, and how often a shift of 1 and 2 mm is found.
"""

import warnings

import numpy as np

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETS = 40


def main() -> None:
    """Print the rows of the table."""
    warnings.simplefilter("ignore")
    result = uq.calibrate(uq.simulate(30, noise=NOISE, seed=1))
    X = uq.simulate(3, seed=0).truth.X
    rng = np.random.default_rng(5)
    for n in (1, 3, 5, 10, 20):
        shown, alarms, found = [], 0, {1e-3: 0, 2e-3: 0}
        for _ in range(SETS):
            plain = uq.check(result, uq.simulate(n, noise=NOISE, seed=rng))
            shown.append(plain.move("X").least_shift)
            alarms += plain.p_value < 0.05
            for shift in found:
                way = rng.normal(size=3)
                delta = np.r_[np.zeros(3), shift * way / np.linalg.norm(way)]
                moved = uq.simulate(n, noise=NOISE, X=perturb(X, delta), seed=rng)
                found[shift] += uq.check(result, moved).p_value < 0.05
        rates = " | ".join(f"{100 * count / SETS:.0f} %" for count in (alarms, *found.values()))
        print(f"| {n} | {1e3 * np.median(shown):.1f} | {rates} |", flush=True)


if __name__ == "__main__":
    main()
