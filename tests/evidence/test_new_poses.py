"""New poses against a calibration: the covariance of their residuals, and the posterior that takes them in."""

from dataclasses import replace

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.evidence.new_poses import evidence_of_poses
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.model.shared_errors.shared_error import SharedError

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.1mm"), camera=("0.05deg", "0.4mm"))
OLD, NEW, TRIALS = 8, 8, 50
# Many draws: some look wrong by chance.
pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")


def both(rng, setup, noise=NOISE, move=None):
    """Return poses of one rig, drawn anew, as old and new."""
    poses = uq.simulate(n_poses=OLD + NEW, noise=noise, setup=setup, seed=rng)
    if move is not None:
        poses = replace(poses, robot=perturb(poses.robot, move(poses)), truth=None)
    return poses.rows(np.arange(OLD)), poses.rows(np.arange(OLD, OLD + NEW))


def distances(rng, setup, move=None, **given):
    """d^2 of new poses in many draws, and the same if the calibration counted as exact."""
    found = []
    for _ in range(TRIALS):
        old, new = both(rng, setup, move=None if move is None else move())
        result = uq.calibrate(old, noise=NOISE, robust=False, **given)
        evidence = evidence_of_poses(result, new)
        exact = replace(evidence, by_unit=0.0 * evidence.by_unit)
        found.append((evidence.d2, exact.d2))
    return np.array(found)


@pytest.mark.statistical
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_d2_of_new_poses_is_chi_square(rng, setup):
    d2, without = distances(rng, setup, shared=[]).T
    error = np.sqrt(2 * 6 * NEW / TRIALS)
    assert abs(d2.mean() - 6 * NEW) < 4 * error
    assert without.mean() > 6 * NEW + 6 * error  # X and W are not exact


@pytest.mark.statistical
def test_errors_in_common_with_the_calibration(rng):
    scale = SharedError.target_scale(0.01)
    found = []
    for _ in range(TRIALS):
        poses = uq.simulate(n_poses=OLD + NEW, noise=NOISE, seed=rng)
        camera = poses.camera.copy()
        camera[:, :3, 3] *= 1 + 0.01 * rng.standard_normal()
        poses = replace(poses, camera=camera, truth=None)
        result = uq.calibrate(poses.rows(np.arange(OLD)), noise=NOISE, robust=False, shared=[scale])
        evidence = evidence_of_poses(result, poses.rows(np.arange(OLD, OLD + NEW)))
        twice = replace(evidence, by_unit=0.25 * evidence.by_unit)
        found.append((evidence.d2, twice.d2))
    d2, smaller = np.mean(found, axis=0)
    error = np.sqrt(2 * 6 * NEW / TRIALS)
    assert abs(d2 - 6 * NEW) < 4 * error < smaller - 6 * NEW


@pytest.mark.statistical
def test_the_errors_of_an_arm_are_those_of_the_calibration(rng):
    """One draw of the arm's errors moves old and new poses; a new draw for the new ones is found."""
    accuracy = SharedError.robot_accuracy("1mm, 0deg", reach=1.0)
    same, anew = [], []
    for _ in range(TRIALS):
        poses = uq.simulate(n_poses=OLD + NEW, noise=NOISE, seed=rng)
        old, new = (poses.rows(rows) for rows in (np.arange(OLD), np.arange(OLD, OLD + NEW)))
        bound = accuracy.bound(old)
        z, other = rng.standard_normal((2, len(bound.keys)))

        def with_errors(of, draw, bound=bound):
            return replace(of, robot=perturb(of.robot, bound.at(of) @ (bound.sd * draw)), truth=None)

        result = uq.calibrate(with_errors(old, z), noise=NOISE, robust=False, shared=[accuracy])
        for draw, listed in ((z, same), (other, anew)):
            listed.append(evidence_of_poses(result, with_errors(new, draw)).d2)
    error = np.sqrt(2 * 6 * NEW / TRIALS)
    assert 0.5 * 6 * NEW < np.mean(same) < 6 * NEW + 4 * error  # a share of an unknown arm is new at other poses
    assert np.mean(anew) > np.mean(same) + 4 * error


