"""Arms by name: poses at known joints, reach, and the postures of poses without joints."""

import json
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import random_chain

from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.known_arms import arm_names, known_arm
from uq_handeye.model.kinematics.postures import postures_by_branch
from uq_handeye.model.kinematics.stack import ROLL, SAGS, ArmStack
from uq_handeye.model.kinematics.work_postures import WorkPostures


def test_names_are_found_however_they_are_written():
    for name in ("UR5e", "ur-5e", "UR 5e", "Universal Robots UR5e"):
        assert Kinematics.from_name(name).name == "Universal Robots ur5e"
    assert known_arm("KUKA KR 6 R900 sixx") is known_arm("kr6r900")
    assert known_arm("Franka Emika Panda") is known_arm("panda")
    assert known_arm("FANUC LR Mate 200iD") is known_arm("lrmate200id")
    assert known_arm("FANUC CRX-10iA/L") is known_arm("crx10ial") is not known_arm("crx10ia")
    assert known_arm("Mecademic Meca500 (R3)".replace("(", "").replace(")", "")) is known_arm("meca500")
    assert len(Kinematics.arm_names()) >= 40


@pytest.mark.parametrize(
    ("wrong", "near"), [("ur5f", "ur5e"), ("irb 121", "irb120"), ("pandas", "panda"), ("?", "Known")]
)
def test_an_unknown_name_is_told_with_the_nearest_ones(wrong, near):
    with pytest.raises(InputError, match=near):
        Kinematics.from_name(wrong)


@pytest.mark.parametrize(
    "vague", ["kr10r1100-3", "kr6", "kr 10", "agilus", "LR Mate", "irb2600-20/1.65", "crx20ia", "ur"]
)
def test_a_name_that_may_be_another_arm_is_not_answered_with_one(vague):
    with pytest.raises(InputError, match="Variants of an arm have other lengths"):
        Kinematics.from_name(vague)


def test_the_second_generation_is_not_the_sixx():
    """KR 10 R1100-2: forearm 10 mm lower, flange 10 mm farther."""
    second, sixx = (Kinematics.from_name(name).poses(np.zeros(6)) for name in ("kr10r1100-2", "KR 10 R1100 sixx"))
    np.testing.assert_allclose(1e3 * (second - sixx)[:3, 3], [10, 0, -10], atol=1e-9)


LIBRARIES = json.loads(Path(__file__).with_name("poses_of_libraries.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", LIBRARIES["arms"])
def test_poses_are_those_of_other_libraries(name):
    """FANUC's by crx-kinematics, at joints as the pendant shows them: joint 3 is J3 + J2."""
    of = LIBRARIES["arms"][name]
    q, T = np.array(of["joints"]), np.array(of["poses"])
    if name.startswith("crx"):
        q, T = np.radians(q), T * [1, 1, 1, 1e-3]
        assert np.abs(Kinematics.from_name(name).poses(q)[:, :3] - T).max() > 0.05
        q[:, 2] += q[:, 1]
    np.testing.assert_allclose(Kinematics.from_name(name).poses(q)[:, :3], T, rtol=0, atol=1e-8)


# Joints of TheRobotStudio/SO-ARM100, Simulation/SO101/so101_new_calib.urdf (Apache-2.0): name, parent, child, xyz, rpy.
SO101 = [
    ("shoulder_pan", "base_link", "shoulder_link", "0.0388353 0 0.0624", "3.14159 0 -3.14159"),
    ("shoulder_lift", "shoulder_link", "upper_arm_link", "-0.0303992 -0.0182778 -0.0542", "-1.5708 -1.5708 0"),
    ("elbow_flex", "upper_arm_link", "lower_arm_link", "-0.11257 -0.028 0", "0 0 1.5708"),
    ("wrist_flex", "lower_arm_link", "wrist_link", "-0.1349 0.0052 0", "0 0 -1.5708"),
    ("wrist_roll", "wrist_link", "gripper_link", "0 -0.0611 0.0181", "1.5708 0.0486795 3.14159"),
    ("", "gripper_link", "gripper_frame_link", "-0.0079 -0.000218121 -0.0981274", "0 3.14159 0"),
]


def test_so101_is_its_urdf():
    urdf = "<robot name='so101'><link name='base_link'/>"
    for name, parent, child, xyz, rpy in SO101:
        urdf += f"<link name='{child}'/><joint name='{name or 'tip'}' type='{'revolute' if name else 'fixed'}'>"
        urdf += f"<parent link='{parent}'/><child link='{child}'/><origin xyz='{xyz}' rpy='{rpy}'/>"
        urdf += "<axis xyz='0 0 1'/><limit lower='-1.6' upper='1.6'/></joint>"
    arm = Kinematics.from_urdf(urdf + "</robot>")
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (20, 5))
    np.testing.assert_allclose(Kinematics.from_name("SO-101").poses(q), arm.poses(q), rtol=0, atol=2e-5)


