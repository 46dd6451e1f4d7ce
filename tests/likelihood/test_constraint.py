"""The linearised constraint: its residual, its derivatives, its covariance, and which noise fits which data."""

import itertools

import mpmath
import numpy as np
import pytest
from scipy import linalg
from scipy.spatial.transform import Rotation
from support import (
    assert_same_covariance,
    difference,
    draw,
    exact_motions,
    exact_poses,
    jacobian,
    moved,
    random_covariance,
    random_transforms,
    rotation_vectors,
    rotations,
)

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import NEAR_HALF_TURN, logarithm
from uq_handeye.fit.graph.constraint import (
    OnMotions,
    OnPoses,
    Unknowns,
    block_diagonal,
    constraint_of,
    covariances_of,
    residual_covariance,
)

SETUPS = ("eye-in-hand", "eye-to-hand")
KINDS = (*SETUPS, "motions")


def problem(kind, rng, n=5, shape=()):
    """The constraint, its true unknowns, and ``r(first, second, X, W)`` written down once more, from whole poses."""
    if kind == "motions":
        X, A, B = exact_motions(rng, n, shape)
        return OnMotions(A, B), Unknowns(X, None), lambda A, B, X, W: difference(A @ X, X @ B)
    X, robot, camera = exact_poses(rng, n, kind)
    turn = np.linalg.inv if kind == "eye-to-hand" else (lambda T: T)
    W = (turn(robot) @ X @ camera)[0]
    robot, camera = (np.broadcast_to(T, (*shape, n, 4, 4)) for T in (robot, camera))
    return (
        OnPoses(robot, camera, kind == "eye-to-hand"),
        Unknowns(X, W),
        lambda G, C, X, W: difference(turn(G) @ X @ C, W),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_exact_data_have_no_residual(kind, rng):
    constraint, at, _ = problem(kind, rng, 20)
    assert np.abs(constraint.linearise(at, constraint.first, constraint.second).r).max() < 1e-14


@pytest.mark.parametrize("kind", KINDS)
def test_residual_far_from_the_solution(kind, rng):
    """Any data and any guess: the logarithm and the difference of the two sides of the equation."""
    constraint, at, residual = problem(kind, rng)
    first, second = random_transforms(rng, (5,)), random_transforms(rng, (5,))
    at = Unknowns(random_transforms(rng), None if at.W is None else random_transforms(rng))
    found = constraint.linearise(at, first, second).r
    expected = residual(first, second, at.X, at.W)
    far = np.linalg.norm(expected[:, :3], axis=1) > np.pi - 1e-3  # the sign of the axis is open there
    np.testing.assert_allclose(found[~far], expected[~far], atol=1e-11)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives(kind, rng):
    """``r = J e + D_1 xi_1 + D_2 xi_2`` for errors e of the unknowns: J, D_1 and D_2 by numerical differentiation."""
    n = 4
    constraint, at, residual = problem(kind, rng, n)
    linear = constraint.linearise(at, constraint.first, constraint.second)
    p = 6 if at.W is None else 12
    assert linear.J.shape == (n, 6, p) and linear.r.shape == (n, 6)

    def by_unknowns(e):
        X = moved(at.X, e[:, None, :6])
        return residual(constraint.first, constraint.second, X, None if at.W is None else moved(at.W, e[:, None, 6:]))

    np.testing.assert_allclose(linear.J.reshape(6 * n, p), jacobian(by_unknowns, p), atol=1e-10)
    for k, T in enumerate((constraint.first, constraint.second)):

        def by_errors(xi, k=k, T=T):
            data = [constraint.first, constraint.second]
            data[k] = moved(T, xi[:, None, :])
            return residual(*data, at.X, at.W)

        np.testing.assert_allclose(linear.sides[k].reshape(6 * n, 6), jacobian(by_errors, 6), atol=1e-10)


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_off_the_solution_are_wrong_by_the_size_of_r(kind, rng):
    """The limit that the module states: at residuals of size e the error of J is of order e, not larger."""
    constraint, at, residual = problem(kind, rng)
    p = 6 if at.W is None else 12
    error = []
    direction = rng.normal(size=(5, 6))
    for size in (1e-2, 1e-3):
        first = moved(constraint.first, size * direction)
        J = constraint.linearise(at, first, constraint.second).J

        def by_unknowns(e, first=first):
            W = None if at.W is None else moved(at.W, e[:, None, 6:])
            return residual(first, constraint.second, moved(at.X, e[:, None, :6]), W)

        error.append(np.abs(J.reshape(-1, p) - jacobian(by_unknowns, p)).max())
    assert 1e-4 < error[0] < 5e-2 and error[0] / error[1] == pytest.approx(10, rel=0.1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("batched", ["data", "unknowns", "both"])
def test_leading_axes(kind, batched, rng):
    shape = (2, 3)
    constraint, at, _ = problem(kind, rng, 4)
    first, second = constraint.first, constraint.second
    if batched != "unknowns":
        first, second = (moved(T, 1e-2 * rng.normal(size=(*shape, 4, 6))) for T in (first, second))
    if batched != "data":
        at = at.moved(1e-2 * rng.normal(size=(*shape, 6 if at.W is None else 12)))
    whole = constraint.linearise(at, first, second)
    first, second = (np.broadcast_to(T, (*shape, 4, 4, 4)) for T in (first, second))
    for index in np.ndindex(shape):
        one = Unknowns(
            np.broadcast_to(at.X, (*shape, 4, 4))[index],
            None if at.W is None else np.broadcast_to(at.W, (*shape, 4, 4))[index],
        )
        single = constraint.linearise(one, first[index], second[index])
        for ours, theirs in zip((whole.r, whole.J, *whole.sides), (single.r, single.J, *single.sides), strict=True):
            np.testing.assert_allclose(np.broadcast_to(ours, (*shape, *theirs.shape))[index], theirs, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_unknowns_moved_by_the_error_convention(kind, rng):
    _, at, _ = problem(kind, rng)
    step = 0.3 * rng.normal(size=12)
    found = at.moved(step[:6] if at.W is None else step)
    np.testing.assert_allclose(found.X, moved(at.X, step[:6]), atol=1e-15)
    assert (found.W is None) == (at.W is None)
    if at.W is not None:
        np.testing.assert_allclose(found.W, moved(at.W, step[6:]), atol=1e-15)


# ------------------------------------------------------------------------------------------------- logarithm


@pytest.mark.parametrize(
    "angles",
    [
        np.array([0.0]),
        np.logspace(-18, np.log10(NEAR_HALF_TURN - 1e-9), 400),
        NEAR_HALF_TURN + np.logspace(-9, np.log10(np.pi - NEAR_HALF_TURN), 50) * (1 - 1e-15),
        np.pi - np.logspace(-12, -0.2, 200),
    ],
    ids=["zero", "small to large", "beyond the switch", "near half a turn"],
)
def testlogarithm(angles, rng):
    """exp of it is the rotation to rounding at every angle, and small vectors keep all their digits."""
    axes = rotation_vectors(rng, (3, len(angles)), 1.0, 1.0)
    R = rotations(axes * angles[:, None])
    found = logarithm(R)
    np.testing.assert_allclose(rotations(found), R, atol=2e-15)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), np.broadcast_to(angles, (3, len(angles))), atol=3e-15)
    open_sign = angles > np.pi - 1e-7  # exp hides the sign of the axis in its last digits
    small = angles < 1e-6
    np.testing.assert_allclose(
        found[:, ~open_sign], (axes * angles[:, None])[:, ~open_sign], atol=1e-7 if angles.max() > 3 else 3e-15
    )
    np.testing.assert_allclose(found[:, small], (axes * angles[:, None])[:, small], rtol=1e-12, atol=1e-30)
    scipy = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec().reshape(found.shape)
    np.testing.assert_allclose(found[:, ~open_sign], scipy[:, ~open_sign], atol=1e-7 if angles.max() > 3 else 5e-15)


@pytest.mark.parametrize("angle", ["1e-15", "1e-8", "1e-3", "0.7", "2.4", "2.6", "3.1", "3.141592"])
def test_logarithm_in_fifty_digits(angle):
    """Against exp by mpmath, rounded to double."""
    with mpmath.workdps(50):
        axis = mpmath.matrix(["0.48", "-0.6", "0.64"])
        x, y, z = mpmath.mpf(angle) * axis
        R = mpmath.expm(mpmath.matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]]))
        exact = np.array([float(x), float(y), float(z)])
        R = np.array([[float(R[i, j]) for j in range(3)] for i in range(3)])
    # near half a turn the rounding of R moves the axis by its share of the distance to pi
    np.testing.assert_allclose(logarithm(R), exact, rtol=1e-12 if float(angle) < 3.14 else 1e-9, atol=1e-25)


