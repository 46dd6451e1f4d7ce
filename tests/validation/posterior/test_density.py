"""The posterior density against dense formulas, least errors for each X, and integrals over latent motions."""

import numpy as np
import pytest
from fixtures.likelihood_problems import KINDS, problem
from scipy import linalg, stats
from support import difference, jacobian, moved

import uq_handeye as uq
from uq_handeye.errors import InputError
from uq_handeye.fit.graph.constraint import constraint_of, covariances_of, residual_covariance
from uq_handeye.trials.validation.posterior.density import ScalePrior, density_of


def dense_parts(given, density):
    """D v, and the covariances of the residuals of each side (6n, 6n), at the estimate."""
    fit = density.fit
    constraint = constraint_of(given.data, given.noise)
    at_best = constraint.linearise(fit.unknowns, density.first, density.second)
    names = ("A", "B") if isinstance(given.noise, uq.PairNoise) else ("robot", "camera")
    sides = []
    for name, S in zip(names, covariances_of(given.noise), strict=True):
        part = residual_covariance(fit.linear.sides, type(given.noise)(**{name: S}))
        sides.append(linalg.block_diag(*part) if part.ndim == 3 else part)
    return fit.residual, at_best.J, sides


# Motions have no joint noise.
KINDS_AND_NOISE = [(kind, joint) for kind in KINDS for joint in (False, True) if (kind, joint) != ("motions", True)]


def residuals(density, step):
    linear = density.constraint.linearise(density.fit.unknowns.moved(step), density.first, density.second)
    return linear.r + density.fit.residual


@pytest.mark.parametrize(("kind", "joint"), KINDS_AND_NOISE)
def test_it_is_a_standard_normal_about_the_estimate(kind, joint, rng):
    density = density_of(*problem(kind, rng, joint=joint, sd=1e-4)[1:3])
    assert density.d == 6
    gradient = jacobian(lambda y: density(y)[:, None], 6, step=0.1)

    def gradients(y):
        return np.array([jacobian(lambda z, at=at: density(z + at)[:, None], 6, step=0.1)[0] for at in y])

    hessian = jacobian(gradients, 6, step=0.1)
    assert np.abs(gradient).max() < 1e-3
    np.testing.assert_allclose(hessian, -np.eye(6), atol=2e-2)


def profile(given, X):
    """Minus half the least sum of whitened squares over W and every true camera pose, X being given."""
    first, second = given.measured
    n = len(first)
    whitening = [np.linalg.inv(np.linalg.cholesky(np.broadcast_to(S, (n, 6, 6)))) for S in covariances_of(given.noise)]
    W, C = given.W, given.exact[1]

    def errors(x, W, C):
        C = moved(C, x[..., -6 * n :].reshape(*x.shape[:-1], n, 6))
        if W is None:
            G = X @ C @ np.linalg.inv(X)
        else:
            G = moved(W, x[..., :6])[..., None, :, :] @ np.linalg.inv(C) @ np.linalg.inv(X)
            G = G if given.kind == "eye-in-hand" else np.linalg.inv(G)
        pairs = zip((first, second), (G, C), whitening, strict=True)
        parts = [(L @ difference(T, m)[..., None])[..., 0] for T, m, L in pairs]
        return np.concatenate([part.reshape(*x.shape[:-1], 6 * n) for part in parts], axis=-1)

    size = 6 * n + (0 if W is None else 6)
    for _ in range(6):
        e = errors(np.zeros(size), W, C)
        step = -np.linalg.lstsq(jacobian(lambda x, W=W, C=C: errors(x, W, C), size, step=1e-4), e, rcond=None)[0]
        W, C = None if W is None else moved(W, step[:6]), moved(C, step[-6 * n :].reshape(n, 6))
    e = errors(np.zeros(size), W, C)
    return -0.5 * float(e @ e)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_against_the_least_errors_for_each_X(kind, rng):
    given = problem(kind, rng, n=6, sd=1e-4)
    density = density_of(given.data, given.noise)
    y = 2.0 * rng.normal(size=(4, 6))
    y[0] = 0.0
    reference = np.array([profile(given, moved(density.fit.X, x)) for x in density.coordinates(y)])
    np.testing.assert_allclose(density(y) - density(y[:1]), reference - reference[0], rtol=1e-2, atol=1e-2)


