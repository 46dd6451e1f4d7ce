"""Robots that pivot about a point, only translate, or rotate about one axis."""

import numpy as np
import pytest
from fixtures.rigs import quietly
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.core.geometry.se3 import inverse


def _poses(rotations, places):
    T = np.zeros((len(places), 4, 4))
    T[:, :3, :3], T[:, :3, 3], T[:, 3, 3] = Rotation.from_rotvec(rotations).as_matrix(), places, 1.0
    return T


def _with_noise(rng, T, turn, move):
    n = len(T)
    return T @ _poses(rng.normal(0.0, turn, (n, 3)), rng.normal(0.0, move, (n, 3)))


def _rig(seed, rotations, places, setup):
    """Robot and camera poses with noise, X and W, of a robot with these rotations (n, 3) and places (n, 3)."""
    rng = np.random.default_rng(seed)
    X, W = (_poses(rng.normal(0.0, 0.8, (1, 3)), rng.normal(0.0, 0.4, (1, 3)))[0] for _ in range(2))
    G = _poses(rotations, places)
    C = inverse(X) @ inverse(G if setup == "eye-in-hand" else inverse(G)) @ W
    robot = G if not np.ptp(rotations, axis=0).any() else _with_noise(rng, G, 3e-4, 0.0)
    return uq.PosePairs(robot, _with_noise(rng, C, 8e-4, 3e-4), setup), X, W


@pytest.mark.slow
def test_a_pivot_is_as_sharp_as_its_poses():
    d2 = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        poses, X, _ = _rig(seed, rng.normal(0.0, 0.4, (22, 3)), np.zeros((22, 3)), "eye-in-hand")
        result = quietly(poses)
        error = np.r_[Rotation.from_matrix(result.X[:3, :3] @ X[:3, :3].T).as_rotvec(), result.X[:3, 3] - X[:3, 3]]
        error[3:] = error[3:] - np.cross(error[:3], X[:3, 3])
        d2.append(error @ np.linalg.solve(result.covariance, error))
        assert result.weakest_translation[1] < 2e-3 and result.weakest_rotation[1] < np.radians(0.1)
    assert np.mean(d2) < 14.0


@pytest.mark.slow
def test_a_gantry_takes_what_is_known_of_its_target_and_is_told_to():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        poses, X, W = _rig(seed, np.zeros((20, 3)), rng.uniform(-0.3, 0.3, (20, 3)), "eye-to-hand")
        result = quietly(poses)
        assert len(result.open_directions) == 3 and "--known" in next_step(result)
        unsure = np.diag([1e2, 1e2, 1e2, 1e-6, 1e-6, 1e-6])
        result = quietly(poses, prior_W=(W, unsure))
        assert len(result.open_directions) == 0
        assert np.linalg.norm(result.X[:3, 3] - X[:3, 3]) < 5e-3
        turn = Rotation.from_matrix(result.X[:3, :3].T @ X[:3, :3]).as_rotvec()
        assert np.linalg.norm(turn) < np.radians(0.3)


def test_published_methods_say_what_one_axis_leaves_open():
    rng = np.random.default_rng(2)
    about = np.outer(rng.uniform(-1.2, 1.2, 16), [0.0, 0.0, 1.0])
    poses, _, _ = _rig(2, about, rng.uniform(-0.3, 0.3, (16, 3)), "eye-in-hand")
    for method in ("tsai", "park", "li"):
        with pytest.raises(uq.DegenerateMotionError, match=r"rotation ax[ie]s") as refused:
            quietly(poses, method=method)
        assert not any(one.code == "input_checks.poses_unexplained" for one in refused.value.findings)
