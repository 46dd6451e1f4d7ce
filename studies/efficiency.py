"""How near the Cramer-Rao bound: 4DPA, one closed-form step, two (`efficient`), and maximum likelihood (`ml`).

    python -m studies.efficiency [--full] [--csv efficiency.csv]

Prints the table of docs/explanation/likelihood.md and writes it as CSV, with a fixed seed. Per row one geometry and
1,000 noise draws (``--full``: 10,000, in about six minutes), and per estimator the smallest and largest of its six
standard deviations about the truth as multiples of the bound's, and the mean NEES ``e^T Sigma^-1 e`` with its own
covariance, 6 if that is true. 4DPA's is the one predicted at exact data, for all pairs where there are poses. Below the
table: what the section on limits of that page says.
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import uq_handeye as uq
from studies.geometries import random_transforms
from uq_handeye.all_pairs import solve_all_pairs
from uq_handeye.constraint import constraint_of
from uq_handeye.likelihood import Fit, bound, efficient, fit, maximum_likelihood, start_of
from uq_handeye.se3 import Array, inverse, perturb

SEED = 2019
BLOCK = 200  # draws at a time, for the memory
Data = uq.PosePairs | uq.Motions
Noise = uq.PoseNoise | uq.PairNoise


def diagonal(*deviations: float) -> Array:
    """From milliradians and millimetres: of all rotations and all translations, or of all six."""
    return np.diag((1e-3 * np.repeat(deviations, 6 // len(deviations))) ** 2)


def both(rotation: float, translation: float) -> uq.PairNoise:
    S = diagonal(rotation, translation)
    return uq.PairNoise(S, S)


def paper() -> uq.PairNoise:
    """(70) of the paper."""
    B = np.diag([4.15625, 32.0952, 1.43937, 19.52937, 4.44314426, 2.13070])
    for i, j, value in (
        (0, 1, -2.88693),
        (0, 2, -0.60653),
        (1, 2, -0.14482),
        (3, 4, 2.12627),
        (3, 5, -1.06675),
        (4, 5, 0.38679),
    ):
        B[i, j] = B[j, i] = value
    return uq.PairNoise(1e-10 * np.eye(6), 1e-5 * B)


ROWS: list[tuple[str, str, Noise]] = [
    ("31 poses", "camera, isotropic: 1 mrad, 1 mm", uq.PoseNoise(camera=diagonal(1, 1))),
    (
        "31 poses",
        "camera, weak in depth and tilt: 3, 3, 0.5 mrad, 0.3, 0.3, 3 mm; robot: 0.1 mrad, 0.1 mm",
        uq.PoseNoise(diagonal(0.1, 0.1), diagonal(3, 3, 0.5, 0.3, 0.3, 3)),
    ),
    (
        "31 poses",
        "robot dominates: 1 mrad, 1 mm; camera: 0.2 mrad, 0.2 mm",
        uq.PoseNoise(diagonal(1, 1), diagonal(0.2, 0.2)),
    ),
    *(
        (f"60 pairs, {geometry}", f"{rotation:g} mrad, {translation:g} mm", both(rotation, translation))
        for geometry in ("random", "star")
        for rotation, translation in ((1, 1), (1, 0.1), (10, 0.1), (30, 0.1))
    ),
    ("60 pairs, random", "(70)", paper()),
]
# Where first order ends.
LIMITS: list[tuple[str, str, Noise]] = [
    ("60 pairs, random", "100 mrad, 0.1 mm", both(100, 0.1)),
    ("31 poses", "camera: 100 mrad, 0.1 mm", uq.PoseNoise(camera=diagonal(100, 0.1))),
    ("31 poses", "robot and camera: 100 mrad, 0.1 mm each", uq.PoseNoise(diagonal(100, 0.1), diagonal(100, 0.1))),
]


class Draws(NamedTuple):
    """One geometry, and noise upon it block by block."""

    X: Array
    exact: Data
    blocks: Iterator[Data]


def disturbed(rng: np.random.Generator, T: Array, S: Array | None, trials: int) -> Array:
    if S is None:
        return np.broadcast_to(T, (trials, *T.shape))
    return perturb(T, rng.standard_normal((trials, len(T), 6)) @ np.linalg.cholesky(S).T)


def draws(row: int, geometry: str, noise: Noise, trials: int) -> Draws:
    rng = np.random.default_rng([SEED, row])
    X = random_transforms(rng, ())
    make: Callable[[Array, Array], Data]
    if isinstance(noise, uq.PoseNoise):
        W, first = random_transforms(rng, ()), random_transforms(rng, (31,))
        second, covariances, make = inverse(X) @ inverse(first) @ W, (noise.robot, noise.camera), uq.PosePairs
    else:
        second = random_transforms(rng, (60,))
        if "star" in geometry:  # nearly a common translation
            second[:, :3, 3] = [0.3, 0.0, 0.4] + 1e-2 * rng.normal(size=(60, 3))
        first, covariances, make = X @ second @ inverse(X), (noise.A, noise.B), uq.Motions
    blocks = (
        make(disturbed(rng, first, covariances[0], BLOCK), disturbed(rng, second, covariances[1], BLOCK))
        for _ in range(0, trials, BLOCK)
    )
    return Draws(X, make(first, second), blocks)


def four_dpa(data: Data) -> Array:
    return solve_all_pairs(data) if isinstance(data, uq.PosePairs) else np.asarray(uq.solve(data.A, data.B))


def one_step(data: Data, noise: Noise) -> Fit:
    constraint = constraint_of(data, noise)
    return fit(constraint, noise, start_of(data, constraint, None), steps=1)


def errors(X: Array, truth: Array) -> Array:
    theta = Rotation.from_matrix(X[..., :3, :3] @ truth[..., :3, :3].mT).as_rotvec()
    return np.concatenate([theta, X[..., :3, 3] - truth[..., :3, 3]], axis=-1)


def nees(e: Array, S: Array) -> Array:
    return np.asarray((e[:, None, :] @ np.linalg.solve(np.broadcast_to(S, (len(e), 6, 6)), e[..., None]))[:, 0, 0])


STEPS: dict[str, Callable[[Data, Noise], Fit]] = {
    "one step": one_step,
    "efficient": efficient,
    "ml": maximum_likelihood,
}


def measure(row: int, geometry: str, noise: Noise, trials: int) -> dict[str, tuple[float, float, float]]:
    """Per estimator: smallest and largest of sd / bound, and mean NEES."""
    drawn = draws(row, geometry, noise, trials)
    limit = np.sqrt(np.diag(bound(drawn.exact, noise, drawn.X)))
    exact = drawn.exact if isinstance(drawn.exact, uq.Motions) else uq.relative_motions(drawn.exact, "all")
    predicted = uq.propagate(exact, noise=noise)
    parts: dict[str, list[tuple[Array, Array]]] = {name: [] for name in ("4dpa", *STEPS)}
    for data in drawn.blocks:
        e = errors(four_dpa(data), drawn.X)
        parts["4dpa"].append((e, nees(e, predicted)))
        for name, method in STEPS.items():
            found = method(data, noise)
            e = errors(found.X, drawn.X)
            parts[name].append((e, nees(e, found.covariance_X)))
    table = {}
    for name, found_in in parts.items():
        e = np.concatenate([part[0] for part in found_in])
        distances = np.concatenate([part[1] for part in found_in])
        ratio = np.sqrt(np.mean(e**2, axis=0)) / limit
        table[name] = (float(ratio.min()), float(ratio.max()), float(distances.mean()))
    return table


def joint(poses: int, trials: int) -> dict[str, tuple[float, float, float]]:
    """As `measure`, `efficient` where all camera poses share 3 mm in depth: so told, and told independent errors."""
    rng = np.random.default_rng([SEED, 1000])
    X, W, robot = random_transforms(rng, ()), random_transforms(rng, ()), random_transforms(rng, (poses,))
    camera = inverse(X) @ inverse(robot) @ W
    own, shared, S = diagonal(0.3, 0.2), diagonal(0.1, 0.1, 0.1, 0.1, 0.1, 3), diagonal(0.1, 0.1)
    true = uq.PoseNoise(S, np.kron(np.eye(poses), own) + np.kron(np.ones((poses, poses)), shared))
    own_errors, common = rng.standard_normal((trials, poses, 6)), rng.standard_normal((trials, 1, 6))
    data = uq.PosePairs(
        disturbed(rng, robot, S, trials), perturb(camera, own_errors @ np.sqrt(own) + common @ np.sqrt(shared))
    )
    limit = np.sqrt(np.diag(bound(uq.PosePairs(robot, camera), true, X)))
    table = {}
    for name, noise in (("joint", true), ("independent", uq.PoseNoise(S, own + shared))):
        found = efficient(data, noise)
        e = errors(found.X, X)
        ratio = np.sqrt(np.mean(e**2, axis=0)) / limit
        table[name] = (float(ratio.min()), float(ratio.max()), float(nees(e, found.covariance_X).mean()))
    return table


def print_limits() -> None:
    print(f"\nLimits, {BLOCK} draws per row of large noise:")
    for row, (geometry, label, noise) in enumerate(LIMITS, start=len(ROWS)):
        cells = (f"{name} NEES {mean:.1f}" for name, (_, _, mean) in measure(row, geometry, noise, BLOCK).items())
        print(f"- {geometry}, {label}: " + ", ".join(cells))
    for name, (low, high, mean) in joint(15, 1_000).items():
        print(
            f"- 15 poses that share 3 mm in depth, 1,000 draws, errors taken as {name}: "
            f"sd / bound {low:.2f} to {high:.2f}, NEES {mean:.2f}"
        )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--full", action="store_true", help="10,000 draws instead of 1,000")
    parser.add_argument("--csv", default="efficiency.csv")
    options = parser.parse_args()
    trials = 10_000 if options.full else 1_000
    names = ("4dpa", *STEPS)
    print("| data | noise | " + " | ".join(f"{name}: sd / bound | NEES" for name in names) + " |")
    print("|---|---" * (1 + len(names)) + "|")
    with open(options.csv, "w", newline="") as file:
        writer = csv.writer(file)
        columns = [f"{name} {what}" for name in names for what in ("least sd/bound", "largest sd/bound", "NEES")]
        writer.writerow(["data", "noise", "draws", *columns])
        for row, (geometry, label, noise) in enumerate(ROWS):
            table = measure(row, geometry, noise, trials)
            cells = (f"{low:.2f} to {high:.2f} | {mean:.2f}" for low, high, mean in table.values())
            print(f"| {geometry} | {label} | " + " | ".join(cells) + " |", flush=True)
            values = [value for name in names for value in table[name]]
            writer.writerow([geometry, label, trials, *(f"{value:.4f}" for value in values)])
    interval = np.asarray(chi2.ppf([0.0005, 0.9995], 6 * trials)) / trials
    print(
        f"\n99.9 % of means of a true NEES over {trials:,} draws lie between {interval[0]:.2f} and {interval[1]:.2f}."
    )
    print_limits()


if __name__ == "__main__":
    main()
