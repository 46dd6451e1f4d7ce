"""Report after each pose: accuracy, the next pose, what limits X."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.arm_sessions import session

import uq_handeye as uq
from uq_handeye.errors import DegenerateMotionError, InputError
from uq_handeye.model.kinematics.newton import postures_at
from uq_handeye.use.planning.after_each import limit_of, next_pose, words_after, words_without

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def poses():
    return uq.simulate(n_poses=12, noise=NOISE, seed=2)


@pytest.fixture(scope="module")
def result(poses):
    return uq.calibrate(poses, noise=NOISE)


def test_the_gain_is_what_the_pose_brings(result, poses):
    """The covariance of X with the planned pose in addition, by the fit, against the gain that was said."""
    ahead = next_pose(result, NOISE, None)
    camera = np.linalg.inv(ahead.robot @ result.X) @ result.W
    robot = np.concatenate([poses.robot, ahead.robot[None]])
    more = uq.PosePairs(robot, np.concatenate([poses.camera, camera[None]]))
    after = uq.calibrate(more, noise=NOISE, robust=False)
    length = float(np.sqrt(np.mean(np.sum(poses.camera[:, :3, 3] ** 2, axis=1))))

    def size(S):
        return np.sqrt(np.trace(S[3:, 3:]) + 2 / 3 * length**2 * np.trace(S[:3, :3]))

    assert ahead.gain == pytest.approx(1 - size(after.covariance) / size(result.covariance), abs=0.01)
    assert 0.05 < ahead.gain < 0.3 and not ahead.least
    assert str(ahead).startswith(f"the next pose would gain {100 * ahead.gain:.0f} %; take")
    assert " % or more; take" in str(replace(ahead, least=True))


def test_one_or_two_lines(result):
    ahead = next_pose(result, NOISE, None)
    first, second = words_after(result, None, ahead)
    assert first.startswith("12 poses: ") and "mm and" in first and second.startswith("The next pose would gain")
    passed = result.verdict("10mm,2deg")
    assert words_after(result, passed, None)[1].startswith("PASS: X lies within 10 mm and 2 deg")
    open_ = words_after(result, result.verdict("0.6mm"), ahead)
    assert "within 0.6 mm with " in open_[0] and "95 % are needed" in open_[0] and open_[1] == second


def test_more_poses_do_not_help_where_shared_errors_limit_x(poses):
    """A shift of all camera poses by the same amount looks like X, and limits it; noise alone does not."""
    shift = np.zeros((12, 6, 3))
    shift[:, 3:] = np.eye(3)
    bend = uq.SharedError.columns("bend", shift, 3e-3, "camera")
    limited = uq.calibrate(poses, noise=NOISE, shared=[bend])
    said = limit_of(limited, None)
    assert said.startswith("More poses will hardly help: what limits X is the bend")
    assert limit_of(limited, limited.verdict("0.5mm")).startswith("More poses will not reach 0.5 mm:")
    assert limit_of(limited, limited.verdict("50mm")) is None
    assert limit_of(uq.calibrate(poses, noise=NOISE), None) is None
    ahead = next_pose(limited, NOISE, [bend])
    assert ahead.gain < 0.03  # the bend stays


@pytest.mark.slow
def test_an_accuracy_that_the_residuals_scale_is_no_limit_yet():
    few = uq.simulate(n_poses=7, noise=NOISE, seed=2)
    few = uq.PosePairs(few.robot, few.camera)
    assert limit_of(uq.calibrate(few), None) is None


def test_what_is_missing_before_there_is_x():
    assert words_without(1, InputError("")) == ["1 pose: at least 3 are needed, rotated about different axes."]
    assert "not determined yet" in words_without(4, DegenerateMotionError("all parallel", np.zeros((1, 6))))[0]
    assert words_without(6, InputError("a\nb")) == ["6 poses: no X yet. a b"]


@pytest.mark.slow
def test_the_next_pose_is_within_reach_of_the_arm():
    """Inside joint limits that are narrow about the poses so far, of which a box of robot positions knows nothing."""
    case = session(n=20)
    limits = zip(case.q.min(axis=0) - 0.1, case.q.max(axis=0) + 0.1, strict=True)
    pairs = zip(case.chain.joints, limits, strict=True)
    chain = replace(case.chain, joints=tuple(replace(joint, lower=low, upper=high) for joint, (low, high) in pairs))
    for poses in (case.poses, uq.PosePairs(case.poses.robot, case.poses.camera)):
        ahead = next_pose(uq.calibrate(poses, kinematics=chain), None, None)
        start = np.random.default_rng(0).uniform(*chain.limits.T, (100, 6))
        assert postures_at(chain, np.tile(ahead.robot, (100, 1, 1)), start).reached.any()
        assert 0.0 <= ahead.gain < 0.5
