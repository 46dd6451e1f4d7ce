"""Robust fits: distances against leaving poses out, weights, outliers of every kind, scale, and honest refusals."""

import numpy as np
import pytest
from scipy import stats
from support import SEED, difference, mean_interval, moved, random_covariance, random_transforms, rotations, transforms

import uq_handeye as uq
from uq_handeye.fit.graph import gauss_helmert as likelihood
from uq_handeye.fit.graph.constraint import Linearised, OnPoses, Unknowns, block_diagonal, constraint_of
from uq_handeye.fit.graph.robust import FULL, NO_WEIGHT, consensus, in_turns, pose_distances, robust_fit, robust_weights
from uq_handeye.fit.graph.starts import start_of

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SETUPS = ("eye-in-hand", "eye-to-hand")


def isotropic_from_residuals(constraint, at, weights):
    """Stands in for the estimator of the noise: one deviation of rotation and one of translation, by hat matrices."""
    variances = np.full(2, 1e-6)
    on_poses = at.W is not None
    for _ in range(20):
        S = np.diag(np.repeat(variances, 3))
        noise = uq.PoseNoise(camera=S) if on_poses else uq.PairNoise(B=S)
        fitted = likelihood.fit(constraint, noise, at, 1, weights)
        at, J = fitted.unknowns, fitted.white[1]
        left = weights[:, None] * (1.0 - np.einsum("nip,pq,niq->ni", J, fitted.covariance, J))
        squares = weights[:, None] * fitted.residual**2
        variances = np.array([squares[:, part].sum() / left[:, part].sum() for part in (slice(3), slice(3, 6))])
    return noise


# ------------------------------------------------------------------------------------------------------ distances


def linear_fit(rng, n, joint, weights):
    """A fit of a linear model with any S, and the same by plain generalised least squares on a chosen set of rows."""
    J, S = rng.normal(size=(n, 6, 12)), random_covariance(rng, 6 * n, sd=1.0)
    if not joint:
        S = np.stack([random_covariance(rng, sd=1.0) for _ in range(n)])
    r = rng.normal(size=(n, 6))
    dense = likelihood.weighted(S if joint else block_diagonal(S), weights)
    J_flat, inverse = J.reshape(6 * n, 12), np.linalg.inv(dense)
    P = np.linalg.inv(J_flat.T @ inverse @ J_flat)
    x = P @ J_flat.T @ inverse @ r.ravel()
    linear = Linearised(r, J, (np.zeros((n, 6, 6)), np.zeros((n, 6, 6))))
    unknowns = Unknowns(np.eye(4), np.eye(4))
    residual = (r.ravel() - J_flat @ x).reshape(n, 6)
    return likelihood.Fit(unknowns, P, linear, S, residual, 1, np.array(True), weights), r, dense


@pytest.mark.parametrize("joint", [False, True])
def test_distances_are_those_of_poses_left_out(joint):
    """The model fitted without pose i predicts it: error and covariance by explicit conditioning on the others."""
    rng = np.random.default_rng(SEED)
    n = 7
    weights = np.array([1.0, 1.0, 0.4, 1.0, 0.0, 1.0, 1.0])
    fitted, r, dense = linear_fit(rng, n, joint, weights)
    found, leverage = pose_distances(fitted)
    J, J_flat = fitted.linear.J, fitted.linear.J.reshape(-1, 12)
    for i in range(n):
        own = np.arange(6 * i, 6 * i + 6)
        rest = np.delete(np.arange(6 * n), own)
        among, across = np.linalg.inv(dense[np.ix_(rest, rest)]), dense[np.ix_(own, rest)]
        P = np.linalg.inv(J_flat[rest].T @ among @ J_flat[rest])
        x = P @ J_flat[rest].T @ among @ r.ravel()[rest]
        error = r[i] - J[i] @ x - across @ among @ (r.ravel()[rest] - J_flat[rest] @ x)
        by_x = J[i] - across @ among @ J_flat[rest]
        S_own = fitted.S[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] if joint else fitted.S[i]
        covariance = S_own - across @ among @ across.T + by_x @ P @ by_x.T
        tolerance = 1e-3 if joint and weights[i] == 0 else 1e-8  # there 1e12 times S is added and taken back
        assert found[i] == pytest.approx(error @ np.linalg.solve(covariance, error), rel=tolerance)
    assert leverage.sum() == pytest.approx(1.0)
    assert leverage[4] < 1e-9


