"""Every method of the registry: what it says of itself, exact data, its singular cases, and the derivative of its X."""

import numpy as np
import pytest
from support import (
    assert_same_covariance,
    difference,
    exact_motions,
    exact_poses,
    jacobian,
    moved,
    noisy_motions,
    random_covariance,
    random_transforms,
    rotation_vectors,
    rotations,
    transforms,
)

import uq_handeye as uq
from uq_handeye.methods.moments import MomentSolver
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.methods.quaternions import axis_signs, quaternions
from uq_handeye.methods.quaternions import rotation_vectors as from_quaternions

NAMES = [
    "tsai",
    "shiu",
    "chou",
    "park",
    "horaud",
    "daniilidis",
    "andreff",
    "lu",
    "gwak",
    "heller",
    "condurache",
    "zhang",
    "zhao",
    "nguyen",
    "4dpa",
]
YEARS = [1989, 1989, 1991, 1994, 1995, 1999, 2001, 2002, 2003, 2014, 2016, 2017, 2018, 2018, 2019]
SLOW = {"heller", "zhao"}  # a program per problem
CLOSED = [name for name in NAMES if uq.METHODS[name].form == "closed form"]
SMOOTH = [name for name in NAMES if name != "zhao"]  # whose X is differentiable at exact data


@pytest.fixture(params=NAMES)
def method(request):
    if request.param == "heller":
        pytest.importorskip("cvxpy")
    return uq.METHODS[request.param]


def test_the_registry_holds_the_methods_of_table_I():
    assert list(uq.METHODS) == sorted(NAMES, key=lambda name: (YEARS[NAMES.index(name)], NAMES.index(name)))
    for name, year in zip(NAMES, YEARS, strict=True):
        method = uq.METHODS[name]
        assert (method.name, method.year) == (name, year)
        assert method.structure in ("separated", "simultaneous")
        assert method.form in ("closed form", "iterative", "convex program")
        assert method.doi.startswith("10.") and method.doi in method.reference and str(year) in method.reference
        assert method.minimises and method.singular and method.authors and method.title
    assert {name for name in NAMES if uq.METHODS[name].extra} == {"heller"}


@pytest.mark.slow
def test_exact_motions(method, rng):
    """200 random problems, 1 to 179 degrees: 1e-9, or 1e-6 where a program or an iteration ends at a tolerance."""
    count = 40 if method.name in SLOW else 200
    problems = [exact_motions(rng, 5, smallest=np.radians(1), largest=np.radians(179)) for _ in range(count)]
    X, A, B = (np.stack(parts) for parts in zip(*problems, strict=True))
    estimate = method.estimate(A, B)
    assert estimate.converged.shape == (count,) and estimate.converged.all()
    assert np.abs(difference(estimate.X, X)).max() < (1e-9 if method.form == "closed form" else 1e-6)


@pytest.mark.parametrize(("smallest", "largest"), [(1, 2), (60, 90), (170, 179.9)])
def test_exact_motions_within_narrow_angles(method, rng, smallest, largest):
    X, A, B = exact_motions(rng, 8, smallest=np.radians(smallest), largest=np.radians(largest))
    assert np.abs(difference(method(A, B), X)).max() < (1e-9 if method.form == "closed form" else 1e-6)


@pytest.mark.parametrize("angle", [*np.logspace(-3, 0, 7), *(np.pi - np.logspace(-3, -1, 3))])
def test_a_sweep_of_angles(angle, rng):
    """Every closed form at one angle for all motions, from 1 mrad to 1 mrad below a half turn."""
    X, A, B = exact_motions(rng, 10, smallest=angle, largest=angle)
    for name in CLOSED:
        error = np.abs(difference(uq.solve(A, B, method=name), X)).max()
        assert error < max(1e-11, 3e-14 / min(angle, np.pi - angle, 1.0) ** 2), name


@pytest.mark.slow
def test_leading_axes(method, rng):
    _, A, B = noisy_motions(rng, 6, 1e-3, (2, 3))
    X = method(A, B)
    assert X.shape == (2, 3, 4, 4)
    for k in np.ndindex(2, 3):
        assert np.abs(difference(method(A[k], B[k]), X[k])).max() < (1e-10 if method.form == "closed form" else 1e-7)
    np.testing.assert_allclose(X[..., :3, :3] @ X[..., :3, :3].mT, np.broadcast_to(np.eye(3), (2, 3, 3, 3)), atol=1e-12)


