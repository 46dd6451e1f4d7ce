r"""The experiment of (70), its rows, its trials, and what judges them; see `figure_5`.

Model: true motions with ``A_i X = X B_i``; measured ones carry Gaussian errors ``xi = (theta, tau)`` (left rotation,
additive translation, rad and m) with the covariances (70), independent from motion to motion and between A and B.
Every covariance (6, 6) is of the error of X in the same convention, in the frame of A.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.stats import binomtest, chi2

import uq_handeye as uq
from studies.common.geometries import random_transforms
from studies.common.noises import paper
from studies.common.scores import CERTAIN, errors, nees, true_means
from uq_handeye.core.geometry.se3 import Array, inverse, perturb
from uq_handeye.methods import _closed_form
from uq_handeye.methods.paper_covariances import PAPER_SCALE
from uq_handeye.methods.scaled import se3_from_so4, so4_from_se3, solve_4dpa
from uq_handeye.trials.simulation.experiment import Experiment, experiment
from uq_handeye.trials.simulation.run import run
from uq_handeye.trials.validation.cross_check.rows import formulas, is_singular

SEED = 2019
PAIRS = 60
LEVEL = 0.95  # of ellipsoids and ellipses
RANDOM, BOARD = "random", "camera and board"
# Which trials judge a row, in the order of the tables.
METHOD_OF = {
    "4dpa-pairs": "4dpa",
    "4dpa-literal": "4dpa",
    "4dpa-mean": "4dpa",
    "nguyen-own": "nguyen",
    "nguyen-first-order": "nguyen",
    "efficient-own": "efficient",
    "bound": "efficient",
}
METHODS = ("4dpa", "nguyen", "efficient")


def problem(geometry: int = 0, kind: str = RANDOM) -> Experiment:
    """Exact motions with the noise (70); number 0 of the random ones is that of the figure."""
    if kind == BOARD:
        poses = uq.simulate(n_poses=PAIRS + 1, seed=SEED + geometry)
        return experiment(uq.relative_motions(poses, "consecutive"), paper())
    rng = np.random.default_rng(SEED if geometry == 0 else [SEED, geometry])
    X, B = random_transforms(rng, ()), random_transforms(rng, (PAIRS,))
    return Experiment(uq.Motions(X @ B @ inverse(X), B), X, None, paper(), "4dpa")


class Sample(NamedTuple):
    """Errors (T, 6) of the trials of one method that gave an estimate, and their covariance about their mean."""

    errors: Array
    failures: int
    own: Array | None  # (T, 6, 6), what each trial reports of itself; of `efficient` alone

    @property
    def covariance(self) -> Array:
        return np.cov(self.errors.T)


def sample(at: Experiment, method: str, trials: int, seed: int) -> Sample:
    """Trials of one method; every method sees draws of its own."""
    rng = np.random.default_rng([SEED, seed, METHODS.index(method)])
    found = run(replace(at, method=method), rng, trials, each=method == "efficient")
    own = None if found.covariances is None else found.covariances[found.ok]
    return Sample(found.errors[found.ok], int((~found.ok).sum()), own)


def rows(at: Experiment, samples: dict[str, Sample]) -> dict[str, Array]:
    """The covariances by the keys of `METHOD_OF`: formulas at the true motions, and the mean of what trials report.

    ``4dpa-mean`` divides F11 and F22 by the number of pairs, as (45) does with their derivative: it is what (45) would
    be if (35) were a mean too, N^2 times (45) as printed.
    """
    found = {row.key: row.covariance for row in formulas(at.truth, at)}
    literal, own = found["4dpa-literal"], samples["efficient"].own
    assert literal is not None and own is not None
    found |= {"4dpa-mean": at.count**2 * literal, "efficient-own": own.mean(axis=0)}
    return {key: S for key in METHOD_OF if (S := found[key]) is not None}


def judged(key: str, S: Array, drawn: Sample, each: Array | None = None) -> dict[str, float | str]:
    """Relate the covariance S, or that of ``each`` trial, to the errors of trials.

    Ratios are standard deviations of S over those sampled, of the six axes and over all directions (roots of the
    eigenvalues of S against the sampled covariance). NEES and coverage are left out where S leaves no error at all in
    some direction.
    """
    T, C = len(drawn.errors), drawn.covariance
    ratio = np.sqrt(np.diag(S) / np.diag(C))
    directions = np.sqrt(np.maximum(eigh(S, C, eigvals_only=True), 0.0))
    line: dict[str, float | str] = {
        "row": key,
        "method": METHOD_OF[key],
        "trials": T + drawn.failures,
        "failures": drawn.failures,
        "least axis": ratio.min(),
        "largest axis": ratio.max(),
        "least direction": directions[0],
        "largest direction": directions[-1],
        "bias (sd)": float(np.abs(drawn.errors.mean(axis=0) / np.sqrt(np.diag(C))).max()),
    }
    names = ("NEES", "NEES from", "NEES to", "coverage", "coverage from", "coverage to")
    if is_singular(S):
        return line | dict.fromkeys(names, np.nan)
    distances = nees(drawn.errors, S if each is None else each)
    share = binomtest(int((distances < chi2.ppf(LEVEL, 6)).sum()), T)
    interval = share.proportion_ci(CERTAIN)
    values = (distances.mean(), *true_means(T), share.statistic, interval.low, interval.high)
    return line | dict(zip(names, values, strict=True))


def inside(e: Array, S: Array) -> float:
    """Share of errors (T, 2) in the ellipse of `LEVEL` of S (2, 2)."""
    return float((nees(e, S) < chi2.ppf(LEVEL, 2)).mean())


# ---------------------------------------------------------------------------------- all pairs with the same error


def same_motion_error(at: Experiment, trials: int, rng: np.random.Generator) -> Array:
    """Errors (trials, 6) of 4DPA where one error xi of A and one of B is common to all pairs of a trial."""
    truth, noise = at.truth, at.noise
    assert isinstance(truth, uq.Motions) and isinstance(noise, uq.PairNoise)
    L_A, L_B = noise.factors
    assert L_A is not None and L_B is not None
    A, B = (
        perturb(T, np.broadcast_to(rng.standard_normal((trials, 1, 6)) @ L.T, (trials, len(T), 6)))
        for T, L in ((truth.A, L_A), (truth.B, L_B))
    )
    return errors(solve_4dpa(A, B, None), at.X)


def same_image_error(at: Experiment, trials: int, rng: np.random.Generator, block: int = 250) -> Array:
    """Errors (trials, 6) of 4DPA in the model of (45): one error b of (vec E, vec Z) is common to all pairs.

    E = F2(A), Z = F2(B) at the paper's d; b has the mean covariance over the pairs, as in (45).
    """
    truth, noise = at.truth, at.noise
    assert isinstance(truth, uq.Motions) and isinstance(noise, uq.PairNoise)
    images, factors = [], []
    for T, S in zip((truth.A, truth.B), (noise.A, noise.B), strict=True):
        assert S is not None
        J = _closed_form.dF2_dxi(T, PAPER_SCALE)
        values, vectors = np.linalg.eigh((J @ S @ J.mT).mean(axis=0))
        images.append(so4_from_se3(T, PAPER_SCALE))
        factors.append(vectors * np.sqrt(np.maximum(values, 0.0)))

    def draws() -> Iterator[Array]:
        for first in range(0, trials, block):
            m = min(block, trials - first)
            E, Z = (
                image + (rng.standard_normal((m, 16)) @ L.T).reshape(m, 1, 4, 4)
                for image, L in zip(images, factors, strict=True)
            )
            yield problem_2(E, Z)

    return errors(np.concatenate(list(draws())), at.X)


def problem_2(E: Array, Z: Array) -> Array:
    """X (..., 4, 4) from images (..., N, 4, 4) that need not be on SO(4): (33)-(35) at the paper's d."""
    q_L, q_R = (np.linalg.eigh(F(E, Z).sum(axis=-3))[1][..., 0] for F in (_closed_form.F11, _closed_form.F22))
    R = _closed_form.R_L(q_L) @ _closed_form.R_R(q_R)
    return se3_from_so4(np.sign(R[..., 3:, 3:]) * R, PAPER_SCALE)
