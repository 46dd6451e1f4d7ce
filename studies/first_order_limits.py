"""Where first order ends, by geometry and method, and how far sigma points reach.

    python -m studies.first_order_limits [--full] [--csv first_order_limits.csv] [--figure first_order_limits.png]

Each row is one geometry at a noise of 1 mrad of rotation and some translation, which grows up to 300 times. The table
has the noise at which each covariance begins to fail (`uq_handeye.validation.sweep`: errors, or what its 95 % ellipsoid
holds, as if deviations were off by 10 %), as rotation deviation in mrad. ``more than``: it holds at all levels. In the
CSV there is every level. 1,000 trials per level, with `4dpa` and `efficient` in about two minutes on two cores
(``--full``: 10,000 trials, and four more methods, far longer).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np

import uq_handeye as uq
from studies.efficiency import diagonal
from studies.geometries import random_transforms
from uq_handeye.io.atomic import write_atomically
from uq_handeye.report.numbers import digits
from uq_handeye.se3 import inverse
from uq_handeye.validation.sweep import Limit, Sweep, sweep
from uq_handeye.validation.sweep_level import KINDS

SEED = 2019
# Of the covariance: deviations 1, 3, ..., 300 mrad.
FACTORS = tuple(float(deviation) ** 2 for deviation in (1, 3, 10, 30, 100, 300))
METHODS = ("4dpa", "efficient")
MORE = ("ml", "park", "daniilidis", "tsai")


def problems() -> Iterator[tuple[str, str, uq.PosePairs | uq.Motions, uq.Noise]]:
    """Name, noise in words, exact data, noise."""
    for n in (6, 20, 60):
        noise: uq.Noise = uq.PoseNoise(diagonal(0.1, 0.1), diagonal(1, 1))
        yield f"cell, {n} poses", "camera 1 mrad, 1 mm; robot 0.1 mrad, 0.1 mm", uq.simulate(n, seed=SEED), noise
    yield (
        "cell, 20 poses, tilt 10 deg, roll 10 deg",
        "camera 1 mrad, 1 mm; robot 0.1 mrad, 0.1 mm",
        uq.simulate(20, tilt="10deg", roll="10deg", seed=SEED),
        noise,
    )
    for name, translation in (("random", 1.0), ("random", 0.1), ("star", 0.1), ("star", 0.01)):
        rng = np.random.default_rng([SEED, len(name)])
        X, B = random_transforms(rng, ()), random_transforms(rng, (60,))
        if name == "star":  # nearly a common translation
            B[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(60, 3))
        S = diagonal(1, translation)
        motions = uq.Motions(X @ B @ inverse(X), B)
        yield f"60 pairs, {name}", f"A and B 1 mrad, {translation:g} mm", motions, uq.PairNoise(S, S)


def cell(limit: Limit, levels: float) -> str:
    """The rotation deviation (mrad) between the last level that holds and the first that fails."""
    if limit.fails is None:
        return f"more than {levels:.0f}"
    if limit.holds is None:
        return f"less than {digits(math.sqrt(limit.fails), 2)}"
    return digits((limit.holds * limit.fails) ** 0.25, 2)


def why(found: Sweep, method: str, kind: str) -> str:
    fails = found[method].limit(kind).fails
    if fails is None:
        return ""
    level = found[method].at(fails)
    tails = " Heavy tails." if level.heavy else ""
    return f"{level.of(kind).reason}{tails}"


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="10,000 trials instead of 1,000, and more methods")
    parser.add_argument("--csv", default="first_order_limits.csv")
    parser.add_argument("--figure", default="first_order_limits.png", help="of the last row")
    options = parser.parse_args()
    import pandas as pd

    methods = (*METHODS, *MORE) if options.full else METHODS
    trials = 10_000 if options.full else 1_000
    tables = []
    print("| data | noise | method | first order fails at, mrad | sigma points fail at, mrad | why those do |")
    print("|---|---|---|---|---|---|")
    for name, noise_in_words, data, noise in problems():
        found = sweep(data, noise=noise, methods=methods, factors=FACTORS, trials=trials, seed=SEED)
        for method in methods:
            first, second = (cell(found[method].limit(kind), math.sqrt(FACTORS[-1])) for kind in KINDS)
            reason = why(found, method, KINDS[1])
            print(f"| {name} | {noise_in_words} | {method} | {first} | {second} | {reason} |", flush=True)
        table = found.to_dataframe()
        table.insert(0, "noise", noise_in_words)
        table.insert(0, "data", name)
        tables.append(table)
    write_atomically(options.csv, pd.concat(tables).to_csv(index=False, lineterminator="\n"))
    found.figure(options.figure)


if __name__ == "__main__":
    main()
