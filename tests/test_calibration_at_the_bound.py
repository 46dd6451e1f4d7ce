"""calibrate() at the bound: the numbers of its parts, noise from the data, robustness, and what it says of all this."""

import json
import re
import warnings

import numpy as np
import pytest
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline
from support import (
    CONFIDENCE,
    SEED,
    assert_same_covariance,
    difference,
    draw,
    jacobian,
    moved,
    nees,
    random_covariance,
    random_transforms,
    transforms,
)

import uq_handeye as uq
from uq_handeye.errors import SingularNoiseError
from uq_handeye.goodness_of_fit import effective_dof
from uq_handeye.likelihood import bound, efficient, maximum_likelihood
from uq_handeye.reference import Reference
from uq_handeye.resampling import KINDS, resampled

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
PAIR_NOISE = uq.PairNoise.isotropic(A=("0.02deg", "0.05mm"), B=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")
FITS = {"efficient": efficient, "ml": maximum_likelihood}
# Two starts of the same iteration, or JSON's digits, are this close.
CLOSE = 1e-6
# Said of every estimated noise where a common error of 0.1 % would show.
LOWER_LIMIT = "The standard deviations are a lower limit"


def motions_alone(n=30, seed=SEED):
    """Independent motions that come without poses, with the noise of PAIR_NOISE."""
    rng = np.random.default_rng(seed)
    X, B = random_transforms(rng), random_transforms(rng, (n,), largest=2.0)
    A = X @ B @ np.linalg.inv(X)
    return X, uq.Motions(moved(A, draw(rng, PAIR_NOISE.A, (n,))), moved(B, draw(rng, PAIR_NOISE.B, (n,))))


def with_wrong(poses, row, metres=0.05):
    camera = poses.camera.copy()
    camera[row, 0, 3] += metres
    return uq.PosePairs(poses.robot, camera, poses.setup)


def quietly(data, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return uq.calibrate(data, **options)


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(20, noise=NOISE, seed=SEED)


@pytest.fixture(scope="module")
def given(poses):
    return quietly(poses, noise=NOISE)


@pytest.fixture(scope="module")
def estimated(poses):
    return quietly(poses)


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


@pytest.mark.parametrize("method", FITS)
def test_noise_is_estimated_where_none_is_given(poses, method):
    result = quietly(poses, method=method)
    estimate = uq.estimate_noise(poses)
    assert result.noise_estimate is not None and result.noise is result.noise_estimate.noise
    for component in estimate.components:
        assert result.noise_estimate[component.name].value == pytest.approx(component.value, rel=0.02, abs=1e-6)
    fitted = FITS[method](poses, result.noise)
    if all(flag == "kept" for flag in result.table.flag):
        np.testing.assert_allclose(result.X, fitted.X, atol=1e-6)
        assert_same_covariance(result.covariance, fitted.covariance_X, 1e-3)
    assert result.reference.kind == "F"
    assert result.reference.dof == pytest.approx(effective_dof(fitted, estimate), rel=0.02)
    assert result.quantile(0.95) == pytest.approx(6 * stats.f.ppf(0.95, 6, result.reference.dof), rel=1e-9)
    assert result.quantile(0.95) > stats.chi2.ppf(0.95, 6)
    motions = uq.relative_motions(poses, "all")
    assert_same_covariance(result.fourdpa.covariance, uq.propagate(motions, result.noise), CLOSE)


@pytest.mark.parametrize("method", ["4dpa", "park", "li"])
def test_published_methods_take_the_same_noise(poses, method):
    result = quietly(poses, method=method)
    assert result.reference.kind == "F" and result.noise_estimate is not None and not result.warnings
    again = quietly(poses, method=method, noise=result.noise)
    np.testing.assert_array_equal(result.X, again.X)
    np.testing.assert_array_equal(result.covariance, again.covariance)
    np.testing.assert_array_equal(result.covariance_W, again.covariance_W)
    assert (again.reference.kind, again.noise_estimate) == ("chi-square", None)


def test_a_prior_passes_through(poses):
    fixed = quietly(poses, prior=uq.NoisePrior(robot=(None, "0.07mm"), factor=1)).noise_estimate
    assert (fixed["robot translation"].status, fixed["robot translation"].value) == ("fixed", pytest.approx(7e-5))
    near = quietly(poses, prior=uq.NoisePrior(robot=("0.02deg", "0.05mm"), factor=1.2)).noise_estimate
    assert near["robot rotation"].status == "prior"
    assert np.degrees(near["robot rotation"].value) == pytest.approx(0.02, rel=0.5)
    for options in ({"robust": False}, {"method": "4dpa"}):
        result = quietly(poses, prior=uq.NoisePrior(robot=(None, "0.07mm"), factor=1), **options)
        assert result.noise_estimate["robot translation"].value == pytest.approx(7e-5)


def test_noise_that_is_known_in_full_has_its_own_reference(poses):
    """With every component fixed nothing is estimated: as with that noise given."""
    prior = uq.NoisePrior(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"), factor=1)
    for method in ("efficient", "4dpa"):
        result = quietly(poses, prior=prior, method=method, robust=False)
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


def test_exact_data_have_no_noise_to_estimate(poses):
    exact = uq.PosePairs(poses.truth.robot, poses.truth.camera)
    for method in ("efficient", "ml", "4dpa"):
        result = uq.calibrate(exact, method=method)
        np.testing.assert_allclose(result.X, poses.truth.X, atol=1e-11)
        assert result.covariance is result.covariance_W is result.noise is result.bound is None
        assert result.noise_estimate.noise is None and "rounding level" in result.noise_estimate.statement[0]
        assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()


def test_the_95_percent_ellipsoid_holds_95_percent():
    """The whole of calibrate() with nothing given; an ellipsoid half as wide does not hold them."""
    trials = 200
    data = uq.simulate(30, noise=NOISE, trials=trials, seed=SEED)
    inside = narrow = 0
    for k in range(trials):
        result = quietly(uq.PosePairs(data.robot[k], data.camera[k]))
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
    assert "not determined: " in result.summary()
    assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()


# ------------------------------------------------------------------------------------------------------- robustness


@pytest.mark.parametrize("options", [{}, {"noise": NOISE, "robust": True}, {"method": "ml"}])
@pytest.mark.parametrize("setup", SETUPS)
def test_a_wrong_detection_is_found_and_named(options, setup):
    clean = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    data, rest = with_wrong(clean, 4), np.delete(np.arange(20), 4)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = uq.calibrate(data, **options)
    assert [str(warning.message) for warning in caught] == list(result.warnings)
    assert result.warnings[0].startswith(
        "1 of 20 poses do not fit the others and took no part in the estimate: pose 4 ("
    )
    assert result.table.rejected == [4] and result.table.weight[4] == 0 and result.table.flag[4] == "rejected"
    assert any("pose 4 (" in text for text in result.warnings)
    reference = quietly(clean.rows(rest), **{**options, "robust": False})
    shift = difference(result.X, reference.X)
    # 0: the good poses count in full; but for one in 1000 that is weighted down
    assert shift @ np.linalg.solve(reference.covariance, shift) < 0.5
    assert np.sqrt(nees(difference(result.X, clean.truth.X)[None], result.covariance))[0] < 6
    data_out = json.loads(result.to_json())
    assert data_out["poses"]["flag"][4] == "rejected" and any("pose 4 (" in text for text in data_out["warnings"])
    assert "pose 4: " in result.summary() and "rejected" in result.summary()
    assert result.to_dict()["n_poses"] == 20


def test_a_plain_fit_names_a_gross_error_and_keeps_it(poses):
    data = with_wrong(poses, 4)
    for options in ({"noise": NOISE}, {"noise": NOISE, "robust": False}):
        result = quietly(data, **options)
        np.testing.assert_allclose(result.X, efficient(data, NOISE).X, atol=1e-9)
        assert (result.table.weight == 1).all() and "outlier" in result.table.flag
        (text,) = [text for text in result.warnings if "robust=True" in text]
        assert text.startswith("1 of 20 poses do not fit the others; the estimate has them in") and "pose 4 (" in text
    data = with_wrong(poses, 4, metres=0.2)
    spoilt, robust = (
        nees(difference(quietly(data, noise=NOISE, robust=r).X, poses.truth.X)[None], bound(poses, NOISE))[0]
        for r in (False, True)
    )
    assert robust < stats.chi2.ppf(0.9999, 6) < spoilt / 5


def test_clean_data_are_silent_and_whole():
    """Nobody is rejected without a word: table, warnings and JSON tell the same."""
    silent = 0
    for seed in range(10):
        result = quietly(uq.simulate(20, noise=NOISE, seed=np.random.default_rng([SEED, seed])))
        flagged = result.table.flagged
        assert [k for k, w in enumerate(result.table.weight) if w < 1] == flagged
        for k in flagged:
            assert any(f"pose {k} (" in text for text in result.warnings)
        assert json.loads(result.to_json())["warnings"] == list(result.warnings)
        silent += all(LOWER_LIMIT in text for text in result.warnings)
    # 20 poses at one in 1000, and a few tests at one in 1000
    assert silent >= stats.binom.ppf(0.0005, 10, 0.95)


def smooth(n, rng, every=12, still=0):
    """A smooth path with noise, ``every`` poses from one view to the next; ``still`` poses at rest at its start."""
    key = uq.simulate(n // every + 4, seed=rng)
    knots = np.arange(len(key))
    frames = np.clip((np.arange(n) - still) / every, 0, None)
    R = RotationSpline(knots, Rotation.from_matrix(key.robot[:, :3, :3]))(frames).as_matrix()
    robot = transforms(R, CubicSpline(knots, key.robot[:, :3, 3])(frames))
    camera = np.linalg.inv(robot @ key.truth.X) @ key.truth.W
    return uq.PosePairs(moved(robot, draw(rng, NOISE.robot, (n,))), moved(camera, draw(rng, NOISE.camera, (n,))))


@pytest.mark.parametrize("noise", [None, NOISE])
@pytest.mark.parametrize("still", [0, 15])
def test_a_shifted_pairing_is_said(noise, still):
    poses = smooth(90, np.random.default_rng(SEED), still=still)
    shifted = uq.PosePairs(poses.robot, np.roll(poses.camera, 1, axis=0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = uq.calibrate(shifted, noise=noise)
        except (uq.InputError, uq.NotConvergedError):
            result = None
    texts = [str(warning.message) for warning in caught]
    assert any("row" in text and "shift" in text for text in texts), texts
    if result is not None:
        assert list(result.warnings) == texts
    assert not any("shift" in text for text in quietly(poses, noise=noise).warnings)


def test_static_views_rolled_by_one_are_said(poses):
    shifted = uq.PosePairs(poses.robot, np.roll(poses.camera, 1, axis=0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with pytest.raises((uq.InputError, uq.NotConvergedError)):
            uq.calibrate(shifted)
    texts = [str(warning.message) for warning in caught]
    assert any("belong together" in text for text in texts) and any("shift" in text for text in texts), texts


# ------------------------------------------------------------------------------------------------------------- JSON


def cases():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    _, alone = motions_alone()
    return {
        "efficient": (poses, {"noise": NOISE}),
        "ml": (poses, {"noise": NOISE, "method": "ml"}),
        "robust": (with_wrong(poses, 4), {"noise": NOISE, "robust": True}),
        "estimated": (poses, {}),
        "estimated, wrong ones": (with_wrong(poses, 4), {}),
        "prior": (poses, {"prior": uq.NoisePrior(robot=(None, "0.05mm"))}),
        "eye-to-hand": (uq.simulate(20, noise=NOISE, setup="eye-to-hand", seed=SEED), {"noise": NOISE}),
        "motions": (alone, {"noise": PAIR_NOISE}),
        "motions, estimated": (alone, {}),
        "sandwich": (poses, {"covariance": "sandwich"}),
        "4dpa": (poses, {"noise": NOISE, "method": "4dpa"}),
        "park, estimated": (poses, {"method": "park"}),
        "shah": (poses, {"noise": NOISE, "method": "shah"}),
    }


@pytest.mark.parametrize("name", cases())
def test_json_round_trip_and_summary(name):
    data, options = cases()[name]
    result = quietly(data, **options)
    text = result.to_json()
    again = uq.Calibration.from_dict(json.loads(text))
    assert again.to_json() == text
    assert again.summary() == result.summary()
    for field in ("X", "covariance", "W", "covariance_W", "bound", "efficiency"):
        value, read = getattr(result, field), getattr(again, field)
        assert (value is None) == (read is None)
        if value is not None:
            np.testing.assert_array_equal(read, value)
    assert again.reference == result.reference and again.fit == result.fit and again.warnings == result.warnings
    if result.analysis is not None:
        assert again.split_half.sentence == result.split_half.sentence
        assert again.diagnostics.sentences() == result.diagnostics.sentences()
        np.testing.assert_allclose(again.budget.shares, result.budget.shares)
        assert again.budget.sources == result.budget.sources
    assert max(map(len, result.summary().splitlines())) <= 120
    assert "nan" not in result.summary().lower().split() and "None" not in result.summary()


def test_damaged_parts_are_refused(estimated):
    data = json.loads(estimated.to_json())
    changes = [
        (key, value) for key in ("fit", "poses", "analysis", "noise_estimate", "4dpa") for value in ("abc", [], 3)
    ]
    changes += [
        ("reference", {"kind": "F", "dof": None}),
        ("reference", {"kind": "F", "dof": -3}),
        ("reference", "F"),
        ("bound", [[1.0]]),
        ("covariance_kind", 3),
        ("fit", {**data["fit"], "more": 1}),
        ("4dpa", {"X": np.eye(3).tolist(), "covariance": None}),
        ("poses", data["poses"] | {"weight": [1.0]}),
        ("poses", data["poses"] | {"distance2": [None] * 20}),
        ("noise_estimate", data["noise_estimate"] | {"components": [{"name": "x"}]}),
        *[
            ("analysis", data["analysis"] | {part: value})
            for part in ("diagnostics", "covariances", "split_half", "split_in_time", "budget", "reasons")
            for value in ("abc", 3)
        ],
        ("analysis", data["analysis"] | {"covariances": {"model": [[1.0]]}}),
        ("analysis", data["analysis"] | {"budget": {"sources": ["a"]}}),
    ]
    for key, value in changes:
        with pytest.raises(uq.InputError):
            uq.Calibration.from_dict(data | {key: value})
    for key in data["analysis"]:
        with pytest.raises(uq.InputError, match="damaged"):
            uq.Calibration.from_dict(data | {"analysis": {k: v for k, v in data["analysis"].items() if k != key}})


# --------------------------------------------------------------------------------------------------- singular noise


@pytest.mark.parametrize("deviations", [("1mrad", "0mm"), ("0mrad", "1mm")])
def test_noise_that_leaves_residuals_exact(deviations):
    noise = uq.PoseNoise.isotropic(camera=deviations)
    poses = uq.simulate(20, noise=noise, seed=SEED)
    result = quietly(poses, noise=noise)
    alone = quietly(poses, noise=noise, method="4dpa")
    assert (result.method, result.bound) == ("4dpa", None)
    assert result.to_json() == alone.to_json()
    assert "by 4dpa from" in result.summary()
    for method in FITS:
        with pytest.raises(SingularNoiseError, match="or use method '4dpa'"):
            quietly(poses, noise=noise, method=method)


# ------------------------------------------------------------------------------------------------------- task space


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("way", ["X", "robot", "target"])
def test_uncertainty_of_points(way, setup, rng):
    """Against a numerical derivative of the chain of poses, and a Monte Carlo of it."""
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    result = quietly(poses, noise=NOISE)
    T = poses.robot[3] if way == "robot" else poses.camera[3]
    S_T, S_p, p = random_covariance(rng), random_covariance(rng, 3), np.array([0.1, -0.05, 0.6])
    options = {"points_covariance": S_p}
    if way == "robot":
        options |= {"robot": T, "robot_covariance": S_T}
    elif way == "target":
        options |= {"camera": T, "camera_covariance": S_T}
    found = result.uncertainty_at(p, **options)

    def carried(x):
        """Of errors (m, 15): of X or W, of the pose, of the point."""
        points = (p + x[:, 12:])[..., None]
        pose = moved(np.tile(T, (len(x), 1, 1)), x[:, 6:12])
        if way == "target":
            chain = moved(np.tile(result.W, (len(x), 1, 1)), x[:, :6]) @ np.linalg.inv(pose)
        else:
            chain = moved(np.tile(result.X, (len(x), 1, 1)), x[:, :6])
        if way == "robot":
            chain = (pose if setup == "eye-in-hand" else np.linalg.inv(pose)) @ chain
        return (chain[:, :3, :3] @ points)[..., 0] + chain[:, :3, 3]

    S = np.zeros((15, 15))
    S[:6, :6] = result.covariance_W if way == "target" else result.covariance
    if way != "X":
        S[6:12, 6:12] = S_T
    S[12:, 12:] = S_p
    J = jacobian(carried, 15)
    assert_same_covariance(found.covariance, J @ S @ J.T, 1e-6)
    np.testing.assert_allclose(found.points, carried(np.zeros((1, 15)))[0], atol=1e-14)
    near, far = ("gripper", "base") if setup == "eye-in-hand" else ("base", "gripper")
    assert found.frame == (near if way == "X" else far)
    values, vectors = np.linalg.eigh(S)
    errors = carried((rng.normal(size=(20_000, 15)) * np.sqrt(np.clip(values, 0, None))) @ vectors.T) - found.points
    # eigenvalues of a covariance from 20,000 samples scatter by 1 %
    assert_same_covariance(np.cov(errors.T), found.covariance, 0.06)
    assert (np.linalg.norm(errors, axis=1) < found.radius_95).mean() > 0.945
    np.testing.assert_allclose(found.std, np.sqrt(np.diag(found.covariance)))


def test_uncertainty_that_is_not_determined(poses, given):
    p = [0, 0, 0.5]
    with pytest.raises(uq.InputError, match=r"either `robot`.*or `camera`"):
        given.uncertainty_at(p, robot=np.eye(4), camera=np.eye(4))
    with pytest.raises(uq.InputError, match="`points`"):
        given.uncertainty_at([0, 0])
    with pytest.raises(uq.InputError, match="robot"):
        given.uncertainty_at(p, robot=np.eye(3))
    with pytest.raises(uq.InputError, match="needs W"):
        quietly(poses, noise=NOISE, kind="pairs").uncertainty_at(p, camera=poses.camera[0])
    _, alone = motions_alone()
    motions = quietly(alone, noise=PAIR_NOISE)
    assert motions.uncertainty_at(p).covariance.shape == (3, 3)
    assert motions.uncertainty_at(p).frame == "parent frame of X"
    for name in ("robot", "camera"):
        with pytest.raises(uq.InputError, match=f"Expected no `{name}`: .*came without poses"):
            motions.uncertainty_at(p, **{name: poses.camera[0]})
        with pytest.raises(uq.InputError, match=f"the pose `{name}` beside `{name}_covariance`"):
            given.uncertainty_at(p, **{f"{name}_covariance": np.eye(6)})
    exact = uq.calibrate(uq.PosePairs(poses.truth.robot, poses.truth.camera))
    for options in ({}, {"robot": poses.robot[0]}, {"camera": poses.camera[0]}):
        with pytest.raises(uq.InputError):
            exact.uncertainty_at(p, **options)


def test_budget_does_not_split_what_is_not_known(given, estimated):
    assert set(given.budget.sources) == {f"{a} {b}" for a in ("robot", "camera") for b in ("rotation", "translation")}
    open_ = [c.name for c in estimated.noise_estimate.components if c.status == "not told apart"]
    assert {"robot translation", "camera translation"} <= set(open_)
    assert "robot translation + camera translation" in estimated.budget.sources
    assert not {"robot translation", "camera translation"} & set(estimated.budget.sources)
    for result in (given, estimated):
        assert_same_covariance(result.budget.covariance[:6, :6], result.bound, 1e-4)
        for shares in result.budget.group_shares.values():
            assert shares.sum() == pytest.approx(1.0)


# ------------------------------------------------------------------------------------------------------------- text


def test_the_summary_has_every_section(given, estimated, poses):
    everywhere = (
        "gripper_T_camera by efficient from 20 poses, eye-in-hand",
        "translation (mm)",
        "gripper_T_camera is known ",
        "sigma_0: 1 before the fit (prior), ",
        "  rotation vector (deg)",
        "The robot turns about three axes: shares ",
        "Residuals of AX = XB over the pairs",
        "camera_T_gripper (inverse of X)",
        "base_T_target (the target, as all poses see it)",
        "Fit: chi-square",
        "4DPA alone, on the same data:",
        "times the Cramer-Rao bound",
        "Standard deviations by",
        "* model (the noise)",
        "bootstrap",
        "Share of the variance of X by its source:",
        "Diagnostics:",
        "95 % of all errors lie within d^2",
        "Systematic errors (wrong",
    )
    for result in (given, estimated):
        for part in everywhere:
            assert part in result.summary(), part
    assert "Noise as given" in given.summary() and "robot: rotation 0.02 deg, translation 0.05 mm" in given.summary()
    assert "chi-square with 6 degrees of freedom" in given.summary()
    assert "Noise, estimated from the residuals" in estimated.summary() and "6 F(6, " in estimated.summary()
    assert "to first order, of the noise given" in given.summary()
    assert "to first order, of the noise estimated" in estimated.summary()
    spoiled = quietly(with_wrong(poses, 4)).summary()
    assert "CAUTION: " in spoiled and "stand out (numbered from 0" in spoiled and "CAUTION: 1 of 20 poses" in spoiled
    assert "No pose stands out" in quietly(uq.simulate(8, noise=NOISE, seed=1), noise=NOISE).summary()


def test_the_summary_answers_first_and_says_each_thing_once(poses):
    result = quietly(with_wrong(poses, 4))
    lines = result.summary().splitlines()
    assert lines[1].startswith("gripper_T_camera is known ")
    first = [k for k, line in enumerate(lines) if line.startswith("CAUTION: ")]
    matrix = next(k for k, line in enumerate(lines) if line.startswith("   "))
    assert len(first) == len(result.warnings) and max(first) < matrix
    assert lines.index("camera_T_gripper (inverse of X)") > lines.index("Diagnostics:")
    flat = " ".join(" ".join(lines).split())
    for text in result.warnings:
        assert flat.count(f"CAUTION: {text}") == 1


def test_the_summary_of_joint_noise():
    n = 12
    noise = uq.PoseNoise(NOISE.robot, np.kron(np.eye(n) + 0.5, NOISE.camera))
    flat = " ".join(quietly(uq.simulate(n, noise=noise, seed=1), noise=noise).summary().split())
    assert flat.count("The noise is joint over the poses") == 1
    assert "sandwich, hac, jackknife, bootstrap: not determined: " in flat
    assert "camera (rotation and translation) " in flat and "camera rotation " not in flat


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
    assert isinstance(own.noise, uq.PairNoise) and own.reference.kind == "F"
    assert own.noise_estimate["B rotation"].high > 0
    with pytest.raises(uq.InputError, match="use PairNoise"):
        uq.calibrate(motions, noise=NOISE)


def test_noise_of_pairs_of_poses(poses):
    """PairNoise says that the motions are independent: the likelihood is theirs."""
    for pairs in ("all", "disjoint", "consecutive"):
        result = quietly(poses, noise=PAIR_NOISE, pairs=pairs)
        fitted = efficient(uq.relative_motions(poses, pairs), PAIR_NOISE)
        np.testing.assert_allclose(result.X, fitted.X, atol=1e-12)
        assert_same_covariance(result.covariance, fitted.covariance_X, CLOSE)
        assert (result.kind, result.table.item, len(result.table)) == ("pairs", "motion", result.n_pairs)
        assert result.covariance_W is None and result.n_poses == 20
        assert uq.Calibration.from_dict(json.loads(result.to_json())).to_json() == result.to_json()


# ---------------------------------------------------------------------------------------------------------- garbage


def garbage():
    poses = uq.simulate(20, noise=NOISE, seed=SEED)
    rng = np.random.default_rng(SEED)
    robot, camera = poses.robot, poses.camera

    def scaled(T, factor):
        T = T.copy()
        T[:, :3, 3] *= factor
        return T

    turned = Rotation.from_matrix(camera[:, :3, :3]).as_quat()
    reordered = camera.copy()
    reordered[:, :3, :3] = Rotation.from_quat(np.roll(turned, 1, axis=1)).as_matrix()
    still = np.tile(robot[:1], (20, 1, 1))
    return {
        "camera times 10": (robot, scaled(camera, 10)),
        "camera over 10": (robot, scaled(camera, 0.1)),
        "robot in mm": (scaled(robot, 1000), camera),
        "camera in mm": (robot, scaled(camera, 1000)),
        "inverse camera": (robot, np.linalg.inv(camera)),
        "inverse robot": (np.linalg.inv(robot), camera),
        "quaternion order": (robot, reordered),
        "no relation": (robot, random_transforms(rng, (20,))),
        "all random": (random_transforms(rng, (20,)), random_transforms(rng, (20,))),
        "permuted": (robot, camera[rng.permutation(20)]),
        "same file": (robot, robot),
        "robot at rest": (still, camera),
        "both at rest": (still, np.tile(camera[:1], (20, 1, 1))),
    }


@pytest.mark.parametrize("noise", [None, NOISE])
@pytest.mark.parametrize("name", garbage())
def test_garbage_is_an_error_or_a_warning(name, noise):
    data = uq.PosePairs(*garbage()[name])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = uq.calibrate(data, noise=noise)
        except (uq.InputError, uq.NotConvergedError) as error:
            result, refusal = None, str(error)
    if result is None:
        assert len(refusal) > 40 and "nan" not in refusal.lower().split()
        return
    assert {warning.category for warning in caught} == {uq.InputWarning}
    assert result.warnings
    for value in (result.X, result.covariance, result.W, result.covariance_W, result.bound):
        assert value is None or np.isfinite(value).all()
    result.to_json()  # which refuses NaN


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("camera times 10", r"multiplied by 0\.(0999|1)"),
        ("camera over 10", r"multiplied by (9\.99|10)"),
        ("robot in mm", "--robot-units mm"),
        ("camera in mm", "--camera-units mm"),
        ("inverse camera", "camera file holds inverse poses"),
        ("inverse robot", "the setup is eye-to-hand, or the robot file holds inverse poses"),
        ("quaternion order", "scalar of the quaternion first"),
        ("same file", "same file was given twice"),
    ],
)
@pytest.mark.parametrize("noise", [None, NOISE])
def test_garbage_comes_with_a_hint(name, hint, noise):
    """Also where it ends in an error: what looks wrong is warned of first."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            uq.calibrate(uq.PosePairs(*garbage()[name]), noise=noise)
        except (uq.InputError, uq.NotConvergedError) as error:
            caught_error = str(error)
        else:
            caught_error = ""
    said = " ".join([*(str(warning.message) for warning in caught), caught_error])
    if name == "quaternion order" and noise is None:
        # noise that is estimated puts all of it down to the rotations: translations alone give X, and it is right
        assert "X does not explain the poses: the target seems to move by" in said
    else:
        assert re.search(hint, said), said


# ----------------------------------------------------------------------------------------- requests, copies, drift


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"robust": "yes"}, "`robust` to be True, False or None, got 'yes'"),
        ({"robust": 1}, "`robust`"),
        ({"seed": -1}, "`seed` to be an integer of at least 0, got -1"),
        ({"seed": "a"}, "`seed`.*'a'"),
        ({"seed": True}, "`seed`"),
        ({"seed": 1.0}, "`seed`"),
        ({"noise": None, "prior": (1, 2)}, "`prior` to be a NoisePrior or None, got tuple"),
        ({"noise": "1mm"}, "`noise` to be PoseNoise, PairNoise or None, got str"),
        ({"method": "efficient", "noise": uq.PoseNoise.isotropic(camera=("1mrad", "0mm"))}, "residuals exact"),
        ({"robust": True, "noise": uq.PoseNoise.isotropic(camera=("1mrad", "0mm"))}, "residuals exact"),
    ],
)
def test_refuses_options_of_a_wrong_type(poses, options, message):
    with pytest.raises(uq.InputError, match=message):
        quietly(poses, **({"noise": NOISE} | options))


def test_numpy_numbers_are_numbers(poses):
    assert quietly(poses, noise=NOISE, robust=np.bool_(True), seed=np.int64(3)).table is not None


@pytest.mark.parametrize("rows", [[*range(22), *range(18)], [*range(20)] * 2])
@pytest.mark.parametrize("noise", [None, NOISE])
def test_copied_rows_are_an_answer_and_accuse_nobody(rows, noise):
    poses = uq.simulate(22, noise=NOISE, seed=SEED)
    found = quietly(uq.PosePairs(poses.robot[rows], poses.camera[rows]), noise=noise, robust=True)
    assert len(found.table.flagged) <= 2 and not found.table.rejected
    xi = difference(found.X, poses.truth.X)
    assert xi @ np.linalg.solve(found.covariance, xi) / 2 < found.quantile(0.999)  # a copy counts as a pose


def test_plain_where_most_poses_do_not_determine_x(poses, monkeypatch):
    """The robust fit cannot; the plain one can, and says that wrong poses were not looked for."""

    def refuse(*_, **__):
        raise uq.DegenerateMotionError("the poses that agree are still", np.eye(6))

    monkeypatch.setattr("uq_handeye.calibration.robust_fit", refuse)
    with pytest.warns(uq.InputWarning) as said:
        found = uq.calibrate(poses)
    assert any("Wrong poses were not looked for" in str(warning.message) for warning in said)
    plain = quietly(poses, robust=False)
    np.testing.assert_array_equal(found.X, plain.X)
    assert any(text.startswith("Wrong poses were not looked for") for text in found.warnings)
    with pytest.raises(uq.DegenerateMotionError, match="are still"):
        quietly(poses, robust=True)
    with pytest.raises(uq.DegenerateMotionError, match="are still"):  # a wrong pose shows in the plain fit
        quietly(with_wrong(uq.simulate(30, noise=NOISE, seed=SEED), 3, 2.0))


def test_halves_that_contradict_each_other_are_a_warning(poses):
    noise = uq.PoseNoise.isotropic(robot=("0.05mrad", "0.05mm"), camera=("0.2mrad", "0.2mm"))
    clean = uq.simulate(40, noise=noise, seed=[SEED, 9])
    X, camera = clean.truth.X, clean.camera.copy()
    camera[20:] = np.linalg.inv(moved(X, np.array([0, 0, 0, 0, 0, 2e-3]))) @ X @ camera[20:]  # slips in its bracket
    found = quietly(uq.PosePairs(clean.robot, camera), noise=noise)
    assert found.split_in_time.p_value < 1e-3 and found.split_in_time.sentence in found.warnings
    assert found.split_in_time is found.analysis.split_in_time
    whole = quietly(clean, noise=noise)
    assert whole.split_half.possible and not any("two halves" in text for text in whole.warnings)


def test_a_data_sheet_that_is_wrong_in_one_part_says_which():
    poses = uq.simulate(40, noise=uq.PoseNoise.isotropic(camera=("1mrad", "0.1mm")), seed=SEED)
    found = quietly(poses, prior=uq.NoisePrior(robot=(0, 0), camera=("1mrad", "1mm"), factor=1))
    said = [text for text in found.warnings if "data sheet explains" in text]
    assert len(said) == 1 and re.search(r"the translation residuals \d+(\.\d+)? times smaller than", said[0])
    assert found.fit.translation_sigma0 < 0.5