def test_distances_of_joint_and_single_covariances_agree():
    rng = np.random.default_rng(SEED + 1)
    fitted, _, _ = linear_fit(rng, 6, False, np.array([1.0, 0.7, 1.0, 1.0, 1.0, 1.0]))
    whole = likelihood.Fit(**{**fitted.__dict__, "S": block_diagonal(fitted.S)})
    for single, joint in zip(pose_distances(fitted), pose_distances(whole), strict=True):
        np.testing.assert_allclose(single, joint, rtol=1e-8)


@pytest.mark.statistical
@pytest.mark.parametrize("setup", SETUPS)
def test_distances_are_chi_square_over_trials(setup):
    """Also: the raw residual's squares are not, and batches equal single problems."""
    poses = uq.simulate(12, noise=NOISE, setup=setup, trials=1500, seed=SEED)
    fitted = likelihood.efficient(poses, NOISE)
    distances, leverage = pose_distances(fitted)
    assert distances.shape == leverage.shape == (1500, 12)
    low, high = mean_interval(1500)
    means, raw = distances.mean(axis=0), (fitted.white[0] ** 2).sum(axis=-1).mean(axis=0)
    assert ((low < means) & (means < high)).sum() >= 11
    assert (raw < low).all()
    np.testing.assert_allclose(leverage.sum(axis=-1), 1.0)
    flagged = stats.binom.ppf([0.0005, 0.9995], distances[:, ::12].size, 0.001)
    assert flagged[0] <= (distances[:, ::12] > FULL).sum() <= flagged[1]


def test_a_pose_that_no_other_predicts_is_not_judged():
    """Only pose 0 determines the last unknown: its residual there is 0 whatever it measured."""
    rng = np.random.default_rng(SEED)
    J = rng.normal(size=(8, 6, 12))
    J[1:, :, 11] = 0.0
    r, n = rng.normal(size=(8, 6)), 8
    P = np.linalg.inv(J.reshape(-1, 12).T @ J.reshape(-1, 12))
    residual = r - J @ (P @ J.reshape(-1, 12).T @ r.ravel())
    S = np.broadcast_to(np.eye(6), (n, 6, 6))
    linear = Linearised(r, J, (S, S))
    for covariance in (S, np.eye(6 * n)):
        found = likelihood.Fit(Unknowns(np.eye(4), None), P, linear, covariance, residual, 1, np.array(True))
        assert 0 < pose_distances(found)[0][0] < 30


def test_weights_fall_between_two_quantiles():
    assert pytest.approx(stats.chi2.ppf(0.999, 6), rel=1e-7) == FULL
    assert pytest.approx(stats.chi2.isf(1e-6, 6), rel=1e-7) == NO_WEIGHT
    d2 = np.array([0.0, FULL, 0.5 * (FULL + NO_WEIGHT), NO_WEIGHT, 1e9])
    np.testing.assert_allclose(robust_weights(d2), [1.0, 1.0, 0.5, 0.0, 0.0], atol=1e-12)


# ------------------------------------------------------------------------------------------------------- outliers


def spoiled(poses, kind, count, rng):
    """The poses with ``count`` wrong ones, and which they are."""
    rows = rng.choice(poses.n, count, replace=False)
    robot, camera = poses.robot.copy(), poses.camera.copy()
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    zero = np.zeros((count, 3))
    if kind == "random":
        camera[rows] = random_transforms(rng, (count,))
    elif kind == "turned by 5 degrees":
        camera[rows] = moved(camera[rows], np.hstack([np.radians(5) * direction, zero]))
    elif kind == "shifted by 5 cm":
        camera[rows] = moved(camera[rows], np.hstack([zero, 0.05 * direction]))
    elif kind == "board by 180 degrees":
        half_turn = transforms(rotations([0.0, 0.0, np.pi]), np.array([0.2, 0.15, 0.0]))
        camera[rows] = camera[rows] @ half_turn
    elif kind == "robot":
        robot[rows] = poses.robot[(rows + 7) % poses.n]
    elif kind == "other board":
        camera[rows] = camera[rows] @ transforms(rotations([0.0, 0.0, 0.1]), np.array([0.05, 0.02, 0.0]))
    elif kind == "frozen":
        camera[rows] = moved(np.tile(random_transforms(rng), (count, 1, 1)), 1e-4 * rng.normal(size=(count, 6)))
    return uq.PosePairs(robot, camera, poses.setup), np.sort(rows)