@pytest.mark.parametrize(("kind", "joint"), KINDS_AND_NOISE)
def test_scales_against_dense_matrices(kind, joint, rng):
    """Gaussian of 6n residuals with ``s_1^2 S_1 + s_2^2 S_2``, W integrated by its 6x6 determinant."""
    given = problem(kind, rng, n=6, joint=joint)
    density = density_of(given.data, given.noise, ScalePrior(robot=3.0, camera=2.0))
    assert density.names[6:] == (
        ("log_scale_A", "log_scale_B") if kind == "motions" else ("log_scale_robot", "log_scale_camera")
    )
    _, J, sides = dense_parts(given, density)
    y = 1.5 * rng.normal(size=(5, 8))
    expected = []
    for x in density.coordinates(y):
        s = np.exp(x[6:])
        S = s[0] ** 2 * sides[0] + s[1] ** 2 * sides[1]
        step = x[:6] if given.W is None else np.concatenate([x[:6], density.follow @ x[:6]])
        r = residuals(density, step).ravel()
        value = -0.5 * np.linalg.slogdet(S)[1] - 0.5 * r @ np.linalg.solve(S, r)
        if given.W is not None:
            J_W = J[..., 6:].reshape(-1, 6)
            information = J_W.T @ np.linalg.solve(S, J_W)
            pull = J_W.T @ np.linalg.solve(S, r)
            value += 0.5 * pull @ np.linalg.solve(information, pull) - 0.5 * np.linalg.slogdet(information)[1]
        expected.append(value + stats.norm.logpdf(x[6:], scale=np.log([3.0, 2.0])).sum())
    found = density(y)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], rtol=1e-8, atol=1e-8)


@pytest.mark.slow
def test_integral_over_W(rng):
    """The same number, up to a constant, by integrating the density of X and W on a grid of Gauss and Hermite."""
    given = problem("eye-in-hand", rng, n=5, sd=1e-4)
    density = density_of(given.data, given.noise)
    S_inverse = np.linalg.inv(density.fit.S)
    L = np.linalg.cholesky(density.fit.covariance_W)
    nodes, weights = np.polynomial.hermite_e.hermegauss(5)
    grid = np.stack(np.meshgrid(*[nodes] * 6, indexing="ij"), axis=-1).reshape(-1, 6)
    logs = sum(np.log(w).ravel() for w in np.meshgrid(*[weights] * 6, indexing="ij")) + 0.5 * (grid**2).sum(axis=1)
    y = rng.normal(size=(3, 6))
    expected = []
    for x in density.coordinates(y):
        steps = np.concatenate([np.broadcast_to(x, grid.shape), density.follow @ x + 0.7 * grid @ L.T], axis=1)
        r = residuals(density, steps)
        value = -0.5 * np.einsum("kni,nij,knj->k", r, S_inverse, r) + logs
        expected.append(np.log(np.exp(value - value.max()).sum()) + value.max())
    found = density(y)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], atol=5e-3)


@pytest.mark.parametrize("scales", [None, ScalePrior(robot=2.0, camera=None), ScalePrior()])
@pytest.mark.parametrize("kind", KINDS)
def test_student_t_against_scipy(kind, scales, rng):
    given = problem(kind, rng, n=5)
    density = density_of(given.data, given.noise, scales, student_t=4.0)
    p = 6 if kind == "motions" else 12
    assert density.d == p + (0 if scales is None else 1 if scales.camera is None else 2)
    _, _, sides = dense_parts(given, density)
    y = rng.normal(size=(4, density.d))
    expected = []
    for x in density.coordinates(y):
        s = np.ones(2)
        s[: len(x) - p] = np.exp(x[p:])
        S = s[0] ** 2 * sides[0] + s[1] ** 2 * sides[1]
        rows = residuals(density, x[:p])
        value = sum(
            stats.multivariate_t.logpdf(r, shape=S[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], df=4.0)
            for k, r in enumerate(rows)
        )
        widths = [] if scales is None else [2.0] if scales.camera is None else [3.0, 3.0]
        expected.append(value + stats.norm.logpdf(x[p:], scale=np.log(widths)).sum())
    found = density(y)
    np.testing.assert_allclose(found - found[0], np.array(expected) - expected[0], rtol=1e-8, atol=1e-8)