# Position (mm) of the flange at joints (deg): zero postures and heights of the data sheets and published examples.
PUBLISHED = [
    ("ur5e", [0, 0, 0, 0, 0, 0], [-817.2, -232.9, 62.8]),
    ("ur5e", [0, -90, 0, -90, 0, 0], [0.0, -232.9, 1079.4]),
    ("ur10e", [0, 0, 0, 0, 0, 0], [-1184.25, -290.7, 60.85]),
    ("irb120", [0, 0, 0, 0, 0, 0], [374.0, 0.0, 630.0]),
    ("irb2600", [0, 0, 0, 0, 0, 0], [1030.0, 0.0, 1260.0]),
    ("irb4600", [0, 0, 0, 0, 0, 0], [1270.0, 0.0, 1570.0]),
    ("kr6r900", [0, -90, 90, 0, 0, 0], [525.0, 0.0, 890.0]),
    ("iiwa7", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 1266.0]),
    ("iiwa14", [0, 0, 0, 0, 0, 0, 0], [0.0, 0.0, 1306.0]),
    ("panda", [0, 0, 0, 0, 0, 0, 0], [88.0, 0.0, 926.0]),
    ("panda", [0, -45, 0, -135, 0, 90, 45], [306.9, 0.0, 590.3]),
    ("gen3", [0, 0, 0, 0, 0, 0, 0], [0.0, -24.85, 1187.385]),
    ("xarm6", [0, 0, 0, 0, 0, 0], [207.0, 0.0, 112.0]),
    ("xarm7", [0, 0, 0, 0, 0, 0, 0], [206.0, 0.0, 120.5]),
    ("crx10ia", [0, 0, 0, 0, 0, 0], [700.0, -150.0, 540.0]),
    ("tx260", [0, 0, 0, 0, 0, 0], [0.0, 20.0, 670.0]),
    ("meca500", [0, 0, 0, 0, 0, 0], [190.0, 0.0, 308.0]),
]


@pytest.mark.parametrize(("name", "joints", "position"), PUBLISHED)
def test_published_poses(name, joints, position):
    T = Kinematics.from_name(name).poses(np.radians(joints))
    np.testing.assert_allclose(1e3 * T[:3, 3], position, atol=0.11)


def test_the_table_is_that_of_the_published_dh_parameters():
    for name, d1, a2, a3, d4, d5, d6 in (
        ("ur5e", 0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
        ("ur3e", 0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    ):
        quarter = np.pi / 2
        rows = [
            [0, d1, 0, quarter],
            [0, 0, a2, 0],
            [0, 0, a3, 0],
            [0, d4, 0, quarter],
            [0, d5, 0, -quarter],
            [0, d6, 0, 0],
        ]
        q = np.random.default_rng(0).uniform(-3, 3, (20, 6))
        np.testing.assert_allclose(Kinematics.from_name(name).poses(q), Kinematics.from_dh(rows).poses(q), atol=1e-12)
    modified = [  # Craig's theta, d, a, alpha of the maker; the last row is the flange
        [0, 0.333, 0, 0],
        [0, 0, 0, -np.pi / 2],
        [0, 0.316, 0, np.pi / 2],
        [0, 0, 0.0825, np.pi / 2],
        [0, 0.384, -0.0825, -np.pi / 2],
        [0, 0, 0, np.pi / 2],
        [0, 0, 0.088, np.pi / 2],
        [0, 0.107, 0, 0],
    ]
    dh = Kinematics.from_dh(modified, "modified", kinds=["revolute"] * 7 + ["fixed"])
    q = np.random.default_rng(0).uniform(-1, 1, (20, 7))
    np.testing.assert_allclose(Kinematics.from_name("panda").poses(q), dh.poses(q), atol=1e-12)


# Reach (m) of the wrist's centre or the flange of the data sheets, from the axis of joint 1, straight out.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "reach", "behind"),
    [("irb120", 0.58, 0.072), ("irb1200", 0.901, 0.082), ("irb2600", 1.653, 0.085), ("kr6r900", 0.901, 0.08),
     ("lrmate200id", 0.717, 0.08), ("gp7", 0.927, 0.08), ("m10ia", 1.42, 0.1), ("crx10ia", 1.249, 0.0)],
)  # fmt: skip
def test_reach_of_the_data_sheets(name, reach, behind):
    """The farthest point of the axis from joint 1 is the reach of the wrist plus the flange's distance from it."""
    arm = Kinematics.from_name(name)
    q = np.random.default_rng(0).uniform(*arm.limits.T, (200_000, arm.n_joints))
    wrist = arm.frames(q[:50_000])[:, 4, :3, 3] if behind else arm.poses(q)[:, :3, 3]
    found = np.linalg.norm(wrist[:, :2], axis=1).max()
    assert 0.97 * reach < found < 1.012 * reach


@pytest.mark.parametrize("name", [name for name in arm_names() if len(known_arm(name).usual) > 5])
def test_the_stack_is_the_chain(name):
    """Poses and columns of an arm in a stack are those of its `Kinematics`."""
    arms = [known_arm(name), known_arm("panda")]
    stack, chain = ArmStack.of(arms), Kinematics.from_name(name)
    q = np.random.default_rng(0).uniform(*chain.limits.T, (5, chain.n_joints))
    seven = q if q.shape[1] == 7 else np.insert(q, ROLL, 0.0, axis=1)
    at = np.stack([seven.T, np.zeros((7, 5))])
    frames, reach = stack.frames(at), stack.reach[0]
    np.testing.assert_allclose(
        np.moveaxis(frames.tip[0], -1, 0) * [1, 1, 1, reach], chain.poses(q)[:, :3], rtol=0, atol=1e-12
    )
    F = np.moveaxis(stack.columns(at, frames)[0], -1, 0).swapaxes(1, 2).copy()
    F[:, 3:] *= reach
    F[..., 21:42] /= reach
    k = np.flatnonzero(stack.moves[0])
    order = [
        *(3 * k + 2),
        *np.concatenate([[3 * i, 3 * i + 1] for i in k]),
        *np.concatenate([21 + 3 * i + np.arange(3) for i in k]),
        *np.concatenate([42 + 4 * i + np.arange(4) for i in k]),
        *(SAGS.start + k),
    ]
    wanted = chain.columns(q)
    sag = wanted.shape[-1] - len(k)
    np.testing.assert_allclose(F[..., order][..., :sag], wanted[..., :sag], atol=1e-12)
    np.testing.assert_allclose(F[..., order][..., sag:], wanted[..., sag:], atol=0.03)  # largest load of fewer postures


def cluster(name, rng, n=40, width=0.4):
    arm = known_arm(name)
    centre = arm.usual.mean(axis=1) + rng.uniform(-0.1, 0.1, len(arm.usual))
    return centre + rng.uniform(-width, width, (n, len(centre)))


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in arm_names() if len(known_arm(name).usual) == 6])
def test_the_joints_of_a_cluster_of_poses_are_found(name):
    q = cluster(name, np.random.default_rng(3))
    chain = Kinematics.from_name(name)
    found = postures_by_branch(chain, chain.poses(q))
    assert found.reached.all()
    same = np.abs((found.q - q + np.pi) % (2 * np.pi) - np.pi).max(axis=1) < 1e-6
    assert same.mean() >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["irb120", "ur5e", "crx10ia", "m1013", "tx260"])