@pytest.mark.slow
def test_blocks_of_many_pairs_give_the_same_sums(rng):
    X, A, B = noisy_motions(rng, 20_000, 1e-3)
    some = (
        np.stack([A[:5000], A[5000:10_000], A[10_000:15_000]]),
        np.stack([B[:5000], B[5000:10_000], B[10_000:15_000]]),
    )
    for name in ("tsai", "shiu", "andreff", "lu"):
        whole = uq.solve(A, B, method=name)
        assert np.abs(difference(whole, X)).max() < 1e-3
        # twice the same data weigh like once
        np.testing.assert_allclose(
            uq.solve(np.tile(A, (2, 1, 1)), np.tile(B, (2, 1, 1)), method=name), whole, atol=1e-12
        )
        parts = uq.solve(*some, method=name)
        for k in range(3):
            np.testing.assert_allclose(uq.solve(some[0][k], some[1][k], method=name), parts[k], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("axis", [None, [1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]], ids=["any", "x", "y", "z"])
def test_motions_about_one_axis_are_refused(method, rng, axis, angle):
    """Parallel axes, also those of a SCARA robot, and no rotation at all."""
    X = random_transforms(rng)
    axis = rotation_vectors(rng, (), 1.0, 1.0) if axis is None else X[:3, :3].T @ axis
    R = rotations(axis * (angle * rng.uniform(0.5, 1.5, (6, 1))))
    B = transforms(R, rng.normal(size=(6, 3)))
    with pytest.raises(uq.DegenerateMotionError) as caught:
        method(X @ B @ np.linalg.inv(X), B)
    assert caught.value.directions.shape[1] == 6 and len(caught.value.directions) >= 2


def test_the_problem_that_fails_in_a_batch_is_named(rng):
    X, A, B = exact_motions(rng, 4, (3,))
    B[1] = transforms(rotations(np.array([0, 0, 1.0]) * rng.uniform(0.5, 1, (4, 1))), rng.normal(size=(4, 3)))
    A[1] = X @ B[1] @ np.linalg.inv(X)
    with pytest.raises(uq.DegenerateMotionError, match="parallel"):
        uq.solve(A, B, method="park")


@pytest.mark.parametrize("away", [0.0, 1e-5])
def test_tsai_refuses_an_X_of_half_a_turn(rng, away):
    axis = rotation_vectors(rng, (), 1.0, 1.0)
    X = transforms(rotations((np.pi - away) * axis), rng.normal(size=3))
    B = random_transforms(rng, (6,))
    A = X @ B @ np.linalg.inv(X)
    with pytest.raises(uq.DegenerateMotionError, match="'tsai' finds no unique X: X rotates by 180 degrees"):
        uq.solve(A, B, method="tsai")
    for name in CLOSED:
        if name != "tsai":
            assert np.abs(difference(uq.solve(A, B, method=name), X)).max() < 1e-9, name


def test_shiu_needs_an_axis_of_every_motion(rng):
    X, A, B = exact_motions(rng, 5)
    A[2, :3, :3] = B[2, :3, :3] = np.eye(3)
    A[2, :3, 3] = X[:3, :3] @ B[2, :3, 3]
    with pytest.raises(uq.DegenerateMotionError, match="a motion in `A` does not rotate"):
        uq.solve(A, B, method="shiu")
    for name in CLOSED:
        if name != "shiu":
            assert np.abs(difference(uq.solve(A, B, method=name), X)).max() < 1e-9, name


@pytest.mark.slow
def test_translations_of_zero(method, rng):
    """A camera in the wrist's centre: only andreff needs translations, to fix the scale of its matrix."""
    X, A, B = exact_motions(rng, 6)
    A[:, :3, 3] = 0.0
    for truth in (X, np.block([[X[:3, :3], np.zeros((3, 1))], [0, 0, 0, 1]])):
        B = np.linalg.inv(truth) @ A @ truth
        if method.name == "andreff":
            with pytest.raises(uq.DegenerateMotionError, match="'andreff' finds no unique X"):
                method(A, B)
        else:
            assert np.abs(difference(method(A, B), truth)).max() < 1e-9


def test_andreff_refuses_a_matrix_that_noise_has_shrunk(rng):
    X, A, B = exact_motions(rng, 20)
    A[:, :3, 3] = 0.0
    B = np.linalg.inv(X) @ A @ X
    a, b = (moved(T, 1e-2 * rng.normal(size=(20, 6)) * [1, 1, 1, 1e-3, 1e-3, 1e-3]) for T in (A, B))
    with pytest.raises(uq.DegenerateMotionError, match="too small against the noise"):
        uq.solve(a, b, method="andreff")


def test_an_empty_batch_is_no_problem_to_solve(method, rng):
    _, A, B = exact_motions(rng, 5, (2,))
    with pytest.raises(uq.InputError, match="at least one problem"):
        method(A[:0], B[:0])


def test_half_turns_alone_leave_the_signs_of_axes_open(rng):
    X, A, B = exact_motions(rng, 6, smallest=np.pi, largest=np.pi)
    for name in ("tsai", "shiu", "chou", "park", "horaud", "daniilidis", "lu", "condurache", "4dpa"):
        with pytest.raises(uq.DegenerateMotionError, match="180 degrees"):
            uq.solve(A, B, method=name)
    assert np.abs(difference(uq.solve(A, B, method="andreff"), X)).max() < 1e-9
    assert np.abs(difference(uq.solve(A, B, method="gwak"), X)).max() < 1e-9


@pytest.mark.filterwarnings("ignore:The covariance of method 'zhao'")  # which has few data here
@pytest.mark.parametrize("name", ["park", "heller", "zhao"])
def test_half_turns_alone_with_an_X_given_are_refused_too(name, rng):
    X, A, B = exact_motions(rng, 6, smallest=np.pi, largest=np.pi)
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    with pytest.raises(uq.DegenerateMotionError, match="180 degrees"):
        uq.propagate(A, B, noise, X=X, method=name)


@pytest.mark.slow
def test_axes_near_half_turns_keep_their_sign(rng):
    """Noise moves motions across 180 degrees: without the reference some axis of A or B would flip alone."""
    X, A, B = exact_motions(rng, 12)
    B[:6] = random_transforms(rng, (6,), np.pi, np.pi)
    A[:6] = X @ B[:6] @ np.linalg.inv(X)
    a, b = (moved(T, 1e-3 * rng.normal(size=(500, 12, 6))) for T in (A, B))
    q_A, q_B = quaternions(a, b, axis_signs(a, b))
    alpha, beta = from_quaternions(q_A), from_quaternions(q_B)
    assert np.abs(alpha - np.einsum("ij,tnj->tni", X[:3, :3], beta)).max() < 0.02
    naive = quaternions(a, b, None)
    assert (
        np.abs(from_quaternions(naive[0]) - np.einsum("ij,tnj->tni", X[:3, :3], from_quaternions(naive[1]))).max() > 4
    )
    for name in CLOSED:
        assert np.abs(difference(uq.solve(a, b, method=name), X)).max() < 0.01, name


def test_chou_and_horaud_are_one_estimator(rng):
    """Two derivations of sum |a - R b|^2 over the vector parts of unit quaternions."""
    _, A, B = noisy_motions(rng, 30, 0.05, (20,))
    np.testing.assert_allclose(uq.solve(A, B, method="chou"), uq.solve(A, B, method="horaud"), atol=1e-12)


def test_gwak_minimises_the_error_metric(rng):
    from scipy.optimize import minimize

    _, A, B = noisy_motions(rng, 12, 0.05)
    X = uq.solve(A, B, method="gwak")

    def cost(xi):
        T = moved(X, xi)
        return float(np.sum((A @ T - T @ B) ** 2))

    found = minimize(cost, 1e-2 * rng.normal(size=6), tol=1e-12)
    assert np.abs(found.x).max() < 1e-6 and cost(np.zeros(6)) <= found.fun + 1e-12
    for name in CLOSED:  # nobody does better in its own measure
        assert cost(np.zeros(6)) <= cost(difference(uq.solve(A, B, method=name), X)) + 1e-12


def test_an_iteration_that_does_not_end_is_flagged(rng, monkeypatch):
    from uq_handeye.methods import gwak

    monkeypatch.setattr(gwak, "MAX_STEPS", 1)
    _, A, B = noisy_motions(rng, 6, 0.05, (3,))
    estimate = uq.METHODS["gwak"].estimate(A, B)
    assert not estimate.converged.any() and estimate.X.shape == (3, 4, 4)
    with pytest.raises(uq.NotConvergedError, match="'gwak' did not converge on 3 of 3 problems") as caught:
        uq.solve(A, B, method="gwak")
    np.testing.assert_array_equal(caught.value.partial.X, estimate.X)
    # what looks wrong with the data may well be the reason, and is said
    with pytest.raises(uq.NotConvergedError), pytest.warns(uq.InputWarning, match="disagree on the rotation angles"):
        uq.calibrate(uq.Motions(A[0], B[0]), method="gwak")


# ------------------------------------------------------------------------------------------------ its covariance


def brute_force(name, A, B, noise, step):
    """J Sigma J^T by central differences of the whole estimator on all 12 N inputs."""
    N, X = len(A), uq.solve(A, B, method=name)
    weights = noise if uq.METHODS[name].weighted else None

    def of(xi):
        xi = xi.reshape(-1, 2, N, 6)
        return difference(uq.METHODS[name].estimate(moved(A, xi[:, 0]), moved(B, xi[:, 1]), weights).X, X)

    J = jacobian(of, 12 * N, step).reshape(6, 2, N, 6)
    return sum(np.einsum("anj,jk,bnk->ab", J[:, k], S, J[:, k]) for k, S in enumerate((noise.A, noise.B)))


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
def test_the_covariance_is_that_of_brute_force(name, rng):
    """On exact data; on noisy data too for all that do not take their weights from a linearisation."""
    if name == "heller":
        pytest.importorskip("cvxpy")
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, A, B = exact_motions(rng, 5)
    assert_same_covariance(uq.propagate(A, B, noise, method=name), brute_force(name, A, B, noise, 1e-4), 1e-5)
    if name not in ("nguyen", "heller"):
        _, A, B = noisy_motions(rng, 5, 0.03)
        assert_same_covariance(uq.propagate(A, B, noise, method=name), brute_force(name, A, B, noise, 1e-4), 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", CLOSED)
@pytest.mark.parametrize("angles", [(0.01, 0.03), (3.0, np.pi)])
def test_the_covariance_at_extreme_angles(name, angles, rng):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, A, B = exact_motions(rng, 6, smallest=angles[0], largest=angles[1])
    step = 1e-3 * min(angles[0], np.pi - angles[1] + 0.1)
    assert_same_covariance(uq.propagate(A, B, noise, method=name), brute_force(name, A, B, noise, step), 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in SMOOTH if name != "condurache"])
def test_the_covariance_at_exact_half_turns_of_a_programmed_robot(name, rng):
    """Right where the canonical quaternion of A changes its sign, with a camera that is noisy.

    Rotation vectors pass there from ``angle axis`` to ``(angle - 360 degrees) axis``, and the weight of the pair jumps
    by as much as A and B disagree: X by the square of that, which the steps must outweigh. That of condurache jumps by
    the first power, as its `singular` says.
    """
    if name == "heller":
        pytest.importorskip("cvxpy")
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    X, A, B = exact_motions(rng, 6)
    A[0, :3, :3], A[1, :3, :3], A[2, :3, :3] = np.diag([-1, -1, 1]), np.diag([1, -1, -1]), np.diag([-1, 1, -1])
    B = moved(np.linalg.inv(X) @ A @ X, 1e-4 * rng.normal(size=(6, 6)))
    assert_same_covariance(uq.propagate(A, B, noise, method=name), brute_force(name, A, B, noise, 1e-3), 0.01)


@pytest.mark.parametrize("N", [3, 4, 8])
def test_the_covariance_of_an_ill_conditioned_least_squares(N, rng):
    """andreff in mm: squared lengths outweigh the rotation equations by 1e6, and any step would be too long."""
    unit = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    S = random_covariance(rng) * np.outer(unit, unit)
    _, A, B = exact_motions(rng, N, smallest=0.1, largest=0.3)
    for T in (A, B):
        T[:, :3, 3] *= 1e3
    X = uq.solve(A, B, method="andreff")

    def of(xi):
        return difference(uq.solve(moved(A, xi.reshape(-1, N, 6) * unit), B, method="andreff"), X)

    J = jacobian(of, 6 * N, 1e-5).reshape(6, N, 6) / unit
    expected = np.einsum("anj,jk,bnk->ab", J, S, J)
    assert_same_covariance(uq.propagate(A, B, uq.PairNoise(A=S), method="andreff"), expected, 1e-3)


def test_zhao_compares_pairs_that_share_a_pose_alone(rng, monkeypatch):
    """Equal to comparing every two residuals, to the tolerance of its fixed point; pairs made twice are compared so."""
    _, robot, camera = exact_poses(rng, 12)
    poses = uq.PosePairs(robot, camera)
    noise = uq.PoseNoise(random_covariance(rng, shape=(12,)), random_covariance(rng))
    for pairs in ("all", "consecutive", [[0, 1], [2, 1], [3, 1], [4, 5], [6, 5], [7, 5], [8, 9], [10, 11], [11, 3]]):
        motions = uq.relative_motions(poses, pairs)
        found = uq.propagate(motions, noise, method="zhao")
        with monkeypatch.context() as patch:
            patch.setattr("uq_handeye.methods.noise_transport.Shared.twice", True)
            assert_same_covariance(found, uq.propagate(motions, noise, method="zhao"), 1e-6)
    again = np.concatenate([uq.relative_motions(poses, "all").pairs, [[1, 0]]])
    assert np.isfinite(uq.propagate(uq.relative_motions(poses, again), noise, method="zhao")).all()


def test_zhao_warns_where_data_are_few(rng):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, A, B = exact_motions(rng, 5)
    with pytest.warns(uq.InputWarning, match="With 5 pairs it may be wrong"):
        uq.propagate(A, B, noise, method="zhao")
    _, robot, camera = exact_poses(rng, 6)
    motions = uq.relative_motions(uq.PosePairs(robot, camera), "all")
    with pytest.warns(uq.InputWarning, match="With 6 poses it may be wrong"):
        uq.propagate(motions, uq.PoseNoise(camera=random_covariance(rng)), method="zhao")


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("name", ["tsai", "daniilidis", "andreff", "gwak", "condurache", "nguyen"])
def test_the_pose_aware_covariance_is_that_of_brute_force(name, setup, rng):
    n = 5
    _, robot, camera = exact_poses(rng, n, setup)
    poses = uq.PosePairs(robot, camera, setup)
    motions = uq.relative_motions(poses, "all")
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng))
    method = uq.METHODS[name]
    weights = noise_of_pairs(motions, noise) if method.weighted else None
    X = uq.solve(motions.A, motions.B, method=name)

    def of(xi):
        xi = xi.reshape(-1, 2, n, 6)
        moved_motions = uq.relative_motions(uq.PosePairs(moved(robot, xi[:, 0]), moved(camera, xi[:, 1]), setup), "all")
        return difference(method.estimate(moved_motions.A, moved_motions.B, weights).X, X)

    J = jacobian(of, 12 * n, 1e-4).reshape(6, 2, n, 6)
    expected = sum(np.einsum("anj,jk,bnk->ab", J[:, k], S, J[:, k]) for k, S in enumerate((noise.robot, noise.camera)))
    assert_same_covariance(uq.propagate(motions, noise, method=name), expected, 1e-5)


