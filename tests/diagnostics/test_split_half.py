"""Split-half test: its rates of passing, the covariance of correlated halves, and what it refuses."""

import json

import numpy as np
import pytest
from scipy import linalg, stats
from support import SEED, assert_same_covariance, covers, difference, moved, random_covariance

import uq_handeye as uq
from uq_handeye.fit.diagnostics.split_half import SplitHalf, _halves, split_fit
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.gauss_helmert import efficient, fit
from uq_handeye.model.errors.joint_covariance import JointCovariance

NOISE = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.1mm"), camera=("1mrad", "1mm"))
SETUPS = ["eye-in-hand", "eye-to-hand"]


def split_half(data, noise, split="interleaved", dof=None):
    return split_fit(efficient(data, noise), data, split, dof)


def d2_of(noise, true, n, setup="eye-in-hand", geometries=4, trials=500, **kwargs):
    found = [
        split_half(uq.simulate(n, noise=true, setup=setup, trials=trials, seed=[SEED, n, k]), noise, **kwargs)
        for k in range(geometries)
    ]
    return np.concatenate([test.d2 for test in found]), np.concatenate([test.p_value > 0.05 for test in found])


@pytest.mark.statistical
@pytest.mark.parametrize(("setup", "n"), [("eye-in-hand", 12), ("eye-to-hand", 20), ("eye-in-hand", 40)])
def test_it_passes_as_often_as_it_says(setup, n):
    """Between 93 and 97 % of 2000 sets at the 95 % level; a noise given 30 % too small fails."""
    d2, passed = d2_of(NOISE, NOISE, n, setup)
    assert 0.93 <= passed.mean() <= 0.97
    np.testing.assert_array_equal(passed, stats.chi2.sf(d2, 6) > 0.05)
    small = uq.PoseNoise(0.49 * NOISE.robot, 0.49 * NOISE.camera)
    assert d2_of(small, NOISE, n, setup, geometries=1)[1].mean() < 0.85


@pytest.mark.slow
@pytest.mark.parametrize("split", ["interleaved", "contiguous"])
def test_every_split(split):
    _, passed = d2_of(NOISE, NOISE, 16, geometries=2, split=split)
    low, high = stats.binom.ppf([0.0005, 0.9995], 1000, 0.95) / 1000
    assert low - 0.01 <= passed.mean() <= high + 0.01
    for n in (7, 12):
        poses = uq.simulate(n, seed=1)
        first, second = _halves(poses, split)
        assert sorted([*first, *second]) == list(range(n)) and abs(len(first) - len(second)) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("setup", SETUPS)
def test_halves_of_a_joint_noise_are_correlated(rng, setup):
    """The covariance of the difference by numerical derivatives of both estimates."""
    n = 6
    true = uq.simulate(n, setup=setup, seed=rng)
    noise = uq.PoseNoise(random_covariance(rng, shape=(n,)), random_covariance(rng, 6 * n))
    found = split_half(true, noise)
    parts = [noise.rows(half) for half in found.halves]

    def shift(xi):
        moved_robot, moved_camera = moved(true.robot, xi[:n]), moved(true.camera, xi[n:])
        X1, X2 = (
            efficient(uq.PosePairs(moved_robot[half], moved_camera[half], setup), part, start=true.truth.X).X
            for half, part in zip(found.halves, parts, strict=True)
        )
        return difference(X1, X2)

    h = 1e-5
    unit = np.eye(12 * n).reshape(-1, 2 * n, 6)
    D = np.stack([(shift(h * e) - shift(-h * e)) / (2 * h) for e in unit], axis=1)
    expected = D @ linalg.block_diag(*noise.robot, noise.camera) @ D.T
    assert_same_covariance(found.covariance, expected, 1e-3)
    apart = sum(efficient(_rows(true, half), part).covariance_X for half, part in zip(found.halves, parts, strict=True))
    values = linalg.eigh(apart, expected, eigvals_only=True)
    assert np.abs(values - 1).max() > 0.02  # the sum of the covariances would be wrong


