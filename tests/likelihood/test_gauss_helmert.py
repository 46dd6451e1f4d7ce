"""`efficient` and `ml` against an independent constrained maximum of the likelihood with all latent poses."""

import numpy as np
import pytest
from fixtures.likelihood_problems import KINDS, as_joint, distance, problem, reference
from support import assert_same_covariance, difference, draw, exact_poses, moved, nees, random_covariance

import uq_handeye as uq
from uq_handeye.fit.graph.constraint import constraint_of, covariances_of
from uq_handeye.fit.graph.gauss_helmert import (
    CLOSED_FORM_STEPS,
    MAX_ML_STEPS,
    bound,
    efficient,
    fit,
    inverse_information,
    maximum_likelihood,
)
from uq_handeye.fit.graph.starts import start_of
from uq_handeye.model.errors.square_roots import gram, weighted, whiten


@pytest.mark.slow
@pytest.mark.parametrize("sd", [1e-4, 3e-2])
@pytest.mark.parametrize(("kind", "joint"), [*((k, False) for k in KINDS), *((k, True) for k in KINDS[:2])])
def test_ml_is_the_constrained_maximum(kind, joint, sd, rng):
    """X and W to 1e-6 standard deviations, at 0.1 mrad and at 30 mrad and 30 mm; the whole covariance to 1e-6."""
    given = problem(kind, rng, 6, sd, joint)
    X, W, covariance, deviance = reference(given)
    found = maximum_likelihood(given.data, given.noise)
    assert found.converged.all() and distance(found, X, W, covariance) < 1e-6
    assert_same_covariance(found.covariance, covariance, 1e-6)
    assert np.sum(found.white[0] ** 2) == pytest.approx(deviance, rel=1e-6)
    assert_same_covariance(bound(given.data, given.noise), covariance[:6, :6], 1e-6)
    # and the truth is within reach: 6 or 12 degrees of freedom
    assert distance(found, given.X, given.W, covariance) < 7.5


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_efficient_is_nearer_to_the_maximum_than_one_step(kind, rng):
    """RMS distances in standard deviations at 3 mrad and 3 mm, over 200 data sets."""
    given = problem(kind, rng, 9, 3e-3, shape=(200,))
    most = maximum_likelihood(given.data, given.noise)
    two = efficient(given.data, given.noise)
    constraint = constraint_of(given.data, given.noise)
    one = fit(constraint, given.noise, start_of(given.data, constraint, None), 1)
    assert (one.iterations, two.iterations) == (1, CLOSED_FORM_STEPS) and most.iterations > 2
    far, near = (np.sqrt(nees(difference(f.X, most.X), most.covariance_X).mean()) for f in (one, two))
    assert near < 0.05 and near < 0.7 * far, (near, far)


@pytest.mark.parametrize("kind", KINDS)
def test_the_start_does_not_matter(kind, rng):
    given = problem(kind, rng, 12, 1e-3)
    from_4dpa = maximum_likelihood(given.data, given.noise)
    far = maximum_likelihood(given.data, given.noise, moved(given.X, 0.05 * rng.normal(size=6)))
    assert distance(far, from_4dpa.X, from_4dpa.W, far.covariance) < 1e-5
    shifted = efficient(given.data, given.noise, moved(given.X, draw(rng, from_4dpa.covariance_X, ())))
    assert distance(shifted, from_4dpa.X, from_4dpa.W, far.covariance) < 1e-2


@pytest.mark.slow
@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("setup", KINDS[:2])
def test_one_exact_side_is_the_limit_of_small_noise(setup, joint, rng):
    """None needs no stand-in: a millionth of the other side's noise gives the same answer."""
    n = 8
    X, robot, camera = exact_poses(rng, n, setup)
    for side in (0, 1):
        S = random_covariance(rng, 6 * n if joint else 6)
        tiny = 1e-15 * random_covariance(rng)
        xi = draw(rng, S, ()).reshape(n, 6) if joint else draw(rng, S, (n,))
        data = uq.PosePairs(*((moved(robot, xi), camera) if side == 0 else (robot, moved(camera, xi))), setup)
        exact, limit = ((S, None), (S, tiny)) if side == 0 else ((None, S), (tiny, S))
        for method in (efficient, maximum_likelihood):
            found, near = method(data, uq.PoseNoise(*exact)), method(data, uq.PoseNoise(*limit))
            assert distance(found, near.X, near.W, near.covariance) < 1e-4
            assert_same_covariance(found.covariance, near.covariance, 1e-4)
            assert np.sqrt(nees(difference(found.X, X)[None], found.covariance_X)[0]) < 6


