"""URDF files: chains out of them, and what is refused, by name."""

import os
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from pytransform3d.urdf import UrdfTransformManager

from uq_handeye.errors import InputError
from uq_handeye.formats.csv_poses import read_pose_file
from uq_handeye.model.kinematics.chain import Kinematics

needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")

# One joint; {0} is inside <joint>, {1} beside it, {2} the type.
ONE = """<robot name="one"><link name="a"/><link name="b"/>
<joint name="hinge" type="{2}"><parent link="a"/><child link="b"/>{0}</joint>{1}</robot>"""


def one(inside="", beside="", kind="revolute"):
    return ONE.format(inside, beside, kind)


def by_pytransform3d(text, chain, q):
    manager = UrdfTransformManager(check=False)
    manager.load_urdf(text)
    found = []
    for posture in q:
        for name, value in zip(chain.names, posture, strict=True):
            manager.set_joint(name, value)
        found.append(manager.get_transform(chain.tip, chain.base))
    return np.array(found)


@pytest.mark.parametrize(("base", "tip"), [("base_link", "tool0"), ("base", "flange"), ("l2", "l5"), (None, "l3")])
def test_poses_are_those_of_pytransform3d(rng, base, tip):
    chain = Kinematics.from_urdf(SIX_AXES, base, tip)
    low, high = np.clip(chain.limits, -3.0, 3.0).T
    q = rng.uniform(low, high, (4, chain.n_joints))
    np.testing.assert_allclose(chain.poses(q), by_pytransform3d(SIX_AXES, chain, q), atol=1e-12)
    assert (chain.base, chain.tip) == (base or "base_link", tip)


def test_angles_prismatic_joints_and_fixed_joints_between(rng):
    text = one(
        '<origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 2.6"/><axis xyz="1 -2 0.5"/><limit lower="-0.1" upper="0.4"/>',
        '<link name="c"/><joint name="plate" type="fixed"><parent link="b"/><child link="c"/>'
        '<origin rpy="1 2 3"/></joint>'
        '<link name="d"/><joint name="spin" type="continuous"><parent link="c"/><child link="d"/>'
        '<origin xyz="1e-1 0 0.5"/><limit lower="-1" upper="1"/></joint>',
        "prismatic",
    )
    chain = Kinematics.from_urdf(text)
    assert [(joint.name, joint.kind) for joint in chain.joints] == [("hinge", "prismatic"), ("spin", "revolute")]
    np.testing.assert_array_equal(chain.limits, [[-0.1, 0.4], [-np.inf, np.inf]])
    np.testing.assert_array_equal(chain.joints[1].axis, [1.0, 0.0, 0.0])  # as the format says
    q = np.column_stack([rng.uniform(-0.1, 0.4, 5), rng.uniform(-1, 1, 5)])
    np.testing.assert_allclose(chain.poses(q), by_pytransform3d(text, chain, q), atol=1e-12)


@needs_data
@pytest.mark.parametrize(
    ("folder", "tolerance"),
    [
        ("fr3_philnad", 1e-10),
        ("industrial_kinematic", 1e-10),
        ("recode_dvrk_points", 1e-10),
        ("mukca_panda/panda_3", 1e-3),  # m; poses that the controller read an instant later
    ],
)
def test_real_arms(folder, tolerance):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / folder
    model = folder / "model.urdf" if (folder / "model.urdf").exists() else folder.parent / "model.urdf"
    chain = Kinematics.from_urdf(model)
    table = np.genfromtxt(folder / "joints.csv", delimiter=",", names=True)
    times, poses = read_pose_file(folder / "robot.csv")
    q = np.column_stack([table[name] for name in chain.names])[np.searchsorted(table["timestamp"], times)]
    error = np.abs(chain.poses(q) - poses)
    assert error[:, :3, 3].max() < tolerance and np.median(error.max(axis=(1, 2))) < 0.2 * tolerance
    few = q[:5]
    np.testing.assert_allclose(chain.poses(few), by_pytransform3d(model.read_text(), chain, few), atol=1e-12)


