"""Sandwich and bootstrap against brute force and against the sampling covariance."""

from functools import cache

import numpy as np
import pytest
from scipy import linalg, stats
from support import (
    CONFIDENCE,
    SEED,
    assert_same_covariance,
    difference,
    draw,
    exact_motions,
    exact_poses,
    jacobian,
    moved,
    random_covariance,
    rotations,
    transforms,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.fit.diagnostics import sandwich as by_influence
from uq_handeye.fit.diagnostics.resampled import OfMethod, resampled
from uq_handeye.fit.diagnostics.sandwich import influence_of, of_known
from uq_handeye.fit.graph.constraint import OnMotions, OnPoses
from uq_handeye.fit.graph.gauss_helmert import efficient, fit
from uq_handeye.fit.graph.reference import Reference
from uq_handeye.fit.graph.request import OF_RESIDUALS as KINDS
from uq_handeye.fit.graph.starts import start_of
from uq_handeye.methods.all_pairs import solve_all_pairs
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.methods.registry import METHODS, ROBOT_WORLD_METHODS
from uq_handeye.methods.target_pose import mean_target
from uq_handeye.model.errors.keys import TARGET_SCALE
from uq_handeye.model.errors.pose_prior import PosePrior

NOISE = uq.PoseNoise.isotropic(robot=("0.2mrad", "0.1mm"), camera=("1mrad", "1mm"))
SMOOTH = [name for name, method in METHODS.items() if method.smooth]


def sandwich(found):
    return influence_of(found).sandwich()


def bootstrap(found, replicates=2000, seed=0):
    return influence_of(found).bootstrap(replicates, seed)


@cache
def simulated(n=30, trials=2000):
    """Data sets and their fits."""
    poses = uq.simulate(n, noise=NOISE, trials=trials, seed=SEED)
    return poses, efficient(poses, NOISE)


@cache
def one_fit(n=16, weighted=False):
    poses = uq.simulate(n, noise=NOISE, seed=SEED)
    weights = np.random.default_rng(SEED).uniform(0.1, 1.0, n) if weighted else None
    constraint = OnPoses(poses.robot, poses.camera, False)
    return poses, fit(constraint, NOISE, start_of(poses, constraint, None), 1, weights)


def some(poses, trials):
    return uq.PosePairs(poses.robot[:trials], poses.camera[:trials])


@cache
def freedom_of_simulated():
    return float(influence_of(efficient(some(simulated()[0], 20), NOISE)).freedom.mean())


def edge(freedom, p):
    """Return how far the eigenvalues of a Wishart mean of p components stray from 1, and half as much again."""
    return 1.5 * (2 * np.sqrt(p / freedom) + p / freedom)


def dense(found):
    """Whitened residuals (6n,) and J (6n, p) of one fit, by a Cholesky factor of all poses together."""
    S = found.S if found.weights is None else found.S / found.weights[:, None, None]
    L = np.linalg.cholesky(linalg.block_diag(*S))
    return np.linalg.solve(L, found.residual.ravel()), np.linalg.solve(L, found.linear.J.reshape(L.shape[0], -1))


def same_up_to(values, reference, tolerance=1e-9):
    assert np.abs(values - reference).max() < tolerance * np.abs(reference).max()


# --------------------------------------------------------------------------------------- against brute force


@pytest.mark.parametrize("weighted", [False, True])
def test_sandwich_is_CR2_of_the_dense_problem(weighted):
    _, found = one_fit(weighted=weighted)
    e, J = dense(found)
    M = np.linalg.inv(J.T @ J)
    H = J @ M @ J.T
    total, expected = np.zeros((12, 12)), np.zeros((12, 12))
    for k in range(len(e) // 6):
        own = slice(6 * k, 6 * k + 6)
        kept = np.eye(6) - H[own, own]
        A = linalg.fractional_matrix_power(kept, -0.5).real
        score = J[own].T @ A @ e[own]
        total += M @ np.outer(score, score) @ M
        expected += M @ J[own].T @ A @ kept @ A @ J[own] @ M
    assert_same_covariance(sandwich(found), total, 1e-6)
    assert_same_covariance(expected, M, 1e-6)  # unbiased under the working model
    assert np.abs(whitened_eigenvalues(sandwich(found), M) - 1).max() > 0.05  # it is not the model's


def test_degrees_of_freedom_are_those_of_the_double_sum():
    _, found = one_fit(n=20)
    at = influence_of(found)
    e = np.eye(6 * at.n) + at.J.reshape(-1, 12) @ at.B.transpose(1, 0, 2).reshape(12, -1)
    c = (at.B @ at.adjustment)[:, :6] @ e.reshape(at.n, 6, -1)  # (n, 6, 6n), by the whitened errors
    c = np.linalg.solve(np.linalg.cholesky(found.covariance_X), c)
    T = np.einsum("kax,lbx->klab", c, c)
    double = (np.einsum("klaa->kl", T) ** 2 + np.einsum("klab,klba->kl", T, T)).sum()
    assert at.freedom == pytest.approx(42 / double, rel=1e-8)


def test_many_poses_beside_shared_errors_are_refused():
    found = uq.calibrate(uq.simulate(12, noise=NOISE, seed=1), noise=NOISE, shared=[uq.SharedError.target_scale(1e-3)])
    assert influence_of(found.analysis.fit, most_with_errors=12).sandwich().shape[-1] >= 12
    with pytest.raises(uq.InputError, match=r"at most 11 poses, got 12.*covariance='model'"):
        influence_of(found.analysis.fit, most_with_errors=11)


@pytest.mark.parametrize("shared", [False, True])
def test_what_is_known_beforehand_is_not_drawn(shared):
    """The prior is the same for every draw of the poses, so that the draws vary less than without it."""
    n = 16
    small = uq.PoseNoise(0.01 * NOISE.robot, 0.01 * NOISE.camera)
    poses = uq.simulate(n, noise=small, seed=SEED)
    sd = np.sqrt(np.diag(efficient(poses, small).covariance_X))
    prior = PosePrior.of((moved(poses.truth.X, 0.5 * sd), np.diag(sd**2)), None)
    camera = small.camera
    if shared:
        scale = uq.SharedError.target_scale(1e-3)
        camera = uq.JointCovariance(np.tile(small.camera, (n, 1, 1)), scale.at(poses) * 1e-3, (TARGET_SCALE,))
    noise = uq.PoseNoise(small.robot, camera, prior=prior)
    found = efficient(poses, noise)
    at = influence_of(found)
    # what residuals can say and what was known beforehand are all of it, on average
    assert_same_covariance(at.covariance[:12, :12] + of_known(found), found.covariance, 1e-6)
    drawn = bootstrap(found)
    without = efficient(poses, uq.PoseNoise(small.robot, camera))
    assert whitened_eigenvalues(bootstrap(without)[:6, :6], drawn[:6, :6]).min() > 1.2


def test_bootstrap_solves_the_linear_problem_with_repeated_rows(monkeypatch):
    _, found = one_fit()
    e, J = dense(found)
    n = len(e) // 6
    counts = np.random.default_rng(5).multinomial(n, np.full(n, 1 / n), size=40)
    moves = []
    for row in counts:
        rows = np.repeat(np.arange(6 * n).reshape(n, 6), row, axis=0).ravel()
        moves.append(-np.linalg.lstsq(J[rows], e[rows], rcond=None)[0])
    value = bootstrap(found, 40, seed=5)
    assert_same_covariance(value, np.cov(np.array(moves).T), 1e-6)
    monkeypatch.setattr(by_influence, "CHUNK", 250)  # some 7 draws at once
    assert_same_covariance(bootstrap(found, 40, seed=5), value, 1e-9)
    assert np.abs(bootstrap(found, 40, seed=6) - value).max() > 0


def test_draws_of_too_few_poses_are_left_out():
    _, found = one_fit(n=7)
    counts = np.random.default_rng(0).multinomial(7, np.full(7, 1 / 7), size=4000)
    assert ((counts > 0).sum(axis=1) < 3).any()
    value = bootstrap(found, 4000)
    assert np.isfinite(value).all() and np.sqrt(np.diag(value)).max() < 10 * np.sqrt(np.diag(found.covariance)).max()


# --------------------------------------------------------------------------------- against the sampling covariance


def test_with_the_true_noise_model_the_sandwich_is_unbiased():
    poses, found = simulated()
    trials = len(found.X)
    errors = np.concatenate([difference(found.X, poses.truth.X), difference(found.W, poses.truth.W)], axis=1)
    sampled, model = errors.T @ errors / trials, found.covariance.mean(axis=0)
    S, freedom = sandwich(found), trials * freedom_of_simulated()
    assert_same_covariance(S.mean(axis=0), model, edge(freedom, 12))
    assert_same_covariance(S.mean(axis=0), sampled, edge(trials, 12))
    # residuals that are taken as they are make it too small
    at = influence_of(found)
    raw = (at.B @ at.residual[..., None])[..., 0]
    assert np.abs(whitened_eigenvalues((raw.mT @ raw).mean(axis=0), model) - 1).max() > 1.3 * edge(freedom, 12)


def test_bootstrap_has_the_size_of_the_sampling_covariance():
    poses, _ = simulated()
    found = efficient(some(poses, 300), NOISE)
    ratio = whitened_eigenvalues(bootstrap(found, 150).mean(axis=0), found.covariance.mean(axis=0))
    assert 0.92 < ratio.mean() < 1.02  # measured 0.97
    assert ratio.min() > 0.75
    assert ratio.max() < 1.2


@pytest.mark.statistical
def test_hotelling_covers_and_chi_square_does_not():
    poses, found = simulated()
    errors = difference(found.X, poses.truth.X)
    d2 = np.einsum("ti,ti->t", errors, np.linalg.solve(sandwich(found)[:, :6, :6], errors[..., None])[..., 0])
    freedom = freedom_of_simulated()
    for level in (0.68, 0.9, 0.95):
        low, high = stats.binom.ppf([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], len(d2), level) / len(d2)
        # the reference is an approximation: within 0.02 of the level
        assert low - 0.02 < (d2 < Reference("Hotelling", freedom).quantile(level)).mean() < high + 0.02
        assert (d2 < stats.chi2.ppf(level, 6)).mean() < low - 0.1


@pytest.mark.statistical
def test_where_every_third_pose_is_worse_the_sandwich_is_right_and_the_model_is_not():
    n, trials = 60, 1000
    worse = np.where(np.arange(n) % 3 == 0, 25.0, 1.0)[:, None, None]
    poses = uq.simulate(n, noise=uq.PoseNoise(NOISE.robot * worse, NOISE.camera * worse), trials=trials, seed=SEED)
    found = efficient(poses, NOISE)
    errors = difference(found.X, poses.truth.X)
    sampled = errors.T @ errors / trials
    assert_same_covariance(sandwich(found)[:, :6, :6].mean(axis=0), sampled, edge(trials, 6) + 0.05)
    assert whitened_eigenvalues(found.covariance_X.mean(axis=0), sampled).max() < 0.3


@pytest.mark.slow
def test_sandwich_of_4dpa_is_the_sampling_covariance():
    poses, _ = simulated()
    errors = difference(solve_all_pairs(poses), poses.truth.X)
    sampled = errors.T @ errors / len(errors)
    trials = 150
    found = [resampled(uq.PosePairs(poses.robot[k], poses.camera[k]), "4dpa") for k in range(trials)]
    mean = np.mean([r.covariance_X for r in found], axis=0)
    freedom = trials * np.mean([r.freedom for r in found])
    assert_same_covariance(mean, sampled, edge(len(errors), 6) + edge(freedom, 6))


# ------------------------------------------------------------------------------------------------ other methods


def solved(problem, robot, camera):
    """X and W of poses (m, n, 4, 4), by the methods' own functions on all pairs."""
    poses = uq.PosePairs(robot, camera, problem.poses.setup)
    if problem.both is not None:
        return problem.both(poses)
    motions = uq.relative_motions(poses, "all")
    noise = problem.of_pairs()
    X = METHODS[problem.method].estimate(motions.A, motions.B, noise).X
    return X, mean_target(poses, X)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "setup"),
    [(name, "eye-in-hand") for name in (*SMOOTH, *ROBOT_WORLD_METHODS)]
    + [(name, "eye-to-hand") for name in ("4dpa", "park", "shah")],
)
def test_errors_of_both_sides_reach_the_estimate_through_the_residual_alone(method, setup, rng):
    n = 5 if method == "heller" else 6
    X, robot, camera = exact_poses(rng, n, setup)
    problem = OfMethod(uq.PosePairs(robot, camera, setup), method, None, NOISE if method == "nguyen" else None)
    r, J, B = problem.first_order()
    assert np.abs(r).max() < 1e-6
    W = problem.at.W
    linear = OnPoses(robot, camera, setup == "eye-to-hand").linearise(problem.at, robot, camera)
    for side in (0, 1):

        def by_errors(xi, side=side):
            xi = xi.reshape(-1, n, 6)
            data = [np.broadcast_to(T, (len(xi), n, 4, 4)) for T in (robot, camera)]
            data[side] = moved(data[side], xi)
            found = solved(problem, *data)
            return np.concatenate([difference(found[0], X), difference(found[1], W)], axis=1)

        numerical = jacobian(by_errors, 6 * n, 1e-3)
        closed = (B @ linear.sides[side]).transpose(1, 0, 2).reshape(12, 6 * n)
        same_up_to(closed, numerical, 1e-4)
    # an estimator that is consistent follows a shift of X and W
    same_up_to(np.einsum("kpa,kaq->pq", B, J), -np.eye(12), 1e-5)