KINDS = (
    "random",
    "turned by 5 degrees",
    "shifted by 5 cm",
    "board by 180 degrees",
    "robot",
    "other board",
    "frozen",
)


@pytest.mark.statistical
@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("kind", KINDS)
def test_as_good_as_without_the_outliers(kind, known):
    """4 of 40 poses are wrong: every one is rejected, and X is within 1.2 times the error of the clean set's."""
    worse = flagged = 0
    for trial in range(6):
        rng = np.random.default_rng([SEED, trial, KINDS.index(kind)])
        poses = uq.simulate(40, noise=NOISE, setup=SETUPS[trial % 2], seed=rng)
        data, wrong = spoiled(poses, kind, 4, rng)
        good = np.setdiff1d(np.arange(40), wrong)
        clean = uq.PosePairs(poses.robot[good], poses.camera[good], poses.setup)
        rows, at = constraint_of(clean, NOISE), likelihood.efficient(clean, NOISE).unknowns
        noise = NOISE if known else isotropic_from_residuals(rows, at, np.ones(36))
        reference = likelihood.efficient(clean, noise)
        found = robust_fit(data, NOISE if known else None, estimate=isotropic_from_residuals, seed=trial)
        assert set(wrong) <= set(found.rejected)
        assert all(found.flags[k] == "rejected" for k in wrong)
        flagged += sum(found.flags[k] != "kept" for k in good)
        information = np.linalg.inv(likelihood.bound(poses, NOISE))
        error, best = (
            np.sqrt(e @ information @ e) for e in (difference(X, poses.truth.X) for X in (found.fit.X, reference.X))
        )
        worse += error > 1.2 * best
        # the test tells: with the outliers left in, the error is far larger
        spoilt = difference(likelihood.efficient(data, NOISE).X, poses.truth.X)
        assert np.sqrt(spoilt @ information @ spoilt) > 1.2 * error
    assert worse == 0
    assert flagged <= stats.binom.ppf(0.9995, 6 * 36, 0.001)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "wrong_ones", "known"), [(10, 1, True), (10, 1, False), (20, 1, False), (40, 15, True)])
def test_few_poses_and_many_outliers(n, wrong_ones, known):
    for trial in range(5):
        rng = np.random.default_rng([SEED, n, trial])
        data, wrong = spoiled(uq.simulate(n, noise=NOISE, seed=rng), "random", wrong_ones, rng)
        found = robust_fit(data, NOISE if known else None, estimate=isotropic_from_residuals)
        assert set(wrong) <= set(found.rejected)
        assert len(found.rejected) <= wrong_ones + 1


@pytest.mark.slow
def test_everything_above_five_sigma_is_flagged():
    """Outliers of 4 to 9 sigma, judged by the residuals of a fit without them."""
    for trial in range(10):
        rng = np.random.default_rng([SEED, 5, trial])
        poses = uq.simulate(40, noise=NOISE, seed=rng)
        camera, wrong = poses.camera.copy(), np.arange(4)
        xi = np.zeros((4, 6))
        xi[np.arange(4), 3 + rng.integers(3, size=4)] = 0.5e-3 * rng.uniform(4, 9, 4)
        camera[:4] = moved(camera[:4], xi)
        data = uq.PosePairs(poses.robot, camera)
        found = robust_fit(data, NOISE)
        constraint = constraint_of(data, NOISE)
        left_out = np.r_[np.zeros(4), np.ones(36)]
        judge = likelihood.fit(constraint, NOISE, start_of(data, constraint, found.fit.X), 1, left_out)
        large = np.abs(judge.white[0][wrong]).max(axis=1) > 5.5
        assert all(found.flags[k] != "kept" for k in wrong[large])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["efficient", "ml"])