def test_moments_of_batches_have_covariances_of_their_own(rng):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, A, B = noisy_motions(rng, 6, 0.02, (3,))
    for name in ("park", "lu"):
        together = uq.propagate(A, B, noise, method=name)
        for k in range(3):
            assert_same_covariance(together[k], uq.propagate(A[k], B[k], noise, method=name), 1e-6)


def test_the_X_given_saves_solving_and_changes_nothing(rng, monkeypatch):
    noise = uq.PairNoise(random_covariance(rng), random_covariance(rng))
    _, A, B = noisy_motions(rng, 6, 0.02)
    expected = uq.propagate(A, B, noise, method="gwak")
    X = uq.solve(A, B, method="gwak")
    monkeypatch.setattr(MomentSolver, "estimate", None)
    assert_same_covariance(uq.propagate(A, B, noise, X=X, method="gwak"), expected, 1e-9)


def test_what_belongs_to_4dpa_is_refused_elsewhere(rng):
    _, A, B = exact_motions(rng, 5)
    noise = uq.PairNoise.isotropic(("1mrad", "1mm"))
    with pytest.raises(uq.InputError, match="no `scale` with method 'park'"):
        uq.solve(A, B, method="park", scale=1e4)
    for extra in ({"scale": 1e4}, {"kind": "literal"}):
        with pytest.raises(uq.InputError, match="belong to 4dpa"):
            uq.propagate(A, B, noise, method="park", **extra)
    with pytest.raises(uq.InputError, match="'park' takes no noise model"):
        uq.METHODS["park"].estimate(A, B, noise)
    with pytest.raises(uq.InputError, match=r"calibrate\(\) or ROBOT_WORLD_METHODS\['shah'\]"):
        uq.solve(A, B, method="shah")
    for value in ("PARK", None, 3):
        with pytest.raises(uq.InputError, match="Expected `method` to be one of tsai, shiu"):
            uq.solve(A, B, method=value)


UNIT_FREE = {"tsai", "shiu", "chou", "park", "horaud", "condurache", "nguyen", "4dpa"}


def test_which_methods_depend_on_the_unit_of_length(method, rng):
    """Methods of docs/explanation/methods.md that weight translation against rotation equations as they come."""
    _, A, B = noisy_motions(rng, 10, 0.02)
    in_mm = [T.copy() for T in (A, B)]
    for T in in_mm:
        T[:, :3, 3] *= 1e3
    X = method(*in_mm)
    X[:3, 3] /= 1e3
    change = np.abs(difference(X, method(A, B))).max()
    assert (change < 1e-9) if method.name in UNIT_FREE else (change > 1e-4)
