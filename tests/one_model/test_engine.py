"""The latent Gaussian model against dense algebra, differences, `efficient`, and data drawn from itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from support import CONFIDENCE, SEED, assert_same_covariance, covers, is_consistent, nees

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.fit.graph import engine
from uq_handeye.fit.graph.constraint import constraint_of
from uq_handeye.fit.graph.engine import Conditional, LatentModel, State
from uq_handeye.fit.graph.estimation import JointModel
from uq_handeye.fit.graph.gauss_helmert import efficient
from uq_handeye.fit.graph.integration import design, integrate
from uq_handeye.fit.graph.mode import Mode, find_mode, other_modes
from uq_handeye.fit.graph.reference import Reference
from uq_handeye.fit.graph.starts import start_of
from uq_handeye.model.errors.keys import ROBOT_ACCURACY, TARGET_SCALE
from uq_handeye.model.errors.sizes import NoisePrior, Size
from uq_handeye.model.errors.term import Component
from uq_handeye.model.shared_errors.shared_error import SharedError

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
TURN, SHIFT = np.eye(6)[:, :3], np.eye(6)[:, 3:]
UNIT = np.repeat([1e-3, 5e-4], 3)  # rad, m
KINDS = ("eye-in-hand", "eye-to-hand", "motions")


def linear_of(kind, n=9):
    poses = uq.simulate(n, noise=NOISE, setup="eye-in-hand" if kind == "motions" else kind, seed=SEED)
    data = uq.relative_motions(poses, "consecutive") if kind == "motions" else poses
    data = uq.Motions(data.A, data.B) if kind == "motions" else data
    constraint = constraint_of(data, None)
    return constraint.linearise(start_of(data, constraint, None), constraint.first, constraint.second)


def every_kind_of_component(rng, n):
    """Columns, blocks of all and of each pose, and both with one size; two of them of a known size."""
    columns = UNIT[:, None] * rng.normal(size=(n, 6, 3))
    block = UNIT[:, None] * rng.normal(size=(n, 6, 4))
    return (
        Component("columns", "robot", Size(0.8, 3.0), columns=columns),
        Component("block", "camera", Size(4e-4, 2.0), block=TURN),
        Component("block of each pose", "robot", Size(0.7, 4.0), block=block),
        Component("both", "camera", Size(0.5, 2.5), columns=columns[..., ::-1] + 2e-4, block=0.3 * np.diag(UNIT)),
        Component("known columns", "camera", Size(0.4), columns=columns[..., :1] ** 2 / 1e-3),
        Component("known block", "camera", Size(2e-4), block=SHIFT),
    )


def model_of(kind, rng, with_prior=False):
    linear = linear_of(kind)
    n, p = linear.J.shape[0], linear.J.shape[-1]
    known = np.tile(np.diag(UNIT**2), (n, 1, 1))
    half = rng.normal(size=(3, p + 1)) * np.r_[np.full(p, 3e2), 1.0]
    return LatentModel.of(linear, every_kind_of_component(rng, n), None, known, half.T @ half if with_prior else None)


def dense(model, theta):
    """Covariance of all rows with its derivatives by theta, restricted projector, and f."""
    n, p = len(model.r), model.p
    s = model.sizes(theta)
    V = np.zeros((6 * n, 6 * n))
    by, start = [], 0
    for k, part in enumerate(model.components):
        of_k = np.zeros_like(V)
        F = model.shared[..., start : start + part.count].reshape(6 * n, -1)
        start += part.count
        of_k += F @ F.T
        for i in range(n if k in model.blocks else 0):
            rows = slice(6 * i, 6 * i + 6)
            of_k[rows, rows] += model.blocks[k][i]
        V += s[k] ** 2 * of_k
        by.append(2 * s[k] ** 2 * of_k)
    for i in range(0 if model.known is None else n):
        rows = slice(6 * i, 6 * i + 6)
        V[rows, rows] += model.known[i]
    J, r = model.J.reshape(-1, p), model.r.ravel()
    inverse = np.linalg.inv(V)
    gram = np.c_[J, r].T @ inverse @ np.c_[J, r] + (0 if model.prior is None else model.prior)
    A, pull, square = gram[:-1, :-1], gram[:-1, -1], gram[-1, -1]
    x = -np.linalg.solve(A, pull)
    off = (theta - model.medians) / model.spreads
    f = 0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(A)[1] + square + pull @ x + off @ off)
    P = inverse - inverse @ J @ np.linalg.solve(A, J.T @ inverse)
    return f, x, np.linalg.inv(A), [by[k] for k in model.free], P, inverse @ (r + J @ x)


@pytest.mark.parametrize("with_prior", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_value_and_posterior_are_those_of_the_dense_covariance(kind, with_prior, rng):
    """The restricted likelihood, where x is flat: log determinants and the quadratic form."""
    model = model_of(kind, rng, with_prior)
    for theta in model.medians + 0.5 * rng.normal(size=(3, len(model.free))):
        f, x, C, *_ = dense(model, theta)
        found = model.of_poses(theta)
        assert model.value(theta) == pytest.approx(f, rel=1e-9) == found.value
        np.testing.assert_allclose(found.mean, x, rtol=1e-6, atol=1e-12)
        assert_same_covariance(found.covariance, C, 1e-8)


@pytest.mark.parametrize("with_prior", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_gradient_is_that_of_differences_for_every_kind_of_component(kind, with_prior, rng):
    model = model_of(kind, rng, with_prior)
    theta, step = model.medians + 0.5 * rng.normal(size=len(model.free)), 1e-4
    for k, move in enumerate(step * np.eye(len(theta))):
        values = [model.value(theta + times * move) for times in (2, 1, -1, -2)]
        slope = (8 * (values[1] - values[2]) - (values[0] - values[3])) / (12 * step)
        assert model.at(theta).gradient[k] == pytest.approx(slope, rel=1e-6, abs=1e-6)


def test_information_is_the_average_information(rng):
    model = model_of("eye-in-hand", rng)
    theta = model.medians + 0.3 * rng.normal(size=len(model.free))
    *_, by, P, weighed = dense(model, theta)
    expected = [[0.5 * weighed @ a @ P @ b @ weighed for b in by] for a in by]
    np.testing.assert_allclose(model.at(theta).information, expected + np.diag(model.spreads**-2.0), rtol=1e-6)


def test_errors_are_those_of_the_joint_posterior(rng):
    """x and the errors e = s z: their regression on the rows, x as an error with a very wide prior."""
    model = model_of("eye-to-hand", rng)
    theta, p, n = model.medians, model.p, len(model.r)
    found = model.conditional(theta)
    s = np.repeat(model.sizes(theta), [part.count for part in model.components])
    *_, P, weighed = dense(model, theta)
    F = model.shared.reshape(6 * n, -1)
    np.testing.assert_allclose(found.mean[p:], -(s**2) * (F.T @ weighed), rtol=1e-6, atol=1e-10)
    left = np.diag(s**2) - (s[:, None] ** 2) * (F.T @ P @ F) * s**2
    np.testing.assert_allclose(found.covariance[p:, p:], left, rtol=1e-6, atol=1e-9 * left.max())
    determined = 1 - np.diag(left) / s**2
    of = np.repeat(np.arange(len(model.components)), [part.count for part in model.components])
    np.testing.assert_allclose(model.at(theta).determined, np.bincount(of, determined, minlength=6), atol=1e-7)
    np.testing.assert_allclose(found.mean[:p], model.of_poses(theta).mean, rtol=1e-9)
    assert_same_covariance(found.covariance[:p, :p], model.of_poses(theta).covariance, 1e-9)


def test_all_sizes_known(rng):
    model = model_of("eye-in-hand", rng)
    parts = tuple(Component(c.name, c.side, Size(c.size.median), c.columns, c.block) for c in model.components)
    model = LatentModel(model.J, model.r, parts, model.shared, model.blocks, model.known)
    mode = find_mode(model)
    assert mode.converged and mode.theta.shape == (0,) and mode.state.information.shape == (0, 0)
    mixture = integrate(model, [mode])
    np.testing.assert_array_equal(mixture.weights, [1.0])
    np.testing.assert_allclose(mixture.covariance, model.of_poses(np.zeros(0)).covariance)


# ---------------------------------------------------------------------------------------------------------- efficient


@pytest.mark.parametrize("setup", KINDS[:2])
def test_with_known_white_sizes_it_is_efficient(setup):
    """The same posterior at the same linearisation, the same X where both have converged."""
    poses = uq.simulate(20, noise=NOISE, setup=setup, seed=SEED)
    fit = efficient(poses, NOISE)
    prior = NoisePrior(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"), factor=1)
    source = JointModel.beside(constraint_of(poses, None), poses, prior)
    assert all(part.size.is_known and part.columns is None for part in source.components)
    model = LatentModel.of(fit.linear, source.components)
    found = model.of_poses(np.zeros(0))
    step = -fit.covariance @ np.einsum(
        "nij,ni->j", fit.linear.J, np.linalg.solve(fit.S, fit.linear.r[..., None])[..., 0]
    )
    np.testing.assert_allclose(found.mean, step, atol=1e-10 * np.sqrt(np.diag(fit.covariance)).min())
    assert_same_covariance(found.covariance, fit.covariance, 1e-10)
    noise = source.find(fit.unknowns).noise
    for side in ("robot", "camera"):
        np.testing.assert_allclose(getattr(noise, side), getattr(NOISE, side), rtol=1e-12, atol=1e-20)


# --------------------------------------------------------------------------------------------------- order of the rows


def test_the_order_of_the_rows_changes_nothing():
    poses = uq.simulate(14, noise=NOISE, seed=SEED)
    order = np.random.default_rng(0).permutation(14)
    errors = (SharedError.focal_length(), SharedError.target_scale())
    found = []
    for data in (poses, uq.PosePairs(poses.robot[order], poses.camera[order], poses.setup)):
        constraint = constraint_of(data, None)
        at = constraint.complete(poses.truth.X)
        found.append(JointModel.beside(constraint, data, errors=errors).find(at))
    one, other = found
    np.testing.assert_allclose(one.mode.theta, other.mode.theta, atol=1e-9)
    np.testing.assert_allclose(one.mixture.mean, other.mixture.mean, atol=1e-9 * np.abs(one.mixture.mean).max())
    assert_same_covariance(one.mixture.covariance, other.mixture.covariance, 1e-9)


@pytest.mark.parametrize("with_prior", [False, True])
def test_many_sizes_at_once_are_those_one_by_one(with_prior, rng, monkeypatch):
    model = model_of("eye-in-hand", rng, with_prior)
    thetas = model.medians + np.linspace(-1, 1, 5)[:, None]
    for at_once in (1, 10**9):
        monkeypatch.setattr(engine, "CHUNK", at_once)
        for found, theta in zip(model.of_poses_at(thetas), thetas, strict=True):
            assert found.value == pytest.approx(model.value(theta), rel=1e-12)
            whole = model.conditional(theta)
            np.testing.assert_allclose(found.mean, whole.mean[: model.p], rtol=1e-8)
            assert_same_covariance(found.covariance, whole.covariance[: model.p, : model.p], 1e-9)


# --------------------------------------------------------------------------------------------------------- integration


class Gaussian:
    """A posterior of theta that is Gaussian, with x a linear function of theta."""

    def __init__(self, rng, k, centre=0.0):
        half = np.linalg.qr(rng.normal(size=(k, k)))[0] * rng.uniform(1, 3, k)
        self.information, self.centre = half @ half.T, np.full(k, centre) + rng.normal(size=k)
        self.medians, self.spreads = np.zeros(k), np.full(k, 10.0)
        self.slope = rng.normal(size=(2, k))

    def of_poses_at(self, thetas):
        off = thetas - self.centre
        values = 7.0 + 0.5 * np.einsum("di,ij,dj->d", off, self.information, off)
        return [
            Conditional(theta, value, self.slope @ theta, np.eye(2))
            for theta, value in zip(thetas, values, strict=True)
        ]

    def mode(self, value=7.0):
        k = len(self.centre)
        return Mode(State(self.centre, value, np.zeros(k), self.information, np.zeros(0)), True, ())


def test_where_a_search_ended_nothing_is_solved_again(rng, monkeypatch):
    model, solved = model_of("eye-in-hand", rng), []
    theta = model.medians + 0.1
    fresh = replace(model).of_poses(theta)
    whitened = LatentModel._whitened
    monkeypatch.setattr(LatentModel, "_whitened", lambda self, s: solved.append(s) or whitened(self, s))
    mode = model.solved(theta)
    again = model.of_poses(theta)
    assert len(solved) == 1 and mode is model.solved(theta)
    np.testing.assert_allclose(again.mean, fresh.mean, rtol=1e-9, atol=1e-12)
    assert_same_covariance(again.covariance, fresh.covariance, 1e-9)
    assert model.solved(theta + 0.1).value != mode.value and len(solved) == 2


@pytest.mark.parametrize("k", [1, 2, 4, 9])
def test_mean_and_covariance_of_a_gaussian_posterior_are_exact(k, rng):
    target = Gaussian(rng, k)
    mixture = integrate(target, [target.mode()])
    assert mixture.weights.sum() == pytest.approx(1.0) and len(mixture.weights) == len(design(k))
    np.testing.assert_allclose(mixture.mean_theta, target.centre, atol=1e-12)
    C = np.linalg.inv(target.information)
    np.testing.assert_allclose(mixture.covariance_theta, C, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(mixture.mean, target.slope @ target.centre, atol=1e-12)
    np.testing.assert_allclose(mixture.covariance, np.eye(2) + target.slope @ C @ target.slope.T, rtol=1e-9)


def test_modes_have_their_evidence_as_weight(rng):
    """Odds of two modes of the same width: by the difference of f alone."""
    target = Gaussian(rng, 3)
    mixture = integrate(target, [target.mode(7.0), target.mode(7.0 + np.log(4.0))])
    np.testing.assert_allclose(mixture.odds, [0.8, 0.2])
    assert mixture.mode_of.tolist() == [0] * len(design(3)) + [1] * len(design(3))
    np.testing.assert_allclose(mixture.weights.reshape(2, -1).sum(axis=1), [0.8, 0.2])


# --------------------------------------------------------------------------------------------------------- reference


@pytest.mark.parametrize("dof", [4.5, 8.0, 60.0])
def test_quantiles_of_t_are_those_of_samples(dof, rng):
    """A multivariate t stated with its covariance; quantiles of its scale would be too far out."""
    trials = 200_000
    scale = np.sqrt((dof - 2) / rng.chisquare(dof, size=trials))
    d2 = ((scale[:, None] * rng.normal(size=(trials, 6))) ** 2).sum(axis=1)
    t, F = Reference("t", dof), Reference("F", dof)
    for level in (0.5, 0.9, 0.95, 0.99):
        low, high = stats.binom.interval(CONFIDENCE, trials, level)
        assert low <= (d2 <= t.quantile(level)).sum() <= high
        assert not low <= (d2 <= F.quantile(level)).sum() <= high
        assert t.p_value(t.quantile(level)) == pytest.approx(1 - level)


def test_a_reference_without_variance_is_refused():
    with pytest.raises(InputError, match="above 2"):
        Reference("t", 2.0)


# ------------------------------------------------------------------------------ simulation-based calibration


@pytest.fixture(scope="module")
def drawn():
    """Sizes drawn from their priors, rows drawn with them, and the mixture of each: 300 sets of 15 poses."""
    rng = np.random.default_rng([SEED, 29])
    poses = uq.simulate(15, noise=NOISE, seed=SEED)
    constraint = constraint_of(poses, None)
    linear = constraint.linearise(constraint.complete(poses.truth.X), poses.truth.robot, poses.truth.camera)
    waves = np.array(UNIT)[:, None] * np.cos(rng.normal(size=(15, 1, 1)) * np.arange(1, 5) + rng.normal(size=(1, 6, 4)))
    parts = (
        Component("robot turn", "robot", Size(2e-4, 2.0), block=TURN),
        Component("robot shift", "robot", Size(1e-4, 2.0), block=SHIFT),
        Component("camera turn", "camera", Size(1e-3, 2.0), block=TURN),
        Component("camera shift", "camera", Size(5e-4, 2.0), block=SHIFT),
        Component("waves", "robot", Size(1.0, 2.0), columns=waves),
    )
    empty = LatentModel.of(linear, parts)
    theta, errors, mixtures, modes, models = [], [], [], [], []
    for _ in range(300):
        true = empty.medians + empty.spreads * rng.normal(size=len(parts))
        s = np.exp(true)
        xi = {side: np.zeros((15, 6)) for side in ("robot", "camera")}
        for size, part in zip(s, parts, strict=True):
            if part.block is not None:
                xi[part.side] += size * rng.normal(size=(15, part.block.shape[-1])) @ part.block.T
            else:
                xi[part.side] += size * part.columns @ rng.normal(size=part.count)
        r = sum((D @ xi[side][..., None])[..., 0] for D, side in zip(linear.sides, ("robot", "camera"), strict=True))
        model = LatentModel(empty.J, -r, parts, empty.shared, empty.blocks)
        mode = find_mode(model)
        assert mode.converged
        mixture = integrate(model, [mode])
        theta.append(true)
        errors.append(mixture.mean)  # of x = 0
        mixtures.append(mixture)
        modes.append(mode)
        models.append(model)
    return np.array(theta), np.array(errors), mixtures, modes, models


def ranks(values, weights, means, deviations):
    """Share of a mixture of normal distributions below the values."""
    return float(weights @ stats.norm.cdf((values - means) / deviations))


@pytest.mark.statistical
@pytest.mark.parametrize("j", range(12))
def test_ranks_of_the_unknowns_are_uniform(drawn, j):
    """Each unknown within its mixture; a third less of standard deviation is rejected."""
    found = {
        times: [ranks(0.0, m.weights, m.means[:, j], times * np.sqrt(m.covariances[:, j, j])) for m in drawn[2]]
        for times in (1.0, 0.67)
    }
    assert stats.kstest(found[1.0], "uniform").pvalue > 1 - CONFIDENCE
    spread = [np.mean(np.abs(np.array(u) - 0.5)) for u in found.values()]
    assert abs(spread[0] - 0.25) < 4 * 0.144 / np.sqrt(300) < abs(spread[1] - 0.25)


@pytest.mark.statistical
def test_all_unknowns_together_are_consistent(drawn):
    _, errors, mixtures, *_ = drawn
    covariances = np.array([m.covariance for m in mixtures])
    assert is_consistent(errors, covariances)
    assert not is_consistent(errors, 0.8 * covariances)
    assert all(covers(errors[:, :6], covariances[:, :6, :6], (0.5, 0.68, 0.9, 0.95)))
    assert not all(covers(errors[:, :6], 0.6 * covariances[:, :6, :6], (0.5, 0.68, 0.9, 0.95)))
    assert nees(errors, covariances).max() < 80


@pytest.fixture(scope="module")
def sampled(drawn):
    """Share of the posterior of each size below the true one, by importance sampling; effective draws."""
    rng, draws = np.random.default_rng([SEED, 30]), 300
    found, effective = [], []
    for true, mode, model in zip(drawn[0][:150], drawn[3], drawn[4], strict=False):
        half = 1.5 * np.linalg.inv(np.linalg.cholesky(mode.state.information)).T
        v = rng.normal(size=(draws, 5)) * np.sqrt(4 / rng.chisquare(4, size=(draws, 1)))
        theta = mode.theta + v @ half.T
        logs = 0.5 * (4 + 5) * np.log1p((v * v).sum(axis=1) / 4) - [model.value(t) for t in theta]
        w = np.exp(logs - logs.max())
        w /= w.sum()
        found.append(w @ (theta < true))
        effective.append(1 / (w @ w))
    return np.array(found), np.array(effective)


@pytest.mark.statistical
@pytest.mark.parametrize("k", range(5))
def test_ranks_of_the_sizes_are_uniform(sampled, drawn, k):
    """Ranks by f itself; those that half of the prior's spread would give are rejected."""
    found, effective = sampled
    assert np.median(effective) > 50
    assert stats.kstest(found[:, k], "uniform").pvalue > 1 - CONFIDENCE
    narrow = stats.norm.cdf(2 * stats.norm.ppf(np.clip(found[:, k], 1e-3, 1 - 1e-3)))
    assert stats.kstest(narrow, "uniform").pvalue < 1 - CONFIDENCE