def test_a_block_diagonal_joint_covariance_is_that_of_each_pose(rng):
    given = problem("eye-to-hand", rng)
    n = given.data.n
    joint = uq.PoseNoise(as_joint(given.noise.robot, n), as_joint(given.noise.camera, n))
    for method in (efficient, maximum_likelihood):
        one, other = method(given.data, given.noise), method(given.data, joint)
        assert distance(other, one.X, one.W, one.covariance) < 1e-8
        assert_same_covariance(other.covariance, one.covariance, 1e-8)
        np.testing.assert_allclose(other.white[0], one.white[0], atol=1e-7)
        np.testing.assert_allclose(other.white[1], one.white[1], rtol=1e-7, atol=1e-7 * np.abs(one.white[1]).max())


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sd", [1e-3, 3e-2])
def test_millimetres_give_the_same_answer(kind, sd, rng):
    given = problem(kind, rng, 10, sd)
    scale = np.repeat([1.0, 1e3], 3)

    def longer(T):
        T = T.copy()
        T[..., :3, 3] *= 1e3
        return T

    first, second = map(longer, given.measured)
    data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
    noise = type(given.noise)(*(S * scale * scale[:, None] for S in covariances_of(given.noise)))
    for method in (efficient, maximum_likelihood):
        metres, millimetres = method(given.data, given.noise), method(data, noise)
        assert metres.iterations == millimetres.iterations
        back = np.tile(scale, 1 if metres.W is None else 2)
        covariance = millimetres.covariance / back / back[:, None]
        assert_same_covariance(covariance, metres.covariance, 1e-9)
        assert distance(millimetres, longer(metres.X), None, millimetres.covariance_X) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
@pytest.mark.parametrize("joint", [False, True])
def test_a_batch_is_a_loop(kind, method, joint, rng):
    if kind == "motions" and joint:
        kind = "eye-in-hand"
    given = problem(kind, rng, 6, 1e-3, joint, shape=(2, 3))
    together = method(given.data, given.noise)
    assert together.X.shape == (2, 3, 4, 4) and together.converged.shape == (2, 3)
    limits = bound(given.data, given.noise)
    for index in np.ndindex(2, 3):
        first, second = (T[index] for T in given.measured)
        data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
        alone = method(data, given.noise)
        W = None if together.W is None else together.W[index]
        assert distance(alone, together.X[index], W, alone.covariance) < 2e-6
        assert_same_covariance(together.covariance[index], alone.covariance, 1e-6)
        assert_same_covariance(limits[index], bound(data, given.noise), 1e-6)
        np.testing.assert_allclose(together.S[index], alone.S, rtol=1e-5, atol=1e-8 * alone.S.max())
        np.testing.assert_allclose(together.residual[index], alone.residual, atol=1e-8)


# ---------------------------------------------------------------------------------------------------- weights


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("setup", KINDS[:2])
def test_a_weight_of_zero_leaves_a_pose_out(setup, joint, rng):
    """A gross outlier: X, W and covariance are those of the other poses."""
    n, out = 10, 3
    given = problem(setup, rng, n, 1e-3, joint)
    robot = given.data.robot.copy()
    robot[out] = moved(robot[out], 0.3 * rng.normal(size=6))
    keep = np.arange(n) != out
    weights = keep.astype(float)
    rows = np.repeat(keep, 6)
    camera = given.noise.camera[np.ix_(rows, rows)] if joint else given.noise.camera
    rest = uq.PosePairs(robot[keep], given.data.camera[keep], setup)
    of_rest = maximum_likelihood(rest, uq.PoseNoise(given.noise.robot[keep], camera))
    data = uq.PosePairs(robot, given.data.camera, setup)
    constraint = constraint_of(data, given.noise)
    start = start_of(rest, constraint_of(rest, None), None)
    found = fit(constraint, given.noise, start, MAX_ML_STEPS, weights)
    assert found.converged and distance(found, of_rest.X, of_rest.W, of_rest.covariance) < 1e-5
    assert_same_covariance(found.covariance, of_rest.covariance, 1e-5)


