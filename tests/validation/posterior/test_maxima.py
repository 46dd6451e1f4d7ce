"""Data that contradict each other: both maxima of a heavy-tailed posterior are sampled by their shares, and said."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from support import SEED, draw, exact_motions, moved

import uq_handeye as uq
from uq_handeye.trials.validation.posterior.sample import sample_posterior

TURN = np.array([10e-3, 0.0, 0.0])  # of X by one half of the motions, and back by the other
S = np.diag(np.repeat([1e-3, 1e-3], 3) ** 2)


@pytest.fixture(scope="module")
def contradicting():
    """20 motions: 10 A twice, B of two X that differ by 20 mrad, both halves with the same noise: fairly even odds."""
    rng = np.random.default_rng([12345, 16])  # the odds depend on the draw
    X, A, _ = exact_motions(rng, 10)
    A_noise, B_noise = draw(rng, S, (10,)), draw(rng, S, (10,))
    halves = []
    for turn in (-TURN, TURN):
        of_half = moved(X, np.append(turn, np.zeros(3)))
        halves.append(moved(np.linalg.inv(of_half) @ A @ of_half, B_noise))
    return uq.Motions(np.concatenate([moved(A, A_noise)] * 2), np.concatenate(halves)), uq.PairNoise(S, S)


def sampled(data, noise, seed):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return sample_posterior(data, noise, student_t=np.float32(2), scales=np.bool(False), samples=2000, seed=seed)


@pytest.fixture(scope="module")
def posteriors(contradicting):
    return [sampled(*contradicting, seed) for seed in (SEED, np.int64(SEED + 1))]


@pytest.mark.slow
def test_both_maxima_have_samples_and_seeds_agree_on_the_share(posteriors):
    shares, worth = [], []
    for posterior in posteriors:
        assert posterior.maxima == 2 and posterior.converged
        x = posterior.samples[:, 0]
        assert 15e-3 < np.ptp(np.quantile(x, [0.02, 0.98])) < 30e-3
        shares.append(float((x > (x.max() + x.min()) / 2).mean()))
        worth.append(posterior.diagnostics.ess_bulk[:6].min())
    error = np.sqrt(sum(0.25 / n for n in worth))
    assert all(0.1 < share < 0.9 for share in shares), shares
    assert abs(shares[0] - shares[1]) < 4 * error


@pytest.mark.slow
def test_two_maxima_are_said_in_words(posteriors):
    posterior = posteriors[0]
    text = " ".join(posterior.summary().split())
    assert (
        "The posterior has 2 separate maxima: the data contradict each other. Mean and covariance describe neither; "
        "look at the corner plot and the samples."
    ) in text
    assert "maxima" not in replace(posterior, maxima=1).summary()
    assert "3 separate maxima" in replace(posterior, maxima=3).summary()
    assert "none of them" in replace(posterior, maxima=3).summary()
    assert posterior.to_dict()["maxima"] == 2


@pytest.mark.slow
def test_repr_is_short(posteriors):
    posterior = posteriors[0]
    assert repr(posterior).startswith("Posterior(X, ") and repr(posterior).endswith(" samples, 2 maxima)")
    assert len(repr(posterior)) < 100


@pytest.mark.slow
def test_numpy_scalars_are_numbers(posteriors, contradicting):
    region = posteriors[0].hpd(np.float32(0.5))
    assert region.level == 0.5 and type(region.level) is float
    assert posteriors[0].student_t == 2.0 and isinstance(posteriors[0].student_t, float)
    for level in (True, np.bool(True), 1.0, "0.9"):
        with pytest.raises(uq.InputError, match="`level`"):
            posteriors[0].hpd(level)
    with pytest.raises(uq.InputError, match="`student_t`"):
        sample_posterior(*contradicting, student_t=np.bool(True))