def _rows(poses, rows):
    return uq.PosePairs(poses.robot[rows], poses.camera[rows], poses.setup)


@pytest.mark.statistical
def test_common_error_of_all_poses_by_monte_carlo():
    """A shift that all camera poses share cancels in the difference: taken as independent, the test is too kind."""
    n, shared = 12, np.diag([0.0] * 5 + [1e-4])
    joint = uq.PoseNoise(NOISE.robot, np.kron(np.eye(n), NOISE.camera) + np.kron(np.ones((n, n)), shared))
    poses = uq.simulate(n, noise=joint, trials=400, seed=[SEED, 0])
    test = split_half(poses, joint)
    assert all(covers(test.difference, test.covariance))
    marginal = split_half(poses, uq.PoseNoise(NOISE.robot, NOISE.camera + shared))
    seen = np.linalg.solve(marginal.covariance.mean(axis=0), np.cov(marginal.difference.T))
    assert np.linalg.eigvals(seen).real.min() < 0.3


def test_motions_and_poses(rng):
    poses = uq.simulate(16, noise=NOISE, seed=rng)
    motions = uq.relative_motions(poses, "disjoint")
    of_motions = split_half(motions, NOISE)
    np.testing.assert_array_equal(of_motions.X1, split_half(poses, NOISE).X1)  # the noise is that of poses
    pairs = uq.PairNoise.isotropic(A=("0.2mrad", "0.2mm"), B=("2mrad", "2mm"))
    found = split_half(motions, pairs)
    assert found.possible and len(found.halves[0]) == 4
    A, B = motions.A[found.halves[0]], motions.B[found.halves[0]]
    alone = efficient(uq.Motions(A, B), pairs)
    assert np.abs(difference(found.X1, alone.X)).max() < 0.01 * np.sqrt(np.diag(alone.covariance_X)).min()


def test_halves_are_those_estimated_alone():
    """One step from the fit of all rows is, to a hundredth of a standard deviation, the estimate of the half."""
    poses = uq.simulate(16, noise=NOISE, seed=[SEED, 11])
    found = split_half(poses, NOISE)
    sd = np.sqrt(np.diag(found.covariance)).min()
    alone = [efficient(poses.rows(half), NOISE) for half in found.halves]
    for X, of in zip((found.X1, found.X2), alone, strict=True):
        assert np.abs(difference(X, of.X)).max() < 0.01 * sd
    assert_same_covariance(found.covariance, alone[0].covariance_X + alone[1].covariance_X, 0.02)


def test_rows_without_full_weight_are_left_out():
    poses = uq.simulate(16, noise=NOISE, seed=[SEED, 11])
    constraint = constraint_of(poses, NOISE)
    weights = np.where(np.arange(16) == 5, 0.0, np.where(np.arange(16) == 6, 0.5, 1.0))
    start = efficient(poses, NOISE).unknowns
    found = split_fit(fit(constraint, NOISE, start, 2, weights), poses, "interleaved")
    rest = np.delete(np.arange(16), [5, 6])
    assert [half.tolist() for half in found.halves] == [rest[::2].tolist(), rest[1::2].tolist()]
    assert found.d2 == pytest.approx(split_half(poses.rows(rest), NOISE).d2, rel=0.02)


def test_drift_is_found():
    noise = uq.PoseNoise.isotropic(robot=("0.05mrad", "0.05mm"), camera=("0.2mrad", "0.2mm"))
    poses = uq.simulate(30, noise=noise, seed=[SEED, 9])
    X = poses.truth.X
    later = moved(X, np.array([0, 0, 0, 0, 0, 2e-3]))
    camera = poses.camera.copy()
    camera[15:] = np.linalg.inv(later) @ X @ camera[15:]  # the camera slips in its bracket
    slipped = uq.PosePairs(poses.robot, camera)
    found = split_half(slipped, noise, split="contiguous")
    assert not found.passed and "do not agree" in found.sentence
    assert split_half(poses, noise, split="contiguous").p_value > 1e-3


