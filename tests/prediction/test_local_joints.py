"""The finding of poses that are too alike to show the errors of an arm."""

import numpy as np
import pytest
from fixtures.arm_sessions import Session, calibrated, chain, drawn_errors, looking, measured, session
from fixtures.rigs import quietly

import uq_handeye as uq
from uq_handeye.calibration.prediction.workspace import range_shares
from uq_handeye.model.kinematics.forward import spread_postures

CODE = "prediction.local_joints"


def found_in(result):
    return [finding for finding in result.findings if finding.code == CODE]


@pytest.mark.slow
def test_local_poses_are_named():
    case = session(1, 20, 0.1)
    result = calibrated(case)
    (found,) = found_in(result)
    assert found.severity == "caution"
    t = case.chain.poses(case.q)[:, :3, 3]
    assert found.values["span"] * case.chain.reach == pytest.approx(np.linalg.norm(t[:, None] - t, axis=-1).max())
    assert found.values["used"] == pytest.approx(np.median(range_shares(case.chain, case.q)))
    told = {of["group"]: of["share"] for of in found.values["told"]}
    assert told == pytest.approx(result.kinematics.told())
    near = result.predict_camera(joints=case.q, new_measurement=False).covariance[:, 3:, 3:]
    assert found.values["here"] == pytest.approx(np.sqrt(np.trace(near, axis1=1, axis2=2).mean()))
    assert found.values["elsewhere"] > 3 * found.values["here"]
    span = 100 * found.values["span"]
    assert f"The poses span {span:.0f} % of the reach" in str(found) and "% of the joint offsets" in str(found)
    assert str(found) in result.warnings


@pytest.mark.slow
def test_poses_all_over_the_joint_ranges_are_not():
    arm, rng = chain(), np.random.default_rng(2)
    e = drawn_errors(arm, rng)
    q = spread_postures(arm.limits, np.ones(6, dtype=bool), 30)
    assert not found_in(calibrated(Session(arm, e, measured(arm, e, q, rng), q)))


@pytest.mark.slow
def test_an_arm_that_is_exact_or_unknown_has_none():
    arm, rng = chain(), np.random.default_rng(2)
    poses = measured(arm, np.zeros(len(arm.errors)), looking(arm, rng, 15, 0.1), rng)
    exact = uq.KinematicErrors("exact", joint_sd=1e-4)
    assert not found_in(quietly(poses, kinematics=arm, kinematic_errors=exact))
    assert not found_in(quietly(poses))


def test_what_joints_use_of_their_ranges():
    arm = chain()
    q = np.array([arm.limits[:, 0], arm.limits[:, 1]])
    q[:, 5] = 0.0, np.pi  # it turns without limits
    np.testing.assert_allclose(range_shares(arm, q), [1, 1, 1, 1, 1, 0.5])
