"""calibrate() at the bound: the numbers of its parts, noise from the data, other covariances, motions."""

import json
from dataclasses import replace

import numpy as np
import pytest
from fixtures.rigs import CLOSE, FITS, NOISE, PAIR_NOISE, SETUPS, motions_alone, quietly
from scipy import stats
from support import (
    CONFIDENCE,
    SEED,
    assert_same_covariance,
    difference,
    nees,
)

import uq_handeye as uq
from uq_handeye.errors import SingularNoiseError
from uq_handeye.fit.diagnostics.resampled import resampled
from uq_handeye.fit.graph.gauss_helmert import bound, efficient
from uq_handeye.fit.graph.reference import Reference
from uq_handeye.fit.graph.request import OF_RESIDUALS as KINDS

# --------------------------------------------------------------------------------- the estimate, 4DPA beside it, W


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("method", FITS)
def test_is_the_fit_of_likelihood(method, setup):
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    result, fitted = quietly(poses, noise=NOISE, method=method), FITS[method](poses, NOISE)
    np.testing.assert_allclose(result.X, fitted.X, atol=1e-12)
    np.testing.assert_allclose(result.W, fitted.W, atol=1e-12)
    assert_same_covariance(result.covariance, fitted.covariance_X, CLOSE)
    assert_same_covariance(result.covariance_W, fitted.covariance_W, CLOSE)
    np.testing.assert_array_equal(result.bound, result.covariance)
    assert (result.method, result.scale, result.kind, result.covariance_kind) == (method, None, "poses", "model")
    assert result.iterations == (fitted.iterations if method == "ml" else 0)
    assert result.reference == Reference() and result.noise_estimate is None
    assert result.quantile(0.95) == pytest.approx(stats.chi2.ppf(0.95, 6))
    assert result.frame_W == ("base_T_target" if setup == "eye-in-hand" else "gripper_T_target")
    assert result.fit.dof == 6 * 20 - 12
    assert result.fit.chi2 == pytest.approx((fitted.white[0] ** 2).sum(), rel=CLOSE)


@pytest.mark.slow
def test_efficient_is_the_default(poses, given):
    again = quietly(poses, noise=NOISE, method="efficient")
    assert given.to_json() == again.to_json()
    assert quietly(poses, noise=NOISE, kind="poses").method == "efficient"
    for options in ({"scale": 1e4}, {"kind": "pairs"}):
        assert quietly(poses, noise=NOISE, **options).method == "4dpa"


@pytest.mark.parametrize("setup", SETUPS)
def test_4dpa_stands_beside_it(setup):
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED + 1)
    motions = uq.relative_motions(poses, "all")
    for method in FITS:
        result = quietly(poses, noise=NOISE, method=method)
        np.testing.assert_allclose(result.fourdpa.X, uq.solve(motions.A, motions.B), atol=1e-12)
        assert_same_covariance(result.fourdpa.covariance, uq.propagate(motions, NOISE), CLOSE)
        ratio = np.sqrt(np.diag(result.fourdpa.covariance) / np.diag(result.bound))
        np.testing.assert_allclose(result.efficiency, ratio)
        # the bound is taken at corrected poses, 4DPA's covariance at measured ones: 1 % at this noise
        assert (result.efficiency > 0.99).all() and result.efficiency.max() > 1.02
        assert np.linalg.eigvalsh(result.fourdpa.covariance - 0.98 * result.bound).min() > 0
    alone = quietly(poses, noise=NOISE, method="4dpa")
    np.testing.assert_allclose(alone.X, result.fourdpa.X, atol=1e-12)
    assert alone.bound is alone.fourdpa is alone.efficiency is alone.fit is alone.table is alone.analysis is None


@pytest.mark.parametrize("setup", SETUPS)
def test_the_bound_is_that_of_the_truth(setup):
    """To a percent: the derivatives at poses as they were corrected, and at true ones."""
    poses = uq.simulate(40, noise=NOISE, setup=setup, seed=SEED)
    assert_same_covariance(quietly(poses, noise=NOISE).bound, bound(poses, NOISE), 0.03)