def test_files_and_texts(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_bytes(b"\xef\xbb\xbf" + SIX_AXES.encode())
    assert Kinematics.from_urdf(path, tip="tool0").names == Kinematics.from_urdf(SIX_AXES, tip="tool0").names
    assert Kinematics.from_urdf(str(path), tip="l2").n_joints == 2
    path.write_text("<robot><link name='a'/></robot>")
    with pytest.raises(InputError, match=r"arm\.urdf"):
        Kinematics.from_urdf(path)
    with pytest.raises(InputError, match="no such file"):
        Kinematics.from_urdf(tmp_path / "none.urdf")


def test_ends_that_are_left_out():
    assert Kinematics.from_urdf(SIX_AXES).tip == "tool0"  # the link `base` does not move
    gripper = "".join(
        f'<link name="{side}"/>'
        f'<joint name="j_{side}" type="fixed"><parent link="flange"/><child link="{side}"/></joint>'
        for side in ("left", "right")
    )
    text = SIX_AXES.replace("</robot>", f"{gripper}</robot>")
    with pytest.raises(InputError, match=r"several ends, 'tool0', .*give the tip; usual is tool0"):
        Kinematics.from_urdf(text)
    assert Kinematics.from_urdf(text, tip="left").n_joints == 6


def test_limits_that_are_not_there():
    for limit in ("", '<limit effort="1" velocity="1"/>', '<limit lower="0" upper="0"/>'):
        np.testing.assert_array_equal(Kinematics.from_urdf(one(limit)).limits, [[-np.inf, np.inf]])


def test_what_does_not_matter():
    """Mimic joints off the path, transmissions with joints of their own, other elements, a namespace of xacro."""
    beside = (
        '<link name="c"/><joint name="finger" type="prismatic"><parent link="b"/><child link="c"/>'
        '<mimic joint="hinge"/></joint><link name="d"/>'
        '<joint name="drop" type="floating"><parent link="a"/><child link="d"/></joint>'
        '<transmission name="t"><joint name="hinge"><hardwareInterface>x</hardwareInterface></joint></transmission>'
        '<gazebo reference="b"><joint name="hinge"/></gazebo><material name="hinge"/>'
    )
    text = one(beside=beside).replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    assert Kinematics.from_urdf(text, tip="b").names == ("hinge",)
    with pytest.raises(InputError, match="'finger' mimics 'hinge'"):
        Kinematics.from_urdf(text, tip="c")


LOOP = (
    '<link name="c"/><joint name="up" type="fixed"><parent link="b"/><child link="c"/></joint>'
    '<joint name="back" type="fixed"><parent link="c"/><child link="a"/></joint>'
)


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (one(kind="floating"), {"tip": "b"}, "joint 'hinge' is of the type 'floating'"),
        (one(kind="planar"), {"tip": "b"}, "'planar'"),
        (one(kind=""), {"tip": "b"}, "is of the type ''"),
        (one("<mimic joint='x'/>"), {}, "'hinge' mimics 'x'"),
        (one(kind="fixed"), {}, "no link moves"),
        (one(kind="fixed"), {"tip": "b"}, "no joint moves between 'a' and 'b'"),
        (one(), {"tip": "a"}, "no joint moves"),
        (one(), {"base": "b", "tip": "a"}, "'hinge', which moves, leads up"),
        (one(), {"tip": "bb"}, "no link 'bb' for the tip; nearest: 'b'"),
        (SIX_AXES, {"base": "baselink"}, "nearest: 'base_link'"),
        (SIX_AXES, {"tip": "axis_6"}, "for the tip"),
        (SIX_AXES, {"tip": 3}, "no link '3'"),
        (one(beside=LOOP), {}, "loop"),
        (one(beside=LOOP), {"base": "a", "tip": "b"}, "loop"),
        (
            one(beside='<joint name="two" type="fixed"><parent link="a"/><child link="b"/></joint>'),
            {},
            "'hinge', 'two' lead to the same link 'b'",
        ),
        (one(beside='<link name="c"/>'), {}, "one root link, got 'a', 'c'"),
        (one(beside='<link name="c"/>'), {"base": "c", "tip": "b"}, "not connected"),
        (one("<axis xyz='0 0 0'/>"), {}, "axis of joint 'hinge' is zero"),
        (one("<axis xyz='0 nan 1'/>"), {}, "finite numbers as xyz of <axis> of joint 'hinge', got 'nan'"),
        (one("<axis xyz='0 1'/>"), {}, "3 numbers"),
        (one("<origin xyz='0 0 1_0'/>"), {}, "got '1_0'"),
        (one("<origin xyz='0 0 inf'/>"), {}, "got 'inf'"),
        (one("<origin xyz='0 0 333'/>"), {}, "millimetres"),
        (one("<origin rpy='0 0 1e400'/>"), {}, "finite"),
        (one("<limit lower='2' upper='1'/>"), {}, "reversed"),
        (one("<limit lower='x' upper='1'/>"), {}, "got 'x'"),
        (one("<origin/><origin/>"), {}, "two <origin>"),
        (one(beside='<link name="a"/>'), {}, "two links of the name 'a'"),
        (one(beside='<joint name="hinge"><parent link="a"/><child link="b"/></joint>'), {}, "two joints of the name"),
        (one(beside='<joint name="x"><parent link="a"/></joint>'), {}, "no <child>"),
        (one(beside='<joint name="x"><parent link="a"/><child link="c"/></joint>'), {}, "'c', which is not in"),
        (one(beside="<joint/>"), {}, "expected a name"),
        (one(beside='<joint name="x"><parent/></joint>'), {}, "expected a link"),
        (one("<origin xyz='0 0 ${d}'/>"), {}, "run xacro first"),
        (one(beside="<xacro:include filename='x'/>"), {}, "run xacro first"),
        ("<sdf><model/></sdf>", {}, "starts with <robot>, got <sdf>"),
        ("<robot/>", {}, "no links"),
        ("<robot", {}, "not XML"),
        ("<robot><link name='a'></robot>", {}, "not XML"),
        (one("<axis xyz='0 0 1'/>").replace("hinge", "a&#10;b"), {}, "printable"),
    ],
)  # fmt: skip
def test_what_is_refused(text, arguments, message):
    with pytest.raises(InputError, match=message) as error:
        Kinematics.from_urdf(text, **arguments)
    assert "\n" not in str(error.value) and len(str(error.value)) < 500


