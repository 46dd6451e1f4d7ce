"""Plans in joints: predictions against the enlarged set, joints inside their limits, and whether such poses help."""

import dataclasses
import json

import numpy as np
import pytest
from fixtures.arm_sessions import CAMERA, W, X, chain, declared, drawn_errors, looking, measured
from fixtures.rigs import quietly
from support import assert_same_covariance

import uq_handeye as uq
from uq_handeye import InputError
from uq_handeye.model.kinematics.forward import spread_postures
from uq_handeye.model.kinematics.joints_file import read_joints
from uq_handeye.use.planning.by_joints import sample_joints, unwound

ARM = chain()
NOISE = uq.PoseNoise.isotropic(robot=(1e-6, 1e-6), camera=CAMERA)
TASK = spread_postures(ARM.limits, np.ones(6, dtype=bool), 60)
pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")


def planned(poses, k=4, **options):
    of_arm = {"kinematics": ARM, "kinematic_errors": declared(), "noise": NOISE, "shared": []}
    return uq.plan(poses, k=k, **of_arm | options)


def joined(a, b):
    joints = np.concatenate([a.joints, b.joints])
    return uq.PosePairs(
        np.concatenate([a.robot, b.robot]), np.concatenate([a.camera, b.camera]), a.setup, joints=joints
    )


@pytest.fixture(scope="module")
def exact():
    """Poses without noise of an arm without errors, and a plan after them."""
    rng = np.random.default_rng(3)
    q = looking(ARM, rng, 12, 0.3)
    poses = measured(ARM, np.zeros(len(ARM.errors)), q, rng, noise=0.0)
    return poses, planned(poses, task=TASK)


@pytest.mark.slow
def test_predictions_are_those_of_the_enlarged_set(exact):
    poses, found = exact
    after = joined(poses, measured(ARM, np.zeros(len(ARM.errors)), found.joints, np.random.default_rng(0), noise=0.0))
    for data, covariance, value in (
        (poses, found.covariance_before, found.criterion_before),
        (after, found.covariances[-1], found.criterion_values[-1]),
    ):
        result = quietly(data, noise=NOISE, kinematics=ARM, kinematic_errors=declared(), shared=[])
        assert_same_covariance(covariance, result.covariance, 1e-4)
        at_task = result.predict_camera(joints=TASK, new_measurement=False).covariance[:, 3:, 3:]
        assert value == pytest.approx(np.trace(at_task, axis1=1, axis2=2).mean(), rel=1e-4)
    assert (np.diff([found.criterion_before, *found.criterion_values]) < 0).all()


