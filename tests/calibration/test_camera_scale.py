"""Camera poses of visual odometry and structure from motion: an unknown scale, and errors that walk."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.fit.graph.scale_start import start_scale

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.1deg", "0.5mm"))


def _scaled(poses: uq.PosePairs, scale: float) -> uq.PosePairs:
    camera = poses.camera.copy()
    camera[:, :3, 3] *= scale
    return uq.PosePairs(poses.robot, camera, poses.setup)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_start_does_not_mind_wrong_rows(setup: str) -> None:
    poses = uq.simulate(25, noise=NOISE, seed=3, setup=setup)
    camera = poses.camera.copy()
    camera[:8, :3, :3] = camera[:8, :3, :3] @ Rotation.random(8, rng=0).as_matrix()
    camera[:, :3, 3] *= 0.08
    assert start_scale(poses.effective_robot, camera) == pytest.approx(1 / 0.08, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["unknown", "declared"])
@pytest.mark.parametrize("scale", [0.0837, 12.0])
def test_an_unknown_scale_is_one_more_unknown(scale: float, how: str, tmp_path: Path) -> None:
    poses = uq.simulate(30, noise=NOISE, seed=4)
    assert poses.truth is not None
    asked = {"camera_scale": "unknown"} if how == "unknown" else {"shared": [uq.SharedError.target_scale("300%")]}
    result = uq.calibrate(_scaled(poses, scale), **asked)
    assert result.usable and result.camera_scale is not None and result.covariance is not None
    found = result.camera_scale
    assert abs(found.units_per_m / scale - 1.0) < 4.0 * found.std / found.factor < 0.02
    assert np.linalg.norm(result.X[:3, 3] - poses.truth.X[:3, 3]) < 4.0 * np.sqrt(np.trace(result.covariance[3:, 3:]))
    assert "have a scale of their own" in " ".join(map(str, result.findings))
    again = uq.load(result.save(tmp_path / "result.json"))
    assert isinstance(again, uq.Calibration) and again.camera_scale == found


def test_poses_without_noise_have_an_exact_scale() -> None:
    poses = uq.simulate(8, noise=NOISE, seed=2)
    assert poses.truth is not None
    camera = inverse(poses.truth.X) @ inverse(poses.robot) @ poses.truth.W
    result = uq.calibrate(_scaled(uq.PosePairs(poses.robot, camera), 0.27), camera_scale="unknown")
    assert result.camera_scale is not None and result.camera_scale.std == 0.0
    assert result.camera_scale.units_per_m == pytest.approx(0.27, rel=1e-9)
    np.testing.assert_allclose(result.X, poses.truth.X, atol=1e-9)


@pytest.mark.slow
def test_an_inverse_file_of_unknown_scale_is_named() -> None:
    poses = uq.simulate(30, noise=NOISE, seed=4)
    turned = _scaled(uq.PosePairs(poses.robot, inverse(poses.camera), poses.setup), 0.2)
    try:
        with pytest.warns(uq.InputWarning):
            findings = uq.calibrate(turned, camera_scale="unknown").findings
    except uq.NotConvergedError as error:  # by rounding either
        findings = error.findings
    (finding,) = [one for one in findings if one.code == "input_checks.poses_unexplained"]
    assert any(reading["kind"] == "inverse camera" for reading in finding.values["readings"])


def test_a_scale_that_is_known_is_not_unknown() -> None:
    poses = uq.simulate(10, noise=NOISE, seed=4)
    with pytest.raises(uq.InputError, match="--camera-scale"):
        uq.calibrate(poses, noise=NOISE, camera_scale="unknown")
    with pytest.raises(uq.InputError, match="camera_scale"):
        uq.calibrate(poses, camera_scale="known")


def _walked(n: int, seed: int, turn: float, shift: float) -> tuple[uq.PosePairs, NDArray[np.float64]]:
    """Poses of odometry with errors (rad, m) at each step, and the true X."""
    poses = uq.simulate(n, noise=uq.PoseNoise.isotropic(robot=("0.01deg", "0.1mm")), seed=seed)
    assert poses.truth is not None
    order = np.argsort(np.linalg.norm(poses.robot[:, :3, 3] - poses.robot[0, :3, 3], axis=-1))
    rng = np.random.default_rng(seed)
    true, walk = inverse(poses.truth.camera[order]), np.eye(4)
    camera = np.empty_like(true)
    camera[0] = true[0]
    for k in range(1, n):
        walk = np.eye(4)
        walk[:3, :3] = Rotation.from_rotvec(rng.normal(0.0, turn, 3)).as_matrix()
        walk[:3, 3] = rng.normal(0.0, shift, 3)
        camera[k] = camera[k - 1] @ inverse(true[k - 1]) @ true[k] @ walk
    return uq.PosePairs(poses.robot[order], inverse(camera), poses.setup), poses.truth.X


@pytest.mark.statistical
def test_a_random_walk_of_odometry_is_found_and_covered() -> None:
    d2 = []
    for seed in range(3):
        poses, X = _walked(60, seed, 1e-3, 5e-4)
        result = uq.calibrate(poses)
        assert result.covariance is not None
        assert any("random walk" in str(one.key) for one in result.shared), seed
        turn = Rotation.from_matrix(X[:3, :3] @ result.X[:3, :3].T).as_rotvec()
        xi = np.r_[turn, X[:3, 3] - result.X[:3, 3]]
        d2.append(float(xi @ np.linalg.solve(result.covariance, xi)))
    assert max(d2) < 16.8 and np.mean(d2) > 0.7, d2  # 99 % of chi-square(6)


@pytest.mark.statistical
def test_a_scale_that_walks_is_found_and_covered() -> None:
    """A walk of the scale that the residuals of rotations do not show: X without it is up to 100 d^2 off."""
    d2 = []
    for seed in range(4):
        poses = uq.simulate(
            150, noise=uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.1deg", "0.5mm")), seed=seed
        )
        assert poses.truth is not None
        order = np.argsort(poses.robot[:, 0, 3])
        camera = poses.camera[order].copy()
        walk = np.cumsum(np.random.default_rng(seed).normal(0.0, 2e-3, len(camera)))
        camera[:, :3, 3] *= 0.5 * np.exp(walk)[:, None]
        result = uq.calibrate(uq.PosePairs(poses.robot[order], camera), camera_scale="unknown")
        assert result.usable and result.covariance is not None
        assert any("walk" in str(one.key) for one in result.shared), seed
        turn = Rotation.from_matrix(poses.truth.X[:3, :3] @ result.X[:3, :3].T).as_rotvec()
        xi = np.r_[turn, poses.truth.X[:3, 3] - result.X[:3, 3]]
        d2.append(float(xi @ np.linalg.solve(result.covariance, xi)))
    assert max(d2) < 22.5 and np.mean(d2) > 0.7, d2  # 99.9 % of chi-square(6)


def test_there_is_no_walk_without_one() -> None:
    poses = _scaled(uq.simulate(40, noise=NOISE, seed=5), 1.0)
    assert not any("walk" in str(one.key) for one in uq.calibrate(poses).shared)