def test_what_is_not_possible():
    few = split_half(uq.simulate(5, noise=NOISE, seed=1), NOISE)
    assert not few.possible and few.passed is None and "a half has 2 poses, 3 are needed" in few.sentence
    poses = uq.simulate(12, seed=1)
    still = np.repeat(poses.robot[:1], 6, axis=0), np.repeat(poses.camera[:1], 6, axis=0)
    halted = uq.PosePairs(np.concatenate([still[0], poses.robot[6:]]), np.concatenate([still[1], poses.camera[6:]]))
    found = split_half(halted, NOISE, split="contiguous")
    assert not found.possible and found.X1 is None and "not run, because the fit of one half fails" in found.sentence
    data = json.loads(json.dumps(found.to_dict()))
    assert data["reason"]["code"] == "diagnostics.half_fails" and SplitHalf.from_dict(data).to_dict() == data
    with pytest.raises(uq.InputError, match="X1 to be numbers"):
        SplitHalf.from_dict(data | {"reason": None})
    with pytest.raises(uq.InputError, match="a reason why it has none"):
        SplitHalf.from_dict(data | {"X1": np.eye(4).tolist()})


def test_words_and_dictionary():
    poses = uq.simulate(20, noise=NOISE, seed=3)
    found = split_half(poses, NOISE)
    assert found.sentence.startswith("The two halves of the data (even and odd rows: 10 and 10) agree within")
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    np.testing.assert_array_equal(data["X1"], found.X1)
    assert data["passed"] == bool(found.passed)
    assert SplitHalf.from_dict(data).to_dict() == found.to_dict()
    with pytest.raises(uq.InputError, match="X1 to be numbers of shape"):
        SplitHalf.from_dict(data | {"X1": [1.0]})
    many = split_half(uq.simulate(20, noise=NOISE, trials=3, seed=3), NOISE)
    assert many.d2.shape == (3,) and "of 3 split-half tests" in many.sentence


@pytest.mark.statistical
def test_estimated_noise_passes_as_often_as_it_should():
    """About 95 of 100; far less often where the covariance is a half of what it is."""
    from scipy.special import fdtrc

    from uq_handeye.fit.graph.goodness_of_fit import effective_dof

    noise = uq.PoseNoise.isotropic(robot=("0.1deg", "0.1mm"), camera=("0.1deg", "0.3mm"))
    n, trials = 10, 200
    many = uq.simulate(n, noise=noise, trials=trials, seed=[SEED, 17, n])
    passed, halved = 0, 0
    for k in range(trials):
        poses = uq.PosePairs(many.robot[k], many.camera[k])
        estimate = uq.estimate_noise(poses)
        dof = effective_dof(efficient(poses, estimate.noise), estimate)
        found = split_half(poses, estimate.noise, dof=dof)
        passed += bool(found.p_value > 0.05)
        halved += fdtrc(6, dof, 2.0 * float(found.d2) / 6) > 0.05
    low, high = stats.binom.ppf([0.0005, 0.9995], trials, 0.95)
    assert low <= passed <= high
    assert halved < low


def test_too_little_to_estimate_from():
    noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    found = split_half(uq.simulate(8, noise=noise, seed=1), noise, dof=5.0)
    assert not found.possible and "5 degrees of freedom only" in str(found.reason)


def test_halves_that_share_all_their_errors_are_no_test(monkeypatch):
    poses = uq.simulate(n_poses=20, noise=uq.PoseNoise.isotropic(camera=("1mrad", "1mm")), seed=3)
    own = np.tile(np.diag([1e-6] * 3 + [1e-6] * 3), (20, 1, 1))
    noise = uq.PoseNoise(camera=JointCovariance(own, np.full((20, 6, 1), 1e-4)))
    monkeypatch.setattr(
        "uq_handeye.fit.diagnostics.split_half._between", lambda *_: np.eye(6)
    )  # more than the variance of both
    found = split_half(poses, noise)
    assert not found.possible and "the same" in found.sentence
