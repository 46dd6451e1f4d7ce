"""Look after every pose and stop at the first PASS: how often does X lie within the tolerance then?

Run:  python docs/figures/stopping.py [SESSIONS]

Sessions of up to 30 poses are simulated. After each pose, from the third on, X is estimated; the session stops once the
probability of the tolerance reaches 95 %. Printed is the share of stopped sessions whose true error lies within the
tolerance, beside the mean probability that was stated at the stop. A loose tolerance stops after few poses, a tight one
after many. Noise given: SESSIONS of each; noise estimated: an eighth of them.
"""

import sys
import warnings

import numpy as np

import uq_handeye as uq
from uq_handeye.calibration.tolerance import Tolerance, probability_within
from uq_handeye.core.geometry.se3 import logarithm
from uq_handeye.core.levels import INTERVAL
from uq_handeye.errors import InputError, NotConvergedError
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.fit.graph.reference import Reference

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
LOOSE, TIGHT = Tolerance.read("3mm,0.4deg"), Tolerance.read("1.2mm,0.15deg")
MOST = 30


def within(X, truth, tolerance):
    turn = np.linalg.norm(logarithm(X[:3, :3] @ truth[:3, :3].T))
    return bool(turn <= tolerance.rotation and np.linalg.norm(X[:3, 3] - truth[:3, 3]) <= tolerance.translation)


def given(poses, tolerance):
    """Return X and the probability of the tolerance with the noise given."""
    fit = efficient(poses, NOISE)
    return fit.X, probability_within(fit.covariance_X, Reference(), tolerance, fit.X[:3, :3])


def estimated(poses, tolerance):
    """Return the same with the noise estimated, by everything that `calibrate` asks before it says PASS."""
    result = uq.calibrate(poses, shared=[uq.SharedError.target_scale(1e-6)])
    verdict = result.verdict(tolerance)
    return result.X, verdict.probability if verdict.passed else 0.0


def session(look, tolerance, seed):
    """Return the poses at the stop, the stated probability and whether X is within; None: no stop."""
    poses = uq.simulate(n_poses=MOST, noise=NOISE, seed=seed)
    for k in range(3, MOST + 1):
        try:
            X, p = look(poses.rows(np.arange(k)), tolerance)
        except (InputError, NotConvergedError):
            continue
        if p >= INTERVAL.probability:
            return k, p, within(X, poses.truth.X, tolerance)
    return None


def main(count):
    warnings.simplefilter("ignore")
    for name, look, sessions in (("given", given, count), ("estimated", estimated, count // 8)):
        for tolerance in (LOOSE, TIGHT):
            found = [one for seed in range(sessions) if (one := session(look, tolerance, seed)) is not None]
            stops, stated, good = (np.array(part) for part in zip(*found, strict=True))
            share = good.mean()
            sd = np.sqrt(share * (1 - share) / len(good))
            print(
                f"noise {name}, {tolerance}: {len(found)} of {sessions} sessions stop, after {np.median(stops):.0f} "
                f"poses (median; {stops.min()} to {stops.max()}); within the tolerance {100 * share:.1f} +- "
                f"{100 * sd:.1f} %, stated on average {100 * stated.mean():.1f} %",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
