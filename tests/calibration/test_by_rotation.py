"""Rotations alone give the rotation of X with its covariance, and leave its translation open."""

import numpy as np
import pytest
from fixtures.rigs import quietly
from scipy.spatial.transform import Rotation

import uq_handeye as uq


def _oriented(seed, n=20, sd=0.0017, setup="eye-in-hand"):
    """Rotations of robot and camera with errors of sd (rad) per axis, without positions, and the true rotation."""
    rng = np.random.default_rng(seed)
    G = Rotation.from_rotvec(rng.normal(0.0, 0.5, (n, 3))).as_matrix()
    X, W = Rotation.random(2, random_state=seed).as_matrix()
    C = X.T @ np.swapaxes(G, 1, 2) @ W if setup == "eye-in-hand" else X.T @ G @ W
    C = C @ Rotation.from_rotvec(rng.normal(0.0, sd, (n, 3))).as_matrix()
    T = np.zeros((2, n, 4, 4))
    T[0, :, :3, :3], T[1, :, :3, :3], T[..., 3, 3] = G, C, 1.0
    return uq.PosePairs(*T, setup), X


def _error(result, X):
    return Rotation.from_matrix(result.X[:3, :3] @ X.T).as_rotvec()


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_rotation_is_known_and_the_translation_open(setup, tmp_path):
    poses, X = _oriented(3, setup=setup)
    result = quietly(poses)
    assert result.answered == "in part" and result.usable is False
    assert result.open_words == ("the positions of camera and target",)
    assert "the rotation is known to" in result.headline
    assert np.degrees(np.linalg.norm(_error(result, X))) < 0.15
    assert "no positions were given" in result.summary()
    again = uq.load(result.save(tmp_path / "result.json"))
    assert np.array_equal(again.X, result.X) and again.headline == result.headline


def test_the_covariance_is_consistent_and_an_outlier_is_left_out():
    d2 = []
    for seed in range(40):
        poses, X = _oriented(seed)
        camera = poses.camera.copy()
        camera[4, :3, :3] = camera[4, :3, :3] @ Rotation.from_rotvec([0.0, 0.0, np.pi]).as_matrix()
        result = quietly(uq.PosePairs(poses.robot, camera))
        (found,) = (one for one in result.findings if one.code == "calibration.rotation_only")
        assert 4 in found.values["left_out"] and len(found.values["left_out"]) <= 2
        error = _error(result, X)
        d2.append(error @ np.linalg.solve(result.covariance[:3, :3], error))
    assert 2.0 < np.mean(d2) < 4.5  # 3 expected, the standard error is 0.4


def test_a_file_without_positions_is_read(tmp_path):
    poses, X = _oriented(5)
    files = []
    for name, T in (("imu", poses.robot), ("camera", poses.camera)):
        rows = np.column_stack([np.arange(poses.n), Rotation.from_matrix(T[:, :3, :3]).as_quat()])
        files.append(tmp_path / f"{name}.csv")
        np.savetxt(files[-1], rows, delimiter=",", header="timestamp,qx,qy,qz,qw", comments="", fmt="%.12f")
    read = uq.read_poses(*files)
    assert np.allclose(read.robot, poses.robot) and "orientations only" in str(read.sources[0].notes)
    assert np.degrees(np.linalg.norm(_error(quietly(read), X))) < 0.15


def test_one_axis_is_refused():
    poses, _ = _oriented(6)
    R = Rotation.from_rotvec(np.outer(np.linspace(0.0, 1.0, 20), [0.0, 0.0, 1.0])).as_matrix()
    robot, camera = poses.robot.copy(), poses.camera.copy()
    robot[:, :3, :3], camera[:, :3, :3] = R, np.swapaxes(R, 1, 2)
    with pytest.raises(uq.DegenerateMotionError, match="rotations"):
        quietly(uq.PosePairs(robot, camera))