@pytest.mark.parametrize("joint", [False, True])
def test_weights_divide_the_covariance_of_the_own_residual(joint, rng):
    n = 6
    given = problem("eye-in-hand", rng, n, 1e-3, joint)
    constraint = constraint_of(given.data, given.noise)
    start = start_of(given.data, constraint, None)
    weights = rng.uniform(0.1, 1.0, n)
    found = fit(constraint, given.noise, start, 1, weights)
    S = as_joint(found.S, n)
    blocks = np.kron(np.eye(n), np.ones((6, 6))) == 1
    inflated = np.where(blocks, S / np.repeat(weights, 6), S)
    J, r = found.linear.J.reshape(6 * n, 12), found.linear.r.ravel()
    information = J.T @ np.linalg.solve(inflated, J)
    assert_same_covariance(found.covariance, np.linalg.inv(information), 1e-8)
    step = -np.linalg.solve(information, J.T @ np.linalg.solve(inflated, r))
    np.testing.assert_allclose(found.X, moved(start.X, step[:6]), atol=1e-12)
    np.testing.assert_allclose(found.W, moved(start.W, step[6:]), atol=1e-12)
    np.testing.assert_allclose(found.residual.ravel(), r + J @ step, atol=1e-12)
    # weights of one change nothing, a batch of weights is a loop
    ones = fit(constraint, given.noise, start, 2, np.ones(n))
    plain = fit(constraint, given.noise, start, 2)
    np.testing.assert_allclose(ones.X, plain.X, atol=1e-13)
    both = fit(constraint, given.noise, start, 2, np.stack([np.ones(n), weights]))
    np.testing.assert_allclose(both.X[0], plain.X, atol=1e-12)
    np.testing.assert_allclose(both.X[1], fit(constraint, given.noise, start, 2, weights).X, atol=1e-12)
    assert both.covariance.shape == (2, 12, 12)
    assert weighted(found.S, np.stack([np.ones(n), weights])).shape[0] == 2


# ------------------------------------------------------------------------------------------------ small pieces


@pytest.mark.parametrize("joint", [False, True])
def test_whiten_and_gram(joint, rng):
    n = 5
    S = random_covariance(rng, 6 * n) if joint else random_covariance(rng, 6, (n,))
    values = rng.normal(size=(2, n, 6, 3))
    found = whiten(np.linalg.cholesky(S) if not joint else np.broadcast_to(np.linalg.cholesky(S), (2, 30, 30)), values)
    flat = values.reshape(2, 6 * n, 3)
    expected = np.linalg.solve(np.linalg.cholesky(as_joint(S, n)), flat).reshape(values.shape)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    expected = flat.mT @ np.linalg.solve(as_joint(S, n), flat)
    np.testing.assert_allclose(gram(found), expected, rtol=1e-8, atol=1e-8 * np.abs(expected).max())


def test_what_a_fit_holds(rng):
    given = problem("eye-to-hand", rng)
    found = efficient(given.data, given.noise)
    np.testing.assert_allclose(found.factor @ found.factor.mT, found.S, rtol=1e-10, atol=1e-10 * found.S.max())
    r, J = found.white
    np.testing.assert_allclose((found.factor @ r[..., None])[..., 0], found.residual, atol=1e-15)
    np.testing.assert_allclose(found.factor @ J, found.linear.J, atol=1e-12)
    np.testing.assert_allclose(np.einsum("nip,ni->p", J, r), 0.0, atol=1e-8 * np.abs(J).max())  # fitted: orthogonal
    assert_same_covariance(np.linalg.inv(gram(J)), found.covariance, 1e-9)
    np.testing.assert_array_equal(found.covariance_X, found.covariance[:6, :6])
    np.testing.assert_array_equal(found.covariance_W, found.covariance[6:, 6:])
    on_motions = efficient(problem("motions", rng).data, uq.PairNoise(A=1e-6 * np.eye(6)))
    assert on_motions.W is None and on_motions.covariance_W is None and on_motions.covariance.shape == (6, 6)


def test_inverse_information(rng):
    S = random_covariance(rng, 12, (4,), spread=1e3)
    for found, expected in zip(inverse_information(np.linalg.inv(S)), S, strict=True):
        assert_same_covariance(found, expected, 1e-6)
    # units: deviations over twelve orders of magnitude are no singularity
    unit = 10.0 ** np.arange(-6, 6)
    found = inverse_information(np.linalg.inv(S[0]) * unit * unit[:, None])
    assert_same_covariance(found * unit * unit[:, None], S[0], 1e-6)
