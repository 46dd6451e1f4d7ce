"""Do the covariances tell the truth? Monte Carlo sampling of 4DPA against what `propagate` predicts.

Judged by the normalised estimation error squared, NEES = e^T Sigma^-1 e, whose mean over T trials is chi-square
with 6 T degrees of freedom over T if Sigma is true, and by the share of trials inside the 50 to 99 % ellipsoids
(binomial). All intervals hold with probability 0.999: with another seed (UQ_HANDEYE_SEED) one of the thirty or so
judgements here fails about once in thirty runs without any fault. Every judge must also reject a covariance that is
10 % off in standard deviation.
"""

import functools
from typing import NamedTuple

import numpy as np
import pytest
import support
from scipy import stats
from support import (
    CONFIDENCE,
    SEED,
    covers,
    difference,
    draw,
    exact_motions,
    exact_poses,
    is_consistent,
    mean_interval,
    moved,
    nees,
    random_covariance,
    whitened_eigenvalues,
)

import uq_handeye as uq

pytestmark = pytest.mark.statistical

TRIALS = 10_000
BLOCK = 1_000  # trials at a time, for the memory


class Sample(NamedTuple):
    errors: np.ndarray  # (TRIALS, 6)
    covariances: np.ndarray  # (TRIALS, 6, 6): predicted from each trial's own noisy data
    at_truth: np.ndarray  # (6, 6): predicted from the data without noise
    as_independent: np.ndarray | None = None  # (6, 6): pairs taken as independent
    literal: np.ndarray | None = None  # (6, 6): (45)


EQUATION_70 = uq.PairNoise(*support.EQUATION_70)