@pytest.mark.slow
@pytest.mark.parametrize("k", range(5))
def test_the_design_finds_mean_and_spread_of_the_sizes(drawn, k):
    """Nearly: two points along each axis see less than all of the tail towards small sizes."""
    theta, _, mixtures, *_ = drawn
    off = np.array([t[k] - m.mean_theta[k] for t, m in zip(theta, mixtures, strict=True)])
    stated = np.sqrt(np.mean([m.covariance_theta[k, k] for m in mixtures]))
    assert abs(off.mean()) < 0.5 * stated and 0.65 < stated / off.std() < 1.2


# -------------------------------------------------------------------------------------------------------- several modes


def few_poses_of_an_arm(times):
    """Six poses of one region, of an arm with smooth errors; the target is larger than was said."""
    rng = np.random.default_rng(5)
    noise = uq.PoseNoise.isotropic(robot=("0.01deg", "0.02mm"), camera=("0.02deg", "0.1mm"))
    poses = uq.simulate(6, noise=noise, seed=3)
    robot, camera = poses.robot.copy(), poses.camera.copy()
    robot[:, :3, 3] += 3e-4 * np.sin(3.0 * robot[:, :3, 3] + rng.uniform(0, 6, 3))
    camera[:, :3, 3] *= times
    constraint = constraint_of(data := uq.PosePairs(robot, camera, poses.setup), None)
    columns = UNIT[:, None] * np.cos(rng.normal(size=(6, 1, 12)) + rng.normal(size=(6, 12)))
    parts = (Component("arm", "robot", Size(0.3, 5.0), columns=columns),)
    scale = replace(SharedError.target_scale(), factor=4.0)
    model = JointModel.beside(constraint, data, errors=(scale,), more=parts)
    return model, constraint.complete(poses.truth.X)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1.02, 0.95, 25.4 / 25])