def test_the_branch_of_an_arm_that_is_not_in_the_table(name):
    """The order of the poses changes nothing."""
    arm = known_arm(name).parts
    joints = list(arm.joints)
    moved = joints[1].origin.copy()
    moved[2, 3] += 1e-3
    joints[1] = type(joints[1])("two", "revolute", moved, joints[1].axis, joints[1].lower, joints[1].upper)
    joints[2] = type(joints[2])(
        "three", "revolute", joints[2].origin + 1e-3 * np.eye(4, k=3), joints[2].axis, -3.1, 3.1
    )
    chain = Kinematics("mine", "base", "tip", tuple(joints), arm.end)
    q = cluster(name, np.random.default_rng(4))
    poses = chain.poses(q)
    found = postures_by_branch(chain, poses)
    assert found.reached.all()
    # one branch: neighbours in pose are neighbours in joint values
    change = np.linalg.norm(found.q - found.q.mean(axis=0), axis=1)
    assert change.max() < 3.0 * np.linalg.norm(q - q.mean(axis=0), axis=1).max()
    order = np.random.default_rng(0).permutation(len(q))
    np.testing.assert_allclose(postures_by_branch(chain, poses[order]).q, found.q[order], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "iiwa14", "gen3", "xarm7"])
def test_the_elbow_of_seven_axes_stays_near_its_usual_roll(name):
    q = cluster(name, np.random.default_rng(5), width=0.3)
    q[:, 2] = known_arm(name).usual[2].mean()
    chain = Kinematics.from_name(name)
    found = postures_by_branch(chain, chain.poses(q))
    assert found.reached.all()
    assert np.abs(found.q[:, 2] - q[:, 2]).max() < 0.7


@pytest.mark.parametrize("kinds", ["PRRRRRR", "RRRRRRRR", "RRP"])
def test_other_chains(kinds):
    chain = random_chain(np.random.default_rng(2), kinds)
    q = np.random.default_rng(3).uniform(-0.2, 0.2, (10, len(kinds)))
    found = postures_by_branch(chain, chain.poses(q))
    np.testing.assert_allclose(chain.poses(found.q)[found.reached], chain.poses(q)[found.reached], atol=1e-6)
    assert found.reached.mean() > 0.6


@pytest.mark.slow
def test_a_pose_out_of_reach_is_told_and_three_poses_are_enough():
    chain = Kinematics.from_name("ur5e")
    poses = chain.poses(cluster("ur5e", np.random.default_rng(0), n=3))
    poses[1, :3, 3] *= 5
    assert postures_by_branch(chain, poses).reached.tolist() == [True, False, True]


def test_stored_postures_stay_in_the_usual_ranges():
    arms = [known_arm("irb120"), known_arm("panda")]
    work = WorkPostures.of(ArmStack.of(arms))
    poses = Kinematics.from_name("irb120").poses(cluster("irb120", np.random.default_rng(1)))[:, :3]
    poses[..., 3] /= 0.7
    q, _, reached = work.find(poses)
    assert reached.mean() > 0.8
    assert (q >= work.low).all() and (q <= work.high).all()
