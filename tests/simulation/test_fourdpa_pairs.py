"""The fast engine of 4DPA against `solve` on the same draws, and its statistics."""

import numpy as np
import pytest
from scipy import stats
from support import CONFIDENCE, SEED, difference, exact_motions, moved, random_covariance, transforms

import uq_handeye as uq
from uq_handeye.trials.simulation.fourdpa import CHUNK, MIN_BLOCK_TRIALS, fourdpa_on_drawn


def generator(seed=SEED):
    return np.random.Generator(np.random.SFC64(seed))


def drawn(noise, N, trials, rng):
    """The same errors of A and of B (trials, N, 6) as the engine draws: block after block, trials last."""
    errors = np.zeros((2, trials, N, 6))
    pairs = max(1, min(N, CHUNK // MIN_BLOCK_TRIALS))
    step = max(MIN_BLOCK_TRIALS, CHUNK // N)
    for first in range(0, trials, step):
        for start in range(0, N, pairs):
            block = errors[:, first : first + step, start : start + pairs]
            for side, L in zip(block, noise.factors, strict=True):
                if L is not None:
                    z = rng.standard_normal((side.shape[1], 6, len(side)))
                    L = np.broadcast_to(L, (N, 6, 6))[start : start + pairs]
                    side[:] = np.einsum("nij,njm->mni", L, z)
    return errors


def by_solve(X, A, B, noise, trials):
    xi_A, xi_B = drawn(noise, len(A), trials, generator())
    return difference(uq.solve(moved(A, xi_A), moved(B, xi_B)), X)


# one of each branch of the series, 9 and 140 mrad, and of blocks of pairs
@pytest.mark.slow
@pytest.mark.parametrize("sd", [1e-9, 1e-3, 2e-2, 0.3, 2.0])
@pytest.mark.parametrize("N", [2, 7, 60, 700])
def test_same_errors_as_solve(sd, N):
    rng = np.random.default_rng([SEED, N])
    X, A, B = exact_motions(rng, N)
    noise = uq.PairNoise(A=random_covariance(rng, sd=sd), B=random_covariance(rng, sd=sd, shape=(N,)))
    errors, ok = fourdpa_on_drawn(A, B, X, noise, generator(), 150)
    reference = by_solve(X, A, B, noise, 150)
    # rounding of R and t, passed on by M^-1 where wild noise leaves X nearly open
    largest = np.abs(reference).max(axis=1)
    assert ok.all()
    assert (np.abs(errors - reference).max(axis=1) < 1e-12 * (1 + largest) ** 2 + 1e-9 * largest * (sd > 0.1)).all()


@pytest.mark.parametrize("exact", ["A", "B"])
def test_one_side_may_be_exact(exact):
    rng = np.random.default_rng(SEED)
    X, A, B = exact_motions(rng, 12)
    noise = uq.PairNoise(**{"B" if exact == "A" else "A": random_covariance(rng)})
    errors, _ = fourdpa_on_drawn(A, B, X, noise, generator(), 50)
    np.testing.assert_allclose(errors, by_solve(X, A, B, noise, 50), atol=1e-13)


def test_axes_in_a_plane_take_the_other_branch():
    """All axes in one plane: H has rank 2 without noise, so that its determinant is small and of either sign."""
    rng = np.random.default_rng(SEED)
    X = exact_motions(rng, 2)[0]
    angles = rng.uniform(0.5, 2.0, 20)
    direction = rng.uniform(0, 2 * np.pi, 20)
    from support import rotations

    axes = np.stack([np.cos(direction), np.sin(direction), np.zeros(20)], axis=1)
    A = transforms(rotations(angles[:, None] * axes), rng.normal(size=(20, 3)))
    B = np.linalg.inv(X) @ A @ X
    noise = uq.PairNoise(A=random_covariance(rng), B=random_covariance(rng))
    errors, ok = fourdpa_on_drawn(A, B, X, noise, generator(), 200)
    assert ok.all()
    np.testing.assert_allclose(errors, by_solve(X, A, B, noise, 200), atol=1e-12)


def test_trials_that_do_not_determine_X_are_marked():
    """Motions about one axis, exact on both sides but for a translation: no draw determines X."""
    rng = np.random.default_rng(SEED)
    X = exact_motions(rng, 2)[0]
    from support import rotations

    A = transforms(rotations(np.outer([0.5, 1.0, 1.5], [0.0, 0.6, 0.8])), rng.normal(size=(3, 3)))
    B = np.linalg.inv(X) @ A @ X
    noise = uq.PairNoise(A=np.diag([0, 0, 0, 1, 1, 1]) * 1e-6)
    errors, ok = fourdpa_on_drawn(A, B, X, noise, generator(), 5)
    assert not ok.any()
    assert (errors == 0).all()


@pytest.mark.statistical
def test_nees_and_a_wrong_covariance():
    rng = np.random.default_rng(SEED)
    X, A, B = exact_motions(rng, 40)
    noise = uq.PairNoise(A=random_covariance(rng), B=random_covariance(rng))
    T = 20_000
    errors, _ = fourdpa_on_drawn(A, B, X, noise, generator(), T)
    predicted = uq.propagate(A, B, noise, X=X)
    low, high = np.array(stats.chi2.interval(CONFIDENCE, 6 * T)) / T
    nees = np.einsum("ti,ij,tj->t", errors, np.linalg.inv(predicted), errors)
    assert low < nees.mean() < high
    assert not low < nees.mean() / 1.1**2 < high  # deviations 10 % too large