def test_clean_data_lose_nothing(method):
    """The same X as without robustness, but for a step of second order and the rare pose that is flagged."""
    ratios = []
    for trial in range(20):
        poses = uq.simulate(20, noise=NOISE, seed=np.random.default_rng([SEED, 9, trial]))
        found = robust_fit(poses, NOISE, method=method)
        plain = (likelihood.efficient if method == "efficient" else likelihood.maximum_likelihood)(poses, NOISE)
        shift = difference(found.fit.X, plain.X)
        ratios.append(shift @ np.linalg.solve(plain.covariance_X, shift))
        if set(found.flags) == {"kept"}:
            np.testing.assert_allclose(found.fit.covariance_X, plain.covariance_X, rtol=0.1, atol=1e-9)
            assert found.rejected.size == 0
    # 2 % of the variance of X is a standard deviation 1 % above the bound
    assert np.mean(ratios) < 0.02 * 6


def test_joint_noise_and_ml():
    """Errors that all camera poses share, such as those of the focal length, are no reason to reject poses."""
    rng = np.random.default_rng(SEED)
    shared = np.kron(np.ones((25, 25)), np.diag([0, 0, 0, 0, 0, 3e-3**2]))
    noise = uq.PoseNoise(NOISE.robot, np.kron(np.eye(25), NOISE.camera) + shared)
    poses = uq.simulate(25, noise=noise, seed=rng)
    data, wrong = spoiled(poses, "shifted by 5 cm", 2, rng)
    for method in ("efficient", "ml"):
        found = robust_fit(data, noise, method=method)
        assert found.rejected.tolist() == wrong.tolist()
        assert found.leverage.sum() == pytest.approx(1.0)
        error = difference(found.fit.X, poses.truth.X)
        assert error @ np.linalg.solve(found.fit.covariance_X, error) < stats.chi2.ppf(0.9999, 6)


@pytest.mark.parametrize("known", [True, False])
def test_motions_without_poses(known):
    rng = np.random.default_rng(SEED)
    truth = random_transforms(rng)
    B = random_transforms(rng, (40,), largest=2.0)
    sd = np.repeat([1e-3, 5e-4], 3)
    A = truth @ B @ np.linalg.inv(truth)
    B = moved(B, sd * rng.normal(size=(40, 6)))
    B[[3, 17, 30]] = random_transforms(rng, (3,))
    noise = uq.PairNoise(B=np.diag(sd**2))
    found = robust_fit(uq.Motions(A, B), noise if known else None, estimate=isotropic_from_residuals)
    assert found.rejected.tolist() == [3, 17, 30]
    assert found.fit.W is None and len(found.flags) == 40
    error = difference(found.fit.X, truth)
    assert error @ np.linalg.solve(found.fit.covariance_X, error) < 40


# ------------------------------------------------------------------------------------------- scale, refusals, edges


def test_noise_that_is_too_small_rejects_nobody():
    poses = uq.simulate(40, noise=NOISE, seed=SEED)
    data, wrong = spoiled(poses, "random", 4, np.random.default_rng(SEED))
    tenth = uq.PoseNoise(NOISE.robot / 100, NOISE.camera / 100)
    found = robust_fit(data, tenth)
    assert set(wrong) <= set(found.rejected) and len(found.rejected) <= 5
    assert 7 < found.scale < 13
    honest = robust_fit(data, NOISE)
    assert honest.scale == 1.0
    assert honest.limit == FULL
    large = robust_fit(data, uq.PoseNoise(NOISE.robot * 9, NOISE.camera * 9))
    assert large.scale == 1.0


def test_says_what_became_of_each_pose():
    rng = np.random.default_rng(SEED)
    data, wrong = spoiled(uq.simulate(30, noise=NOISE, seed=rng), "random", 2, rng)
    found = robust_fit(data, NOISE)
    assert found.rejected.tolist() == wrong.tolist()
    for flag, weight, d2 in zip(found.flags, found.weights, found.distances, strict=True):
        assert (flag == "kept") == (weight == 1) == (d2 <= found.limit)
        assert (flag == "rejected") == (weight == 0)
    again = robust_fit(data, NOISE)
    np.testing.assert_array_equal(found.fit.X, again.fit.X)


