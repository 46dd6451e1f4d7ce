"""Task space: points and budgets against numerical derivatives and Monte Carlo."""

import json

import numpy as np
import pytest
from scipy import linalg
from support import (
    assert_same_covariance,
    covers,
    difference,
    draw,
    jacobian,
    moved,
    random_covariance,
    random_transforms,
)

import uq_handeye as uq
from uq_handeye.fit.diagnostics.budget import budget, budget_of_sensitivities
from uq_handeye.fit.diagnostics.task_space import Link, frames_of, through
from uq_handeye.fit.graph.gauss_helmert import efficient

SETUPS = ["eye-in-hand", "eye-to-hand"]
NOISE = uq.PoseNoise.isotropic(robot=("0.1mrad", "0.2mm"), camera=("1mrad", "0.5mm"))


@pytest.fixture(params=SETUPS)
def setup(request):
    return request.param


def applied(T, p):
    return (T[..., :3, :3] @ p[..., None])[..., 0] + T[..., :3, 3]


# ------------------------------------------------------------------------------------------------------ points


def through_X(X, S, points, setup="eye-in-hand", points_covariance=None):
    return through([Link("X", X, S)], points, frames_of(setup)[0], points_covariance)


def through_robot(X, S, points, robot, robot_covariance=None, setup="eye-in-hand", points_covariance=None):
    links = [Link("X", X, S), Link("robot", robot, robot_covariance, inverted=setup == "eye-to-hand")]
    return through(links, points, frames_of(setup)[1], points_covariance)


def through_target(W, S, points, camera, camera_covariance=None, setup="eye-in-hand", points_covariance=None):
    links = [Link("camera", camera, camera_covariance, inverted=True), Link("W", W, S)]
    return through(links, points, frames_of(setup)[1], points_covariance)


def test_points_through_X(rng, setup):
    X, S, N = random_transforms(rng), random_covariance(rng), random_covariance(rng, 3)
    points = rng.normal(size=(2, 4, 3))
    found = through_X(X, S, points, setup=setup, points_covariance=N)
    assert found.frame == ("gripper" if setup == "eye-in-hand" else "base")
    np.testing.assert_allclose(found.points, applied(X, points))
    for k in np.ndindex(2, 4):
        p = points[k]
        J = jacobian(lambda x, p=p: applied(moved(X, x[:, :6]), p + x[:, 6:]), 9)
        assert_same_covariance(found.covariance[k], J @ linalg.block_diag(S, N) @ J.T, 1e-8)
    exact = through_X(X, S, points).covariance
    assert exact.shape == (2, 4, 3, 3)
    np.testing.assert_allclose(exact + X[:3, :3] @ N @ X[:3, :3].T, found.covariance)


def through_both(setup, X, G, p):
    return applied(G if setup == "eye-in-hand" else np.linalg.inv(G), applied(X, p))


def test_points_through_the_robot(rng, setup):
    X, G = random_transforms(rng), random_transforms(rng)
    S, S_G, N = random_covariance(rng), random_covariance(rng), random_covariance(rng, 3)
    p = rng.normal(size=3)
    found = through_robot(X, S, p, G, robot_covariance=S_G, setup=setup, points_covariance=N)
    assert found.frame == ("base" if setup == "eye-in-hand" else "gripper")
    np.testing.assert_allclose(found.points, through_both(setup, X, G, p))
    J = jacobian(lambda x: through_both(setup, moved(X, x[:, :6]), moved(G, x[:, 6:12]), p + x[:, 12:]), 15)
    assert_same_covariance(found.covariance, J @ linalg.block_diag(S, S_G, N) @ J.T, 1e-8)
    exact = through_robot(X, S, p, G, setup=setup)
    assert_same_covariance(exact.covariance, J[:, :6] @ S @ J[:, :6].T, 1e-8)
    many = through_robot(X, S, np.stack([p, 2 * p]), np.stack([G, G]), setup=setup)
    np.testing.assert_allclose(many.covariance[0], exact.covariance)


