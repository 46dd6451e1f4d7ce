"""All pairs by the moments of the poses against all pairs formed one by one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import difference, jacobian, moved, random_covariance, random_transforms

import uq_handeye as uq
from uq_handeye.methods.all_pairs import AllPairs
from uq_handeye.model.poses.motions import pair_indices, spread_pairs


def noisy(rng, n, setup="eye-in-hand", **options):
    return uq.simulate(
        n, noise=uq.PoseNoise.isotropic(("0.5deg", "2mm"), ("0.5deg", "2mm")), setup=setup, seed=rng, **options
    )


def whitened(covariance, reference):
    L = np.linalg.cholesky(reference)
    return np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, covariance).T))


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("n", [3, 4, 20, 150])
def test_equals_the_pairs_formed(setup, n, rng):
    poses = noisy(rng, n, setup)
    pairs, everything = uq.relative_motions(poses, "all"), AllPairs(poses)
    X = uq.solve(pairs.A, pairs.B)
    assert everything.n_pairs == pairs.N
    np.testing.assert_allclose(everything.solve(), X, atol=1e-13)
    for noise in (
        uq.PoseNoise(random_covariance(rng), random_covariance(rng)),
        uq.PoseNoise(random_covariance(rng, shape=(n,)), None),
        uq.PoseNoise(None, random_covariance(rng, 6 * n)),
    ):
        expected = uq.propagate(pairs, noise, X=X)
        np.testing.assert_allclose(whitened(everything.propagate(noise, X), expected), 1.0, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("side", ["robot", "camera"])
def test_covariance_by_numerical_derivative(setup, side, rng):
    poses = noisy(rng, 5, setup)
    S = random_covariance(rng, 30)
    X = AllPairs(poses).solve()

    def estimates(xi):
        changed = moved(getattr(poses, side), xi.reshape(-1, 5, 6))
        parts = {"robot": poses.robot, "camera": poses.camera}
        return np.array(
            [difference(AllPairs(uq.PosePairs(**(parts | {side: T}), setup=setup)).solve(), X) for T in changed]
        )

    J = jacobian(estimates, 30)
    np.testing.assert_allclose(
        whitened(AllPairs(poses).propagate(uq.PoseNoise(**{side: S}), X), J @ S @ J.T), 1, atol=1e-6
    )


def test_far_from_the_origin(rng):
    """A base or a target frame a kilometre away costs no digits: pairs do not see it."""
    poses = noisy(rng, 30)
    shift, noise = np.eye(4), uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))
    shift[:3, 3] = [1000.0, -2000.0, 500.0]
    moved_base = uq.PosePairs(shift @ poses.robot, poses.camera)
    near, far = AllPairs(poses), AllPairs(moved_base)
    np.testing.assert_allclose(far.solve(), near.solve(), atol=1e-11)
    X = near.solve()
    np.testing.assert_allclose(whitened(far.propagate(noise, X), near.propagate(noise, X)), 1, atol=1e-9)


@pytest.mark.filterwarnings("ignore:The target is ahead")  # poses anywhere
def test_small_rotations_are_left_to_the_pairs(rng):
    for angle, precise in ((0.3, True), (0.001, False)):
        robot = random_transforms(rng, (10,), smallest=0.1 * angle, largest=angle)
        X, W = random_transforms(rng), random_transforms(rng)
        poses = uq.PosePairs(robot, np.linalg.inv(robot @ X) @ W)
        assert AllPairs(poses).precise == precise
        if not precise:
            with pytest.warns(uq.InputWarning, match="amplifies the noise"):
                result = uq.calibrate(poses, method="4dpa")
            np.testing.assert_allclose(result.X, X, atol=1e-8)
        else:
            np.testing.assert_allclose(uq.calibrate(poses, method="4dpa").X, X, atol=1e-11)


def test_degenerate_poses(rng):
    robot = np.tile(np.eye(4), (10, 1, 1))
    robot[:, :3, :3] = Rotation.from_rotvec(rng.uniform(-2, 2, (10, 1)) * [0.6, 0, 0.8]).as_matrix()
    robot[:, :3, 3] = rng.normal(size=(10, 3))
    X = random_transforms(rng)
    with pytest.raises(uq.DegenerateMotionError, match=r"\(0.600, 0.000, 0.800\)"):
        AllPairs(uq.PosePairs(robot, np.linalg.inv(robot @ X))).solve()


@pytest.mark.parametrize("n", [3, 10, 100, 700, 5000])
def test_spread_pairs(n):
    pairs = spread_pairs(n, 3000)
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert pairs.max() == n - 1
    if n * (n - 1) // 2 <= 3000:
        np.testing.assert_array_equal(pairs, pair_indices(n, "all"))
    else:
        assert 2000 < len(pairs) < max(4000, 2 * n)
        assert (pairs[:, 1] - pairs[:, 0]).max() == n - 1


@pytest.mark.slow
def test_many_poses_are_diagnosed_on_some_pairs():
    noise = uq.PoseNoise.isotropic(camera=("0.1deg", "0.5mm"))
    result = uq.calibrate(uq.simulate(1000, noise=noise, seed=1), noise=noise, method="4dpa")
    assert result.n_pairs == 499_500
    assert result.residuals.pairs < 250_000
    assert f"over {result.residuals.pairs:,} of the 499,500 pairs" in result.summary(verbose=True)
    assert np.degrees(result.residuals.rotation_rms) == pytest.approx(0.1 * np.sqrt(6), rel=0.05)


def test_counts_of_covariances():
    poses = uq.simulate(5, seed=0)
    with pytest.raises(uq.InputError, match="`camera` to cover 5 poses, got 4"):
        uq.calibrate(poses, noise=uq.PoseNoise(camera=np.tile(np.eye(6), (4, 1, 1))))
