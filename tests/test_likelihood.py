"""`efficient`, `ml` and `bound` against an independent constrained maximum of the likelihood with all latent poses.

The reference knows nothing of residuals r, S or Gauss-Helmert: it minimises the whitened errors of all measured poses
over X, W and every camera pose, the robot poses being those that the constraint leaves, by `scipy.optimize`; its
covariance is the inverse of the Fisher information of all 12 + 6 n unknowns, by numerical differentiation.
"""

import tracemalloc
from typing import NamedTuple

import numpy as np
import pytest
from scipy import linalg, optimize
from support import (
    assert_same_covariance,
    difference,
    draw,
    exact_motions,
    exact_poses,
    jacobian,
    moved,
    nees,
    random_covariance,
    random_transforms,
    whitened_eigenvalues,
)

import uq_handeye as uq
from uq_handeye.constraint import constraint_of, covariances_of
from uq_handeye.likelihood import (
    CLOSED_FORM_STEPS,
    MOST_STEPS,
    Fit,
    bound,
    efficient,
    fit,
    gram,
    inverse_information,
    maximum_likelihood,
    start_of,
    weighted,
    whiten,
)

KINDS = ("eye-in-hand", "eye-to-hand", "motions")


class Problem(NamedTuple):
    kind: str
    data: uq.PosePairs | uq.Motions
    noise: uq.PoseNoise | uq.PairNoise
    X: np.ndarray
    W: np.ndarray | None
    exact: tuple[np.ndarray, np.ndarray]

    @property
    def measured(self):
        return (self.data.A, self.data.B) if self.kind == "motions" else (self.data.robot, self.data.camera)


def problem(kind, rng, n=8, sd=1e-3, joint=False, shape=()):
    """Data of random geometry with full 6x6 (or joint 6n x 6n) covariances on both sides."""
    per_item, whole = random_covariance(rng, 6, (n,), sd), random_covariance(rng, 6 * n if joint else 6, sd=sd)
    if kind == "motions":
        X, *exact = exact_motions(rng, n)
        W, noise = None, uq.PairNoise(per_item, whole)
    else:
        X, *exact = exact_poses(rng, n, kind)
        W = (exact[0] if kind == "eye-in-hand" else np.linalg.inv(exact[0]))[0] @ X @ exact[1][0]
        noise = uq.PoseNoise(per_item, whole)
    first = moved(exact[0], draw(rng, per_item, (*shape, n)))
    xi = draw(rng, whole, shape).reshape(*shape, n, 6) if joint else draw(rng, whole, (*shape, n))
    second = moved(exact[1], xi)
    data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
    return Problem(kind, data, noise, X, W, tuple(exact))


def as_joint(covariance, n):
    if covariance.ndim == 3:
        return linalg.block_diag(*covariance)
    return covariance if len(covariance) == 6 * n else np.kron(np.eye(n), covariance)