def test_points_through_the_target(rng, setup):
    W, C = random_transforms(rng), random_transforms(rng)
    S, S_C, N = random_covariance(rng), random_covariance(rng), random_covariance(rng, 3)
    p = rng.normal(size=3)
    found = through_target(W, S, p, C, camera_covariance=S_C, setup=setup, points_covariance=N)
    assert found.frame == ("base" if setup == "eye-in-hand" else "gripper")

    def of(x):
        return applied(moved(W, x[:, :6]), applied(np.linalg.inv(moved(C, x[:, 6:12])), p + x[:, 12:]))

    np.testing.assert_allclose(found.points, of(np.zeros((1, 15)))[0])
    J = jacobian(of, 15)
    assert_same_covariance(found.covariance, J @ linalg.block_diag(S, S_C, N) @ J.T, 1e-8)


@pytest.mark.statistical
def test_points_by_monte_carlo(rng, setup):
    """The point's ellipsoid covers where X and a new robot pose carry noise; without the noise of X it does not."""
    trials = 4000
    X, G = random_transforms(rng), random_transforms(rng)
    S, S_G = random_covariance(rng), random_covariance(rng)
    p = np.array([0.1, -0.2, 0.7])
    Xs, Gs = moved(X, -draw(rng, S, (trials,))), moved(G, -draw(rng, S_G, (trials,)))
    errors = through_both(setup, Xs, Gs, p) - through_both(setup, X, G, p)
    found = through_robot(X, S, p, G, robot_covariance=S_G, setup=setup)
    assert all(covers(errors, found.covariance))
    inside = (np.linalg.norm(errors, axis=1) < found.radius_95).mean()
    assert abs(inside - 0.95) < 4 * np.sqrt(0.95 * 0.05 / trials)
    wrong = through_robot(X, 0.25 * S, p, G, robot_covariance=0.25 * S_G, setup=setup)
    assert not all(covers(errors, wrong.covariance))


def test_point_results_as_text(rng):
    S = np.diag([0, 0, 0, 1e-6, 4e-6, 9e-6])
    found = through_X(np.eye(4), S, [0.0, 0.0, 0.0])
    np.testing.assert_allclose(found.std, [1e-3, 2e-3, 3e-3])
    assert found.radius_95 == pytest.approx(6.45e-3, rel=3e-3)  # by 10^8 random draws
    assert json.loads(json.dumps(found.to_dict()))["frame"] == "gripper"


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: through_X(np.eye(4), np.eye(6), [1.0, 2.0]).covariance, "points"),
        (lambda: through_X(np.eye(4), np.eye(5), [1.0, 2.0, 3.0]).covariance, "covariance of `X`"),
        (lambda: through_X(np.eye(3), np.eye(6), [1.0, 2.0, 3.0]).covariance, "`X`"),
        (lambda: through_X(np.eye(4), np.eye(6), np.zeros(3), points_covariance=np.eye(2)), "points_covariance"),
    ],
)
def test_errors_of_points(call, text):
    with pytest.raises(uq.InputError, match=text):
        call()


