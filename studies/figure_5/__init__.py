"""Fig. 5 and section IV-C: do 4DPA and Nguyen and Pham state their covariances rightly, and whose is smaller?

The experiment of (70): 60 motions A X = X B with independent Gaussian errors of the covariances (70) on each, drawn
10,000 times; every method estimates X from each draw. Its errors xi = (theta, tau) (left rotation in mrad, additive
translation in mm, in the frame of A) are held against the covariances that 4DPA (the sum over pairs, and the paper's
(45) as printed), Nguyen and Pham, and `efficient` state, and against the Cramer-Rao bound.

The geometry of the test program that the paper refers to is not in the paper. Here X and the motions B are random
(axes uniform, angles 0.4 to 2.6 rad, translations 0.5 m per axis), and in 20 further geometries: ten drawn alike, ten
of a camera that looks at a board. Covariances are taken at the true motions; those of `efficient` are the mean of what
it reports of each draw. (45) takes one error for all pairs, which is simulated as well. Seed 2019; 10,000 trials per
method and geometry, in the quick size 500 and four geometries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.linalg import eigh

import uq_handeye as uq
from studies.common.noises import paper
from studies.common.study import Study, Tables
from studies.figure_5.figures import figures
from studies.figure_5.findings import findings
from studies.figure_5.rig import (
    BOARD,
    METHOD_OF,
    METHODS,
    RANDOM,
    SEED,
    Sample,
    inside,
    judged,
    problem,
    rows,
    same_image_error,
    same_motion_error,
    sample,
)
from uq_handeye.core.geometry.se3 import Array
from uq_handeye.core.progress import progress_bar

AXES = ("theta_x", "theta_y", "theta_z", "tau_x", "tau_y", "tau_z")
UNITS = ("mrad",) * 3 + ("mm",) * 3
PROJECTIONS = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), *((i, j) for i in range(3) for j in (3, 4, 5))]
FACTORS = (0.1, 1.0, 2.0, 4.0)  # of the standard deviations of (70)
SHOWN = 400  # sampled points per method that are kept for the figure


def geometries(full: bool) -> list[tuple[int, str]]:
    """Number and kind; the first is that of the figure."""
    alike, board = (10, 10) if full else (2, 1)
    return [(0, RANDOM), *((k + 1, RANDOM) for k in range(alike)), *((k + 1, BOARD) for k in range(board))]


def measure(full: bool) -> Tables:
    trials = 10_000 if full else 500
    statistics: list[dict[str, object]] = []
    deviations: list[dict[str, object]] = []
    for number, (geometry, kind) in enumerate(counted(geometries(full))):
        at = problem(geometry, kind)
        samples = {method: sample(at, method, trials, number) for method in METHODS}
        found = rows(at, samples)
        where = {"geometry": number, "kind": kind}
        for key, S in found.items():
            drawn = samples[METHOD_OF[key]]
            statistics.append(where | judged(key, S, drawn, drawn.own if key == "efficient-own" else None))
            for k, axis in enumerate(AXES):
                deviations.append(
                    where
                    | {"row": key, "axis": axis, "unit": UNITS[k], "sd": 1e3 * np.sqrt(S[k, k])}
                    | {"sampled sd": 1e3 * np.sqrt(drawn.covariance[k, k])}
                )
        if number == 0:
            first = (samples, found)
    rng = np.random.default_rng([SEED, 45])
    return {
        "statistics": pd.DataFrame(statistics),
        "deviations": pd.DataFrame(deviations),
        "projections": projections(*first),
        "samples": pd.concat([points(method, first[0][method]) for method in ("4dpa", "nguyen")], ignore_index=True),
        "same_error": same_error(first[1], trials, rng),
        "noise": noise_levels(trials),
    }


def counted(items: list[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    with progress_bar("geometries", len(items), "geometries") as done:
        for item in items:
            yield item
            done(1)


def projections(samples: dict[str, Sample], found: dict[str, Array]) -> pd.DataFrame:
    """Every covariance in all 15 planes, with the share of the trials of its method in its ellipse."""
    lines = []
    every = [(key, METHOD_OF[key], S) for key, S in found.items()]
    every += [(f"{method}-sampled", method, samples[method].covariance) for method in METHODS]
    for i, j in PROJECTIONS:
        for key, method, S in every:
            plane = np.ix_([i, j], [i, j])
            (xx, xy), (_, yy) = 1e6 * S[plane]
            share = inside(samples[method].errors[:, [i, j]], S[plane])
            line = {"x": AXES[i], "y": AXES[j], "x unit": UNITS[i], "y unit": UNITS[j], "row": key}
            line |= {"variance x": xx, "covariance": xy, "variance y": yy}
            lines.append(line | {"share in 95 % ellipse": share, "trials": len(samples[method].errors)})
    return pd.DataFrame(lines)


def points(method: str, drawn: Sample) -> pd.DataFrame:
    """The first errors of the trials of one method, mrad and mm."""
    names = [f"{axis} ({unit})" for axis, unit in zip(AXES, UNITS, strict=True)]
    return pd.DataFrame(1e3 * drawn.errors[:SHOWN], columns=names).assign(method=method)


def same_error(found: dict[str, Array], trials: int, rng: np.random.Generator) -> pd.DataFrame:
    """Compare (45) with the errors of 4DPA where all pairs of a trial carry one error."""
    lines = []
    at = problem()
    for name, draw in (("E and Z", same_image_error), ("A and B", same_motion_error)):
        C = np.cov(draw(at, trials, rng).T)
        for key in ("4dpa-literal", "4dpa-mean"):
            S = found[key]
            ratio = np.sqrt(np.diag(S) / np.diag(C))
            largest = float(np.sqrt(eigh(S, C, eigvals_only=True)[-1]))
            line = {"same error of": name, "row": key, "pairs": at.count, "trials": trials}
            lines.append(line | {"least axis": ratio.min(), "largest axis": ratio.max(), "largest direction": largest})
    return pd.DataFrame(lines)


def noise_levels(trials: int) -> pd.DataFrame:
    """The first-order covariance of each method where all standard deviations of (70) are multiplied."""
    lines = []
    noise = paper()
    assert noise.A is not None and noise.B is not None
    for number, factor in enumerate(FACTORS):
        at = replace(problem(), noise=uq.PairNoise(factor**2 * noise.A, factor**2 * noise.B))
        samples = {method: sample(at, method, trials, 100 + number) for method in METHODS}
        found = rows(at, samples)
        sd = 1e3 * factor * np.sqrt(np.diag(noise.B))
        line = {"times sd of (70)": factor} | {
            f"B: {which} ({unit})": limit
            for unit, some in (("mrad", sd[:3]), ("mm", sd[3:]))
            for which, limit in (("least sd", some.min()), ("largest sd", some.max()))
        }
        for key in ("4dpa-pairs", "nguyen-first-order", "bound"):
            lines.append(line | judged(key, found[key], samples[METHOD_OF[key]]))
    return pd.DataFrame(lines)


STUDY = Study("figure_5", measure, findings, figures)