def solved_again(method, poses, rows, noise=None):
    """X and W of some of the poses, some of them several times, each pair that has two poses."""
    drawn = uq.PosePairs(poses.robot[rows], poses.camera[rows])
    if method in ROBOT_WORLD_METHODS:
        return ROBOT_WORLD_METHODS[method](drawn)
    motions = uq.relative_motions(drawn, "all")
    X = METHODS[method].estimate(motions.A, motions.B, None if noise is None else noise_of_pairs(motions, noise)).X
    return X, mean_target(drawn, X)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "shah"])
def test_bootstrap_of_other_methods_is_that_of_solving_again_to_first_order(method):
    noise = uq.PoseNoise(0.01 * NOISE.robot, 0.01 * NOISE.camera)
    n, replicates = 60, 200
    poses = uq.simulate(n, noise=noise, seed=SEED)
    counts = np.random.default_rng(3).multinomial(n, np.full(n, 1 / n), size=replicates)
    whole = solved_again(method, poses, np.arange(n))
    moves = []
    for row in counts:
        again = solved_again(method, poses, np.repeat(np.arange(n), row))
        moves.append(np.concatenate([difference(a, b) for a, b in zip(again, whole, strict=True)]))
    found = resampled(poses, method, "bootstrap", replicates=replicates, seed=3)
    ratio = whitened_eigenvalues(found.covariance, np.cov(np.array(moves).T))
    print(method, ratio)
    assert np.abs(ratio - 1).max() < 0.1  # measured 0.08 of 4dpa (pairs), 0.0002 of shah


