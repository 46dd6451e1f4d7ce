"""The simulator: geometry, noise and truth are what was asked for."""

import numpy as np
import pytest
from support import difference, random_covariance, random_transforms

import uq_handeye as uq


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_truth_closes_the_loop(setup, rng):
    X, W = random_transforms(rng), random_transforms(rng)
    poses = uq.simulate(12, setup=setup, X=X, W=W, seed=3)
    loop = poses.effective_robot @ X @ poses.camera
    np.testing.assert_allclose(loop, np.broadcast_to(W, loop.shape), atol=1e-12)
    np.testing.assert_array_equal(poses.truth.X, X)
    np.testing.assert_array_equal(poses.truth.robot, poses.robot)


def test_workspace():
    poses = uq.simulate(500, distance=("300mm", 0.9), tilt="40deg", roll=0.5, seed=1)
    target = poses.camera[:, :3, 3]
    assert (target[:, 2] > 0).all()  # in front of the camera
    target_T_camera = np.linalg.inv(poses.camera)
    sight = target_T_camera[:, :3, 2]
    tilt = np.degrees(np.arccos(-sight[:, 2]))
    assert 38 < tilt.max() <= 40
    depth = target[:, 2]
    assert 0.25 < depth.min() < 0.45
    assert 0.7 < depth.max() < 1.0
    turned = uq.relative_motions(poses, "all")
    assert np.degrees(np.arccos((np.trace(turned.A[:, :3, :3], axis1=1, axis2=2).min() - 1) / 2)) > 60


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["one", "each", "joint"])
def test_noise_has_the_covariance_given(kind, rng):
    n, trials = 3, 40_000
    S = random_covariance(rng, 6 * n if kind == "joint" else 6, shape=(n,) if kind == "each" else ())
    poses = uq.simulate(n, noise=uq.PoseNoise(camera=S), trials=trials, seed=5)
    assert poses.robot.shape == poses.camera.shape == (trials, n, 4, 4)
    np.testing.assert_array_equal(poses.robot[7], poses.truth.robot)
    xi = difference(poses.camera, np.broadcast_to(poses.truth.camera, poses.camera.shape)).reshape(trials, 6 * n)
    sampled = xi.T @ xi / trials
    expected = S if kind == "joint" else np.zeros((6 * n, 6 * n))
    if kind != "joint":
        for k in range(n):
            expected[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = S if kind == "one" else S[k]
    L = np.linalg.cholesky(expected)
    eigenvalues = np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, sampled).T))
    # Marchenko-Pastur edge of 18 variances estimated from 40,000 samples, with room for chance
    edge = 2.2 * np.sqrt(6 * n / trials)
    assert np.abs(eigenvalues - 1).max() < edge
    wrong = np.linalg.eigvalsh(np.linalg.solve(L, np.linalg.solve(L, 1.1**2 * sampled).T))
    assert np.abs(wrong - 1).max() > edge


def test_seed():
    noise = uq.PoseNoise.isotropic(robot=("1mrad", "1mm"))
    first, again, other = (uq.simulate(4, noise=noise, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.robot, again.robot)
    assert np.abs(first.robot - other.robot).max() > 0.01


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"n_poses": 0}, "`n_poses`"),
        ({"n_poses": 2.5}, "`n_poses` to be an integer of at least 1, got 2.5"),
        ({"n_poses": True}, "`n_poses`"),
        ({"n_poses": None}, "`n_poses`"),
        ({"trials": 0}, "`trials`"),
        ({"trials": 2.5}, "`trials` to be an integer"),
        ({"seed": 1.5}, "`seed` to be what"),
        ({"seed": -1}, "`seed`"),
        ({"noise": "1mm"}, "`noise` to be PoseNoise or None, got str"),
        ({"distance": 0.5}, "`distance` to be .nearest, farthest., got 0.5"),
        ({"distance": (0.4, 0.5, 0.6)}, "`distance`"),
        ({"setup": "eye"}, "`setup`"),
        ({"distance": ("0.8m", "0.4m")}, "`distance`"),
        ({"distance": ("0.8deg", "0.4m")}, "Unknown unit 'deg'"),
        ({"tilt": "200deg"}, "`tilt`"),
        ({"noise": uq.PoseNoise(camera=np.tile(np.eye(6), (5, 1, 1)))}, "camera"),
        ({"X": np.ones((4, 4))}, "`X`"),
    ],
)
def test_bad_arguments(options, message):
    with pytest.raises(uq.InputError, match=message):
        uq.simulate(**({"n_poses": 3} | options))