def test_logarithm_of_a_mixed_stack_is_that_of_each(rng):
    """One rotation near half a turn sends the whole stack to SciPy: the others keep their value."""
    R = rotations(rotation_vectors(rng, (50,), 1e-9, 2.4))
    alone = logarithm(R)
    with_one = logarithm(np.concatenate([R, rotations(np.array([[0.0, 3.1, 0.0]]))]))
    np.testing.assert_allclose(with_one[:-1], alone, atol=2e-15)
    assert logarithm(np.zeros((0, 3, 3))).shape == (0, 3)


# -------------------------------------------------------------------------------------------- covariance of r


CHOICES = ("none", "one", "per pose", "joint")


def dense(D):
    return linalg.block_diag(*D)


@pytest.mark.parametrize("kind", SETUPS)
@pytest.mark.parametrize(("robot", "camera"), [*itertools.product(CHOICES, CHOICES)][1:])
def test_residual_covariance(kind, robot, camera, rng):
    """``D Sigma D^T`` with everything written out as one 6n x 6n matrix."""
    n = 4
    sizes = {"one": (6, ()), "per pose": (6, (n,)), "joint": (6 * n, ())}
    given, full = [], []
    for choice in (robot, camera):
        S = None if choice == "none" else random_covariance(rng, *sizes[choice])
        given.append(S)
        as_joint = {
            "none": lambda S: np.zeros((6 * n, 6 * n)),
            "one": lambda S: np.kron(np.eye(n), S),
            "per pose": lambda S: linalg.block_diag(*S),
            "joint": lambda S: S,
        }[choice]
        full.append(as_joint(S))
    constraint, at, _ = problem(kind, rng, n)
    sides = constraint.linearise(at, constraint.first, constraint.second).sides
    noise = uq.PoseNoise(*given)
    expected = sum(dense(D) @ S @ dense(D).T for D, S in zip(sides, full, strict=True))
    found = residual_covariance(sides, noise)
    if "joint" in (robot, camera):
        assert found.shape == (6 * n, 6 * n)
    else:
        assert found.shape == (n, 6, 6)
        found = block_diagonal(found)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12 * expected.max())


