"""X by points: the covariance of the camera poses comes along, in files and results, and is consistent."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from fixtures.point_sets import noisy, pose_errors
from scipy import stats
from support import CONFIDENCE, SEED, rotation_vectors, rotations, transforms

import uq_handeye as uq
from uq_handeye import InputError, InputWarning
from uq_handeye.core.geometry.se3 import inverse, perturb

LATERAL, AXIAL = 1e-4, 5e-4
ROBOT = np.diag([1e-4] * 3 + [5e-5] * 3) ** 2
TRUTH = transforms(rotations(np.array([[0.1, -0.2, 0.3]])), np.array([[0.05, 0.02, 0.1]]))[0]


def cell(rng, n=15):
    """Robot poses (n, 4, 4) and points (n, m, 3) of a camera on the gripper, and the target (m, 3)."""
    p = rng.uniform(-0.1, 0.1, (6, 3))
    t = np.column_stack([rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(0.5, 0.9, n)])
    C = transforms(rotations(rotation_vectors(rng, (n,), 0.1, 0.7)), t)
    W = transforms(rotations(np.array([[1.0, 0.5, 0.3]])), np.array([[0.5, 0.2, 0.1]]))[0]
    G = perturb(W @ inverse(C) @ inverse(TRUTH), rng.normal(size=(n, 6)) * np.sqrt(np.diag(ROBOT)))
    at = np.einsum("nab,mb->nma", C[:, :3, :3], p) + C[:, None, :3, 3]
    return G, noisy(rng, at, LATERAL, AXIAL), p


def mean_d2(noise, trials=20):
    rng = np.random.default_rng(SEED)
    d2 = []
    for _ in range(trials):
        G, y, p = cell(rng)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            seen = uq.poses_from_points(y, p, noise)
            poses = uq.PosePairs(G[seen.rows], seen.poses, camera_covariance=seen.covariance)
            found = uq.efficient(poses, uq.PoseNoise(ROBOT, poses.known_camera))  # as calibrate does
        e = pose_errors(TRUTH[None], found.X[None])[0]
        d2.append(e @ np.linalg.solve(found.covariance_X, e))
    return np.sum(d2), 6 * trials


@pytest.mark.statistical
def test_covariance_of_X_is_consistent():
    total, dof = mean_d2(None)
    low, high = stats.chi2.interval(CONFIDENCE, dof)
    assert low < total < 1.1 * high  # noise from about 100 degrees of freedom


@pytest.mark.statistical
def test_isotropic_noise_assumed_of_a_depth_camera_is_rejected():
    total, dof = mean_d2(LATERAL)
    assert total > 1.3 * stats.chi2.isf(1 - CONFIDENCE, dof)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Folder with robot.csv and seen/; pose 4 has no usable points."""
    folder = tmp_path_factory.mktemp("session")
    G, y, p = cell(np.random.default_rng(SEED + 1))
    y[4, 2:] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        seen = uq.poses_from_points(y, p)
    uq.write_pose_file(folder / "robot.csv", G)
    seen.write(folder / "seen")
    return folder, seen


@pytest.mark.slow
def test_a_folder_takes_the_place_of_the_camera_file(session):
    folder, seen = session
    poses = uq.read_poses(folder / "robot.csv", folder / "seen")
    assert poses.n == 14 and poses.camera_known
    np.testing.assert_array_equal(np.asarray(poses.camera_covariance), np.asarray(seen.covariance))
    np.testing.assert_array_equal(poses.camera, uq.read_poses(folder / "robot.csv", seen).camera)
    assert any("left out: 4" in note for source in poses.sources for note in source.notes)
    found = uq.calibrate(poses)
    assert found.noise_estimate.from_points
    assert "from the measured points" in " ".join(found.noise_estimate.statement)
    again = uq.Calibration.from_dict(found.to_dict())
    np.testing.assert_array_equal(np.asarray(again.data.camera_covariance), np.asarray(seen.covariance))
    assert again.summary() == found.summary()
    np.testing.assert_array_equal(poses.rows(np.arange(3)).camera_covariance.own, seen.covariance.own[:3])


@pytest.mark.slow
def test_points_in_place_of_poses_lead_to_the_command(session):
    folder, _ = session
    with pytest.raises(InputError, match="uq-handeye points -o DIR"):
        uq.read_poses(folder / "robot.csv", folder / "seen" / "points.csv")


def test_poses_numbered_from_1_and_missing_ones(session):
    folder, seen = session
    rows = np.array(seen.points.row) + 1
    shifted = replace(seen, rows=seen.rows + 1, points=uq.PointSet(rows, seen.points.point, seen.points.xyz))
    poses = uq.read_poses(folder / "robot.csv", shifted)
    np.testing.assert_array_equal(poses.robot, uq.read_poses(folder / "robot.csv", seen).robot)
    assert any("numbered from 1" in note for source in poses.sources for note in source.notes)
    points = uq.PointSet(rows + 1, seen.points.point, seen.points.xyz)
    more = replace(shifted, rows=shifted.rows + 1, points=points)
    with pytest.raises(InputError, match="points of pose 16"):
        uq.read_poses(folder / "robot.csv", more)


@pytest.mark.slow
def test_new_points_are_added(session):
    folder, seen = session
    poses = uq.read_poses(folder / "robot.csv", seen)
    result = uq.calibrate(poses.rows(np.arange(8)))
    updated = uq.update(result, poses.rows(np.arange(8, 14)))
    assert updated.data.n == 14
    np.testing.assert_array_equal(updated.data.camera_covariance.own, seen.covariance.own)
    with pytest.raises(InputError, match="camera_covariance"):
        uq.PosePairs(poses.robot[:5], poses.camera[:5], camera_covariance=seen.covariance)
