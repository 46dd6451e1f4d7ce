"""The relations of a cross-check on covariances sampled from Wishart distributions, healthy and wrong."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from support import SEED, random_covariance, whitened_eigenvalues

from uq_handeye.core.levels import CONTRADICTED
from uq_handeye.trials.validation.cross_check.ratios import chance, ratios
from uq_handeye.trials.validation.cross_check.relations import Evidence, relations

T = 10_000


def test_ratios_are_whitened_eigenvalues():
    rng = np.random.default_rng(SEED)
    S, P = random_covariance(rng), random_covariance(rng)
    r = ratios(S, P)
    expected = np.sqrt(whitened_eigenvalues(S, P))
    assert np.allclose([r.least, r.largest], expected[[0, -1]])
    assert np.isclose(r.overall, np.sqrt(np.trace(np.linalg.solve(P, S)) / 6))
    assert (r.low, r.high, r.spread) == (1.0, 1.0, 0.0)
    part = ratios(S, P, part=slice(3, 6))
    assert np.isclose(part.largest, np.sqrt(whitened_eigenvalues(S[3:, 3:], P[3:, 3:])[-1]))


def wishart(rng, P, samples):
    """The covariance of so many draws about their mean."""
    return np.atleast_2d(stats.wishart(samples - 1, P / (samples - 1)).rvs(random_state=rng))


@pytest.mark.slow
@pytest.mark.parametrize("samples", [100, T])
def test_chance(samples):
    rng = np.random.default_rng(SEED)
    P = random_covariance(rng)
    found = [ratios(wishart(rng, P, samples), P, samples) for _ in range(400)]
    low, high = chance(samples)
    outside = sum(r.least < low or r.largest > high for r in found)
    assert outside <= stats.binom.ppf(0.999, 400, 2 * CONTRADICTED.probability)
    assert sum(abs(r.overall - 1) > r.spread for r in found) <= stats.binom.ppf(
        0.999, 400, 2 * CONTRADICTED.probability
    )
    assert max(r.largest for r in found) > 1 + 0.6 * (high - 1)  # and no wider than need be
    assert all(r.equal for r in found)
    # heavy tails widen it
    assert chance(samples, 0.5)[1] > high > chance(samples, -0.1)[1] * (1 - 1e-12)


def evidence(rng, wrong=None, scale=1.0, samples=T, on_poses=False):
    """Return the evidence of a healthy problem, with the covariance sampled of ``wrong`` from another than the
    predicted one.
    """
    bound = random_covariance(rng)
    worse = bound + random_covariance(rng, sd=2e-3)
    true = {"4dpa": worse, "nguyen": bound + random_covariance(rng, sd=5e-4), "efficient": bound, "ml": bound}
    own = np.zeros((6, 6))
    own[:3, :3], own[3:, 3:] = 1.2 * bound[:3, :3], 1.1 * bound[3:, 3:]
    covariances = {
        "4dpa-pairs": worse / (9.0 if on_poses else 1.0),
        "4dpa-literal": worse / 400,
        "nguyen-own": own,
        "nguyen-first-order": true["nguyen"],
        "efficient": bound,
        "ml": bound,
        "bound": bound,
        "posterior": wishart(rng, bound * (scale if wrong == "posterior" else 1.0), samples),
    }
    if on_poses:
        covariances["4dpa-poses"] = worse
    runs = {}
    for method, P in true.items():
        sampled = wishart(rng, P * (scale if method == wrong else 1.0), samples)
        judged = SimpleNamespace(sums=SimpleNamespace(count=samples), kurtosis=0.0, rejected=())
        runs[method] = SimpleNamespace(covariance=sampled, consistency=judged, failures=0, trials=samples)
    return Evidence(covariances, {}, runs, samples, on_poses, on_poses, True, 60)


def broken(e):
    return {r.name for r in relations(e) if r.law and r.holds is False}


@pytest.mark.slow
@pytest.mark.parametrize("samples", [200, T])
@pytest.mark.parametrize("on_poses", [False, True])
def test_healthy_covariances_break_nothing(samples, on_poses):
    rng = np.random.default_rng([SEED, samples, on_poses])
    alarms = sum(bool(broken(evidence(rng, samples=samples, on_poses=on_poses))) for _ in range(100))
    assert alarms <= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wrong", "names"),
    [
        ("4dpa", {"4dpa-first-order"}),
        ("nguyen", {"nguyen-first-order"}),
        ("efficient", {"efficient-bound"}),
        ("ml", {"ml-bound"}),
        ("posterior", {"posterior-bound"}),
    ],
)
def test_a_standard_deviation_10_percent_off_is_named(wrong, names):
    rng = np.random.default_rng(SEED)
    for _ in range(20):
        assert broken(evidence(rng, wrong, 1.1**2)) == names
        found = broken(evidence(rng, wrong, 0.85**2))
        below = {"none-below-bound"} if wrong in ("efficient", "ml") else set()
        assert names | below <= found
    # what is real but small is no alarm
    assert sum(bool(broken(evidence(rng, wrong, 1.02**2))) for _ in range(20)) == 0


def test_one_direction_alone_is_named():
    rng = np.random.default_rng(SEED)
    e = evidence(rng)
    bound = e.covariances["bound"]
    L = np.linalg.cholesky(bound)
    direction = L @ np.eye(6)[:, :1]
    changed = bound + (1 / 1.15**2 - 1) * direction @ direction.T
    assert broken(e._replace(covariances={**e.covariances, "bound": changed})) >= {"efficient-bound", "ml-bound"}


def test_what_pairs_share():
    rng = np.random.default_rng(SEED)
    e = evidence(rng, on_poses=True)
    assert {r.name: r.holds for r in relations(e)}["shared-poses"] is True
    same = {**e.covariances, "4dpa-pairs": e.covariances["4dpa-poses"]}
    assert broken(e._replace(covariances=same)) == {"shared-poses"}  # all pairs must show it
    (chosen,) = [r for r in relations(e._replace(covariances=same, all_pairs=False)) if r.name == "shared-poses"]
    assert chosen.holds is None and "no difference" in chosen.text


def test_claims_are_no_laws():
    rng = np.random.default_rng(SEED)
    e = evidence(rng)
    by_name = {r.name: r for r in relations(e)}
    assert by_name["nguyen-near-bound"].holds and by_name["nguyen-below-4dpa"].holds
    low = e.covariances["nguyen-own"].copy()
    low[3:, 3:] /= 4
    found = {r.name: r for r in relations(e._replace(covariances={**e.covariances, "nguyen-own": low}))}
    assert found["nguyen-near-bound"].holds is False and "translation" in found["nguyen-near-bound"].advice
    low[:3, :3] /= 4
    assert broken(e._replace(covariances={**e.covariances, "nguyen-own": low})) == {"nguyen-not-below-bound"}
    high = 1e4 * e.covariances["nguyen-own"]
    found = {r.name: r for r in relations(e._replace(covariances={**e.covariances, "nguyen-own": high}))}
    assert found["nguyen-below-4dpa"].holds is False and not found["nguyen-below-4dpa"].law
    literal = {**e.covariances, "4dpa-literal": e.covariances["4dpa-pairs"]}
    assert broken(e._replace(covariances=literal)) == {"literal-too-small"}


def test_heavy_tails_without_a_rejection_cannot_be_told():
    rng = np.random.default_rng(SEED)
    e = evidence(rng, on_poses=True)
    names = {"4dpa": "4dpa-first-order", "ml": "ml-bound"}
    for method, name in names.items():
        for kurtosis, rejected, scale, holds in (
            (88.0, ("mean NEES, joint",), 1.15**2, False),
            (88.0, ("mean NEES, joint",), 1.05**2, None),  # of the right size
            (88.0, (), 1.15**2, None),
            (88.0, (), 1.45**2, False),  # more than even such tails explain
            (0.4, (), 1.0, True),
        ):
            run = e.runs[method]
            tails = SimpleNamespace(sums=run.consistency.sums, kurtosis=kurtosis, rejected=rejected)
            changed = SimpleNamespace(**vars(run) | {"covariance": scale * run.covariance, "consistency": tails})
            found = {r.name: r for r in relations(e._replace(runs={**e.runs, method: changed}))}
            assert found[name].holds is holds, (method, kurtosis, scale)
            if holds is None:
                assert "cannot be told: the errors have heavy tails, which no covariance describes" in found[name].text
            if method == "4dpa":
                assert found["shared-poses"].holds is holds
    # a method that may as well be below the bound is not said to be above it
    below = SimpleNamespace(**vars(changed) | {"covariance": 0.8**2 * e.runs["ml"].covariance})
    below.consistency = SimpleNamespace(sums=run.consistency.sums, kurtosis=88.0, rejected=())
    found = {r.name: r for r in relations(e._replace(runs={**e.runs, "ml": below}))}
    assert found["none-below-bound"].holds is None and "cannot be told of ml" in found["none-below-bound"].text


def test_no_error_at_all_along_an_axis_is_no_division_by_zero():
    rng = np.random.default_rng(SEED)
    e = evidence(rng)
    exact = e.covariances["4dpa-literal"].copy()
    exact[4], exact[:, 4] = 0.0, 0.0
    found = {r.name: r for r in relations(e._replace(covariances={**e.covariances, "4dpa-literal": exact}))}
    assert found["literal-too-small"].holds is True and "inf" in found["literal-too-small"].text