def test_consensus_uses_subsets_that_turn():
    """Half of the poses only translate: subsets of those say nothing, and must not end the search."""
    rng = np.random.default_rng(SEED)
    poses = uq.simulate(16, noise=None, seed=rng)
    robot = poses.robot.copy()
    robot[:8] = robot[0]
    robot[:8, :3, 3] += 0.1 * rng.normal(size=(8, 3))
    camera = np.linalg.inv(robot @ poses.truth.X) @ poses.truth.W
    camera = moved(camera, 1e-4 * rng.normal(size=(16, 6)))
    found = consensus(constraint_of(uq.PosePairs(robot, camera), None), None, 0)
    assert np.abs(difference(found.unknowns.X, poses.truth.X)).max() < 2e-3


def test_refuses():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    with pytest.raises(uq.InputError, match="'efficient' or 'ml'"):
        robust_fit(poses, NOISE, method="median")
    with pytest.raises(uq.InputError, match="`noise`, or a function"):
        robust_fit(poses, None)
    with pytest.raises(uq.InputError, match="`noise` to be PoseNoise, PairNoise or None, got str"):
        robust_fit(poses, "1mm")
    with pytest.raises(uq.InputError, match="more than 3 poses to identify outliers, got 3"):
        robust_fit(uq.PosePairs(poses.robot[:3], poses.camera[:3]), NOISE)
    with pytest.raises(uq.InputError, match="one data set"):
        robust_fit(uq.simulate(12, noise=NOISE, trials=2, seed=SEED), NOISE)
    assert robust_fit(poses, None, estimate=lambda constraint, at, weights: None).noise is None  # exact data, it says
    still = uq.PosePairs(np.tile(poses.robot[:1], (6, 1, 1)), np.tile(poses.camera[:1], (6, 1, 1)))
    with pytest.raises(uq.DegenerateMotionError):
        robust_fit(still, NOISE)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [[*range(22), *range(18)], [*range(20)] * 2, [*range(21), *[3] * 19]])
@pytest.mark.parametrize("wrong", [False, True])
def test_copies_are_no_consensus(rows, wrong):
    """Exact copies agree for every X: they must neither decide what the others are judged by, nor hide a wrong pose."""
    poses = uq.simulate(22, noise=NOISE, seed=SEED)
    camera = poses.camera[rows].copy()
    bad = [k for k, row in enumerate(rows) if row == 7] if wrong else []
    camera[bad] = moved(camera[bad], np.tile([0.2, 0.0, 0.1, 0.1, 0.0, 0.0], (len(bad), 1)))
    found = robust_fit(uq.PosePairs(poses.robot[rows], camera), NOISE)
    assert set(bad) <= set(found.rejected) and len(found.rejected) <= len(bad) + 1
    xi = difference(found.fit.X, poses.truth.X)
    assert xi @ np.linalg.solve(found.fit.covariance_X, xi) < 20 * stats.chi2.ppf(0.999, 6)  # a copy counts as a pose
    start = consensus(OnPoses(poses.robot[rows], camera, False), NOISE, 0)
    assert start.inside.shape == (40,) and not start.inside[bad].any()
    first = np.array([rows.index(row) for row in rows])
    np.testing.assert_array_equal(start.inside, start.inside[first])
    assert np.linalg.norm(difference(start.unknowns.X, poses.truth.X)) < 0.02


def test_copies_of_too_few_poses():
    poses = uq.simulate(2, noise=NOISE, seed=SEED)
    rows = [0, 1] * 5
    data = uq.PosePairs(poses.robot[rows], poses.camera[rows])
    with pytest.raises(uq.DegenerateMotionError, match="Only 2 of the rows differ"):
        consensus(constraint_of(data, NOISE), NOISE, 0)
    assert len(robust_fit(data, NOISE).fit.open_directions) == 2  # about and along the axis of their one motion


def test_a_weight_that_falls_to_nothing_is_zero():
    """A mean of weights that comes ever nearer to 0 ends there: what is rejected counts as rejected."""
    rounds = iter(range(100))

    def fitted(weights, undamped):
        k = next(rounds)
        return k, np.array([1.0, float(k % 2 and undamped)])  # the second takes turns, then it is rejected

    _, weights = in_turns(fitted, np.ones(2), lambda done: 0.01, 100)
    assert weights.tolist() == [1.0, 0.0]
