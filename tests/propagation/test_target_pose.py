"""W = G X C beside X: exact data, derivatives, statistics, and what is not determined."""

import numpy as np
import pytest
from support import (
    assert_same_covariance,
    difference,
    exact_poses,
    is_consistent,
    jacobian,
    moved,
    random_covariance,
)

import uq_handeye as uq
from uq_handeye.methods.noise_transport import noise_of_pairs
from uq_handeye.methods.target_pose import mean_target

NOISE = uq.PoseNoise.isotropic(robot=("0.2mrad", "0.2mm"), camera=("1mrad", "0.5mm"))
ON_POSES = [*uq.ROBOT_WORLD_METHODS]


@pytest.fixture(params=["eye-in-hand", "eye-to-hand"])
def setup(request):
    return request.param


@pytest.mark.slow
@pytest.mark.parametrize("method", ["4dpa", "park", "lu", *ON_POSES])
def test_exact_poses(method, setup):
    poses = uq.simulate(n_poses=8, setup=setup, seed=3)
    result = uq.calibrate(poses, noise=NOISE, method=method)
    np.testing.assert_allclose(result.W, poses.truth.W, atol=1e-11)
    np.testing.assert_allclose(result.X, poses.truth.X, atol=1e-11)
    assert result.frame_W == ("base_T_target" if setup == "eye-in-hand" else "gripper_T_target")
    assert result.std_W.shape == (6,) and "covariance_W" in result.to_dict()
    again = uq.Calibration.from_dict(result.to_dict())
    np.testing.assert_array_equal(again.covariance_W, result.covariance_W)
    assert f"{result.frame_W} (" in result.summary(verbose=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")  # random poses are no usual rig
@pytest.mark.parametrize("joint", [False, True])
@pytest.mark.parametrize("method", ["4dpa", "horaud", *ON_POSES])
def test_the_covariance_of_W_is_that_of_numerical_derivatives(method, setup, joint, rng):
    n = 5
    _, robot, camera = exact_poses(rng, n, setup)
    poses = uq.PosePairs(robot, camera, setup)
    size = 6 * n if joint else 6
    noise = uq.PoseNoise(random_covariance(rng), random_covariance(rng, size))
    result = uq.calibrate(poses, noise=noise, method=method)

    def of(xi):
        found = []
        for x in xi.reshape(-1, 2, n, 6):
            changed = uq.PosePairs(moved(robot, x[0]), moved(camera, x[1]), setup)
            if method in ON_POSES:
                found.append(uq.ROBOT_WORLD_METHODS[method](changed).W)
            else:
                motions = uq.relative_motions(changed, "all")
                found.append(mean_target(changed, uq.solve(motions.A, motions.B, method=method)))
        return difference(np.stack(found), result.W)

    J = jacobian(of, 12 * n, 1e-4).reshape(6, 2, n, 6)
    expected = np.einsum("anj,jk,bnk->ab", J[:, 0], noise.robot, J[:, 0])
    if joint:
        row = J[:, 1].reshape(6, 6 * n)
        expected += row @ noise.camera @ row.T
    else:
        expected += np.einsum("anj,jk,bnk->ab", J[:, 1], noise.camera, J[:, 1])
    assert_same_covariance(result.covariance_W, expected, 1e-5)


@pytest.mark.statistical
@pytest.mark.parametrize("method", ["4dpa", "daniilidis", "nguyen", "zhao", *ON_POSES])
def test_statistics_of_W(method, setup):
    trials, n = (150 if method == "zhao" else 1000), 12
    poses = uq.simulate(n, noise=NOISE, setup=setup, trials=trials, seed=5)
    exact = uq.PosePairs(poses.truth.robot, poses.truth.camera, setup)
    predicted = uq.calibrate(exact, noise=NOISE, method=method)
    if method in ON_POSES:
        X, W = uq.ROBOT_WORLD_METHODS[method](poses)
    else:
        motions = uq.relative_motions(poses, "all")
        weights = noise_of_pairs(uq.relative_motions(exact, "all"), NOISE) if method == "nguyen" else None
        X = uq.METHODS[method].estimate(motions.A, motions.B, weights).X
        W = np.stack([mean_target(uq.PosePairs(poses.robot[k], poses.camera[k], setup), X[k]) for k in range(trials)])
    for estimate, truth, covariance in (
        (X, poses.truth.X, predicted.covariance),
        (W, poses.truth.W, predicted.covariance_W),
    ):
        errors = difference(estimate, truth)
        assert is_consistent(errors, covariance)
        assert not is_consistent(errors, 1.2**2 * covariance)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_what_is_not_determined_is_not_given(rng):
    poses = uq.simulate(n_poses=8, noise=NOISE, seed=1)
    estimated = uq.calibrate(poses, method="4dpa")
    again = uq.calibrate(poses, noise=estimated.noise, method="4dpa")
    np.testing.assert_array_equal(estimated.covariance_W, again.covariance_W)
    for exact in (uq.calibrate(uq.simulate(n_poses=8, seed=1), method=method) for method in (None, "4dpa", "shah")):
        assert exact.W is not None and exact.covariance_W is exact.std_W is None
    assert uq.calibrate(poses, noise=NOISE, kind="pairs").covariance_W is None
    pair_noise = uq.PairNoise.isotropic(A=("1mrad", "1mm"), B=("1mrad", "1mm"))
    motions = uq.relative_motions(poses)
    for method in ("4dpa", "efficient"):
        assert uq.calibrate(poses, noise=pair_noise, method=method).covariance_W is None
        alone = uq.calibrate(uq.Motions(motions.A, motions.B), noise=pair_noise, method=method)
        assert alone.W is None and alone.covariance_W is None and alone.frame_W == "W"


def test_methods_on_poses_say_what_they_need():
    poses = uq.simulate(n_poses=8, noise=NOISE, seed=1)
    motions = uq.relative_motions(poses)
    with pytest.raises(uq.InputError, match="'shah' solves G X C = W: it needs poses"):
        uq.calibrate(uq.Motions(motions.A, motions.B), method="shah")
    with pytest.raises(uq.InputError, match="its covariance needs PoseNoise"):
        uq.calibrate(poses, noise=NOISE, kind="pairs", method="li")
    with pytest.raises(uq.InputError, match="no `scale` with method 'li'"):
        uq.calibrate(poses, method="li", scale=1e4)


@pytest.mark.parametrize("method", ON_POSES)
def test_parallel_axes_are_refused(method, rng):
    from scipy.spatial.transform import Rotation

    robot = np.tile(np.eye(4), (6, 1, 1))
    robot[:, :3, :3] = Rotation.from_rotvec(rng.uniform(0, 2, (6, 1)) * [0, 0, 1]).as_matrix()
    robot[:, :3, 3] = rng.normal(size=(6, 3))
    poses = uq.PosePairs(robot, np.linalg.inv(robot))
    with pytest.raises(uq.DegenerateMotionError, match="parallel"):
        uq.ROBOT_WORLD_METHODS[method](poses)


@pytest.mark.slow
@pytest.mark.parametrize("method", ON_POSES)
def test_few_poses_in_mm(method, rng):
    """An ill-conditioned least squares: exact to 1e-9 of a metre, and so are its derivatives to 1e-4."""
    unit = np.array([1, 1, 1, 1e3, 1e3, 1e3])
    n = 4
    X, robot, camera = exact_poses(rng, n)
    for T in (robot, camera):
        T[:, :3, 3] *= 1e3
    solve = uq.ROBOT_WORLD_METHODS[method]
    found = solve(uq.PosePairs(robot, camera))
    assert np.abs(found.X[:3, 3] - 1e3 * X[:3, 3]).max() < 1e-6
    D = solve.sensitivities(uq.PosePairs(robot, camera))
    for which in (0, 1):

        def of(xi, which=which):
            poses = (uq.PosePairs(moved(robot, x[0]), moved(camera, x[1])) for x in xi.reshape(-1, 2, n, 6) * unit)
            return difference(np.stack([solve(pair)[which] for pair in poses]), found[which])

        J = jacobian(of, 12 * n, 1e-5).reshape(6, 2, n, 6) / unit
        for k in (0, 1):
            np.testing.assert_allclose(J[:, k].swapaxes(0, 1), D[which][k], atol=1e-4 * np.abs(D[which][k]).max())


def test_what_is_no_set_of_poses_is_refused():
    solve = uq.ROBOT_WORLD_METHODS["li"]
    poses = uq.simulate(n_poses=8, seed=1)
    with pytest.raises(uq.InputError, match="`poses` to be PosePairs, got ndarray"):
        solve(poses.robot)
    with pytest.raises(uq.InputError, match="at least 3 poses, got 2"):
        solve(uq.PosePairs(poses.robot[:2], poses.camera[:2]))
    with pytest.raises(uq.InputError, match=r"`method` to be one of .*li, shah, got \['li'\]"):
        uq.calibrate(poses, method=["li"])