def test_residual_covariance_of_motions(rng):
    constraint, at, _ = problem("motions", rng, 4)
    sides = constraint.linearise(at, constraint.first, constraint.second).sides
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng, 6, (4,)))
    found = residual_covariance(sides, noise)
    for k in range(4):
        expected = sides[0][k] @ noise.A @ sides[0][k].T + sides[1][k] @ noise.B[k] @ sides[1][k].T
        np.testing.assert_allclose(found[k], expected, rtol=1e-12, atol=1e-20)
    assert covariances_of(noise) == (noise.A, noise.B)


@pytest.mark.parametrize("joint", [False, True])
def test_residual_covariance_over_leading_axes(joint, rng):
    shape, n = (2, 3), 4
    constraint, at, _ = problem("eye-to-hand", rng, n)
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng, 6 * n if joint else 6))
    first, second = (moved(T, 1e-2 * rng.normal(size=(*shape, n, 6))) for T in (constraint.first, constraint.second))
    whole = residual_covariance(constraint.linearise(at, first, second).sides, noise)
    assert whole.shape == (*shape, *((6 * n, 6 * n) if joint else (n, 6, 6)))
    for index in np.ndindex(shape):
        one = residual_covariance(constraint.linearise(at, first[index], second[index]).sides, noise)
        np.testing.assert_allclose(whole[index], one, rtol=1e-10, atol=1e-18)