def test_the_map_of_scales_keeps_volumes(rng):
    given = problem("motions", rng)
    density = density_of(given.data, given.noise, ScalePrior())
    for at in 2.0 * rng.normal(size=(5, 2)):
        J = jacobian(lambda d, at=at: density._log_scales(at[0] + d[:, 0], at[1] + d[:, 1]), 2)
        assert abs(abs(np.linalg.det(J)) - 1.0) < 1e-9


def by_importance(given, density, x, draws):
    """Log of the integral over every true B of the density of A and B, by importance sampling, for errors x (K, 6)."""
    first, second = given.measured
    S_A, S_B = (np.broadcast_to(S, (len(first), 6, 6)) for S in covariances_of(given.noise))
    D_B = density.fit.linear.sides[1]
    gain = S_B @ D_B.mT @ np.linalg.inv(density.fit.S)
    conditional = S_B - gain @ D_B @ S_B
    L = np.linalg.cholesky(0.5 * (conditional + conditional.mT))
    inverses = np.linalg.inv(S_A), np.linalg.inv(S_B)
    e = stats.norm.ppf(stats.qmc.Sobol(6, seed=1).random(draws))[:, None]
    found = []
    for step in x:
        X = moved(density.fit.X, step)
        mean = (gain @ residuals(density, step)[..., None])[..., 0]
        b = mean + (L @ e[..., None])[..., 0]
        B = moved(second, -b)
        a = difference(first, X @ B @ np.linalg.inv(X))
        log = 0.5 * (e**2).sum(axis=-1) - 0.5 * sum(
            np.einsum("kni,nij,knj->kn", v, M, v) for v, M in ((a, inverses[0]), (b, inverses[1]))
        )
        peak = log.max(axis=0)
        found.append((np.log(np.exp(log - peak).mean(axis=0)) + peak).sum())
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("deviations", [("10mrad", "10mm"), ("1mrad", "0.1mm"), ("10mrad", "0.1mm")])
def test_mean_and_deviations_with_every_latent_motion_integrated(deviations, rng):
    """No first order in the reference: the true motions are integrated, X is reweighted."""
    given = problem("motions", rng, n=12)
    noise = uq.PairNoise.isotropic(deviations, deviations)
    sd = np.sqrt(np.diag(noise.A))
    data = uq.Motions(*(moved(T, sd * rng.normal(size=(12, 6))) for T in given.exact))
    given = given._replace(data=data, noise=noise)
    density = density_of(data, noise)
    y = rng.normal(size=(250, 6))
    y = np.concatenate([y, -y])
    x = density.coordinates(y)
    weight = by_importance(given, density, x, 128) - density(y)
    weight = np.exp(weight - weight.max())
    weight /= weight.sum()
    # mean and deviations under the reference, less those of the same samples under the density of the package
    shift = weight @ y - y.mean(axis=0)
    spread = np.sqrt(weight @ (y - weight @ y) ** 2) / y.std(axis=0)
    assert np.abs(shift).max() < (0.1 if deviations[1] == "10mm" else 0.02), shift
    assert np.abs(np.log(spread)).max() < 0.03, spread


def test_wrong_arguments(rng):
    given = problem("eye-in-hand", rng, joint=True)
    with pytest.raises(InputError, match="joint over poses"):
        density_of(given.data, given.noise, student_t=5.0)
    for factor in (1.0, 0.5, "2", True, np.nan):
        with pytest.raises(InputError, match="factor above 1"):
            ScalePrior(robot=factor)
    with pytest.raises(InputError, match="scales=False"):
        ScalePrior(None, None)
    exact = uq.PoseNoise(camera=np.eye(6) * 1e-6)
    with pytest.raises(InputError, match="is exact"):
        density_of(problem("eye-in-hand", rng).data, exact, ScalePrior(camera=None))
    assert density_of(problem("eye-in-hand", rng).data, exact, ScalePrior()).names[6:] == ("log_scale_camera",)
