"""One uncertainty everywhere: covariance, budget, accuracy, tolerance, plan, certificate, files read the posterior."""

from dataclasses import replace

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.fit.diagnostics.budget import parts_of_posterior
from uq_handeye.model.errors.keys import SIZES_OPEN
from uq_handeye.report.budget import worst_of

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
CASES = {
    "noise given": {"noise": NOISE},
    "errors declared": {
        "noise": NOISE,
        "shared": [uq.SharedError.target_scale(1e-3), uq.SharedError.focal_length(1e-3)],
    },
    "sizes open": {},
}


@pytest.fixture(scope="module", params=CASES)
def result(request):
    return uq.calibrate(uq.simulate(n_poses=20, noise=NOISE, seed=11), **CASES[request.param])


def test_all_parts_speak_of_the_covariance_of_the_posterior(result):
    P = result.posterior.covariance_of("X")
    unit = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(result.covariance / unit, P / unit, atol=1e-9)
    np.testing.assert_allclose(result.covariance_W, result.posterior.covariance_of("W"), rtol=1e-6, atol=1e-18)
    np.testing.assert_allclose(result.budget.covariance[:6, :6] / unit, P / unit, atol=1e-6)
    worst = [np.sqrt(np.linalg.eigvalsh(P[part, part])[-1]) for part in (slice(3, 6), slice(0, 3))]
    assert [result.accuracy.translation, result.accuracy.rotation] == pytest.approx(worst, rel=1e-6)
    assert [one.u for one in worst_of(result)[:2]] == pytest.approx(worst, rel=1e-6)


def test_a_tolerance_is_asked_of_the_mixture_over_the_sizes(result, rng):
    limit = 2.0 * result.accuracy.translation
    weights, means, covariances = result.posterior.mixture_of("X")
    of = rng.choice(len(weights), 100_000, p=weights / weights.sum())
    move = np.empty((len(of), 3))
    for d in range(len(weights)):
        some = of == d
        move[some] = means[d, 3:] + rng.multivariate_normal(np.zeros(3), covariances[d, 3:, 3:], int(some.sum()))
    assert result.verdict((limit, None)).probability == pytest.approx(
        np.mean(np.linalg.norm(move, axis=1) < limit), abs=6e-3
    )


def test_a_file_has_the_same(result):
    stored = uq.Calibration.from_dict(result.to_dict())
    limit = 1.7 * result.accuracy.translation
    np.testing.assert_allclose(stored.posterior.covariance, result.posterior.covariance, rtol=1e-9, atol=1e-15)
    both = [of.verdict((limit, None)).probability for of in (result, stored)]
    assert both[0] == pytest.approx(both[1], abs=2e-3)


def test_estimates_of_errors_are_those_of_the_posterior(result):
    of = {name: k for k, name in enumerate(result.posterior.names)}
    assert {error.name for error in result.shared} <= of.keys()
    for error in result.shared:
        assert error.estimate == pytest.approx(float(result.posterior.estimate[of[error.name]]), abs=1e-12)


def test_deviations_of_errors_are_those_of_the_posterior(result):
    """Over the sizes that are open: not less certain than the sizes leave them."""
    sd = dict(zip(result.posterior.names, np.sqrt(np.diag(result.posterior.covariance)[12:]), strict=True))
    for error, settled in zip(result.shared, result.shared_at_sizes, strict=True):
        assert error.sd == pytest.approx(sd[error.name], rel=1e-9)
        assert error.resolved == settled.resolved
    if result.posterior.points is not None:
        more = [e.sd / s.sd for e, s in zip(result.shared, result.shared_at_sizes, strict=True)]
        assert min(more) > 0.99 and max(more) > 1.2


def test_the_budget_is_that_of_the_posterior(result):
    """Errors with what the mixture makes of them, sizes by what they move X, the noise of the poses the rest."""
    P, of = result.posterior, result.budget
    parts = parts_of_posterior(P, {error.key: error.size for error in result.shared})
    unit = np.sqrt(np.outer(*[np.diag(P.covariance)[:12]] * 2))
    for key, S in parts.items():
        np.testing.assert_allclose(of.covariances[of.keys.index((key,))] / unit, S / unit, atol=1e-6)
    if P.points is not None:
        w, m, C = P.mixture_of("X", "W")
        effect = sum(w[:, None, None] * C) + (w * m.T) @ m
        np.testing.assert_allclose(effect / unit, of.covariance / unit, atol=1e-6)
        assert np.abs(np.diag(parts[SIZES_OPEN]) / np.diag(of.covariance)).max() < 0.3
    noise = of.covariance - sum(parts.values(), np.zeros((12, 12)))
    assert np.linalg.eigvalsh(noise / unit)[0] > -1e-9


def test_a_plan_starts_from_it():
    poses = uq.simulate(n_poses=15, noise=NOISE, seed=3)
    found, result = uq.plan(poses, k=1, noise=NOISE), uq.calibrate(poses, noise=NOISE)
    np.testing.assert_allclose(found.covariance_before, result.posterior.covariance_of("X"), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("shared", [None, [uq.SharedError.target_scale(1e-3)]])
def test_the_budget_of_a_result_that_took_poses_in_is_that_of_the_fit_of_all(shared):
    poses = uq.simulate(n_poses=24, noise=NOISE, seed=11)
    first, both = (uq.calibrate(poses.rows(range(n)), noise=NOISE, shared=shared) for n in (16, 24))
    assert first.has_budget and first.budget.sources[0] == "robot rotation"
    without = replace(first, provenance=replace(first.provenance, request=None))
    found = uq.update(without, poses.rows(range(16, 24)), although_changed=True)
    assert found.has_budget and found.budget.sources[0] == "noise of the poses"
    np.testing.assert_allclose(found.budget.covariance[:6, :6], found.covariance, rtol=1e-9, atol=1e-18)
    for source in found.budget.sources[1:]:  # the shares of errors
        one, other = (of.budget.group_shares["X translation"][of.budget.sources.index(source)] for of in (found, both))
        assert one == pytest.approx(other, abs=0.01)
    assert found.accuracy.parts[0].name == "noise of the poses"
