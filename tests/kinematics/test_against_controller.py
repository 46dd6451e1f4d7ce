"""The controller's poses against the forward kinematics: frames that explain them, what is left, misread files."""

import os
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, motion
from support import moved

from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.against_controller import compare_with_controller
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.joints_file import read_joints
from uq_handeye.read import read_pose_file

TOOL = motion((0.0, 0.0, 0.8), (0.01, 0.0, 0.12))
BASE = motion((0.0, 0.0, np.pi), (0.3, -0.2, 0.9))
NOISE = (2e-5, 5e-5)  # rad, m


@pytest.fixture(scope="module")
def arm():
    return Kinematics.from_urdf(SIX_AXES)


@pytest.fixture
def joints(rng, arm):
    lower, upper = np.clip(arm.limits, -2.0, 2.0).T
    return rng.uniform(lower, upper, (20, 6))


def said(found):
    return " ".join(map(str, found.findings))


def noisy(rng, poses):
    return moved(poses, rng.normal(size=(len(poses), 6)) * np.repeat(NOISE, 3))


def test_poses_of_the_chain_itself_are_nothing_to_speak_of(arm, joints):
    found = compare_with_controller(arm, joints, arm.poses(joints))
    assert found.exact and found.same_arm and found.findings == []


@pytest.mark.parametrize(("base", "tool"), [(None, None), (None, TOOL), (BASE, None), (BASE, TOOL)])
def test_frames_are_found_and_what_is_left(rng, arm, joints, base, tool):
    true = (np.eye(4) if base is None else base) @ arm.poses(joints) @ (np.eye(4) if tool is None else tool)
    found = compare_with_controller(arm, joints, noisy(rng, true))
    for fitted, frame in ((found.base, base), (found.tool, tool)):
        assert (fitted is None) == (frame is None)
        if frame is not None:
            np.testing.assert_allclose(fitted, frame, rtol=0, atol=2e-4)
    assert found.rms[0] < 2 * NOISE[0] and found.rms[1] < 2 * NOISE[1]
    assert found.rms[1] <= found.largest[1]
    np.testing.assert_allclose(found.adapt(arm).poses(joints), true, rtol=0, atol=2e-4)
    (finding,) = found.findings
    assert finding.severity == "note"
    assert ("a tool frame of 120 mm, 45.8 deg" in said(found)) == (tool is not None)
    assert ("a base frame of 970 mm, 180 deg" in said(found)) == (base is not None)
    assert ("in the same frames" in said(found)) == (base is None and tool is None)


def test_adapted_chain_has_columns_at_the_tool(arm, joints):
    """The twist of the controller's pose by a joint, by differences."""
    adapted = compare_with_controller(arm, joints, BASE @ arm.poses(joints) @ TOOL).adapt(arm)
    step = np.array([0, 0, 1e-6, 0, 0, 0])
    ahead, behind = (BASE @ arm.poses(joints + sign * step) @ TOOL for sign in (1, -1))
    np.testing.assert_allclose(adapted.jacobian(joints)[:, 3:, 2], (ahead - behind)[:, :3, 3] / 2e-6, rtol=0, atol=1e-5)


def test_gravity_turns_with_the_base_frame(arm, joints):
    adapted = compare_with_controller(arm, joints, motion((0.7, 0.2, 0.0), (0.3, 0.0, 0.9)) @ arm.poses(joints)).adapt(
        arm
    )
    np.testing.assert_allclose(adapted.gravity(joints), arm.gravity(joints), rtol=0, atol=1e-5)


def test_rows_of_another_moment_are_named_and_spoil_nothing(rng, arm, joints):
    poses = noisy(rng, arm.poses(joints) @ TOOL)
    wrong = joints.copy()
    wrong[[3, 11]] = wrong[[4, 12]]
    found = compare_with_controller(arm, wrong, poses)
    assert found.apart == (3, 11) and found.same_arm
    np.testing.assert_allclose(found.tool, TOOL, rtol=0, atol=2e-4)
    assert [finding.severity for finding in found.findings] == ["note", "caution"]
    assert "Poses 3, 11: joints and robot pose are not of the same moment" in said(found)


def other_way(q, joint):
    return np.concatenate([q[:, :joint], -q[:, joint : joint + 1], q[:, joint + 1 :]], axis=1)


def scaled(G, factor):
    T = G.copy()
    T[:, :3, 3] *= factor
    return T