# ------------------------------------------------------------------------------------------------------ budget


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["one", "each", "joint"])
def test_the_budget_of_a_fit_is_that_of_numerical_derivatives(rng, setup, kind):
    n = 6
    true = uq.simulate(n, setup=setup, seed=rng)
    shape = (n,) if kind == "each" else ()
    camera = random_covariance(rng, 6 * n) if kind == "joint" else random_covariance(rng, shape=shape)
    noise = uq.PoseNoise(random_covariance(rng, shape=shape), camera)
    fit = efficient(true, noise)
    found = budget(fit, noise)
    assert_same_covariance(found.covariance, fit.covariance, 1e-6)
    np.testing.assert_allclose(found.shares.sum(axis=0), 1)

    def of(xi):
        poses = uq.PosePairs(moved(true.robot, xi[:n]), moved(true.camera, xi[n:]), setup)
        again = efficient(poses, noise, start=true.truth.X)
        return np.concatenate([difference(again.X, true.truth.X), difference(again.W, true.truth.W)])

    h = 1e-5
    unit = np.eye(12 * n).reshape(-1, 2 * n, 6)
    D = np.stack([(of(h * e) - of(-h * e)) / (2 * h) for e in unit], axis=1)
    D = {"robot": D[:, : 6 * n], "camera": D[:, 6 * n :]}
    for side, covariance in (("robot", noise.robot), ("camera", noise.camera)):
        whole = covariance
        if covariance.shape[-1] == 6:
            whole = linalg.block_diag(*np.broadcast_to(covariance, (n, 6, 6)))
        turn = np.tile([True] * 3 + [False] * 3, n)
        masks = {"rotation": np.outer(turn, turn), "translation": np.outer(~turn, ~turn)}
        masks["coupling"] = ~(masks["rotation"] | masks["translation"])
        for name, mask in masks.items():
            expected = D[side] @ (whole * mask) @ D[side].T
            part = found.covariances[found.sources.index(f"{side} {name}")]
            sd = np.sqrt(np.diag(fit.covariance))
            np.testing.assert_allclose(part / sd / sd[:, None], expected / sd / sd[:, None], atol=2e-4)


@pytest.mark.slow
def test_sources_by_monte_carlo(rng):
    """X scatters, with one source at work, by that source's part of the budget."""
    true = uq.simulate(10, seed=5)
    fit = efficient(true, NOISE)
    found = budget(fit, NOISE)
    assert found.sources == ("robot rotation", "robot translation", "camera rotation", "camera translation")
    for side, rows, source in (("camera", slice(0, 3), "camera rotation"), ("robot", slice(3, 6), "robot translation")):
        S = np.zeros((6, 6))
        S[rows, rows] = getattr(NOISE, side)[rows, rows]
        xi = np.sqrt(np.diag(S)) * rng.normal(size=(1000, 10, 6))
        poses = {"robot": np.broadcast_to(true.robot, (1000, 10, 4, 4)), "camera": true.camera}
        poses["camera"] = np.broadcast_to(true.camera, (1000, 10, 4, 4))
        poses[side] = moved(poses[side], xi)
        errors = difference(efficient(uq.PosePairs(**poses), NOISE).X, true.truth.X)
        part = found.covariances[found.sources.index(source)][:6, :6]
        ratio = errors.var(axis=0) / np.diag(part)
        assert np.abs(ratio - 1).max() < 4.5 * np.sqrt(2 / 1000)
        assert np.abs(errors.var(axis=0) / np.diag(fit.covariance_X) - 1).max() > 4.5 * np.sqrt(2 / 1000)


def test_the_budget_of_4dpa(rng):
    from uq_handeye.methods.all_pairs import AllPairs

    poses = uq.simulate(8, noise=NOISE, seed=rng)
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    pairs = AllPairs(poses)
    X = pairs.solve()
    found = budget_of_sensitivities(*pairs.sensitivities(X), noise, X)
    assert_same_covariance(found.covariance, pairs.propagate(noise, X), 1e-9)
    assert found.components[0] == "X theta_x" and len(found.components) == 6


def test_the_budget_on_motions(rng):
    noise = uq.PairNoise(random_covariance(rng), np.diag([1e-6] * 6))
    motions = uq.relative_motions(uq.simulate(9, seed=rng))
    fit = efficient(motions, noise)
    found = budget(fit, noise)
    assert found.sources == ("A rotation", "A translation", "A coupling", "B rotation", "B translation")
    assert_same_covariance(found.covariance, fit.covariance, 1e-9)
    one_side = uq.PairNoise(B=np.diag([1e-6] * 6))
    assert budget(efficient(motions, one_side), one_side).sources == ("B rotation", "B translation")