def test_the_probability_of_another_size(scale):
    """A target of the size given, of another one, in inches: the probability is near 0 or 1, from either start."""
    source, at = few_poses_of_an_arm(scale)
    found = source.find(at)
    assert abs(found.probability_of(TARGET_SCALE, 3e-3) - (scale != 1.0)) < 0.01
    assert found.mixture.odds.sum() == pytest.approx(1.0) and found.mixture.odds[0] == found.mixture.odds.max()
    assert found.probability_of(TARGET_SCALE, 0.0) == pytest.approx(1.0)
    with pytest.raises(InputError, match="target scale"):
        found.probability_of(ROBOT_ACCURACY, 1e-3)


def test_a_search_begins_in_the_tail_too():
    """Find the other mode where the search stays at the usual size and a large arm, and tell the better one."""
    source, at = few_poses_of_an_arm(1.02)
    found = source.find(at)
    k = [part.name for part in source.components].index("target scale")
    place = found.model.free.tolist().index(k)
    start = found.mode.theta.copy()
    start[place] = found.model.medians[place]
    usual = find_mode(found.model, start)
    for mode in (usual, find_mode(found.model)):
        every = [mode, *other_modes(found.model, mode)]
        assert max(known.log_evidence for known in every) >= found.mode.log_evidence - 0.05
