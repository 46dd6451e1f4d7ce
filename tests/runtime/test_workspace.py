"""Kept work arrays never reach a result, and threads do not share them."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from support import noisy_motions, random_covariance

import uq_handeye as uq
from uq_handeye.core.scratch import MAX_KEPT_NUMBERS, scratch


def test_kept_and_not_kept():
    assert np.shares_memory(scratch("test", 3, 4), scratch("test", 12))
    assert not np.shares_memory(scratch("test", 3), scratch("other", 3))
    assert not np.shares_memory(scratch("test", MAX_KEPT_NUMBERS + 1), scratch("test", MAX_KEPT_NUMBERS + 1))


def test_results_stay(rng):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, *first = noisy_motions(rng, 30)
    _, *second = noisy_motions(rng, 30)
    X, covariance = uq.solve(*first), uq.propagate(*first, noise)
    kept = X.copy(), covariance.copy()
    uq.propagate(*second, noise, X=uq.solve(*second))
    np.testing.assert_array_equal(X, kept[0])
    np.testing.assert_array_equal(covariance, kept[1])


def test_threads(rng):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    problems = [noisy_motions(rng, N)[1:] for N in (5, 40, 300, 1500) * 8]

    def work(problem):
        return np.concatenate([uq.solve(*problem).ravel(), uq.propagate(*problem, noise).ravel()])

    alone = [work(problem) for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(alone, pool.map(work, problems), strict=True):
            np.testing.assert_array_equal(one, other)