def sample_pairs(kind, scale):
    rng = np.random.default_rng([SEED, 70])
    X, A, B = exact_motions(rng, 60)
    noise = {
        "1 mrad, 1 mm": lambda: uq.PairNoise.isotropic(("1mrad", "1mm"), ("1mrad", "1mm")),
        "correlated, per pair": lambda: uq.PairNoise(
            random_covariance(rng, 6, (60,)), random_covariance(rng, 6, (60,))
        ),
        "equation (70) / 100": lambda: uq.PairNoise(EQUATION_70.A, EQUATION_70.B / 100),
    }[kind]()
    errors, covariances = [], []
    for _ in range(TRIALS // BLOCK):
        a, b = (moved(T, draw(rng, S, (BLOCK, 60))) for T, S in ((A, noise.A), (B, noise.B)))
        estimate = uq.solve(a, b, scale=scale)
        errors.append(difference(estimate, X))
        covariances.append(uq.propagate(a, b, noise, X=estimate))
    literal = uq.propagate(A, B, noise, kind="literal")
    return Sample(*map(np.concatenate, (errors, covariances)), uq.propagate(A, B, noise), literal=literal)


def sample_poses(kind, setup, joint, n=31):
    """``n`` poses, camera noise of 1 mrad and 1 mm, the robot exact (T4); or all noisy, with what poses share (T4b)."""
    rng = np.random.default_rng([SEED, 31])
    X, robot, camera = exact_poses(rng, n, setup)
    if joint:
        shared = np.tile(random_covariance(rng), (n, n))
        noise = uq.PoseNoise(random_covariance(rng, sd=3e-4), shared + 1e-7 * np.eye(6 * n))
    else:
        noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    errors, covariances = [], []
    for _ in range(TRIALS // BLOCK):
        if joint:
            C = moved(camera, draw(rng, noise.camera, (BLOCK,)).reshape(BLOCK, n, 6))
            G = moved(robot, draw(rng, noise.robot, (BLOCK, n)))
        else:
            C = moved(camera, draw(rng, noise.camera, (BLOCK, n)))
            G = np.broadcast_to(robot, C.shape)
        motions = uq.relative_motions(uq.PosePairs(G, C, setup), kind)
        estimate = uq.solve(motions.A, motions.B)
        errors.append(difference(estimate, X))
        covariances.append(uq.propagate(motions, noise, X=estimate))
    motions = uq.relative_motions(uq.PosePairs(robot, camera, setup), kind)
    return Sample(
        *map(np.concatenate, (errors, covariances)),
        uq.propagate(motions, noise),
        uq.propagate(motions, noise, kind="pairs"),
    )


SAMPLES = {
    "60 pairs, 1 mrad, 1 mm": (sample_pairs, "1 mrad, 1 mm", None),
    "60 pairs, correlated": (sample_pairs, "correlated, per pair", None),
    "60 pairs, correlated, d = 1e4": (sample_pairs, "correlated, per pair", 1e4),
    "60 pairs, (70) / 100": (sample_pairs, "equation (70) / 100", None),
    "30 consecutive pairs": (sample_poses, "consecutive", "eye-in-hand", False),
    "120 pairs, all": (sample_poses, "all", "eye-in-hand", False, 16),
    "15 disjoint pairs": (sample_poses, "disjoint", "eye-to-hand", False),
    "30 consecutive pairs, joint": (sample_poses, "consecutive", "eye-to-hand", True),
}


@functools.cache
def sample(name):
    function, *arguments = SAMPLES[name]
    return function(*arguments)


@pytest.fixture(params=SAMPLES)
def drawn(request):
    return sample(request.param)


def test_mean_nees(drawn):
    """Between 5.89 and 6.11: a standard deviation wrong by 1 % would show."""
    low, high = mean_interval(TRIALS)
    assert 5.85 < low < 6 < high < 6.15
    assert low < nees(drawn.errors, drawn.covariances).mean() < high
    assert low < nees(drawn.errors, drawn.at_truth).mean() < high


def test_nees_of_each_half(drawn):
    """Rotation and translation on their own: an excess of one cannot hide a lack of the other."""
    for half in (slice(0, 3), slice(3, 6)):
        assert is_consistent(drawn.errors[:, half], drawn.covariances[:, half, half])


def test_distribution_of_nees(drawn):
    """Not only its mean: chi-square with 6 degrees of freedom (Kolmogorov-Smirnov)."""
    distances = nees(drawn.errors, drawn.covariances)
    assert stats.kstest(distances, stats.chi2(6).cdf).pvalue > 1 - CONFIDENCE
    assert stats.kstest(distances / 1.1**2, stats.chi2(6).cdf).pvalue < 1e-6


def test_coverage(drawn):
    """The 50, 68, 90, 95 and 99 % ellipsoids hold as many trials as they say."""
    assert covers(drawn.errors, drawn.covariances) == [True] * 5


def test_sampling_covariance(drawn):
    """Whitened eigenvalues of the sampling covariance, within what 10,000 trials of a 6-vector spread (Wishart).

    The extreme eigenvalues of a white sample covariance lie near (1 +- sqrt(6/T))^2; the margin beyond is for
    the Tracy-Widom fluctuation, which is of order T^(-2/3) here.
    """
    eigenvalues = whitened_eigenvalues(np.cov(drawn.errors.T), drawn.at_truth)
    spread = np.sqrt(6 / TRIALS)
    margin = 5 * TRIALS ** (-2 / 3)
    assert (1 - spread) ** 2 - margin < eigenvalues[0]
    assert eigenvalues[-1] < (1 + spread) ** 2 + margin


def test_unbiased(drawn):
    """Hotelling: T m^T S^-1 m of the mean error is chi-square with 6 degrees of freedom (first order)."""
    mean = drawn.errors.mean(axis=0)
    assert TRIALS * mean @ np.linalg.solve(drawn.at_truth, mean) < stats.chi2.ppf(CONFIDENCE, 6)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_ten_percent_off_is_rejected(drawn, factor):
    """Every judge above says no to standard deviations that are 10 % off, though not far from the truth."""
    wrong = drawn.covariances * factor**2
    assert not is_consistent(drawn.errors, wrong)
    assert covers(drawn.errors, wrong) == [False] * 5
    for half in (slice(0, 3), slice(3, 6)):
        assert not is_consistent(drawn.errors[:, half], wrong[:, half, half])
    eigenvalues = whitened_eigenvalues(np.cov(drawn.errors.T), drawn.at_truth * factor**2)
    assert not np.abs(eigenvalues - 1).max() < 0.1


def test_two_percent_off_is_rejected(drawn):
    """The reach of 10,000 trials: the mean NEES sees 2 %."""
    assert not is_consistent(drawn.errors, drawn.covariances * 0.98**2)
    assert not is_consistent(drawn.errors, drawn.covariances * 1.02**2)


@pytest.mark.parametrize("axis", range(6))
def test_ten_percent_off_in_one_axis_is_rejected(axis):
    drawn = sample("60 pairs, correlated")
    stretch = np.where(np.arange(6) == axis, 0.9, 1.0)
    assert not is_consistent(drawn.errors, drawn.covariances * stretch * stretch[:, None])


def test_lost_correlation_is_rejected():
    """Rotation and translation errors are correlated; the two blocks alone are not the covariance.

    The mean NEES need not see it, the generalised eigenvalues do: a reason to have both judges.
    """
    drawn = sample("60 pairs, correlated")
    blocks = drawn.at_truth.copy()
    blocks[:3, 3:] = blocks[3:, :3] = 0
    eigenvalues = whitened_eigenvalues(np.cov(drawn.errors.T), blocks)
    assert np.abs(eigenvalues - 1).max() > 0.1 > 2.5 * np.sqrt(6 / TRIALS)


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [("30 consecutive pairs", 7.0, 10.0), ("120 pairs, all", 20.0, 80.0), ("15 disjoint pairs", 5.8, 6.2)],
)
def test_pairs_taken_as_independent(name, least, most):
    """NEES 8.35 for consecutive pairs of 31 poses, 6 where nothing is shared, by the geometry; of all pairs it grows
    with the poses, to 84.8 for 31 (T4's table).

    Its expectation is tr(Sigma_pairs^-1 Sigma_poses) exactly, with the variance 2 tr(..^2) per trial.
    """
    drawn = sample(name)
    found = nees(drawn.errors, drawn.as_independent).mean()
    ratio = np.linalg.solve(drawn.as_independent, drawn.at_truth)
    deviation = np.sqrt(2 * np.trace(ratio @ ratio) / TRIALS)
    assert abs(found - np.trace(ratio)) < stats.norm.ppf((1 + CONFIDENCE) / 2) * deviation
    assert least < found < most
    if most > 6.2:
        assert not is_consistent(drawn.errors, drawn.as_independent)


def test_literal_form_is_rejected():
    """(45) at the noise of (70), axis by axis: true variances more than 60 times the predicted ones.

    Axis by axis, for the matrix as a whole is singular (see test_propagation.py).
    """
    drawn = sample("60 pairs, (70) / 100")
    ratio = np.mean(drawn.errors**2, axis=0) / np.diag(drawn.literal)
    low = stats.chi2.ppf((1 - CONFIDENCE) / 2, TRIALS) / TRIALS
    assert (ratio > 60 * low).all()
    true = np.mean(drawn.errors**2, axis=0) / np.diag(drawn.at_truth)
    high = stats.chi2.ppf((1 + CONFIDENCE) / 2, TRIALS) / TRIALS
    assert (low < true).all()
    assert (true < high).all()


def test_first_order_at_equation_70():
    """(70) as printed, 18 mrad and 14 mm: still first order, within 3 % in standard deviation."""
    rng = np.random.default_rng([SEED, 7])
    X, A, B = exact_motions(rng, 60)
    b = moved(B, draw(rng, EQUATION_70.B, (TRIALS, 60)))
    errors = difference(uq.solve(A, b), X)
    eigenvalues = whitened_eigenvalues(np.cov(errors.T), uq.propagate(A, B, uq.PairNoise(B=EQUATION_70.B)))
    assert np.abs(np.sqrt(eigenvalues) - 1).max() < 0.03 + np.sqrt(6 / TRIALS)


def test_the_judges_themselves(rng):
    """On errors drawn from a known covariance: 200 data sets, none wrongly rejected but by chance."""
    S = random_covariance(rng)
    errors = draw(rng, S, (200, 1000))
    accepted = [is_consistent(e, S) for e in errors]
    assert np.sum(accepted) >= stats.binom.ppf(1e-4, 200, CONFIDENCE)
    assert sum(is_consistent(e, 1.1**2 * S) for e in errors) == 0
