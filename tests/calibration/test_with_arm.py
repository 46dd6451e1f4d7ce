"""Calibrations with joints at their edges: parallel axes, nothing to estimate, priors without end."""

import itertools

import numpy as np
import pytest
from fixtures.arms import measured, motion, random_chain
from fixtures.rigs import quietly
from fixtures.rigs_on_arms import ARM, CAMERA, rig

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import perturb
from uq_handeye.model.kinematics.chain import Joint, Kinematics


def scara():
    """Four joints, all about or along z."""
    joints = (
        Joint("shoulder", "revolute", motion(shift=(0, 0, 0.3)), [0, 0, 1], -2.5, 2.5),
        Joint("elbow", "revolute", motion(shift=(0.3, 0, 0)), [0, 0, 1], -2.5, 2.5),
        Joint("quill", "prismatic", motion(shift=(0.25, 0, 0)), [0, 0, 1], -0.2, 0.0),
        Joint("wrist", "revolute", np.eye(4), [0, 0, 1], -3.0, 3.0),
    )
    return Kinematics("scara", "base", "tip", joints, motion((np.pi, 0, 0)))


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_parallel_axes_leave_open_what_predictions_need(rng, setup):
    arm = scara()
    poses, _, _ = measured(arm, rng, 20, setup=setup, camera=(1e-3, 1e-3), joint_sd=2e-4)
    result = quietly(poses, kinematics=arm)
    assert result.opened is not None
    text = result.summary(verbose=True)
    assert "errors of the arm (joint offsets, joint tilts" in " ".join(text.split())
    assert "wrong robot kinematics" not in text and "declared)" not in text
    for predict in (result.predict_camera, lambda joints: result.predict([0, 0, 0.3], joints)):
        with pytest.raises(uq.InputError, match=r"leave a part of them open.*prior"):
            predict(joints=poses.joints[:2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_parallel_axes_without_errors_of_the_arm(seed):
    """Moves of X and W that change nothing count for no likelihood of errors in common."""
    poses, _, _ = measured(scara(), np.random.default_rng(seed), 20, camera=(1e-3, 1e-3))
    assert quietly(poses).opened is not None
    exact = uq.KinematicErrors("exact")
    assert quietly(poses, kinematics=scara(), kinematic_errors=exact).opened is not None


@pytest.mark.slow
def test_one_axis_does_not_stop_a_calibration(rng):
    arm = random_chain(rng, "R")
    poses, _, _ = measured(arm, rng, 20, camera=(1e-3, 1e-3), joint_sd=2e-4)
    assert len(quietly(poses, kinematics=arm).open_directions) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    ("errors", "noise"),
    [
        (uq.KinematicErrors(joint_sd=0), uq.PoseNoise.isotropic(camera=CAMERA)),  # no noise is left to be estimated
        (uq.KinematicErrors(offset_sd=3.0, tilt_sd=3.0, length_sd=10.0), None),  # the data leave nothing of the prior
    ],
)
def test_a_file_holds_results_at_the_edge(tmp_path, errors, noise):
    result = quietly(rig(np.random.default_rng(8), n=12).poses, kinematics=ARM, kinematic_errors=errors, noise=noise)
    result.to_json(tmp_path / "result.json")
    again = uq.Calibration.from_json(tmp_path / "result.json")
    assert [error.alone_sd for error in again.shared] == [error.alone_sd for error in result.shared]
    unit = np.sqrt(np.diag(result.posterior.covariance))
    off = (again.posterior.covariance - result.posterior.covariance) / np.outer(unit, unit)
    assert np.abs(off).max() < 1e-6


def test_noise_of_all_robot_poses_together_says_nothing_of_a_new_one(rng):
    found = rig(rng, n=12)
    noise = uq.PoseNoise(robot=np.eye(72) * 1e-8, camera=np.eye(6) * 1e-7)
    errors = uq.KinematicErrors("declared", robot_class="industrial")
    result = quietly(found.poses, kinematics=ARM, kinematic_errors=errors, noise=noise)
    assert result.over_workspace is None
    assert "The arm:" in result.summary(verbose=True)
    with pytest.raises(uq.InputError, match="joint array of the robot poses"):
        result.predict_camera(joints=found.near)


@pytest.mark.slow
def test_the_branch_of_the_inverse_kinematics_is_that_of_the_data():
    """Errors of 2 mm of a UR5e without joints, elbow up and down, in front and behind: evidence finds most postures.

    Not all: of a dozen branches the best ones are within 0.2 to 2 of each other in the logarithm, more so where inverse
    kinematics turns the wrist over in a fifth of the poses and no branch is that of all. A branch by chance is right in
    one of nine.
    """
    found_in, arm = [], uq.Kinematics.from_name("ur5e")
    centres = [0.3, -0.9, -1.9, 1.2, 1.4, 0.2], [0.3, -1.8, 1.9, -1.7, -1.5, 0.2], [0.3, -2.6, 1.9, -1.7, 1.5, 0.2]
    for centre, seed in itertools.product(centres, (3, 4, 5)):
        rng = np.random.default_rng(seed)
        q = centre + rng.uniform(-0.4, 0.4, (25, 6))
        unit = {"joint offsets": 2e-3, "joint tilts": 1e-3, "link lengths": 5e-4}
        e = np.array([unit.get(error.group, 0.0) for error in arm.errors]) * rng.normal(size=len(arm.errors))
        X, target = motion((0.1, 0.2, 0.3), (0.02, 0.05, 0.1)), motion((3.0, 0.2, 0.1), (0.6, 0.1, 0.1))
        camera = np.linalg.inv(arm.poses(q, e) @ X) @ target
        camera = perturb(camera, rng.normal(size=(25, 6)) * np.repeat([3e-4, 2e-4], 3))
        result = quietly(uq.PosePairs(arm.poses(q), camera, "eye-in-hand"), kinematics=arm)
        off = np.abs(np.sin(0.5 * (result.kinematics.joints - q))).max(axis=1)
        found_in.append(np.mean(off < 1e-6) > 0.6)  # others may be reached with the wrist turned over
    assert sum(found_in) >= 5
