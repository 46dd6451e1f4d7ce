"""Joint values that are meant otherwise than as they were read: what is taken, named, or left alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.joint_readings import is_fanuc, may_be_coupled, uncoupled
from uq_handeye.model.kinematics.known_arms import known_arm
from uq_handeye.read import read_poses, write_pose_file

CRX, UR = Kinematics.from_name("crx10ia"), Kinematics.from_name("ur5e")
MIDDLE = {CRX: [0.2, 0.3, -0.2, 0.3, -1.2, 0.5], UR: [0.2, -1.3, 1.4, -1.5, -1.2, 0.5]}
Q_NAMES = [f"q_{k}" for k in range(6)]


def moved_to(rotation, shift):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.from_rotvec(rotation).as_matrix(), shift
    return T


X, W = moved_to([0.2, -0.1, 0.4], [0.05, 0.02, 0.08]), moved_to([0.0, 0.3, 2.0], [0.6, 0.1, 0.1])


@pytest.fixture
def rig(tmp_path):
    """Write a rig of an arm at joints q and what is written of them; return what is read."""

    def make(
        arm,
        change=None,
        names=Q_NAMES,
        n=15,
        by_controller=False,
        setup="eye-in-hand",
        noise=(1e-3, 3e-4),
        true=None,
        model=None,
        **asked,
    ):
        rng = np.random.default_rng([SEED, 47])
        q = np.array(MIDDLE[arm]) + rng.uniform(-0.4, 0.4, (n, arm.n_joints))
        q = q if true is None else true(q)
        G = arm.poses(q)
        seen = np.linalg.inv((G if setup == "eye-in-hand" else np.linalg.inv(G)) @ X) @ W
        seen[:, :3, :3] @= Rotation.from_rotvec(noise[0] * rng.normal(size=(n, 3))).as_matrix()
        seen[:, :3, 3] += noise[1] * rng.normal(size=(n, 3))
        write_pose_file(tmp_path / "camera.csv", seen)
        write_pose_file(tmp_path / "robot.csv", G @ moved_to([0, 0, 0.8], [0, 0, 0.1]))
        written = q if change is None else change(q)
        np.savetxt(tmp_path / "joints.csv", written, delimiter=",", header=",".join(names), comments="", fmt="%.8f")
        robot = tmp_path / "robot.csv" if by_controller else None
        poses = read_poses(
            robot,
            tmp_path / "camera.csv",
            joints=tmp_path / "joints.csv",
            kinematics=model or arm,
            setup=setup,
            **asked,
        )
        return q, poses

    return make


def pendant(q):
    """J3 of FANUC's pendant: the forearm's angle from the horizontal, which J2 does not change."""
    shown = q.copy()
    shown[:, 2] -= q[:, 1]
    return shown


def said(poses):
    """Findings but for the note of units that were given."""
    return tuple(finding for finding in poses.findings if finding.code != "poses.units")


def codes(poses):
    return [finding.code for finding in said(poses)]


def test_fanuc_arms_are_found_by_their_names_and_their_axes():
    for name in ("fanuc_m10ia", "crx10ia_l", "lrmate200id", "r2000ic165f", "FANUC LR Mate", "cell_m20id25"):
        assert is_fanuc(replace(CRX, name=name))
    assert not any(map(is_fanuc, (UR, replace(CRX, name="arm"), replace(UR, name="fanuc"))))
    assert may_be_coupled(replace(CRX, name="arm")) and not may_be_coupled(UR)
    q = np.radians([[0.0, 30.0, -30.0, 0.0, 0.0, 0.0]])  # J2 ahead by 30 deg, J3 back by as much: the forearm is level
    np.testing.assert_allclose(uncoupled(pendant(q)), q)
    forearm = CRX.frames(uncoupled(np.radians([[0.0, 30.0, 0.0, 0.0, 0.0, 0.0]])))[0, 3, :3, 2]
    np.testing.assert_allclose(forearm, [-1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize("by_controller", [False, True], ids=["camera", "controller"])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("coupled", [True, False])
def test_joint_3_of_fanuc_is_read_as_the_poses_show(rig, coupled, setup, by_controller):
    q, poses = rig(CRX, pendant if coupled else None, setup=setup, by_controller=by_controller)
    np.testing.assert_allclose(poses.joints, q, atol=1e-7)
    if not by_controller:
        np.testing.assert_allclose(poses.robot, CRX.poses(q), atol=1e-7)
    (finding,) = said(poses)
    assert finding.code == "kinematics.joint_3" and finding.values["coupled"] is coupled
    assert ("joint_3 is read as FANUC's pendant shows it" in str(finding)) is coupled
    assert "--joint-units deg,pendant" in str(finding) and str(finding).startswith("joints.csv: ")


def test_wrong_rows_do_not_hide_the_reading(rig):
    """Three of fifteen joints are of another moment."""

    def with_wrong_rows(q):
        shown = pendant(q)
        shown[[2, 7, 11]] = shown[[5, 1, 13]]
        return shown

    _, poses = rig(CRX, with_wrong_rows)
    assert said(poses)[0].values["coupled"] is True
    _, poses = rig(UR, lambda q: np.concatenate([q[:2], q[3:4], q[3:]]) * [1, 1, -1, 1, 1, 1])
    assert said(poses)[0].values["meant"] == "sign"


def test_joint_3_of_a_fanuc_arm_of_a_urdf(rig):
    arm = replace(CRX, name="fanuc_crx10ia")
    MIDDLE[arm] = MIDDLE[CRX]
    q, poses = rig(arm, pendant)
    np.testing.assert_allclose(poses.joints, q, atol=1e-7)


def test_joint_3_of_an_arm_that_is_not_known_to_be_fanucs_is_named(rig):
    arm = replace(CRX, name="cell")
    MIDDLE[arm] = MIDDLE[CRX]
    q, poses = rig(arm, pendant)
    np.testing.assert_allclose(poses.joints, pendant(q), atol=1e-7)
    assert said(poses)[0].values["meant"] == "coupled" and "--joint-units deg,pendant" in str(said(poses)[0])
    q, poses = rig(arm, pendant, joint_units="rad,pendant")
    np.testing.assert_allclose(poses.joints, q, atol=1e-7)
    assert said(poses) == ()


def test_joint_3_that_is_said_to_be_the_pendants(rig):
    q, poses = rig(CRX, lambda q: np.degrees(pendant(q)), joint_units="deg,pendant")
    np.testing.assert_allclose(poses.joints, q, atol=1e-7)
    assert said(poses) == () and "joint 3 is J3 + J2 of the pendant" in poses.sources[0].notes
    with pytest.raises(uq.InputError, match="pendant: for the six axes of a FANUC arm"):
        rig(UR, joint_units="pendant")
    arm = Kinematics.from_name("lrmate200id")  # whose joint 3 goes from -140 to 213 deg
    MIDDLE[arm] = [0.0, 1.2, -1.2, 0.0, -1.0, 0.0]
    with pytest.raises(uq.InputError, match=r"is it J3 of FANUC's pendant\? Give --joint-units deg,pendant\."):
        rig(arm, lambda q: np.degrees(pendant(q)), joint_units="deg")


def test_joint_3_where_the_poses_do_not_tell(rig):
    """J2 at rest at 0: both readings are the same; what was read stays, and nothing is said."""
    _, poses = rig(CRX, true=lambda q: q * [1, 0, 1, 1, 1, 1])
    assert said(poses) == () and poses.joints[:, 1].max() == 0


@pytest.mark.parametrize(
    ("change", "meant", "words"),
    [
        (lambda q: q * [1, 1, -1, 1, 1, 1], "sign", "joint_3 rotates the other way"),
        (lambda q: q * [1, 1, -1, 1, -1, 1], "sign", "joint_3, joint_5 rotates the other way"),
        (lambda q: q[:, [2, 1, 0, 3, 4, 5]], "order", "joint_3, joint_2, joint_1, joint_4"),
        (lambda q: q[:, [1, 2, 3, 4, 5, 0]], "order", "joint_2, joint_3, joint_4, joint_5, joint_6, joint_1"),
        pytest.param(lambda q: q - [0, np.pi / 2, 0, 0, 0, 0], "zero", "zero of joint joint_2", marks=pytest.mark.slow),
    ],
)
def test_the_reading_that_fits_the_camera_is_named(rig, change, meant, words):
    q, poses = rig(UR, change)
    np.testing.assert_allclose(poses.joints, change(q), atol=1e-7)  # named, not taken
    (finding,) = said(poses)
    assert (finding.code, finding.severity) == ("kinematics.another_reading", "failure")
    assert finding.values["meant"] == meant and words in str(finding)


def test_a_column_in_degrees_is_named(rig):
    """Angles of some degrees are within the limits; larger ones are refused by them."""
    slow = [1, 1, 1, 1, 1, 0.1]
    _, poses = rig(UR, lambda q: np.column_stack([q[:, :5], np.degrees(q[:, 5])]), true=lambda q: q * slow)
    (finding,) = said(poses)
    assert finding.values["meant"] == "column in degrees" and "joint joint_6 is in degrees" in str(finding)
    with pytest.raises(uq.InputError, match=r"joint joint_2: .*; is its column in degrees and the others in radians"):
        rig(UR, lambda q: np.column_stack([q[:, 0], np.degrees(q[:, 1]), q[:, 2:]]))
    irb = Kinematics.from_name("irb120")  # whose joint 3 goes from -110 to 70 deg
    MIDDLE[irb] = [0.2, -0.3, -1.4, 0.5, -1.0, 0.5]
    with pytest.raises(
        uq.InputError, match=r"joint joint_3: .*; has its column the other sign, or is this another arm"
    ):
        rig(irb, lambda q: q * [1, 1, -1, 1, 1, 1])
    panda = Kinematics.from_name("panda")  # whose joint 4 is never positive
    MIDDLE[panda] = [0.0, 0.2, 0.1, -1.9, 0.0, 1.9, 0.5]
    with pytest.raises(
        uq.InputError, match=r"joint joint_4: .*; has its column the other sign, or is this another arm"
    ):
        rig(panda, lambda q: q * [1, 1, 1, -1, 1, 1, 1], [f"q{k}" for k in range(1, 8)])


def test_columns_that_are_shifted_by_one_are_named(rig):
    with pytest.warns(uq.InputWarning, match="'q_0' to 'q_6' are 7 columns"):
        _, poses = rig(UR, lambda q: np.column_stack([np.full(len(q), 0.3), q]), [*Q_NAMES, "q_6"])
    (finding,) = said(poses)
    assert finding.values["meant"] == "columns" and "the columns q_1, q_2, q_3, q_4, q_5, q_6" in str(finding)
    panda = Kinematics.from_name("panda")
    MIDDLE[panda] = [0.0, 0.2, 0.1, -1.9, 0.0, 1.9, 0.5]
    words = r"joint joint_4: .*; the columns 'q_1, q_2, q_3, q_4, q_5, q_6, q_7' are within the limits"
    with pytest.warns(uq.InputWarning, match="8 columns"), pytest.raises(uq.InputError, match=words):
        rig(panda, lambda q: np.column_stack([np.full(len(q), 0.3), q]), [f"q_{k}" for k in range(8)])
    with pytest.warns(uq.InputWarning, match="7 columns"):  # of a gripper
        _, poses = rig(UR, lambda q: np.column_stack([q, np.full(len(q), 0.3)]), [*Q_NAMES, "q_6"])
    assert said(poses) == ()


def test_nothing_is_said_of_joints_that_agree(rig):
    assert codes(rig(UR)[1]) == []
    assert codes(rig(UR, noise=(0.01, 0.01))[1]) == []  # a poor camera


@pytest.mark.slow
def test_nothing_is_said_of_joints_that_nothing_explains(rig):
    assert codes(rig(UR, noise=(0.03, 0.02))[1]) == []  # a poorer camera
    rng = np.random.default_rng(0)
    assert codes(rig(UR, lambda q: rng.permutation(q))[1]) == []  # rows that do not belong together
    arm = Kinematics.from_name("irb120")  # joints of another arm, beside a camera on this one
    MIDDLE[arm] = [0.2, -0.3, 0.4, 0.5, -1.0, 0.5]
    other = np.array(MIDDLE[UR]) + rng.uniform(-0.4, 0.4, (15, 6))
    assert codes(rig(arm, lambda q: other * [1, 0.5, 0.5, 1, 1, 1])[1]) == []


@pytest.mark.parametrize(("given", "true"), [("ur3e", "ur5e"), ("m1013", "ur10e"), ("crx5ia", "crx10ial")])
def test_joints_of_another_arm_of_the_table_are_named(rig, given, true):
    """Arms by the camera alone: all with its kinematics are named."""
    arm = Kinematics.from_name(true)
    MIDDLE[arm] = known_arm(true).usual.mean(axis=1).tolist()
    _, poses = rig(arm, model=Kinematics.from_name(given))
    finding = said(poses)[-1]
    assert finding.values["meant"] == "arm" and true in finding.values["joints"]
    assert f"--robot-model {finding.values['joints'][0]}" in str(finding)
    alike = {"ur5e": ["ur5e", "ur7e"], "ur10e": ["ur10e", "ur12e"], "crx10ial": ["crx10ial", "crx20ial"]}
    assert finding.values["joints"] == alike[true]