@pytest.mark.slow
def test_its_poses_are_those_of_its_joints(exact):
    _, found = exact
    np.testing.assert_allclose(found.robot, ARM.poses(found.joints), atol=1e-9)
    np.testing.assert_allclose(found.camera, np.linalg.inv(found.X) @ np.linalg.inv(found.robot) @ found.W, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_candidates_are_inside_the_limits_and_see_the_target(setup):
    q = looking(ARM, np.random.default_rng(1), 10, 0.3)
    poses = measured(ARM, np.zeros(len(ARM.errors)), q, np.random.default_rng(1), noise=0.0)
    if setup == "eye-to-hand":  # the same geometry: what was the target's frame is the camera's
        poses = uq.PosePairs(poses.robot, np.linalg.inv(poses.camera), setup, joints=q)
        frames = W, X
    else:
        frames = X, W
    found = sample_joints(poses, ARM, q, *frames, 150, seed=4)
    assert found.shape == (150, 6)
    assert ((found >= ARM.limits[:, 0]) & (found <= ARM.limits[:, 1])).all()
    G = ARM.poses(found)
    C = np.linalg.inv(frames[0]) @ (np.linalg.inv(G) if setup == "eye-in-hand" else G) @ frames[1]
    distance, before = (np.linalg.norm(T[:, :3, 3], axis=-1) for T in (C, poses.camera))
    assert distance.min() > 0.8 * before.min() - 1e-6 and distance.max() < 1.2 * before.max() + 1e-6
    view, old = (T[:, :3, 3] / np.linalg.norm(T[:, :3, 3], axis=-1)[:, None] for T in (C, poses.camera))
    widest = np.arccos(np.clip((old @ old.T).min(), -1, 1))
    assert np.arccos(np.clip((view @ old.T).max(axis=1), -1, 1)).max() < widest + 1e-6
    # joints stay within half a turn of where they have been
    assert (np.maximum(found - q.max(axis=0), q.min(axis=0) - found) <= np.pi + 1e-9).all()


def test_equivalent_angles_are_the_nearest_and_no_joint_is_half_a_turn_beyond():
    arm = uq.Kinematics.from_name("ur5e")  # +-360 deg
    so_far = np.array([[0.1, -1.5, 1.2, -1.0, -1.6, 0.0], [0.4, -1.2, 1.5, -0.8, -1.4, 2.0]])
    near = so_far.mean(axis=0)
    far = near + (np.pi + 0.3) * np.eye(6)[2]  # the other way round is near
    around = near + 2 * np.pi * np.array([-1, 1, 0, 1, 1, -1])
    found = unwound(arm, np.array([near, around, far]), so_far)
    np.testing.assert_allclose(found[:2], [near, near], atol=1e-12)
    np.testing.assert_allclose(arm.poses(found[2]), arm.poses(far), atol=1e-12)
    limited = uq.Kinematics.from_name("irb120")  # +-400 deg of the last joint
    ends = limited.limits.T.clip(-3.0, 3.0)
    ends[:, 5] = limited.limits[5]
    assert (np.abs(unwound(limited, ends, np.zeros((1, 6)))) <= np.pi).all()


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_nothing_is_below_the_floor(setup):
    q = looking(ARM, np.random.default_rng(1), 10, 0.3)
    poses = measured(ARM, np.zeros(len(ARM.errors)), q, np.random.default_rng(1), noise=0.0)
    frames = X, W
    if setup == "eye-to-hand":
        poses, frames = uq.PosePairs(poses.robot, np.linalg.inv(poses.camera), setup, joints=q), (W, X)
    carried = frames[0] if setup == "eye-in-hand" else frames[1]

    def heights(joints):
        flange = ARM.poses(joints)
        parts = [ARM.frames(joints)[:, 1:, 2, 3], flange[:, 2, 3], (flange @ carried)[:, 2, 3]]
        return np.column_stack(parts).min(axis=1)

    free = sample_joints(poses, ARM, q, *frames, 100, seed=4)
    floor = float(np.median(heights(free)))
    assert heights(sample_joints(poses, ARM, q, *frames, 100, seed=4, floor=floor)).min() >= floor
    with pytest.raises(InputError, match="above the floor"):
        sample_joints(poses, ARM, q, *frames, 5, seed=4, floor=50.0)


@pytest.mark.slow
def test_eight_poses_chosen_by_joints_beat_local_ones_far_away():
    """True errors of predictions all over the workspace: 8 + 8 chosen ones against 16 and 30 local ones."""
    squares, stated = [], []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        e = drawn_errors(ARM, rng)
        local = measured(ARM, e, looking(ARM, rng, 30, 0.2), rng)
        few = local.rows(np.arange(8))
        found = uq.plan(few, k=8, kinematics=ARM, kinematic_errors=declared(), task=TASK, shared=[])
        sets = joined(few, measured(ARM, e, found.joints, rng)), local.rows(np.arange(16)), local
        true = np.linalg.inv(X) @ np.linalg.inv(ARM.poses(TASK, e)) @ W
        row, said = [], []
        for poses in sets:
            result = quietly(poses, kinematics=ARM, kinematic_errors=declared(), shared=[])
            seen = result.predict_camera(joints=TASK, new_measurement=False)
            row.append(np.mean(np.sum((seen.poses - true)[:, :3, 3] ** 2, axis=-1)))
            said.append(np.mean(np.trace(seen.covariance[:, 3:, 3:], axis1=1, axis2=2)))
        squares.append(row)
        stated.append(said)
    chosen, sixteen, thirty = np.sqrt(np.mean(squares, axis=0))
    assert chosen < 0.75 * sixteen and chosen < 0.85 * thirty
    chosen, sixteen, thirty = np.sqrt(np.mean(stated, axis=0))
    assert chosen < 0.75 * sixteen and chosen < 0.85 * thirty


def test_text_json_and_csv_list_the_joints(exact, tmp_path):
    _, found = exact
    text = found.to_text()
    assert "axis_6" in text and "deg" in text and f"{np.degrees(found.joints[0, 0]):.2f}" in text
    assert "The joints are inside their limits and within 180 deg" in text and "the 60 given" in text
    long = dataclasses.replace(found, joint_names=tuple(f"shoulder_{name}" for name in ARM.names)).to_text()
    assert "q1" in long and "q1 to q6: joints shoulder_axis_1, shoulder_axis_2" in long.replace("\n", " ")
    data = json.loads(found.to_json())
    assert data["joint_names"] == list(ARM.names) and data["joint_units"] == ["rad"] * 6
    np.testing.assert_allclose([step["joints"] for step in data["steps"]], found.joints)
    found.to_csv(tmp_path / "next.csv")
    np.testing.assert_allclose(read_joints(tmp_path / "next.csv", ARM).q, found.joints, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("criterion", ["trace", "logdet"])
def test_other_criteria_are_of_X(exact, criterion):
    poses, _ = exact
    found = planned(poses, 2, criterion=criterion)
    expected = np.log(np.linalg.det(found.covariances))
    if criterion == "trace":
        S = found.covariances
        turn, shift = (np.trace(S[:, part, part], axis1=1, axis2=2) for part in (slice(0, 3), slice(3, 6)))
        expected = shift + 2 / 3 * found.length**2 * turn
    np.testing.assert_allclose(found.criterion_values, expected, rtol=1e-6)


@pytest.mark.slow
def test_an_arm_that_is_exact_is_planned_for_too(exact):
    poses, _ = exact
    found = planned(poses, 2, kinematic_errors=uq.KinematicErrors("exact"))
    assert found.criterion_values[-1] < found.criterion_before < planned(poses, 1).criterion_before


@pytest.mark.slow
def test_what_cannot_be_is_refused(exact):
    poses, _ = exact
    for options, message in (
        ({"candidates": np.degrees(poses.joints)}, "in degrees"),
        ({"task": np.zeros((3, 5))}, r"`task` to be finite joints \(m, 6\)"),
        ({"candidates": poses.joints[:2]}, "at most as many poses as candidates"),
        ({"criterion": "best"}, "`criterion` to be one of"),
        ({"kinematics": None}, "Expected `kinematics`"),
        ({"kinematics": None, "kinematic_errors": None, "task": TASK}, "Expected `kinematics`"),
        ({"kinematics": None, "kinematic_errors": None, "criterion": "prediction"}, "Expected `kinematics`"),
    ):
        with pytest.raises(InputError, match=message):
            planned(poses, **options)
    bare = uq.PosePairs(poses.robot, poses.camera, poses.setup)
    assert planned(bare).joints.shape[1] == ARM.n_joints  # they follow from the poses