@pytest.mark.slow
def test_hostile_files(tmp_path):
    bomb = "".join(f'<!ENTITY b{k} "{f"&b{k - 1};" * 10}">' for k in range(1, 9))
    for document_type in (
        f'<!DOCTYPE robot [<!ENTITY b0 "lol">{bomb}]>',
        '<!DOCTYPE robot [<!ENTITY file SYSTEM "file:///etc/passwd">]>',
        '<!DOCTYPE robot SYSTEM "http://localhost/x.dtd">',
    ):
        for text in (document_type + one(), '<?xml version="1.0"?>\n' + document_type + one().replace("hinge", "&b8;")):
            with pytest.raises(InputError, match="without a document type or entities"):
                Kinematics.from_urdf(text)
    deep = "<robot>" + "<a>" * 100_000 + "</a>" * 100_000 + "</robot>"
    with pytest.raises(InputError, match="levels"):
        Kinematics.from_urdf(deep)
    with pytest.raises(InputError, match="MB"):
        Kinematics.from_urdf("<robot>" + " " * 20_000_001)
    many = "".join(
        f'<link name="m{k}"/><joint name="j{k}" type="revolute"><parent link="{"b" if k == 0 else f"m{k - 1}"}"/>'
        f'<child link="m{k}"/></joint>'
        for k in range(3000)
    )
    with pytest.raises(InputError, match="1 to 64 joints"):
        Kinematics.from_urdf(one(beside=many))
    path = tmp_path / "arm.urdf"
    for data in (b"", b"\0\1\2", b"<robot \xff\xfe/>", "<robot/>".encode("utf-16")):
        path.write_bytes(data)
        with pytest.raises(InputError):
            Kinematics.from_urdf(path)
    xacro = tmp_path / "arm.urdf.xacro"
    xacro.write_text(one())
    with pytest.raises(InputError, match="run xacro first"):
        Kinematics.from_urdf(xacro)