@pytest.mark.slow
def test_at_a_pose_of_the_calibration_nothing_of_the_arm_is_new(rng):
    accuracy = SharedError.robot_accuracy("1mm, 0deg")
    old, _ = both(rng, "eye-in-hand")
    result = uq.calibrate(old, noise=NOISE, shared=[accuracy])
    far = replace(old, robot=old.robot @ [[-1, 0, 0, 0.2], [0, -1, 0, 0.1], [0, 0, 1, 0.3], [0, 0, 0, 1]])
    sd = [np.sqrt(np.trace(of.covariance[..., 3:, 3:], axis1=-2, axis2=-1)) for of in
          (result.predict_camera(poses.robot, new_measurement=False) for poses in (old, far))]  # fmt: skip
    assert sd[0].max() < sd[1].min()


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_absorbed_is_the_fit_of_all_poses(rng, setup):
    small = uq.PoseNoise.isotropic(robot=("4urad", 0.001e-3), camera=("9urad", 0.004e-3))
    old, new = both(rng, setup, small)
    shared = [SharedError.target_scale(1e-5)]
    given = {"noise": small, "robust": False, "shared": shared, "method": "ml"}
    result = uq.calibrate(old, **given)
    together = uq.PosePairs(np.concatenate([old.robot, new.robot]), np.concatenate([old.camera, new.camera]), setup)
    batch = uq.calibrate(together, **given)
    after = evidence_of_poses(result, new).absorbed()
    X = perturb(result.X, -after.mean[:6])
    white = np.linalg.inv(np.linalg.cholesky(batch.covariance))
    assert np.abs(X - batch.X)[:3, 3].max() < 1e-3 * np.sqrt(np.diag(batch.covariance)[3:]).min()
    ratios = np.linalg.eigvalsh(white @ after.covariance[:6, :6] @ white.T)
    np.testing.assert_allclose(ratios, 1.0, atol=2e-3)
    assert np.linalg.eigvalsh(white @ result.covariance @ white.T).max() > 1.05


def test_causes_power_and_rows(rng):
    old, new = both(rng, "eye-in-hand")
    result = uq.calibrate(old, noise=NOISE, shared=[])
    evidence = evidence_of_poses(result, new)
    J = evidence.linear.J[..., :6]
    delta = np.array([0.01, 0, 0, 0, 0.02, 0])
    moved = replace(evidence, r=evidence.r - J @ delta)
    found = moved.explained_by(-J)
    assert (np.abs(found.estimate - delta) < 5 * np.sqrt(np.diag(found.covariance))).all()
    np.testing.assert_allclose(np.linalg.inv(found.covariance), moved.information(J), rtol=1e-6)
    np.testing.assert_allclose(found.gain, found.estimate @ moved.information(J) @ found.estimate, rtol=1e-6)
    np.testing.assert_allclose(moved.d2, moved.r.ravel() @ np.linalg.solve(moved.covariance, moved.r.ravel()))
    first = evidence.rows(np.arange(1))
    np.testing.assert_allclose(first.d2, evidence_of_poses(result, new.rows(np.arange(1))).d2)


def test_what_cannot_be_held_against_a_calibration(rng):
    old, new = both(rng, "eye-in-hand")
    result = uq.calibrate(old, noise=NOISE, shared=[])
    with pytest.raises(uq.InputError, match="setup eye-in-hand"):
        evidence_of_poses(result, uq.PosePairs(new.robot, new.camera, "eye-to-hand"))
    with pytest.raises(uq.InputError, match="method '4dpa'"):
        evidence_of_poses(uq.calibrate(old, noise=NOISE, method="4dpa"), new)
    with pytest.raises(uq.InputError, match="PosePairs"):
        evidence_of_poses(result, new.robot)