# -------------------------------------------------------------------------------------------------- on motions


@pytest.mark.slow
def test_on_motions_the_clusters_are_motions(rng):
    trials, N = 1000, 25
    _, A, B = exact_motions(rng, N)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    A, B = (
        moved(np.broadcast_to(T, (trials, N, 4, 4)), draw(rng, S, (trials, N))) for T, S in ((A, noise.A), (B, noise.B))
    )
    found = efficient(uq.Motions(A, B), noise)
    freedom = trials * influence_of(efficient(uq.Motions(A[:20], B[:20]), noise)).freedom.mean()
    assert_same_covariance(sandwich(found).mean(axis=0), found.covariance.mean(axis=0), edge(freedom, 6) + 0.02)
    one = uq.Motions(A[0], B[0])
    for method in ("efficient", "4dpa", "park"):
        values = [resampled(one, method, kind, noise=noise, replicates=300) for kind in KINDS]
        assert all(r.cluster == "motions" and r.clusters == 25 and r.covariance_W is None for r in values)
        ratio = [whitened_eigenvalues(r.covariance_X, values[0].covariance_X) for r in values[1:]]
        assert np.min(ratio) > 0.4
        assert np.max(ratio) < 3.0


def test_sensitivities_on_motions_are_numerical_ones(rng):
    X, A, B = exact_motions(rng, 5)
    problem = OfMethod(uq.Motions(A, B), "park", None, None)
    linear = OnMotions(A, B).linearise(problem.at, A, B)
    closed = (problem.first_order()[2] @ linear.sides[1]).transpose(1, 0, 2).reshape(6, 30)
    numerical = jacobian(lambda xi: difference(uq.solve(A, moved(B, xi.reshape(-1, 5, 6)), method="park"), X), 30, 1e-3)
    same_up_to(closed, numerical, 1e-6)


