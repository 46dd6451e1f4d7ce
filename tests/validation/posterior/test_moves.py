"""The proposal and the moves: known targets, a wrong Hastings factor that shows, the first maximum."""

import emcee
import numpy as np
import pytest
from scipy import stats
from support import SEED, random_covariance

from uq_handeye.trials.validation.posterior import proposal as posterior_moves
from uq_handeye.trials.validation.posterior.proposal import (
    PROPOSAL_DOF,
    around_maxima,
    fitted,
    maximum_of,
    moves_of,
    single,
)

# A target that is neither symmetric nor near the proposals below: independent Gumbel and logistic coordinates.
TARGET = (stats.gumbel_r(), stats.logistic())


def log_target(y):
    a, b = y.T
    return -a - np.exp(-a) - b - 2.0 * np.logaddexp(0.0, -b)


def wide():
    return single(np.array([1.0, -0.5]), np.array([[1.6, 0.0], [0.4, 2.0]]))


def deviations(moves, steps=1000, walkers=64):
    """Return how far mean and variance of the samples are from those of the target, in standard deviations of their
    errors.
    """
    random = np.random.RandomState(SEED % 2**32)
    sampler = emcee.EnsembleSampler(walkers, 2, log_target, moves=moves, vectorize=True)
    state = emcee.State(random.normal(size=(walkers, 2)), random_state=random.get_state())
    state = sampler.run_mcmc(state, 100)
    sampler.reset()
    sampler.run_mcmc(state, steps)
    y = sampler.get_chain()
    found = []
    for k, one in enumerate(TARGET):
        for power, expected in ((1, 0.0), (2, one.var())):
            of_walkers = ((y[..., k] - one.mean()) ** power).mean(axis=0)  # walkers are independent but for the moves
            found.append((of_walkers.mean() - expected) / (of_walkers.std(ddof=1) / np.sqrt(walkers)))
    return np.array(found)


def test_target():
    y = np.linspace(-2.0, 3.0, 7)
    expected = TARGET[0].logpdf(y) + TARGET[1].logpdf(y)
    np.testing.assert_allclose(log_target(np.stack([y, y], axis=1)), expected, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("shares", [(1.0, 0.0, 0.0), (0.5, 0.4, 0.1), (0.8, 0.16, 0.04)])
def test_targets_stay_as_they_are(shares):
    assert np.abs(deviations(moves_of(wide(), shares))).max() < 4.5


@pytest.mark.slow
def test_a_wrong_hastings_factor_shows(monkeypatch):
    monkeypatch.setattr(posterior_moves.Proposal, "log_density", lambda self, y: np.zeros(len(y)))
    assert np.abs(deviations(moves_of(wide(), (1.0, 0.0, 0.0)))).max() > 10.0


@pytest.mark.statistical
def test_proposal_against_scipy(rng):
    S = random_covariance(rng, 4, sd=1.0)
    proposal = single(rng.normal(size=4), np.linalg.cholesky(S))
    y = rng.normal(size=(6, 4))
    reference = stats.multivariate_t(proposal.location[0], S, df=PROPOSAL_DOF)
    expected = reference.logpdf(y)
    found = proposal.log_density(y)
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-10, atol=1e-10)
    draws = proposal.draw(np.random.RandomState(SEED % 2**32), 4000)
    z = np.linalg.solve(proposal.factor[0], (draws - proposal.location[0]).T)
    # |z|^2 / d of a multivariate t is F distributed
    assert stats.kstest((z**2).mean(axis=0), stats.f(4, PROPOSAL_DOF).cdf).pvalue > 1e-3
    assert stats.kstest(z[0], stats.t(PROPOSAL_DOF).cdf).pvalue > 1e-3
    assert stats.kstest(z[0] * 1.5, stats.t(PROPOSAL_DOF).cdf).pvalue < 1e-3


def test_fitted(rng):
    y = rng.normal(size=(500, 3))
    found = fitted(y, single(np.zeros(3), np.eye(3)))
    np.testing.assert_allclose(found.location[0], y.mean(axis=0))
    np.testing.assert_allclose(found.factor[0] @ found.factor[0].T, np.cov(y.T))
    least = single(np.ones(3), 2 * np.eye(3))
    np.testing.assert_array_equal(fitted(np.zeros((500, 3)), least).factor, least.factor)


def test_maximum_of_a_gaussian(rng):
    S, middle = random_covariance(rng, 5, sd=1.0, spread=2.0), 4.0 * rng.normal(size=5)
    inverse = np.linalg.inv(S)
    found = maximum_of(lambda y: -0.5 * np.einsum("ki,ij,kj->k", y - middle, inverse, y - middle), np.zeros(5))
    np.testing.assert_allclose(found.location, middle, atol=0.1)
    np.testing.assert_allclose(found.factor @ found.factor.T, S, rtol=1e-5, atol=1e-6)


def test_maximum_where_the_density_is_not_concave():
    found = maximum_of(lambda y: -3.0 * np.log1p(((y - [6.0, -4.0]) ** 2).sum(axis=1) / 4.0), np.zeros(2))
    np.testing.assert_allclose(found.location, [6.0, -4.0], atol=0.1)


def test_maximum_beside_impossible_values():
    """Scales out of range have the density 0; Newton stays where it is possible."""
    found = maximum_of(lambda y: np.where(y[:, 0] > 2.5, -np.inf, -0.5 * (y[:, 0] - 2.0) ** 2), np.zeros(1))
    assert np.isfinite(found.factor).all()
    assert abs(found.location[0] - 2.0) < 0.1


def two_maxima(y):
    """Log of 0.3 N((-9, 0), I) + 0.7 N((9, 2), diag(4, 1)), not normalised otherwise."""
    one = np.log(0.3) - 0.5 * ((y[:, 0] + 9) ** 2 + y[:, 1] ** 2)
    other = np.log(0.7 / 2) - 0.5 * ((y[:, 0] - 9) ** 2 / 4 + (y[:, 1] - 2) ** 2)
    return np.logaddexp(one, other)


STARTS = np.array([[0.0, 0.0], [-8.0, 0.0], [7.0, 1.0], [9.5, 2.5]])


def test_maxima_with_their_shares():
    found = around_maxima(two_maxima, STARTS)
    np.testing.assert_allclose(found.location, [[9, 2], [-9, 0]], atol=0.1)
    np.testing.assert_allclose(found.weight, [0.7, 0.3], rtol=1e-2)
    alone = around_maxima(lambda y: np.where(y[:, 0] < 0, two_maxima(y) - 20.0, two_maxima(y)), STARTS)
    np.testing.assert_allclose(alone.location, [[9, 2]], atol=0.1)


@pytest.mark.statistical
def test_a_mixture_against_its_parts(rng):
    mixture = around_maxima(two_maxima, STARTS)
    y = 10.0 * rng.normal(size=(50, 2))
    parts = [
        w * stats.multivariate_t(m, L @ L.T, df=PROPOSAL_DOF).pdf(y)
        for m, L, w in zip(mixture.location, mixture.factor, mixture.weight, strict=True)
    ]
    expected = np.log(sum(parts))
    found = mixture.log_density(y)
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-9, atol=1e-9)
    draws = mixture.draw(np.random.RandomState(SEED % 2**32), 4000)
    assert stats.binomtest(int((draws[:, 0] > 0).sum()), 4000, mixture.weight[0]).pvalue > 1e-3
    refitted = fitted(draws, mixture)
    np.testing.assert_allclose(refitted.location, mixture.location, atol=0.2)
    assert abs(refitted.weight[0] - mixture.weight[0]) < 0.03