def test_pairs_serve_4dpa_and_the_residuals_alone(poses, given):
    few = quietly(poses, noise=NOISE, pairs="consecutive")
    assert nees(difference(few.X, given.X)[None], given.covariance)[0] < 1e-6  # another start, the same answer
    assert (few.n_pairs, few.residuals.pairs, given.n_pairs) == (19, 19, 190)
    assert np.abs(few.fourdpa.X - given.fourdpa.X).max() > 1e-6


# ----------------------------------------------------------------------------------------------- noise from the data


@pytest.mark.slow
@pytest.mark.parametrize("method", FITS)
def test_noise_is_estimated_where_none_is_given(poses, method):
    result = quietly(poses, method=method, shared=[])
    estimate = uq.estimate_noise(poses)
    assert result.noise_estimate is not None and result.noise is result.noise_estimate.noise
    for component in estimate.components:
        assert result.noise_estimate[component.name].size == pytest.approx(component.size, rel=0.02, abs=1e-6)
    fitted = FITS[method](poses, result.noise)
    if all(flag == "kept" for flag in result.table.flag):
        np.testing.assert_allclose(result.X, fitted.X, atol=1e-6)
        assert_same_covariance(result.bound, fitted.covariance_X, 1e-3)
    more = result.covariance - result.bound  # what the open sizes add
    assert np.linalg.eigvalsh(more).min() > -1e-12 and np.trace(more) > 0
    assert result.reference.kind == "t" and result.quantile(0.95) > stats.chi2.ppf(0.95, 6)
    motions = uq.relative_motions(poses, "all")
    assert_same_covariance(result.fourdpa.covariance, uq.propagate(motions, result.noise), CLOSE)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "park", "li"])
def test_published_methods_take_the_same_noise(poses, method):
    result = quietly(poses, method=method)
    assert result.reference.kind == "t" and result.noise_estimate is not None and not result.warnings
    again = quietly(poses, method=method, noise=result.noise)
    np.testing.assert_array_equal(result.X, again.X)
    np.testing.assert_array_equal(result.covariance, again.covariance)
    np.testing.assert_array_equal(result.covariance_W, again.covariance_W)
    assert (again.reference.kind, again.noise_estimate) == ("chi-square", None)


@pytest.mark.slow
def test_a_prior_passes_through(poses):
    fixed = quietly(poses, prior=uq.NoisePrior(robot=(None, "0.07mm"), factor=1)).noise_estimate
    assert (fixed["robot translation"].status, fixed["robot translation"].size) == ("fixed", pytest.approx(7e-5))
    near = quietly(poses, prior=uq.NoisePrior(robot=("0.02deg", "0.05mm"), factor=1.2)).noise_estimate
    assert near["robot rotation"].status == "prior"
    assert np.degrees(near["robot rotation"].size) == pytest.approx(0.02, rel=0.5)
    for options in ({"robust": False}, {"method": "4dpa"}):
        result = quietly(poses, prior=uq.NoisePrior(robot=(None, "0.07mm"), factor=1), **options)
        assert result.noise_estimate["robot translation"].size == pytest.approx(7e-5)