# --------------------------------------------------------------------------------------------------- refusals


def test_joint_noise_is_refused():
    poses = uq.simulate(10, noise=NOISE, seed=SEED)
    joint = uq.PoseNoise(camera=np.kron(np.eye(10) + 0.5, NOISE.camera))
    for call in (sandwich, bootstrap):
        with pytest.raises(uq.InputError, match="joint"):
            call(efficient(poses, joint))
    with pytest.raises(uq.InputError, match="joint"):
        resampled(poses, "4dpa", noise=joint)


def test_too_few_poses_and_a_pose_that_carries_all_are_refused(rng):
    few = uq.simulate(6, noise=NOISE, seed=SEED)
    for method in ("efficient", "4dpa"):
        with pytest.raises(uq.InputError, match="at least 7"):
            resampled(few, method, noise=NOISE)
    turns = np.zeros((10, 3))
    turns[:, 2] = np.linspace(0, 2, 10)
    turns[4] = (1.0, 0.2, 0.3)
    X, W = (transforms(rotations(v), v) for v in rng.normal(size=(2, 3)))
    G = transforms(rotations(turns), rng.normal(size=(10, 3)))
    C = np.linalg.inv(X) @ np.linalg.inv(G) @ W
    small = uq.PoseNoise.isotropic(camera=(1e-5, 1e-5))
    poses = uq.PosePairs(G, moved(C, 1e-5 * rng.normal(size=(10, 6))))
    with pytest.raises(uq.DegenerateMotionError, match=r"Without pose \(or motion\) 4 the"):
        sandwich(efficient(poses, small))