def reference(given):
    """The constrained maximum: X, W, their covariance (p, p), and minus twice the log-likelihood there."""
    first, second = given.measured
    n = len(first)
    joint = [as_joint(S, n) for S in covariances_of(given.noise)]
    whitening = [np.linalg.inv(np.linalg.cholesky(S)) for S in joint]
    p = 6 if given.W is None else 12
    size = p + 6 * n
    unit = np.sqrt(np.concatenate([np.tile(np.diag(joint[1])[:6], p // 6), np.diag(joint[1])]))

    def unknowns(x, at):
        x = x * unit
        X, W, C = at
        return (
            moved(X, x[..., :6]),
            None if W is None else moved(W, x[..., 6:12]),
            moved(C, x[..., p:].reshape(*x.shape[:-1], n, 6)),
        )

    def errors(x, at):
        X, W, C = unknowns(x, at)
        X = X[..., None, :, :]
        if W is None:
            G = X @ C @ np.linalg.inv(X)
        else:
            G = W[..., None, :, :] @ np.linalg.inv(C) @ np.linalg.inv(X)
            G = G if given.kind == "eye-in-hand" else np.linalg.inv(G)
        pairs = zip((first, second), (G, C), whitening, strict=True)
        return np.concatenate([difference(T, m).reshape(*x.shape[:-1], 6 * n) @ L.T for T, m, L in pairs], axis=-1)

    at = given.X, given.W, given.exact[1]

    def derivatives(x, at):
        return jacobian(lambda d: errors(x + d, at), size, step=1e-2)

    found = optimize.least_squares(errors, np.zeros(size), derivatives, args=(at,), xtol=1e-9, ftol=1e-12, gtol=1e-12)
    at, here = unknowns(found.x, at), np.zeros(size)
    for _ in range(4):  # the optimiser stops where the sum stands still, before its gradient is 0
        J = derivatives(here, at)
        at = unknowns(-np.linalg.lstsq(J, errors(here, at), rcond=None)[0], at)
    covariance = np.linalg.inv(J.T @ J) * unit * unit[:, None]
    return at[0], at[1], covariance[:p, :p], 2 * found.cost


def distance(found: Fit, X, W, covariance):
    """Between the estimate and X, W, in standard deviations."""
    e = difference(found.X, X)
    if W is not None:
        e = np.concatenate([e, difference(found.W, W)], axis=-1)
    return float(np.sqrt(np.max((e[..., None, :] @ np.linalg.solve(covariance, e[..., None]))[..., 0, 0])))


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


@pytest.mark.parametrize("kind", KINDS)
def test_efficient_is_nearer_to_the_maximum_than_one_step(kind, rng):
    """At 3 mrad and 3 mm, over 200 data sets: rms distances in deviations."""
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


@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("setup", KINDS[:2])
def test_one_exact_side_is_the_limit_of_small_noise(setup, joint, rng):
    """None needs no stand-in: a millionth of the other side's noise gives the same answer."""
    n = 8
    X, robot, camera = exact_poses(rng, n, setup)
    for side in (0, 1):
        S = random_covariance(rng, 6 * n if joint else 6)
        tiny = 1e-12 * random_covariance(rng)
        xi = draw(rng, S, ()).reshape(n, 6) if joint else draw(rng, S, (n,))
        data = uq.PosePairs(*((moved(robot, xi), camera) if side == 0 else (robot, moved(camera, xi))), setup)
        exact, limit = ((S, None), (S, tiny)) if side == 0 else ((None, S), (tiny, S))
        for method in (efficient, maximum_likelihood):
            found, near = method(data, uq.PoseNoise(*exact)), method(data, uq.PoseNoise(*limit))
            assert distance(found, near.X, near.W, near.covariance) < 1e-5
            assert_same_covariance(found.covariance, near.covariance, 1e-5)
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
    found = fit(constraint, given.noise, start, MOST_STEPS, weights)
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


# ---------------------------------------------------------------------------------------------------- limits


@pytest.mark.parametrize("sd", [1e-6, 1e-9, 1e-12, 1e-15])
@pytest.mark.parametrize("kind", KINDS)
def test_ml_comes_to_an_end_at_any_small_noise(kind, sd, rng):
    """Also where a standard deviation is less than rounding moves X: no step can then be small beside it."""
    given = problem(kind, rng, 12, sd, shape=(20,))
    found = maximum_likelihood(given.data, given.noise)
    assert found.converged.all()
    # rad and m, by rounding through an ill-placed geometry
    assert np.abs(difference(found.X, given.X)).max() < 30 * sd + 1e-13


@pytest.mark.parametrize("kind", KINDS)
def test_ml_on_exact_data(kind, rng):
    given = problem(kind, rng, 6, 1e-3)
    first, second = given.exact
    data = uq.Motions(first, second) if kind == "motions" else uq.PosePairs(first, second, kind)
    found = maximum_likelihood(data, given.noise)
    np.testing.assert_allclose(found.X, given.X, atol=1e-12)
    assert found.iterations == 2 and np.abs(found.residual).max() < 1e-12
    assert_same_covariance(found.covariance_X, bound(data, given.noise, given.X), 1e-9)


@pytest.mark.parametrize("kind", ["eye-in-hand", "motions"])
def test_ml_converges_at_large_noise(kind, rng):
    """30 mrad and 10 mm on both sides, 300 data sets."""
    S = np.diag(np.repeat([30e-3, 10e-3], 3) ** 2)
    if kind == "motions":
        _, *exact = exact_motions(rng, 30)
        first, second = (moved(T, draw(rng, S, (300, 30))) for T in exact)
        found = maximum_likelihood(uq.Motions(first, second), uq.PairNoise(S, S))
    else:
        poses = uq.simulate(30, noise=uq.PoseNoise(S, S), trials=300, seed=rng)
        found = maximum_likelihood(poses, uq.PoseNoise(S, S))
    assert found.converged.all() and found.iterations < 20


def test_not_converged_says_so_and_gives_what_it_has(rng):
    """Poses that have nothing to do with each other: some of the problems have no maximum that is reached."""
    noise = uq.PoseNoise.isotropic(("1mrad", "1mm"), ("1mrad", "1mm"))
    poses = uq.simulate(12, noise=noise, trials=5, seed=rng)
    camera = poses.camera.copy()
    camera[2:] = random_transforms(rng, (3, 12), 2.0, 3.1)
    with pytest.raises(
        uq.NotConvergedError, match=r"did not converge on \d of 5 problems within 50 iter.*too large"
    ) as c:
        maximum_likelihood(uq.PosePairs(poses.robot, camera), noise)
    partial = c.value.partial
    assert isinstance(partial, Fit) and partial.iterations == MOST_STEPS
    assert partial.converged[:2].all() and not partial.converged.all()
    good = maximum_likelihood(uq.PosePairs(poses.robot[:2], poses.camera[:2]), noise)
    assert distance(good, partial.X[:2], partial.W[:2], good.covariance) < 1e-5
    bad = int(np.argmin(partial.converged))
    with pytest.raises(uq.NotConvergedError, match="did not converge within 50 iterations") as c:
        maximum_likelihood(uq.PosePairs(poses.robot[bad], camera[bad]), noise)
    assert not c.value.partial.converged


@pytest.mark.parametrize(
    "noise",
    [
        uq.PoseNoise(camera=np.diag([1e-6] * 3 + [0.0] * 3)),
        uq.PoseNoise(robot=np.diag([0.0] * 3 + [1e-6] * 3)),
        uq.PoseNoise(np.diag([1e-6] * 3 + [0.0] * 3), np.diag([1e-6] * 3 + [0.0] * 3)),
        uq.PoseNoise(camera=np.tile(1e-6 * np.eye(6), (8, 8))),  # one error that all poses share, and none of their own
    ],
)
def test_noise_that_leaves_residuals_exact_is_refused(noise, rng):
    poses = uq.simulate(8, seed=2)
    for function in (efficient, maximum_likelihood, bound):
        with pytest.raises(uq.InputError, match=r"leaves a part of the residuals exact.*or use method '4dpa'"):
            function(poses, noise)


def test_the_other_side_can_make_up_for_exact_components(rng):
    """Rotations of the camera exact, translations of the robot exact: together every residual has noise."""
    noise = uq.PoseNoise(np.diag([1e-6] * 3 + [0.0] * 3), np.diag([0.0] * 3 + [1e-6] * 3))
    poses = uq.simulate(12, noise=noise, seed=rng)
    found = maximum_likelihood(poses, noise)
    assert distance(found, poses.truth.X, poses.truth.W, found.covariance) < 7.5


@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
def test_degenerate_data_are_named(method, rng):
    noise = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    poses = uq.simulate(12, noise=noise, seed=rng)
    few = uq.PosePairs(poses.robot[:1], poses.camera[:1])
    with pytest.raises(uq.DegenerateMotionError):
        method(few, noise)
    # one rotation axis: the translation of X along it leaves no trace
    X = random_transforms(rng)
    turns = np.zeros((9, 3)) + np.linspace(0.1, 2.0, 9)[:, None] * [0.0, 0.0, 1.0]
    robot = moved(np.broadcast_to(np.eye(4), (9, 4, 4)), np.concatenate([turns, rng.normal(size=(9, 3))], axis=1))
    camera = np.linalg.inv(X) @ np.linalg.inv(robot) @ random_transforms(rng)
    planar = uq.PosePairs(robot, camera)
    with pytest.raises(uq.DegenerateMotionError) as caught:
        method(planar, noise)
    assert caught.value.directions.shape[1] == 6
    with pytest.raises(uq.DegenerateMotionError, match="leaves no trace") as caught:
        method(planar, noise, X)  # the engine's own judgement, without 4DPA's
    # along z of the gripper, the axis of rotation
    np.testing.assert_allclose(np.abs(caught.value.directions), [[0, 0, 0, 0, 0, 1]], atol=1e-5)
    with pytest.raises(uq.DegenerateMotionError):
        bound(planar, noise, X)


@pytest.mark.parametrize("method", [efficient, maximum_likelihood])
def test_pure_translations_are_named(method, rng):
    """No rotation at all: nothing is known of the translation of X, on motions not even its derivative."""
    X = random_transforms(rng)
    A = np.broadcast_to(np.eye(4), (6, 4, 4)).copy()
    A[:, :3, 3] = rng.normal(size=(6, 3))
    motions = uq.Motions(A, np.linalg.inv(X) @ A @ X)
    noise = uq.PairNoise.isotropic(A=("1mrad", "1mm"))
    with pytest.raises(uq.DegenerateMotionError):
        method(motions, noise)
    with pytest.raises(uq.DegenerateMotionError, match=r"leaves? no trace") as caught:
        method(motions, noise, X)
    assert np.abs(caught.value.directions[:, :3]).max() < 1e-6 and len(caught.value.directions) in (1, 3)


def test_three_poses_suffice(rng):
    for kind in KINDS:
        given = problem(kind, rng, 3, 1e-4)
        X, W, covariance, _ = reference(given)
        found = maximum_likelihood(given.data, given.noise)
        assert distance(found, X, W, covariance) < 1e-6
        assert_same_covariance(found.covariance, covariance, 1e-5)


def test_five_thousand_poses(rng):
    """Memory is linear in the poses: a few 6 x 12 matrices each."""
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    peaks = []
    for n in (500, 5000):
        poses = uq.simulate(n, noise=noise, seed=rng)
        tracemalloc.start()
        found = efficient(poses, noise)
        peaks.append(tracemalloc.get_traced_memory()[1] / n)
        tracemalloc.stop()
        assert distance(found, poses.truth.X, poses.truth.W, found.covariance) < 7.5
    assert max(peaks) < 14e3 and peaks[1] < 1.3 * peaks[0]


# ----------------------------------------------------------------------------------------------------- bound


def test_bound_at_truth_at_a_given_X_and_at_neither(rng):
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    for setup in KINDS[:2]:
        poses = uq.simulate(15, noise=noise, setup=setup, seed=rng)
        truth = poses.truth
        at_truth = bound(poses, noise)
        exact = uq.PosePairs(truth.robot, truth.camera, setup)
        assert_same_covariance(bound(exact, noise, truth.X), at_truth, 1e-9)
        assert_same_covariance(bound(exact, noise), at_truth, 1e-9)
        assert_same_covariance(bound(uq.relative_motions(poses, "all"), noise), at_truth, 1e-9)
        bare = uq.PosePairs(poses.robot, poses.camera, setup)
        np.testing.assert_array_equal(bound(bare, noise), maximum_likelihood(bare, noise).covariance_X)
        for near in (bound(bare, noise), bound(bare, noise, truth.X)):
            assert_same_covariance(near, at_truth, 0.05)
        assert np.abs(whitened_eigenvalues(1.1 * at_truth, at_truth) - 1).min() > 0.05


def test_bound_of_motions(rng):
    """X given, on exact motions: the inverse of the Fisher information summed up pair by pair."""
    X, A, B = exact_motions(rng, 12)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (12,)))

    def residual(kind):
        def of(x):
            a, b, at = A, B, X
            if kind == "X":
                at = moved(X, x)[:, None]
            elif kind == "A":
                a = moved(A, x[:, None])
            else:
                b = moved(B, x[:, None])
            return difference(a @ at, at @ b)

        return jacobian(of, 6).reshape(12, 6, 6)

    J, D_A, D_B = (residual(kind) for kind in "XAB")
    S = D_A @ noise.A @ D_A.mT + D_B @ noise.B @ D_B.mT
    expected = np.linalg.inv(np.sum(J.mT @ np.linalg.solve(S, J), axis=0))
    assert_same_covariance(bound(uq.Motions(A, B), noise, X), expected, 1e-8)
    assert_same_covariance(bound(uq.Motions(A, B), noise), expected, 1e-8)


@pytest.mark.parametrize("method", ["4dpa", "park", "daniilidis", "nguyen", "andreff"])
def test_no_method_is_below_the_bound(method, rng):
    """Predicted covariances of published estimators, independent pairs: no direction has less variance."""
    X, A, B = exact_motions(rng, 25)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    predicted = uq.propagate(uq.Motions(A, B), noise=noise, method=method, X=X)
    smallest = whitened_eigenvalues(predicted, bound(uq.Motions(A, B), noise, X))[0]
    assert smallest > 1 - 1e-6


def test_no_combination_of_pairs_is_below_the_bound_on_poses(rng):
    for setup in KINDS[:2]:
        noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
        poses = uq.simulate(12, setup=setup, seed=rng)
        least = bound(poses, noise)
        for pairs in ("consecutive", "all"):
            predicted = uq.propagate(uq.relative_motions(poses, pairs), noise=noise)
            assert whitened_eigenvalues(predicted, least)[0] > 1 - 1e-6


def test_bound_refuses_what_does_not_fit(rng):
    poses = uq.simulate(8, seed=rng)
    with pytest.raises(uq.InputError, match="`X` to have shape"):
        bound(poses, uq.PoseNoise(camera=np.eye(6)), np.eye(3))
    with pytest.raises(uq.InputError, match="`camera` to cover 8 poses, got 7"):
        bound(poses, uq.PoseNoise(camera=np.eye(42)))
    with pytest.raises(uq.InputError, match="give the Motions"):
        bound(poses, uq.PairNoise(A=np.eye(6)))


@pytest.mark.parametrize("function", [uq.likelihood.efficient, uq.likelihood.maximum_likelihood, uq.bound])
@pytest.mark.parametrize("noise", [None, "1mm", np.eye(6)])
def test_noise_and_data_of_a_wrong_type(function, noise):
    with pytest.raises(uq.InputError, match=f"`noise` to be PoseNoise or PairNoise, got {type(noise).__name__}"):
        function(uq.simulate(5, seed=1), noise)
    with pytest.raises(uq.InputError, match="`data` to be PosePairs or Motions, got ndarray"):
        function(np.eye(4), uq.PoseNoise(camera=1e-6 * np.eye(6)))
