"""Diagnostics: closed forms against brute force, rates of false alarms, and what they find in spoilt data."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg, stats
from scipy.spatial.transform import Rotation
from support import SEED, assert_same_covariance, difference, moved, nees, random_covariance

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.fit.diagnostics import diagnose as module
from uq_handeye.fit.diagnostics import residual_patterns
from uq_handeye.fit.diagnostics import sentences as diagnosis_words
from uq_handeye.fit.diagnostics.diagnose import diagnose, scale_errors, shared_lengths
from uq_handeye.fit.diagnostics.result import Diagnostics
from uq_handeye.fit.graph.gauss_helmert import corrected, efficient, maximum_likelihood
from uq_handeye.fit.graph.goodness_of_fit import goodness_of_fit
from uq_handeye.fit.graph.own_residuals import own_residuals
from uq_handeye.fit.graph.robust import robust_fit
from uq_handeye.model.errors.error_estimate import IN_NOISE
from uq_handeye.model.errors.square_roots import cholesky_of, whiten
from uq_handeye.model.shared_errors.in_noise import shared_columns, with_shared

NOISE = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("1mrad", "1mm"))
SETUPS = ["eye-in-hand", "eye-to-hand"]
needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


@pytest.fixture(params=SETUPS)
def setup(request):
    return request.param


def joint_noise(rng, n):
    return uq.PoseNoise(random_covariance(rng), random_covariance(rng, 6 * n))


def solved(J, S, r, rows):
    """GLS of some rows by SciPy: the step (12,) and its covariance."""
    index = (6 * np.asarray(rows)[:, None] + np.arange(6)).ravel()
    J, r = J.reshape(-1, J.shape[-1])[index], r.reshape(-1)[index]
    weight = linalg.inv(S[np.ix_(index, index)])
    covariance = linalg.inv(J.T @ weight @ J)
    return -covariance @ J.T @ weight @ r, covariance


def whole(fit):
    return fit.S if fit.S.shape[-1] > 6 else linalg.block_diag(*fit.S)


# ---------------------------------------------------------------------------------------------- influence


@pytest.mark.parametrize("joint", [False, True])
def test_influence_is_that_of_leaving_poses_out(rng, setup, joint):
    n = 9
    noise = joint_noise(rng, n) if joint else uq.PoseNoise(random_covariance(rng), random_covariance(rng, shape=(n,)))
    poses = uq.simulate(n, noise=noise, setup=setup, seed=rng)
    fit = efficient(poses, noise)
    found = diagnose(fit, poses, noise).influence
    S, J, r = whole(fit), fit.linear.J, fit.residual
    everything, C = solved(J, S, r, range(n))
    lost = []
    for k in range(n):
        rest, C_rest = solved(J, S, r, np.delete(np.arange(n), k))
        shift = (rest - everything)[:6]
        np.testing.assert_allclose(found.shift[k], shift, atol=1e-7 * np.abs(shift).max())
        np.testing.assert_allclose(found.shift_sd[k], np.sqrt(shift @ linalg.solve(C[:6, :6], shift)), rtol=1e-6)
        np.testing.assert_allclose(found.cook[k], shift @ linalg.solve(C[:6, :6], shift) / 6, rtol=1e-6)
        # What leaving out takes from the information, seen in the directions that move X with W at its best.
        T = C[:, :6] @ linalg.inv(C[:6, :6])
        lost.append(np.trace(C[:6, :6] @ T.T @ (linalg.inv(C) - linalg.inv(C_rest)) @ T))
    np.testing.assert_allclose(found.share, np.array(lost) / np.sum(lost), rtol=1e-6)
    assert found.effective_number == pytest.approx(1 / np.sum(found.share**2))
    assert 1 <= found.effective_number <= n


def test_influence_predicts_the_fit_without_the_pose(rng):
    poses = uq.simulate(12, noise=NOISE, seed=rng)
    fit = efficient(poses, NOISE)
    found = diagnose(fit, poses, NOISE).influence
    sd = np.sqrt(np.diag(fit.covariance_X))
    for k in range(12):
        rows = np.delete(np.arange(12), k)
        rest = efficient(uq.PosePairs(poses.robot[rows], poses.camera[rows]), NOISE, start=fit.X)
        np.testing.assert_allclose(found.shift[k] / sd, difference(rest.X, fit.X) / sd, atol=0.05)


@pytest.mark.slow
def test_p_values_of_single_poses_are_uniform():
    p_values = []
    for k in range(60):
        poses = uq.simulate(10, noise=NOISE, seed=[SEED, 3, k])
        p_values.append(diagnose(efficient(poses, NOISE), poses, NOISE).influence.p_value)
    # Poses of one fit are correlated: 60 independent sets, of which the mean is compared.
    assert abs(np.mean(p_values) - 0.5) < 4 * np.std(np.mean(p_values, axis=1)) / np.sqrt(60)
    assert (np.array(p_values) < 1e-4).mean() < 0.01


def test_a_wrong_pose_is_the_most_influential(rng):
    poses = uq.simulate(20, noise=NOISE, seed=rng)
    camera = poses.camera.copy()
    camera[7] = moved(camera[7], np.array([0.02, 0, 0.01, 0, 0.02, 0]))
    spoilt = uq.PosePairs(poses.robot, camera)
    found = diagnose(efficient(spoilt, NOISE), spoilt, NOISE)
    assert found.influence.shift_sd.argmax() == 7
    said = [text for text in found.warnings() if "Without pose 7 X would move by" in text]
    assert len(said) == 1 and "more than its noise explains" in said[0]


def test_poses_without_which_nothing_is_determined():
    poses = uq.simulate(3, noise=NOISE, seed=2)
    found = diagnose(efficient(poses, NOISE), poses, NOISE)
    assert np.isinf(found.influence.shift_sd).all() and np.isfinite(found.influence.share).all()
    assert any("poses 0, 1, 2 the data do not determine X" in text for text in found.warnings())
    assert "too few" in str(found.autocorrelation.reason) and "too few" in str(found.normality.reason)
    again = Diagnostics.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False)))
    assert again.sentences() == found.sentences()
    np.testing.assert_array_equal(again.influence.shift, found.influence.shift)


# ---------------------------------------------------------------------------------------------- observability


def test_the_weakest_direction_in_words():
    S = np.diag([1e-3, 1e-3, 2e-3, 1e-3, 1e-3, 9e-3]) ** 2
    found = module._spectrum(S, "gripper", 0.5, True)
    words = " ".join(map(str, found.findings))
    assert "translation is least certain along gripper z: 9 mm, 9 times that along its best direction (1 mm)" in words
    assert "rotation is least certain about gripper z: " in words
    np.testing.assert_allclose(found.sd_joint_mm, [9, 1, 1, 1, 0.5, 0.5])
    assert found.condition == pytest.approx(18)
    turn = np.linalg.qr(np.random.default_rng(SEED).normal(size=(3, 3)))[0]
    S[3:, 3:] = turn @ S[3:, 3:] @ turn.T
    found = module._spectrum(S, "base", 0.5, True)
    assert abs(found.axes_translation[0] @ turn[:, 2]) == pytest.approx(1)
    assert_same_covariance((found.axes_joint.T * found.sd_joint_mm**2) @ found.axes_joint,
                           1e6 * np.diag([0.5] * 3 + [1] * 3) @ S @ np.diag([0.5] * 3 + [1] * 3), 1e-9)  # fmt: skip


def test_directions_that_are_equally_certain():
    S = np.diag([1e-3, 1.2e-3, 1e-3, 1e-3, 1e-3, 1.4e-3]) ** 2
    words = " ".join(map(str, module._spectrum(S, "gripper", 0.5, True).findings))
    assert "translation is about equally certain in all directions (1 to 1.4 mm)" in words
    assert "rotation is about equally certain in all directions (0.057 to 0.069 deg)" in words
    assert "less certain" not in words


def test_motions_without_poses_have_no_gripper(rng):
    motions = uq.relative_motions(uq.simulate(9, noise=NOISE, seed=rng))
    noise = uq.PairNoise.isotropic(B=("1mrad", "1mm"))
    alone = uq.Motions(motions.A, motions.B)
    found = diagnose(efficient(alone, noise), alone, noise)
    assert found.frame == "parent frame of X"
    assert not any("gripper" in text for text in found.sentences())
    assert diagnosis_words.along(np.array([0.0, 0.0, 1.0]), found.frame) == "z of the parent frame of X"


def test_numbers_in_words():
    from uq_handeye.core.presentation.numbers import digits, probability

    assert [digits(x, 2) for x in (170.3, 17.3, 1.73, 0.0, 1e-6)] == ["170", "17", "1.7", "0", "1.0e-06"]
    assert [digits(x) for x in (99.96, 1234.5, 0.01234)] == ["100", "1234", "0.0123"]
    assert [probability(p) for p in (0.0, 1e-16, 0.024)] == ["p < 1e-15", "p < 1e-15", "p = 0.02"]


def test_names_of_axes():
    assert diagnosis_words.along(np.array([0.1, -0.95, 0.2]), "base") == "base y"
    assert diagnosis_words.along(np.array([0.6, 0.0, 0.8]), "base") == "(0.60, 0.00, 0.80) of the base frame"


def test_diversity_is_the_sum_over_all_pairs(rng, setup):
    poses = uq.simulate(7, noise=NOISE, setup=setup, seed=rng)
    fit = efficient(poses, NOISE)
    found = diagnose(fit, poses, NOISE).diversity
    A = uq.relative_motions(poses, "all").A
    vectors = Rotation.from_matrix(A[:, :3, :3]).as_rotvec()
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    u = vectors / angle * np.sin(angle / 2)
    values, axes = np.linalg.eigh(u.T @ u / np.sum(u**2))
    np.testing.assert_allclose(found.share, values[::-1], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(found.axes * axes.T[::-1], axis=1)), 1, atol=1e-8)


# ---------------------------------------------------------------------------------------------- patterns


def test_moments_of_the_autocorrelation_by_whole_matrices(rng):
    n, p = 11, 12
    J, r = rng.normal(size=(n, 6, p)), rng.normal(size=(n, 6))
    r, U = residual_patterns.standardised(r, J)
    flat = U.reshape(-1, p)
    np.testing.assert_allclose(flat.T @ flat, np.eye(p), atol=1e-10)
    np.testing.assert_allclose(flat.T @ r.ravel(), 0, atol=1e-10)
    M, freedom = np.eye(6 * n) - flat @ flat.T, 6 * n - p
    found, error, _ = residual_patterns.autocorrelation_of(r, U)
    for k in (1, 2):
        A = 0.5 * np.kron(np.eye(n, k=k) + np.eye(n, k=-k), np.eye(6))
        mean = np.trace(A @ M) / freedom
        variance = 2 * (np.trace(A @ M @ A @ M) - np.trace(A @ M) ** 2 / freedom) / (freedom * (freedom + 2))
        np.testing.assert_allclose(error[k - 1], np.sqrt(variance), rtol=1e-9)
        np.testing.assert_allclose(found[k - 1], r.ravel() @ A @ r.ravel() / np.sum(r**2) - mean, atol=1e-12)
    draws = (M @ rng.normal(size=(6 * n, 20000))).T
    A = 0.5 * np.kron(np.eye(n, k=1) + np.eye(n, k=-1), np.eye(6))
    q = np.einsum("ti,ti->t", draws @ A, draws) / np.sum(draws**2, axis=1)
    assert abs(q.mean() - np.trace(A @ M) / freedom) < 4 * error[0] / np.sqrt(20000)
    assert q.std() == pytest.approx(error[0], rel=0.03)


def test_normal_scores_are_those_of_scipy(rng):
    r = rng.standard_t(5, size=(40, 6))
    skewness, _, (p_skewness, p_kurtosis, _) = residual_patterns.normality_of(r)
    np.testing.assert_allclose(skewness, stats.skew(r))
    by_component = stats.skewtest(r).statistic
    np.testing.assert_allclose(p_skewness, stats.chi2.sf(np.sum(by_component**2), 6))
    np.testing.assert_allclose(p_kurtosis, 2 * stats.norm.sf(abs(stats.kurtosistest(r).statistic.sum() / np.sqrt(6))))


def test_the_regression_is_that_of_the_larger_model(rng):
    n, p = 20, 12
    J, r = rng.normal(size=(n, 6, p)), rng.normal(size=(n, 6))
    Z = np.linalg.qr(rng.normal(size=(n, 4)))[0]
    J[..., 0] = 0.0
    J[:, 0, 0] = Z[:, 0]  # a column that the fit has used up already
    r, U = residual_patterns.standardised(r, J)
    R2, chance, p_value = residual_patterns.regression_of(r, U, Z)
    larger = np.concatenate([U.reshape(-1, p), np.einsum("tz,cd->tczd", Z, np.eye(6)).reshape(6 * n, -1)], axis=1)
    left = r.ravel() - larger @ np.linalg.lstsq(larger, r.ravel())[0]
    rank = np.linalg.matrix_rank(larger) - p
    freedom = 6 * n - p
    assert rank == 23
    assert pytest.approx(1 - left @ left / np.sum(r**2)) == R2
    assert pytest.approx(rank / freedom) == chance
    F = (R2 / rank) / ((1 - R2) / (freedom - rank))
    assert pytest.approx(stats.f.sf(F, rank, freedom - rank)) == p_value


def p_values(true, used, n, trials, seed, camera_error=None):
    """Return the p-values of autocorrelation, normality and regression on simulated sets."""
    found = []
    for k in range(4):  # geometries
        poses = uq.simulate(n, noise=true, trials=trials // 4, seed=[SEED, seed, k])
        if camera_error is not None:
            poses = uq.PosePairs(poses.robot, camera_error(poses))
        r, U = residual_patterns.standardised(*efficient(poses, used).white)
        regression = residual_patterns.regression_of(r, U, residual_patterns._regressors(poses.camera[0]))
        found.append(
            (residual_patterns.autocorrelation_of(r, U)[2], residual_patterns.normality_of(r)[2][2], regression[2])
        )
    return np.concatenate(found, axis=1)


# Also with a noise that is wrong in the ratio of rotation to translation.
@pytest.mark.statistical
@pytest.mark.parametrize(
    ("n", "used"), [(12, NOISE), (30, uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("2mrad", "0.7mm")))]
)
def test_false_alarms_are_rare(n, used):
    """Rates at nominally 1 %, over 800 sets; measured over 5000: 0.5 to 2 %, and 0.04 to 0.5 % at nominally 0.1 %."""
    rates = (p_values(NOISE, used, n, 800, 1) < 0.01).mean(axis=1)
    assert (rates <= stats.binom.ppf(0.9999, 800, 0.02) / 800).all(), rates


@pytest.mark.statistical
def test_correlated_neighbours_are_found_and_the_growth_is_right():
    """AR(1) noise in time: the alarm rings and X scatters by as much more as the factor says."""
    n, trials, rho = 80, 200, 0.6
    rng = np.random.default_rng([SEED, 7])
    true = uq.simulate(n, seed=5)
    xi = rng.normal(size=(trials, n, 6))
    for t in range(1, n):
        xi[:, t] = rho * xi[:, t - 1] + np.sqrt(1 - rho**2) * xi[:, t]
    camera = moved(true.camera, 1e-3 * xi)
    noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    poses = uq.PosePairs(np.broadcast_to(true.robot, camera.shape), camera)
    fit = efficient(poses, noise)
    growths, alarms, factors = [], [], []
    for k in range(0, trials, 4):
        one = uq.PosePairs(true.robot, camera[k])
        found = diagnose(efficient(one, noise), one, noise)
        growths.append(found.autocorrelation.growth)
        factors.append(found.autocorrelation.factor)
        alarms.append(any("Thin the" in text or "or thin the" in text for text in found.warnings()))
    assert np.mean(alarms) > 0.95
    assert 2.3 < np.mean(factors) < (1 + rho) / (1 - rho)  # views turn, and the correlation with them
    actual = np.sqrt(nees(difference(fit.X, true.truth.X), fit.covariance_X).mean() / 6)
    assert actual > 1.15  # so that a growth of 1 would be wrong
    assert np.sqrt(np.mean(np.square(growths))) == pytest.approx(actual, rel=0.15)


def test_timestamps_give_the_order(rng):
    poses = uq.simulate(30, noise=NOISE, seed=rng)
    order = rng.permutation(30)
    mixed = uq.PosePairs(poses.robot[order], poses.camera[order], timestamps=poses.timestamps[order])
    first, second = (diagnose(efficient(x, NOISE), x, NOISE).autocorrelation for x in (poses, mixed))
    np.testing.assert_allclose(first.correlation, second.correlation, atol=1e-6)
    unordered = uq.PosePairs(poses.robot[order], poses.camera[order])
    third = diagnose(efficient(unordered, NOISE), unordered, NOISE).autocorrelation
    assert np.abs(third.correlation - first.correlation).max() > 1e-3


@pytest.mark.slow
def test_heavy_tails_are_found():
    rng = np.random.default_rng([SEED, 8])
    true = uq.simulate(60, seed=3)
    found = []
    for _ in range(20):
        spoilt = uq.PosePairs(true.robot, moved(true.camera, 1e-3 * rng.standard_t(2.5, size=(60, 6))))
        said = diagnose(efficient(spoilt, NOISE), spoilt, NOISE).warnings()
        found.append(any("heavier tails than Gaussian" in text for text in said))
    assert np.mean(found) > 0.8


def test_noise_of_translations_alone(rng):
    poses = uq.simulate(12, noise=uq.PoseNoise(camera=np.diag([0.0] * 3 + [1e-6] * 3)), seed=rng)
    for solve in (efficient, maximum_likelihood):
        data = diagnose(solve(poses, NOISE), poses, NOISE).to_dict()
        assert np.isfinite([data["normality"]["p_value"], data["autocorrelation"]["factor"]]).all()


@pytest.mark.slow
def test_a_bent_camera_leaves_a_pattern():
    def bent(poses):
        camera = poses.camera.copy()
        depth = camera[..., 2, 3]
        camera[..., :2, 3] += 0.1 * camera[..., :2, 3] * (depth / 0.6)[..., None]
        camera[..., 2, 3] += 0.1 * (depth - 0.6)
        return camera

    found = p_values(NOISE, NOISE, 50, 200, 4, bent)
    assert (found[2] < 1e-4).mean() > 0.95


# ---------------------------------------------------------------------------------------------- systematic errors


def scaled(poses, name, s):
    """Poses with all lengths of a kind too long by s."""
    robot, camera = np.array(poses.robot), np.array(poses.camera)
    if name == "focal length":
        camera[..., 2, 3] *= 1 + s
    elif name == "target scale":
        camera[..., :3, 3] *= 1 + s
    else:
        robot[..., :3, 3] *= 1 + s
    return uq.PosePairs(robot, camera, poses.setup)


@pytest.mark.slow
@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("name", ["focal length", "target scale", "robot scale"])
def test_probes_are_numerical_derivatives(rng, setup, name, joint):
    poses = uq.simulate(9, setup=setup, seed=rng)
    noise = joint_noise(rng, 9) if joint else uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    fit = efficient(poses, noise)
    probe = next(p for p in diagnose(fit, poses, noise).probes if p.name == name)
    h = 1e-5
    ends = [efficient(scaled(poses, name, s), noise, start=fit.X).X for s in (h, -h)]
    expected = 1e-3 * difference(ends[0], ends[1]) / (2 * h)
    np.testing.assert_allclose(probe.effect, expected, atol=1e-4 * np.abs(expected).max())
    np.testing.assert_allclose(probe.share, expected @ linalg.solve(fit.covariance_X, expected), rtol=1e-3)


def test_probes_on_motions(rng):
    poses = uq.simulate(9, seed=rng)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    motions = uq.relative_motions(poses)
    fit = efficient(motions, noise)
    found = diagnose(fit, motions, noise)
    h = 1e-5
    for probe in found.probes:
        ends = [efficient(uq.relative_motions(scaled(poses, probe.name, s)), noise, start=fit.X).X for s in (h, -h)]
        expected = 1e-3 * difference(ends[0], ends[1]) / (2 * h)
        np.testing.assert_allclose(probe.effect, expected, atol=1e-4 * np.abs(expected).max())
    bare = uq.Motions(motions.A, motions.B)
    alone = diagnose(efficient(bare, noise), bare, noise)
    assert alone.item == "motion" and not alone.probes[0].effect.size and alone.probes[0].alone is None
    assert not alone.asked_for


def test_scale_errors_are_estimated_as_by_one_more_unknown(rng, setup):
    poses = scaled(uq.simulate(15, noise=NOISE, setup=setup, seed=rng), "focal length", 0.01)
    fit = efficient(poses, NOISE)
    found = diagnose(fit, poses, NOISE)
    probe = found.probes[0]
    depth = corrected(fit, NOISE, poses.robot, poses.camera)[1][:, 2, 3:4]
    step = (fit.linear.sides[1][..., 5] * depth)[..., None]
    white = whiten(cholesky_of(fit.S), np.concatenate([fit.linear.J, step, fit.residual[..., None]], axis=-1))
    design, r = white[..., :-1].reshape(-1, 13), white[..., -1].ravel()
    solution = np.linalg.lstsq(design, r)[0]
    assert probe.alone == pytest.approx(solution[-1], rel=1e-6)
    expected = max(1.0, found.sigma_0) * np.sqrt(linalg.inv(design.T @ design)[-1, -1])
    assert probe.alone_sd == pytest.approx(expected * inflation(found.autocorrelation), rel=1e-6)


def inflation(autocorrelation):
    """Residuals that follow each other widen a deviation by the root of their factor, from 1 in 1,000 on."""
    return np.sqrt(autocorrelation.factor) if autocorrelation.p_value < 1e-3 else 1.0


def test_residuals_that_follow_each_other_widen_the_deviation_of_a_scale_error(rng):
    poses = uq.simulate(60, seed=rng)
    drift = np.cumsum(1e-3 * rng.normal(size=(2, 60, 6)), axis=1)
    poses = uq.PosePairs(moved(poses.robot, drift[0]), moved(poses.camera, drift[1]), poses.setup)
    fit = efficient(poses, NOISE)
    found = diagnose(fit, poses, NOISE)
    assert found.autocorrelation.p_value < 1e-3 and found.autocorrelation.factor > 2
    sides = corrected(fit, NOISE, poses.robot, poses.camera)
    lengths = shared_lengths(*sides, poses, poses, True)
    plain = scale_errors(fit, lengths, max(1.0, found.sigma_0))
    widened = inflation(found.autocorrelation)
    for probe, other in zip(found.probes, plain, strict=True):
        assert probe.alone == pytest.approx(other.alone) and probe.alone_sd == pytest.approx(widened * other.alone_sd)


@pytest.mark.slow
def test_scale_errors_are_found_with_their_sign_and_size():
    noise = uq.PoseNoise.isotropic(robot=("0.05mrad", "0.05mm"), camera=("0.1mrad", "0.1mm"))
    z, estimates = [], []
    for k in range(100):
        poses = uq.simulate(30, noise=noise, seed=[SEED, 11, k])
        z.append([p.alone / p.alone_sd for p in diagnose(efficient(poses, noise), poses, noise).probes])
        spoilt = scaled(poses, "focal length", -0.01)  # given 1 % too short
        found = diagnose(efficient(spoilt, noise), spoilt, noise)
        estimates.append(found.probes[0].alone)
    z = np.array(z)
    assert (np.abs(z) < 5).all() and (np.abs(z.mean(axis=0)) < 4 / np.sqrt(100)).all()
    assert (z.std(axis=0) < 1.25).all() and (z.std(axis=0) > 0.7).all()  # sigma_0 counts only where above 1
    assert np.mean(estimates) == pytest.approx(-0.01, rel=0.05)
    asked = [text for text in found.warnings() if "shared errors that were not declared: focal length -" in text]
    assert len(asked) == 1 and re.search(r"length -(1\.[01]|0\.[89])\d*\(\d+\) % or", asked[0])


def test_target_and_robot_scale_look_alike(rng):
    poses = scaled(uq.simulate(30, noise=NOISE, seed=rng), "target scale", 0.05)
    found = diagnose(efficient(poses, NOISE), poses, NOISE)
    target, robot = (probe.alone / probe.alone_sd for probe in found.probes[1:])
    assert target == pytest.approx(-robot, rel=0.1) and target > 4
    assert {probe.name for probe in found.asked_for} >= {"target scale", "robot scale"}
    said = [text for text in found.warnings() if "not declared" in text]
    assert len(said) == 1 and "target scale +" in said[0] and " or robot scale -" in said[0]


def test_what_the_noise_holds_is_not_asked_for(rng):
    poses = scaled(uq.simulate(20, noise=NOISE, seed=rng), "target scale", 0.05)
    assert diagnose(efficient(poses, NOISE), poses, NOISE).asked_for
    wide = uq.SharedError.target_scale("10%")
    noise = with_shared(NOISE, shared_columns([wide], poses))
    found = diagnose(efficient(poses, noise), poses, noise)
    assert [probe.status == IN_NOISE for probe in found.probes] == [False, True, False]
    assert not found.asked_for and not any("not declared" in text for text in found.warnings())


def passing_on(way):
    """Noise of 30 poses that have errors in common: a dense covariance, or a few columns."""
    n, own = 30, np.diag([1e-6] * 6)
    if way == "dense":
        return uq.PoseNoise(NOISE.robot, np.kron(0.4 * np.ones((n, n)) + np.eye(n), own))
    F = np.random.default_rng(3).normal(size=(n, 6, 2)) * 1e-3
    return uq.PoseNoise(NOISE.robot, uq.JointCovariance(np.tile(own, (n, 1, 1)), F))


@pytest.mark.statistical
@pytest.mark.parametrize("way", ["dense", "columns"])
def test_errors_in_common_are_tested_too(way):
    """False alarms are rare, and what the noise does not hold is found: more correlation, a bent camera, tails."""
    noise = passing_on(way)
    n, sets = 30, 100
    poses = uq.simulate(n, noise=noise, trials=sets, seed=[SEED, 21])
    found = []
    for k in range(sets):
        one = uq.PosePairs(poses.robot[k] if poses.robot.ndim == 4 else poses.robot, poses.camera[k])
        tests = residual_tests_of(one, noise)
        assert all(test.reason is None for test in tests)
        found.append([test.p_value for test in tests])
    assert ((np.array(found) < 0.01).mean(axis=0) <= stats.binom.ppf(0.9999, sets, 0.02) / sets).all()
    rng = np.random.default_rng([SEED, 22])
    alarms = []
    for k in range(20):
        robot, camera = (T[k] if T.ndim == 4 else T for T in (poses.robot, poses.camera))
        walk = np.cumsum(rng.normal(size=(n, 6)), axis=0)
        depth = camera[:, 2, 3]
        bent = camera.copy()
        bent[:, :2, 3] += 0.1 * camera[:, :2, 3] * (depth / 0.6)[:, None]
        bent[:, 2, 3] += 0.1 * (depth - 0.6)
        wrong = moved(camera, 3e-3 * walk), moved(camera, 3e-3 * rng.standard_t(2, size=(n, 6))), bent
        alarms.append([
            residual_tests_of(uq.PosePairs(robot, T), noise)[m].p_value < 1e-3 for m, T in enumerate(wrong)
        ])  # fmt: skip
    assert (np.mean(alarms, axis=0) > 0.8).all(), np.mean(alarms, axis=0)


def residual_tests_of(poses, noise):
    found = diagnose(efficient(poses, noise), poses, noise)
    return found.autocorrelation, found.normality, found.regression


def test_a_rejected_pose_reaches_no_other_beside_a_drift():
    """Poses behind it are not judged by what it says of the drift."""
    noise, n, wrong = passing_on("serial"), 30, 7
    poses = uq.simulate(n, noise=noise, seed=[SEED, 23])
    camera = poses.camera.copy()
    camera[wrong] = moved(camera[wrong], np.array([0.1, 0, 0.05, 0, 0.1, 0]))
    found = robust_fit(uq.PosePairs(poses.robot, camera), noise).fit
    assert found.weights[wrong] == 0
    kept = np.arange(n) != wrong
    rest = poses.rows(kept)
    rest_noise = noise.rows(kept)
    without = own_residuals(efficient(rest, rest_noise))
    np.testing.assert_allclose(own_residuals(found).e[kept], without.e, atol=0.02)


def test_tests_that_were_not_run_have_no_numbers(rng):
    few = uq.simulate(5, noise=NOISE, seed=rng)
    found = diagnose(efficient(few, NOISE), few, NOISE)
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    for name in ("autocorrelation", "normality", "regression"):
        numbers = {key: value for key, value in data[name].items() if key != "reason"}
        assert all(value is None or value == [] for value in numbers.values())
    said = [str(reason) for reason in found.not_run]
    assert len(said) == 3 and all("was not run, because 5 rows are too few, 8 are needed" in text for text in said)
    assert not found.correlated and Diagnostics.from_dict(data).not_run == found.not_run
    with pytest.raises(uq.InputError, match="regression of the residuals among the diagnostics, or why"):
        Diagnostics.from_dict(data | {"regression": data["regression"] | {"reason": None}})


# ---------------------------------------------------------------------------------------------- as a whole


def test_dictionary_and_size(rng):
    poses = uq.simulate(12, noise=NOISE, seed=rng)
    found = diagnose(efficient(poses, NOISE), poses, NOISE)
    again = Diagnostics.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False)))
    assert again.to_dict() == found.to_dict() and again.sentences() == found.sentences()
    assert set(found.warnings()) <= set(found.sentences())


def test_exact_data_have_no_residuals_to_test():
    poses = uq.simulate(12, seed=1)
    found = diagnose(efficient(poses, NOISE), poses, NOISE)
    assert "zero" in str(found.normality.reason) and "zero" in str(found.autocorrelation.reason)


def test_robust_weights(rng):
    from uq_handeye.fit.graph.constraint import constraint_of
    from uq_handeye.fit.graph.gauss_helmert import fit
    from uq_handeye.fit.graph.starts import start_of

    poses = uq.simulate(12, noise=NOISE, seed=rng)
    weights = np.ones(12)
    weights[4] = 0.0
    at = constraint_of(poses, NOISE)
    found = diagnose(fit(at, NOISE, start_of(poses, at, None), 1, weights), poses, NOISE)
    assert found.influence.share[4] < 1e-9 and np.abs(found.influence.shift_sd[4]) < 1e-5


@pytest.mark.slow
def test_a_rejected_pose_does_not_leak_into_the_others():
    """Whitened with a joint S that does not know the weights, it would: sigma_0 far above 1."""
    n, wrong, trials = 20, 7, 10
    own = np.diag([1e-6] * 6)
    noise = uq.PoseNoise(NOISE.robot, np.kron(np.eye(n) + 0.5, own))
    chi2, alarms, leaked = [], [], []
    for k in range(trials):
        poses = uq.simulate(n, noise=noise, seed=[SEED, 12, k])
        camera = poses.camera.copy()
        camera[wrong] = moved(camera[wrong], np.array([0.1, 0, 0.05, 0, 0.1, 0]))
        found = robust_fit(uq.PosePairs(poses.robot, camera), noise).fit
        assert found.weights[wrong] == 0
        judged = goodness_of_fit(found)
        diagnosed = diagnose(found, uq.PosePairs(poses.robot, camera), noise)
        assert judged.dof == pytest.approx(6 * found.weights.sum() - 12)
        assert diagnosed.sigma_0 == pytest.approx(judged.sigma0)
        chi2.append(judged.chi2 / judged.dof)
        alarms.append(diagnosed.normality.p_value)
        leaked.append(np.sum(np.delete(found.white[0], wrong, axis=0) ** 2) / judged.dof)
    assert abs(np.mean(chi2) - 1) < 4 * np.sqrt(2 / (102 * trials))
    assert np.sum(np.array(alarms) < 1e-3) <= 2  # false alarms of one set in 200 are allowed for
    assert min(leaked) > 4


def test_errors(rng):
    poses = uq.simulate(6, noise=NOISE, trials=2, seed=rng)
    with pytest.raises(uq.InputError, match="leading axes"):
        diagnose(efficient(poses, NOISE), poses, NOISE)
    one, other = uq.simulate(6, noise=NOISE, seed=1), uq.simulate(7, noise=NOISE, seed=1)
    with pytest.raises(uq.InputError, match="6 rows, got 7"):
        diagnose(efficient(one, NOISE), other, NOISE)


@needs_data
@pytest.mark.parametrize("name", ["synthetic_camera_2", "kuka_1"])
def test_focal_length_hides_from_independent_camera_noise(name):
    """T4b: d^2 = 26 for X of the rendered set whose truth is known."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    sd = np.array([1e-3, 1e-3])
    for _ in range(5):
        noise = uq.PoseNoise.isotropic(camera=tuple(float(x) for x in sd))
        fit = efficient(poses, noise)
        squares = np.sum(fit.residual.reshape(-1, 2, 3) ** 2, axis=(0, 2))
        sd = np.sqrt(squares / (3 * len(poses) - 6))
    found = diagnose(fit, poses, noise)
    focal = found.probes[0]
    assert focal.share > 1.5**2 and abs(focal.alone / focal.alone_sd) < 4  # it moves X by much, and hides
    if name == "synthetic_camera_2":
        error = difference(fit.X, np.diag([1.0, -1.0, -1.0, 1.0]))
        assert error @ linalg.solve(fit.covariance_X, error) > 16.8  # the 99 % point of 6 degrees of freedom


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_correlation_is_not_tested_on_the_residuals_that_it_was_estimated_from():
    """The same correlation is not reported twice, by two cautions."""
    rng = np.random.default_rng([SEED, 11])
    true = uq.simulate(n_poses=40, seed=11)
    walk = np.cumsum(rng.normal(size=(40, 6)), axis=0) * np.array([*[6e-4] * 3, *[2e-4] * 3])
    camera = perturb(true.camera, walk + 1e-4 * rng.normal(size=(40, 6)))
    poses = replace(true, camera=camera, timestamps=np.arange(40.0), truth=None)
    result = uq.calibrate(poses)
    assert any("drift" in part.name for part in result.components)
    test = result.diagnostics.autocorrelation
    assert test.p_value is None and "estimated from these same residuals" in str(test.reason)
    assert "diagnostics.correlated" not in {finding.code for finding in result.findings}
    assert "Neighbouring poses are not independent" not in result.summary()
    assert uq.calibrate(poses, correlation="none").diagnostics.correlated
    again = uq.Calibration.from_dict(result.to_dict())
    assert str(again.diagnostics.autocorrelation.reason) == str(test.reason)
