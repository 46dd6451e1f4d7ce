"""Joint values from poses: against the forward kinematics, inside the limits, honest where there are none."""

import numpy as np
import pytest
from fixtures.arm_sessions import chain, drawn_errors
from fixtures.arms import random_chain

from uq_handeye.core.rounding import HALF_DIGITS
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.elbow import elbow_moved
from uq_handeye.model.kinematics.forward import spread_postures
from uq_handeye.model.kinematics.kinematic_errors import KinematicErrors
from uq_handeye.model.kinematics.newton import postures_at


def spread(arm, n):
    return spread_postures(arm.limits, np.array([joint.is_revolute for joint in arm.joints]), n)


@pytest.mark.slow
@pytest.mark.parametrize("errors", [False, True])
def test_postures_have_the_poses_wanted(errors):
    arm, rng = chain(), np.random.default_rng(0)
    e = drawn_errors(arm, rng) if errors else None
    q = spread(arm, 500)
    poses = arm.poses(q, e)
    found = postures_at(arm, poses, q + 0.2 * rng.normal(size=q.shape), e)
    assert found.reached.mean() > 0.9
    np.testing.assert_allclose(arm.poses(found.q, e)[found.reached], poses[found.reached], atol=3 * HALF_DIGITS)


def test_postures_stay_inside_the_limits_and_a_pose_out_of_reach_is_told():
    arm = chain()
    q = spread(arm, 300)
    poses = arm.poses(q)
    far = poses.copy()
    far[::2, :3, 3] *= 10.0
    found = postures_at(arm, far, q[::-1])
    assert ((found.q >= arm.limits[:, 0]) & (found.q <= arm.limits[:, 1])).all()
    assert not found.reached[::2].any() and found.reached[1::2].mean() > 0.3


def test_a_prismatic_joint():
    arm = random_chain(np.random.default_rng(2), "PRRRRRR")
    q = spread(arm, 200)
    found = postures_at(arm, arm.poses(q), q + 0.05)
    assert found.reached.mean() > 0.8
    np.testing.assert_allclose(arm.poses(found.q)[found.reached], arm.poses(q)[found.reached], atol=1e-6)


def test_an_elbow_that_is_turned_leaves_the_pose():
    arm = Kinematics.from_name("panda")
    q = np.array([[0.1, -0.4, 0.2, -2.2, 0.1, 1.8, 0.8], [0.6, 0.2, -0.3, -1.9, -0.4, 1.9, 0.2]])
    ways = elbow_moved(arm, arm.poses(q), q, 0.9)
    for way in ways:
        np.testing.assert_allclose(arm.poses(way), arm.poses(q), atol=3 * HALF_DIGITS)
        assert (np.linalg.norm(way - q, axis=1) > 0.5).all()
    assert (np.linalg.norm(ways[0] - ways[1], axis=1) > 1.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_columns_hold_an_elbow_that_is_elsewhere_at_all_poses(sign):
    """A Panda whose elbow is 0.2 rad further round at all poses than where its joints are taken to be.

    What that changes in the errors of each group is in the columns of an elbow elsewhere, which differ between poses
    smoothly: half of the motions of the joints by a singular value decomposition are the other way round.
    """
    arm, rng = Kinematics.from_name("panda"), np.random.default_rng(0)
    q = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8]) + rng.uniform(-0.3, 0.3, (30, 7))
    errors = KinematicErrors()
    found, joints = errors.terms(arm, q, by_poses=True), errors.terms(arm, q)
    along = np.linalg.svd(arm.jacobian(q))[2][:, -1]
    assert 0 < (along[:, 2] > 0).sum() < 30
    away = q + sign * 0.2 * along * np.sign(along[:, 2:3])
    weight = np.repeat([0.3, 1.0], 3)[:, None]
    groups = [part for part in zip(found, joints, errors.terms(arm, away), strict=True) if part[0].columns is not None]
    assert len(groups) == 5
    for there, here, other in groups:
        group, frames, elsewhere = here.key.kind, here.count - 12, here.count  # those of an elbow elsewhere come last
        D = (other.columns - here.columns)[..., :frames]
        K, D = ((weight * x).reshape(180, -1) for x in (there.columns[..., elsewhere:], D))
        left = D - K @ np.linalg.lstsq(K, D, rcond=None)[0]
        assert K.shape[1] < 60 and (left**2).sum() < 0.1 * (D**2).sum(), group
        assert (K**2).sum() > (0.5 / 0.2) ** 2 * 0.9 * (D**2).sum(), group