@pytest.mark.slow
def test_residual_covariance_is_that_of_sampled_residuals(rng):
    """S is the scatter of r at true unknowns."""
    n, trials = 3, 20_000
    constraint, at, residual = problem("eye-to-hand", rng, n)
    noise = uq.PoseNoise(random_covariance(rng, sd=1e-4), random_covariance(rng, 6 * n, sd=1e-4))
    S = residual_covariance(constraint.linearise(at, constraint.first, constraint.second).sides, noise)
    first = moved(constraint.first, draw(rng, noise.robot, (trials, n)))
    second = moved(constraint.second, draw(rng, noise.camera, (trials,)).reshape(trials, n, 6))
    r = constraint.linearise(at, first, second).r
    np.testing.assert_allclose(r, residual(first, second, at.X, at.W), atol=1e-14)
    spread = 2 * np.sqrt(6 * n / trials) + 0.02  # extreme eigenvalues of a white sample covariance
    assert_same_covariance(np.cov(r.reshape(trials, -1).T), S, spread)


# ------------------------------------------------------------------------------------- which noise fits which data


def test_the_constraint_that_data_and_noise_choose(rng):
    poses = uq.simulate(6, seed=1)
    made, plain = uq.relative_motions(poses, "all"), uq.Motions(*exact_motions(rng, 4)[1:])
    on_poses = uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    on_pairs = uq.PairNoise.isotropic(A=("1mrad", "1mm"))
    for noise in (None, on_poses):
        for data in (poses, made):
            found = constraint_of(data, noise)
            assert isinstance(found, OnPoses) and not found.inverted
            assert found.first is poses.robot and found.second is poses.camera
    assert constraint_of(uq.simulate(6, setup="eye-to-hand"), on_poses).inverted
    for data, noise in ((made, on_pairs), (plain, on_pairs), (plain, None)):
        found = constraint_of(data, noise)
        assert isinstance(found, OnMotions) and found.first is data.A and found.second is data.B


@pytest.mark.parametrize(
    ("data", "noise", "message"),
    [
        ("poses", uq.PairNoise(A=np.eye(6)), "PairNoise is noise of motions: give the Motions"),
        (
            "motions",
            uq.PoseNoise(np.eye(6)),
            "PoseNoise needs poses; for motions that come without poses use PairNoise",
        ),
        ("motions", uq.PairNoise(A=np.tile(np.eye(6), (3, 1, 1))), "`A` to cover 4 motions, got 3"),
        ("motions", uq.PairNoise(B=np.tile(np.eye(6), (5, 1, 1))), "`B` to cover 4 motions, got 5"),
        ("poses", uq.PoseNoise(np.tile(np.eye(6), (5, 1, 1))), "`robot` to cover 6 poses, got 5"),
        ("poses", uq.PoseNoise(camera=np.eye(42)), "`camera` to cover 6 poses, got 7"),
        ("made", uq.PoseNoise(camera=np.tile(np.eye(6), (15, 1, 1))), "`camera` to cover 6 poses, got 15"),
        ("made", uq.PairNoise(A=np.tile(np.eye(6), (6, 1, 1))), "`A` to cover 15 motions, got 6"),
    ],
)
def test_noise_that_does_not_fit_is_refused(data, noise, message, rng):
    poses = uq.simulate(6, seed=1)
    chosen = {
        "poses": poses,
        "made": uq.relative_motions(poses, "all"),
        "motions": uq.Motions(*exact_motions(rng, 4)[1:]),
    }[data]
    with pytest.raises(uq.InputError, match=message):
        constraint_of(chosen, noise)
