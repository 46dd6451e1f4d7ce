"""Pairs of motions that share poses: what is the covariance of X worth that takes them as independent?

The paper, Nguyen and Pham, and the other published covariances of AX = XB known to us take the motions A_i, B_i as
independent.
Motions are made of poses, A_ij = inv(G_j) G_i and B_ij = C_j inv(C_i) as in (6), and two motions that share a pose
share its noise. Here X is estimated by 4DPA (limit of large d) from disjoint pairs (0, 1), (2, 3), ..., from
consecutive ones (0, 1), (1, 2), ..., and from all n (n - 1) / 2; and by `efficient` from the poses themselves. Two
first-order covariances of 4DPA are held against the errors xi = (theta, tau) of the trials: one takes the pairs as
independent, with the right noise of each; the other ("pose-aware") carries the noise of each pose through all its
pairs.

Eye-in-hand, 10 to 100 poses of a camera that looks at a board (`uq.simulate`; the first n of one sequence), independent
Gaussian noise of 1 mrad and 1 mm per axis on camera poses, robot poses, or both. Seed 2019; 4,500 trials per cell, so
that 99.9 % of the means of a true NEES lie within 3 % of 6; quick: 300. Without trials, to first order, the same ratios
for ten geometries of the camera and ten of random poses, also for 31 poses.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import diagonal
from studies.common.scores import nees, true_means
from studies.common.study import Study, Tables
from studies.shared_poses.figures import figures
from studies.shared_poses.findings import findings
from uq_handeye.core.geometry.se3 import Array, inverse
from uq_handeye.core.progress import progress_bar
from uq_handeye.model.poses.pose_pairs import Truth
from uq_handeye.trials.simulation.experiment import Experiment, experiment
from uq_handeye.trials.simulation.run import run

SEED = 2019
WAYS = ("disjoint", "consecutive", "all")
NOISES = {
    "camera": uq.PoseNoise(camera=diagonal(1, 1)),
    "robot": uq.PoseNoise(robot=diagonal(1, 1)),
    "both": uq.PoseNoise(diagonal(1, 1), diagonal(1, 1)),
}
BOARD, RANDOM = "camera and board", "random poses"
POSES = (10, 15, 20, 30, 50, 70, 100)
EXTRA = 31  # only to first order


def sequence(kind: str, geometry: int, n: int) -> uq.PosePairs:
    """The first n exact poses of a sequence, which carry their truth."""
    if kind == BOARD:
        whole = uq.simulate(n_poses=max(POSES), seed=SEED + geometry).truth
        assert whole is not None
        truth = Truth(whole.X, whole.W, whole.robot[:n], whole.camera[:n])
    else:
        rng = np.random.default_rng([SEED, geometry])
        X, W = random_transforms(rng, ()), random_transforms(rng, ())
        robot = random_transforms(rng, (max(POSES),))[:n]
        truth = Truth(X, W, robot, inverse(X) @ inverse(robot) @ W)
    return uq.PosePairs(truth.robot, truth.camera, "eye-in-hand", truth=truth)


def measure(full: bool) -> Tables:
    poses = POSES if full else (10, 20, 50)
    trials = 4500 if full else 300
    sampled: list[dict[str, object]] = []
    for number, (noise, n) in enumerate(cells(poses)):
        data = sequence(BOARD, 0, n)
        limit = uq.bound(data, NOISES[noise])
        for k, way in enumerate((*WAYS, "poses")):
            method = "efficient" if way == "poses" else "4dpa"
            at = experiment(data, NOISES[noise], method, pairs="all" if way == "poses" else way)
            rng = np.random.default_rng([SEED, number, k])
            line = {"noise": noise, "poses": n, "data": way}
            sampled.append(line | trial_statistics(at, trials, limit, rng))
    return {"sampled": pd.DataFrame(sampled), "predicted": pd.DataFrame(predicted((*poses, EXTRA), 10 if full else 2))}


def cells(poses: tuple[int, ...]) -> Iterator[tuple[str, int]]:
    every = [(noise, n) for noise in NOISES for n in poses]
    with progress_bar("trials", len(every), "cells") as done:
        for cell in every:
            yield cell
            done(1)


def stated(at: Experiment) -> dict[str, Array]:
    """The covariances (6, 6) of X to first order at the true poses: of `efficient` the bound, of 4DPA both."""
    if at.method == "efficient":
        return {"pose-aware": at.predicted()}
    return {"pairs independent": at.predicted("pairs"), "pose-aware": at.predicted("poses")}


def trial_statistics(at: Experiment, trials: int, limit: Array, rng: np.random.Generator) -> dict[str, object]:
    """NEES of each covariance with its standard error, and sampled standard deviations as ratios over the six axes."""
    found = run(at, rng, trials)
    e = found.errors[found.ok]
    sd = np.sqrt(np.mean(e**2, axis=0))
    low, high = true_means(len(e))
    line: dict[str, object] = {
        "pairs": 0 if at.method == "efficient" else at.number_of_pairs,
        "trials": trials,
        "failures": int((~found.ok).sum()),
        "NEES from": low,
        "NEES to": high,
    }
    for name, S in stated(at).items():
        distances = nees(e, S)
        line |= {f"NEES, {name}": distances.mean(), f"error of NEES, {name}": distances.std() / np.sqrt(len(e))}
        line |= span(f"sd over stated, {name}", sd, S)
    return line | span("sd over bound", sd, limit)


def span(name: str, sd: Array, S: Array) -> dict[str, object]:
    """Least, geometric mean and largest over the axes of standard deviations over those of S."""
    ratio = sd / np.sqrt(np.diag(S))
    values = (ratio.min(), np.exp(np.log(ratio).mean()), ratio.max())
    return {f"{name}: {which}": value for which, value in zip(("least", "mean", "largest"), values, strict=True)}


def predicted(poses: tuple[int, ...], geometries: int) -> Iterator[dict[str, object]]:
    """To first order: the mean NEES ``tr(P^-1 S)`` of the covariance P of independent pairs, S pose-aware."""
    every = [(kind, k) for kind in (BOARD, RANDOM) for k in range(geometries)]
    with progress_bar("geometries", len(every), "geometries") as done:
        for kind, geometry in every:
            for n in sorted(poses):
                data = sequence(kind, geometry, n)
                for name, noise in NOISES.items():
                    limit = uq.bound(data, noise)
                    for way in WAYS:
                        at = experiment(data, noise, pairs=way)
                        P, S = stated(at).values()
                        line: dict[str, object] = {"motions": kind, "geometry": geometry, "noise": name, "poses": n}
                        line |= {"data": way, "pairs": at.number_of_pairs, "NEES": np.trace(np.linalg.solve(P, S))}
                        yield line | span("sd over bound", np.sqrt(np.diag(S)), limit)
            done(1)


STUDY = Study("shared_poses", measure, findings, figures)
