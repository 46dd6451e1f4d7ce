"""The diagnostics on chains whose autocorrelation is known, and on chains that must not pass."""

import numpy as np
import pytest
from scipy.signal import lfilter

from uq_handeye.trials.validation.posterior.convergence import (
    PosteriorDiagnostics,
    autocorrelation_time,
    by_arviz,
    diagnose,
)
from uq_handeye.trials.validation.posterior.result import inference_data

NAMES = ("theta_x", "tau_y")


def autoregressive(rng, phi, steps, walkers):
    """Stationary AR(1) of variance 1: autocorrelation time (1 + phi) / (1 - phi)."""
    noise = np.sqrt(1 - phi**2) * rng.normal(size=(steps + 200, walkers))
    return lfilter([1.0], [1.0, -phi], noise, axis=0)[200:]


def chain_of(*columns):
    return np.stack(columns, axis=-1)


@pytest.mark.slow
def test_autocorrelation_time_of_a_known_process(rng):
    chain = chain_of(autoregressive(rng, 0.5, 1500, 64), autoregressive(rng, 0.8, 1500, 64))
    np.testing.assert_allclose(autocorrelation_time(chain), [3.0, 9.0], rtol=0.12)
    _, bulk, tail = by_arviz(chain)
    np.testing.assert_allclose(bulk, chain[..., 0].size / np.array([3.0, 9.0]), rtol=0.12)
    assert (tail > 0.5 * bulk).all()


def test_independent_samples_pass(rng):
    found = diagnose(rng.normal(size=(100, 64, 2)), NAMES, 0.7, 10, asked=5000)
    assert found.converged
    assert found.faults == ()
    assert found.to_dict()["converged"] is True


def failing(rng):
    good = rng.normal(size=(100, 64))
    stuck = good.copy()
    stuck[:, 3] = stuck[0, 3]
    modes = good + 0.5 * np.sign(rng.normal(size=64))
    trend = good + np.linspace(-0.5, 0.5, 100)[:, None]
    return {
        "too few": (good, 10_000, "posterior.few_samples"),
        "stuck walker": (stuck, 1000, "posterior.short_chain"),
        "two modes": (modes, 10, "posterior.r_hat"),
        "trend": (trend, 10, "posterior.r_hat"),
        "slow": (autoregressive(rng, 0.95, 500, 64), 10, "posterior.short_chain"),
        "short": (good[:3], 10, "posterior.short_chain"),
    }


@pytest.mark.parametrize("name", ["too few", "stuck walker", "two modes", "trend", "slow", "short"])
def test_what_must_not_pass(name, rng):
    bad, asked, code = failing(rng)[name]
    good = rng.normal(size=bad.shape)
    found = diagnose(chain_of(good, bad), NAMES, 0.7, 10, asked)
    assert not found.converged
    by_code = {finding.code: finding.values for finding in found.findings}
    assert code in by_code
    if code == "posterior.r_hat":  # the wrong column is named
        assert by_code[code]["name"] == "tau_y" and by_code[code]["r_hat"] == found.r_hat[1] > 1.01
    if name in ("stuck walker", "short"):
        assert by_code[code]["autocorrelation_time"] is None and "(unknown)" in found.faults[0]


def test_what_is_not_known_is_not_fulfilled():
    nothing = np.full(2, np.nan)
    found = PosteriorDiagnostics(NAMES, nothing, nothing, nothing, nothing, 0.5, 64, 100, 0, 10)
    assert len(found.faults) == 4
    assert all("unknown" in fault for fault in found.faults)
    assert found.to_dict()["r_hat"] == [None, None]


@pytest.mark.slow
def test_names_keep_their_columns(rng):
    chain = rng.normal(loc=[0.0, 5.0], size=(20, 8, 2))
    data = inference_data(chain, NAMES, np.zeros((20, 8)))
    assert data["posterior"]["tau_y"].shape == (8, 20)  # ArviZ has the chain first
    np.testing.assert_array_equal(data["posterior"]["tau_y"].values, chain[..., 1].T)