@pytest.mark.slow
def test_noise_that_is_known_in_full_has_its_own_reference(poses):
    """Result with every component fixed: nothing is estimated, as with that noise given."""
    prior = uq.NoisePrior(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"), factor=1)
    for method in ("efficient", "4dpa"):
        result = quietly(poses, prior=prior, method=method, robust=False, shared=[])
        known = quietly(poses, noise=NOISE, method=method)
        assert result.reference == known.reference and result.quantile() == known.quantile()
        assert_same_covariance(result.covariance, known.covariance, CLOSE)
        assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()
        assert "nan" not in result.summary()


def test_refuses_what_contradicts_itself(poses):
    for options, match in (
        ({"prior": uq.NoisePrior(robot=(None, "1mm")), "noise": NOISE}, "either `noise` or.*`prior`; not both"),
        ({"robust": True, "method": "park"}, "'park' takes no robust weights"),
        ({"robust": True, "method": "li", "noise": NOISE}, "'li' takes no robust weights"),
        ({"kind": "pairs", "method": "efficient"}, "kind='pairs' with method 'efficient'"),
        ({"scale": 1e4, "method": "ml"}, "no `scale` with method 'ml'"),
        ({"covariance": "magic"}, "`covariance` to be one of model, sandwich"),
        ({"method": "magic"}, "`method` to be one of efficient, ml, tsai"),
    ):
        with pytest.raises(uq.InputError, match=match):
            uq.calibrate(poses, **options)


@pytest.mark.slow
def test_exact_data_have_no_noise_to_estimate(poses):
    exact = uq.PosePairs(poses.truth.robot, poses.truth.camera)
    for method in ("efficient", "ml", "4dpa"):
        result = uq.calibrate(exact, method=method)
        np.testing.assert_allclose(result.X, poses.truth.X, atol=1e-11)
        assert result.covariance is result.covariance_W is result.noise is result.bound is None
        assert result.noise_estimate.noise is None and "rounding level" in result.noise_estimate.statement[0]
        assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()


@pytest.mark.statistical
def test_the_95_percent_ellipsoid_holds_95_percent():
    """The whole of calibrate() with noise estimated; an ellipsoid half as wide does not hold them."""
    trials = 100
    data = uq.simulate(30, noise=NOISE, trials=trials, seed=SEED)
    inside = narrow = 0
    for k in range(trials):
        result = quietly(uq.PosePairs(data.robot[k], data.camera[k]), shared=[])
        d2 = nees(difference(result.X, data.truth.X)[None], result.covariance)[0]
        inside += d2 <= result.quantile(0.95)
        narrow += d2 <= 0.25 * result.quantile(0.95)
    low, high = stats.binom.interval(CONFIDENCE, trials, 0.95)
    assert low <= inside <= high
    assert narrow < low


# ----------------------------------------------------------------------------------------------- other covariances


@pytest.mark.parametrize("kind", KINDS)
def test_covariance_by_residuals(poses, given, kind):
    result = quietly(poses, noise=NOISE, covariance=kind, seed=7)
    expected = resampled(poses, "efficient", kind, fit=efficient(poses, NOISE), seed=7)
    assert_same_covariance(result.covariance, expected.covariance_X, CLOSE)
    assert_same_covariance(result.covariance_W, expected.covariance_W, CLOSE)
    assert (result.covariance_kind, result.reference.kind) == (kind, "Hotelling")
    nu = expected.freedom
    assert result.reference.dof == pytest.approx(nu, rel=1e-6)
    assert result.quantile(0.95) == pytest.approx(6 * nu / (nu - 5) * stats.f.ppf(0.95, 6, nu - 5), rel=1e-6)
    np.testing.assert_array_equal(result.X, given.X)
    np.testing.assert_array_equal(result.bound, given.bound)
    assert_same_covariance(result.covariances["model"], given.covariance, CLOSE)
    assert_same_covariance(result.covariances[kind], result.covariance, CLOSE)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "park", "shah"])
def test_covariance_by_residuals_of_published_methods(poses, method):
    result = quietly(poses, noise=NOISE, covariance="sandwich", method=method)
    expected = resampled(poses, method, "sandwich", noise=NOISE)
    assert_same_covariance(result.covariance, expected.covariance_X, 1e-4)
    assert (result.covariance_kind, result.reference.kind) == ("sandwich", "Hotelling")


def test_the_split_halves_are_judged_by_the_noise_model(poses, estimated):
    """Whichever covariance is that of the result."""
    other = quietly(poses, covariance="sandwich")
    assert other.reference.kind == "Hotelling"
    assert other.split_half.sentence == estimated.split_half.sentence
    assert other.analysis.dof == estimated.analysis.dof == estimated.reference.dof


def test_side_by_side(poses, given):
    assert list(given.covariances) == ["model", *KINDS]
    assert given.analysis.reasons == {}
    fitted = efficient(poses, NOISE)
    for kind in KINDS:
        assert_same_covariance(given.covariances[kind], resampled(poses, kind=kind, fit=fitted).covariance_X, CLOSE)