@pytest.mark.slow
def test_what_a_method_does_not_allow_is_said():
    poses, _ = one_fit()
    consecutive = uq.relative_motions(poses)
    for arguments, options, message in (
        ((poses, "li", "bootstrap"), {}, "Choose 'sandwich'"),
        ((poses, "zhao", "sandwich"), {}, "no smooth function"),
        ((poses, "nguyen", "sandwich"), {}, "give the `noise`"),
        ((poses, "efficient", "sandwich"), {}, "give `noise`, or the `fit`"),
        ((uq.Motions(consecutive.A, consecutive.B), "shah", "bootstrap"), {}, "needs poses"),
        ((poses, "4dpa", "other"), {}, "Expected `kind`"),
        ((poses, "other", "sandwich"), {}, "Expected `method`"),
        (("poses", "4dpa", "sandwich"), {}, "Expected `data`"),
        ((poses, "4dpa", "bootstrap"), {"replicates": 1}, "Expected `replicates`"),
        ((simulated()[0], "4dpa", "sandwich"), {}, "one data set"),
    ):
        with pytest.raises(uq.InputError, match=message):
            resampled(*arguments, **options)
    with pytest.raises(uq.InputError, match="exact"):
        resampled(uq.simulate(10, noise=uq.PoseNoise(camera=np.zeros((6, 6))), seed=1), "4dpa")
    shared = uq.PairNoise.isotropic(A=("1mrad", "1mm"), B=("1mrad", "1mm"))
    with pytest.raises(uq.InputError, match="share poses"):
        resampled(consecutive, "efficient", noise=shared)
    assert resampled(consecutive, "efficient", noise=NOISE).cluster == "poses"
    assert resampled(consecutive, "park").clusters == poses.n


def test_poses_of_weight_zero_are_no_clusters():
    poses, _ = one_fit()
    rest = np.arange(16) != 5
    constraint = OnPoses(poses.robot, poses.camera, False)
    start = start_of(poses, constraint, None)
    found = fit(constraint, NOISE, start, 1, rest.astype(float))
    without = fit(OnPoses(poses.robot[rest], poses.camera[rest], False), NOISE, start, 1)
    assert_same_covariance(sandwich(found), sandwich(without), 1e-6)
    assert resampled(poses, "efficient", "bootstrap", fit=found).clusters == 15
