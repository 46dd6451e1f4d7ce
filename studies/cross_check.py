"""Every covariance of the paper's experiment (70) against every other, with 10,000 trials of each method.

    python -m studies.cross_check [--trials 10000] [--workers 2] [--seed 0] [--stem cross_check]

60 motions of random geometry (`geometries`) with the noise (70) on the pairs, drawn once as the measured data. Prints
the table and the relations, with the time in all, and writes the table (STEM.csv), everything (STEM.json) and the
figure of the ellipses (STEM.png).
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from studies.efficiency import paper
from studies.geometries import random_transforms
from uq_handeye.motions import Motions
from uq_handeye.se3 import inverse
from uq_handeye.simulation import disturbed
from uq_handeye.validation.cross_check import cross_check

SEED = 2019
PAIRS = 60


def measured(seed: int = SEED) -> Motions:
    """The motions with one draw of the noise (70)."""
    rng = np.random.default_rng(seed)
    X, B = random_transforms(rng, ()), random_transforms(rng, (PAIRS,))
    noise = paper()
    A = X @ B @ inverse(X)
    return Motions(disturbed(A, noise.A, (), rng), disturbed(B, noise.B, (), rng))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="of trials and posterior")
    parser.add_argument("--stem", default="cross_check", help="of the files written")
    options = parser.parse_args()
    started = time.perf_counter()
    check = cross_check(
        measured(),
        noise=paper(),
        trials=options.trials,
        seed=options.seed,
        workers=options.workers,
        progress=True,
    )
    print(check.to_text())
    check.to_dataframe().to_csv(f"{options.stem}.csv")
    check.to_json(f"{options.stem}.json")
    check.figure(f"{options.stem}.png")
    print(f"{time.perf_counter() - started:.1f} s with the files {options.stem}.csv, .json and .png.")


if __name__ == "__main__":
    main()