def test_merged_sources_and_text(rng):
    poses = uq.simulate(9, noise=NOISE, seed=rng)
    fit = efficient(poses, NOISE)
    whole = budget(fit, NOISE)
    found = budget(fit, NOISE, merged=[("robot translation", "camera translation")])
    assert found.sources == ("robot rotation", "robot translation + camera translation", "camera rotation")
    np.testing.assert_allclose(found.covariances[1], whole.covariances[1] + whole.covariances[3])
    np.testing.assert_allclose(found.covariance, whole.covariance)
    table = found.table()
    assert len(table.splitlines()) == 4 and "X rotation" in table and "W translation" in table
    assert set(whole.group_shares) == {"X rotation", "X translation", "W rotation", "W translation"}
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["sources"] == list(found.sources)
    with pytest.raises(uq.InputError, match="names to merge"):
        budget(fit, NOISE, merged=[("robot", "camera")])
    with pytest.raises(uq.InputError, match="names to merge"):
        whole.merged(("robot rotation",), ("robot rotation", "camera rotation"))


def test_the_budget_of_a_point(rng, setup):
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    poses = uq.simulate(9, noise=noise, setup=setup, seed=rng)
    fit = efficient(poses, noise)
    p = np.array([0.1, 0.2, 0.5])
    found = budget(fit, noise).budget_at(p)
    assert_same_covariance(found.covariance, through_X(fit.X, fit.covariance_X, p).covariance, 1e-8)
    np.testing.assert_allclose(found.group_shares["point"].sum(), 1)
    assert found.components == ("x", "y", "z")
    with pytest.raises(uq.InputError, match="point"):
        found.budget_at(p)
    with pytest.raises(uq.InputError, match="point"):
        budget(fit, noise).budget_at(np.zeros((2, 3)))


def test_robust_weights(rng):
    """The budget sums to the covariance that the noise gives the weighted estimate."""
    from uq_handeye.fit.graph.constraint import constraint_of
    from uq_handeye.fit.graph.gauss_helmert import fit
    from uq_handeye.fit.graph.starts import start_of

    poses = uq.simulate(9, noise=NOISE, seed=rng)
    at = constraint_of(poses, NOISE)
    weights = np.array([1.0] * 6 + [0.0, 0.5, 0.5])
    whole = fit(at, NOISE, start_of(poses, at, None), 1, weights)
    found = budget(whole, NOISE)
    J, S = whole.linear.J, whole.S
    gain = whole.covariance @ (weights[:, None, None] * np.linalg.solve(S, J)).mT
    assert_same_covariance(found.covariance, (gain @ S @ gain.mT).sum(axis=0), 1e-7)


def test_errors_of_budgets(rng):
    poses = uq.simulate(6, noise=NOISE, trials=2, seed=rng)
    with pytest.raises(uq.InputError, match="leading axes"):
        budget(efficient(poses, NOISE), NOISE)
    with pytest.raises(uq.InputError, match="derivatives for `camera`"):
        budget_of_sensitivities(np.zeros((3, 6, 6)), None, NOISE, np.eye(4))
    noise = uq.PoseNoise(camera=np.stack([np.eye(6)] * 4))
    with pytest.raises(uq.InputError, match="rows of the derivatives"):
        budget_of_sensitivities(None, np.zeros((3, 6, 6)), noise, np.eye(4))


@pytest.mark.parametrize("bad", [-1e-6 * np.eye(6), np.triu(np.ones((6, 6))), np.ones((6, 6)) - 0.5 * np.eye(6)])
def test_covariances_of_points_are_checked(bad):
    T, p = np.eye(4), [0.1, 0.0, 0.5]
    good = 1e-6 * np.eye(6)
    for call in (
        lambda: through_X(T, bad, p),
        lambda: through_X(T, good, p, points_covariance=bad[:3, :3]),
        lambda: through_robot(T, good, p, T, robot_covariance=bad),
        lambda: through_target(T, good, p, T, camera_covariance=np.stack([good, bad])),
    ):
        with pytest.raises(uq.InputError, match=r"(robot|camera|points)_covariance|`X`"):
            call()
    assert through_X(T, good, p, setup=None).frame == "parent frame of X"