def test_joint_noise_leaves_reasons():
    """Errors that poses share leave no independent residuals to resample."""
    n = 15
    shared = np.kron(np.ones((n, n)), np.diag([0, 0, 0, 0, 0, 3e-3**2]))
    noise = uq.PoseNoise(NOISE.robot, np.kron(np.eye(n), NOISE.camera) + shared)
    poses = uq.simulate(n, noise=noise, seed=SEED)
    result = quietly(poses, noise=noise)
    assert_same_covariance(result.covariances["model"], efficient(poses, noise).covariance_X, CLOSE)
    for kind in KINDS:
        assert result.covariances[kind] is None and "joint" in result.analysis.reasons[kind]
        with pytest.raises(uq.InputError, match="joint"):
            quietly(poses, noise=noise, covariance=kind)
    assert "not determined: " in result.summary(verbose=True)
    assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()


# --------------------------------------------------------------------------------------------------- singular noise


@pytest.mark.parametrize("deviations", [("1mrad", "0mm"), ("0mrad", "1mm")])
def test_noise_that_leaves_residuals_exact(deviations):
    noise = uq.PoseNoise.isotropic(camera=deviations)
    poses = uq.simulate(20, noise=noise, seed=SEED)
    with pytest.warns(uq.InputWarning, match="X is that of method '4dpa'"):
        result = uq.calibrate(poses, noise=noise)
    alone = quietly(poses, noise=noise, method="4dpa")
    assert (result.method, result.bound) == ("4dpa", None)
    assert result.provenance.options["robust"] is False  # what was recorded can be asked for again
    assert [found for found in result.findings if found.code != "calibration.unweighted"] == list(alone.findings)
    assert replace(result, findings=alone.findings).to_json() == alone.to_json()
    assert "eye-in-hand, 4dpa" in result.summary()
    for method in FITS:
        with pytest.raises(SingularNoiseError, match="or use method '4dpa'"):
            quietly(poses, noise=noise, method=method)


# ---------------------------------------------------------------------------------------------------------- motions


def test_motions_that_know_their_poses(poses, given):
    """The likelihood is of the poses, whichever motions are made of them."""
    for pairs in ("all", "consecutive"):
        result = quietly(uq.relative_motions(poses, pairs), noise=NOISE)
        assert nees(difference(result.X, given.X)[None], given.covariance)[0] < 1e-6
        assert_same_covariance(result.covariance, given.covariance, 1e-4)
        assert (result.n_poses, result.setup, len(result.table)) == (20, "eye-in-hand", 20)
        assert result.W is not None and result.kind == "poses"


def test_motions_without_poses():
    X, motions = motions_alone()
    for method in FITS:
        result, fitted = quietly(motions, noise=PAIR_NOISE, method=method), FITS[method](motions, PAIR_NOISE)
        np.testing.assert_allclose(result.X, fitted.X, atol=1e-12)
        assert_same_covariance(result.covariance, fitted.covariance_X, CLOSE)
        assert result.W is result.covariance_W is result.n_poses is result.setup is None
        assert (result.kind, result.table.item, result.fit.dof) == ("pairs", "motion", 6 * 30 - 6)
        assert_same_covariance(result.fourdpa.covariance, uq.propagate(motions, PAIR_NOISE), CLOSE)
        assert nees(difference(result.X, X)[None], result.covariance)[0] < stats.chi2.ppf(0.9999, 6)
    own = quietly(motions)
    assert isinstance(own.noise, uq.PairNoise) and own.reference.kind == "t"
    assert own.noise_estimate["B rotation"].high > 0
    with pytest.raises(uq.InputError, match="use PairNoise"):
        uq.calibrate(motions, noise=NOISE)


@pytest.mark.slow
def test_noise_of_pairs_of_poses(poses):
    """PairNoise says that the motions are independent: the likelihood is theirs."""
    for pairs in ("all", "disjoint", "consecutive"):
        result = quietly(poses, noise=PAIR_NOISE, pairs=pairs, robust=False)
        fitted = efficient(uq.relative_motions(poses, pairs), PAIR_NOISE)
        np.testing.assert_allclose(result.X, fitted.X, atol=1e-12)
        assert_same_covariance(result.covariance, fitted.covariance_X, CLOSE)
        assert (result.kind, result.table.item, len(result.table)) == ("pairs", "motion", result.n_pairs)
        assert result.covariance_W is None and result.n_poses == 20
        assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()