@pytest.mark.slow
@pytest.mark.parametrize(
    ("reading", "read", "words"),
    [
        ("degrees", lambda q, G: (np.degrees(q), G), "--joint-units deg"),
        ("radians", lambda q, G: (np.radians(q), G), "--joint-units rad"),
        ("inverted", lambda q, G: (q, np.linalg.inv(G)), "--robot-frame gripper_T_base"),
        ("order", lambda q, G: (q[:, [2, 1, 0, 3, 4, 5]], G), "axis_3, axis_2, axis_1, axis_4"),
        ("order", lambda q, G: (q[:, [1, 2, 0, 3, 4, 5]], G), "axis_2, axis_3, axis_1, axis_4"),
        ("sign", lambda q, G: (other_way(q, 2), G), "axis_3 rotates the other way"),
        ("zero", lambda q, G: (q - [0, 0, np.pi / 2, 0, 0, 0], G), "the zero of joint axis_3"),
        ("rows later", lambda q, G: (q[:-1], G[1:]), "joints of the next row"),
        ("rows earlier", lambda q, G: (q[1:], G[:-1]), "joints of the row before"),
        ("millimetres", lambda q, G: (q, scaled(G, 1e3)), "--units robot=mm"),
        ("metres", lambda q, G: (q, scaled(G, 1e-3)), "--units robot=m"),
    ],
    ids=lambda value: value if isinstance(value, str) and " " not in value else "",
)
def test_what_would_explain_poses_of_another_arm(rng, arm, joints, reading, read, words):
    found = compare_with_controller(arm, *read(joints, noisy(rng, arm.poses(joints) @ TOOL)))
    assert not found.same_arm and found.reading == reading
    (finding,) = found.findings
    assert finding.severity == "failure" and words in str(finding)
    assert "more than any tolerance of an arm" in str(finding)


@pytest.mark.slow
def test_another_arm_without_an_explanation(rng, arm, joints):
    other = Kinematics.from_urdf(SIX_AXES.replace("0 0 0.27", "0 0 0.57"))
    found = compare_with_controller(other, joints, noisy(rng, arm.poses(joints)))
    assert not found.same_arm and found.reading is None
    assert "another arm" in said(found)


@pytest.mark.slow
def test_another_arm_of_the_table_is_named(rng):
    q = np.array([0.0, -1.2, 1.4, -1.6, -1.5, 0.0]) + rng.uniform(-0.5, 0.5, (15, 6))
    found = compare_with_controller(Kinematics.from_name("ur10e"), q, Kinematics.from_name("ur5e").poses(q) @ TOOL)
    assert found.reading == "arm" and found.detail == ("ur5e", "ur7e")
    assert "They fit with the arm ur5e, ur7e of the table" in said(found)
    assert compare_with_controller(Kinematics.from_name("ur7e"), q, Kinematics.from_name("ur5e").poses(q)).exact


def test_an_arm_that_is_calibrated_for_itself_is_the_same_arm(rng, arm, joints):
    e = rng.normal(size=len(arm.errors)) * np.where([error.unit == "m" for error in arm.errors], 5e-4, 2e-3)
    found = compare_with_controller(arm, joints, arm.poses(joints, e))
    assert found.same_arm and 1e-4 < found.rms[1] < 0.02 and found.apart == ()


def test_numbers_are_plain(rng, arm, joints):
    told = compare_with_controller(arm, joints, noisy(rng, arm.poses(joints) @ TOOL)).to_dict()
    assert told["same_arm"] and told["base"] is None and np.shape(told["tool"]) == (4, 4)
    assert 0 < told["translation_rms"] <= told["translation_max"] < 1e-3


@pytest.mark.parametrize("n", [1, 2, 3])
def test_few_poses_are_compared_too(rng, arm, joints, n):
    found = compare_with_controller(arm, joints[:n], noisy(rng, arm.poses(joints[:n])))
    assert found.same_arm
    assert not compare_with_controller(arm, np.degrees(joints[:n]), arm.poses(joints[:n]) @ TOOL).same_arm or n == 1


def test_refuses_other_numbers(arm, joints):
    with pytest.raises(InputError, match="as many robot poses"):
        compare_with_controller(arm, joints, arm.poses(joints[:5]))


needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


@needs_data
def test_real_controller_is_the_nominal_chain_with_a_tool_turned():
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "fr3_philnad"
    joints = np.loadtxt(folder / "joints.csv", delimiter=",", skiprows=1)[:, 1:]
    found = compare_with_controller(
        Kinematics.from_urdf(folder / "model.urdf"), joints, read_pose_file(folder / "tcp.csv")[1]
    )
    assert "a tool frame of 45 deg" in said(found) and found.largest[1] < 1e-4


@needs_data
@pytest.mark.parametrize(("arm", "apart"), [("panda_2", 4), ("panda_3", 1), ("panda_6", 0)])
def test_real_controllers_that_calibrate_nothing(arm, apart):
    """Pandas report the nominal kinematics; a few rows were read while the arm was moved by hand."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "mukca_panda"
    times, robot = read_pose_file(folder / arm / "robot.csv")
    nominal, calibrated = (
        Kinematics.from_urdf(file) for file in (folder / "model.urdf", folder / arm / "calibrated.urdf")
    )
    joints = read_joints(folder / arm / "joints.csv", nominal)
    q = joints.q[np.searchsorted(joints.timestamps, times)]
    found = compare_with_controller(nominal, q, robot)
    assert found.base is None and found.tool is None and len(found.apart) == apart
    assert 1e-5 < found.rms[1] < 1e-4
    assert 2e-3 < compare_with_controller(calibrated, q, robot).rms[1] < 20e-3
