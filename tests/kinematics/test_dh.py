"""Tables of Denavit-Hartenberg parameters and calibrations of Universal Robots arms."""

import os
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import motion

from uq_handeye.errors import InputError
from uq_handeye.model.kinematics.chain import Kinematics

X, Z = np.eye(3)[0], np.eye(3)[2]
# theta, d, a, alpha of a UR5 (standard), in rad and m.
UR5 = np.array(
    [
        [0.0, 0.089159, 0.0, np.pi / 2],
        [0.0, 0.0, -0.425, 0.0],
        [0.0, 0.0, -0.39225, 0.0],
        [0.0, 0.10915, 0.0, np.pi / 2],
        [0.0, 0.09465, 0.0, -np.pi / 2],
        [0.0, 0.0823, 0.0, 0.0],
    ]
)
# The same arm as ur_description has it.
UR5_YAML = """kinematics:
  shoulder: {x: 0, y: 0, z: 0.089159, roll: 0, pitch: 0, yaw: 0}
  upper_arm: {x: 0, y: 0, z: 0, roll: 1.5707963267948966, pitch: 0, yaw: 0}
  forearm: {x: -0.425, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}
  wrist_1: {x: -0.39225, y: 0, z: 0.10915, roll: 0, pitch: 0, yaw: 0}
  wrist_2: {x: 0, y: -0.09465, z: 0, roll: 1.5707963267948966, pitch: 0, yaw: 0}
  wrist_3: {x: 0, y: 0.0823, z: 0, roll: 1.5707963267948966, pitch: 3.141592653589793, yaw: 3.141592653589793}
  hash: calib_1
"""


def standard(rows, q, kinds="RRRRRR"):
    T = np.eye(4)
    for (theta, d, a, alpha), value, kind in zip(rows, q, kinds, strict=True):
        turn, shift = (value, 0.0) if kind == "R" else (0.0, value)
        T = T @ motion((theta + turn) * Z) @ motion(shift=(d + shift) * Z) @ motion(shift=a * X) @ motion(alpha * X)
    return T


def modified(rows, q, kinds):
    T = np.eye(4)
    for (theta, d, a, alpha), value, kind in zip(rows, q, kinds, strict=True):
        turn, shift = (value, 0.0) if kind == "R" else (0.0, value)
        T = T @ motion(alpha * X) @ motion(shift=a * X) @ motion((theta + turn) * Z) @ motion(shift=(d + shift) * Z)
    return T


@pytest.mark.parametrize("kinds", ["RRRR", "RPRP", "PPRR"])
def test_poses_are_those_of_the_convention(rng, kinds):
    rows, q = rng.uniform(-2.0, 2.0, (4, 4)), rng.uniform(-1.0, 1.0, (3, 4))
    names = {"R": "revolute", "P": "prismatic"}
    for convention, reference in (("standard", standard), ("modified", modified)):
        chain = Kinematics.from_dh(rows, convention, kinds=[names[kind] for kind in kinds])
        np.testing.assert_allclose(chain.poses(q), [reference(rows, part, kinds) for part in q], atol=1e-13)
    assert chain.names == ("joint_1", "joint_2", "joint_3", "joint_4")


def test_fixed_rows_names_limits_and_up(rng):
    rows = rng.uniform(-1.0, 1.0, (3, 4))
    chain = Kinematics.from_dh(
        rows, kinds=["fixed", "revolute", "fixed"], names=["f", "turn", "g"], limits=[[0, 0], [-1, 2], [0, 0]], up=X
    )
    assert chain.names == ("turn",) and chain.limits.tolist() == [[-1.0, 2.0]] and chain.up.tolist() == [1, 0, 0]
    np.testing.assert_allclose(chain.poses([0.7]), standard(rows, [0.0, 0.7, 0.0], "RRR"), atol=1e-14)


CSV = """# UR5, DH convention: standard
joint,theta,d [mm],a [mm],alpha [deg],type,lower [deg],upper [deg],offset
pan,q1,89.159,0,90,,-360,360,
lift,*,0,-425,0,revolute,-360,360,0
elbow,0,0,-392.25,0,r,-180,180,0
w1,,109.15,0,90,,,,0
w2,theta_5,94.65,0,-90,,,,0
w3,0,82.3,0,0,continuous,,,0
"""
TOML = """convention = "standard"
name = "ur5"
base = "base"
tip = "tool0"
angle = "deg"
length = "mm"
up = [0.0, 0.0, 1.0]
joints = [
  {name = "pan", d = 89.159, alpha = 90, lower = -360, upper = 360},
  {name = "lift", a = "-425mm", lower = -360, upper = 360},
  {name = "elbow", a = "-0.39225 m", lower = "-180deg", upper = 180},
  {name = "w1", d = 109.15, alpha = "90deg"},
  {name = "w2", d = 94.65, alpha = -90},
  {name = "w3", d = 82.3},
]
"""


@pytest.mark.parametrize(("name", "text"), [("ur5.csv", CSV), ("ur5.toml", TOML), ("ur5.csv", CSV.replace(",", ";"))])
def test_files(rng, tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    chain = Kinematics.from_dh(path)
    assert chain.names == ("pan", "lift", "elbow", "w1", "w2", "w3")
    np.testing.assert_allclose(chain.limits[:4], [[-2 * np.pi, 2 * np.pi]] * 2 + [[-np.pi, np.pi], [-np.inf, np.inf]])
    q = rng.uniform(-3, 3, (4, 6))
    np.testing.assert_allclose(chain.poses(q), Kinematics.from_dh(UR5).poses(q), atol=1e-14)
    np.testing.assert_allclose(chain.poses(q), [standard(UR5, part) for part in q], atol=1e-13)


def test_offsets_and_units_by_argument(tmp_path):
    path = tmp_path / "dh.csv"
    path.write_text(
        "joint,theta [deg],d,a,alpha [deg],type,lower,upper,offset\na,90,10,200,-90,R,-1,1,45\nb,30,10,0,0,P,0,5,5\n"
    )
    chain = Kinematics.from_dh(path, "modified", length="mm")
    np.testing.assert_allclose(chain.limits, [[-np.pi / 180, np.pi / 180], [0.0, 0.005]])
    rows = [[np.deg2rad(135), 0.01, 0.2, -np.pi / 2], [np.deg2rad(30), 0.015, 0.0, 0.0]]
    np.testing.assert_allclose(chain.poses([0.3, 0.1]), modified(rows, [0.3, 0.1], "RP"), atol=1e-14)


def refused(path, text, message, *arguments, **options):
    path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        Kinematics.from_dh(path, *arguments, **options)
    assert "\n" not in str(error.value)


def test_what_is_refused(tmp_path):
    path = tmp_path / "dh.csv"
    body = "joint,theta,d,a,alpha\na,0,0.1,0,1.5\n"
    refused(path, body, "does not say the convention")
    refused(path, "# convention: craig\n" + body, "standard or modified, got 'craig'")
    refused(path, "# convention: modified\n" + body, "is in the modified convention", "standard")
    said = "# convention: standard\n"
    for text, message in (
        ("", "empty"),
        (body.replace("1.5", "90"), r"line 3, alpha: 90 rad is too large; is it in degrees\?"),
        (body.replace("0.1", "100"), r"line 3, d: 100 m is too large; is it in millimetres\?"),
        (body.replace("alpha", "alpha [mm]"), "alpha is an angle, not in mm"),
        (body.replace("alpha", "beta"), "unknown column 'beta'"),
        (body.replace("alpha", "a"), "the column a is given twice"),
        (body.replace(",alpha", ",type"), "missing: alpha"),
        (body.replace("1.5", "x"), "line 3, alpha: expected a number"),
        (body.replace("1.5", "nan"), "finite"),
        (body.replace("1.5", "q1"), "alpha: expected a number"),
        (body.replace("1.5", "1.5,2"), "line 3: expected 5 fields separated by commas, got 6"),
        (body.replace("\na,", "\na\x01,"), "printable"),
        (body + "a,0,0,0,0\n", "two of the name a"),
        (body + "b,0,0,0,0\n" * 200, "at most 128 rows"),
        ("joint,theta,d,a,alpha,type\na,0,0,0,0,ball\n", "expected the type"),
        ("joint,theta,d,a,alpha,type\na,0,0,0,0,fixed\n", "1 to 64 joints"),
        ("joint,theta,d,a,alpha,lower,upper\na,0,0,0,0,-170,170\n", "lower: -170 rad is too large"),
        ("joint,theta,d,a,alpha,lower,upper\na,0,0,0,0,1,-1\n", "line 3: .*lower limit"),
        (body.replace("alpha", "alpha [mm"), "unknown column"),
        (body.replace("theta", "theta [deg]"), "line 3: alpha '1.5' has no unit, and theta is in deg"),
        ("joint,theta,d,a,alpha,type,lower [deg]\na,0,0,0,0,P,1\n", "line 3, lower: expected a length, got '1' deg"),
        (body.replace("1.5", "1" * 5000), "too large|number"),
    ):
        text = f"{said}{text}"
        refused(path, text, message)
    path = tmp_path / "dh.toml"
    for text, message in (
        ("", r"\[\[joints\]\]"),
        ("x = 1", "unknown key 'x'"),
        ("[[joints]]\nd = 0.1", "does not say"),
        ('convention = "standard"\n[[joints]]\nd = "90deg"', r"row 0, d: expected a number or one with a unit \(m"),
        ('convention = "standard"\n[[joints]]\ndd = 1', "unknown field 'dd'"),
        ('convention = "standard"\n[[joints]]\nd = true', "finite number"),
        ('convention = "standard"\n[[joints]]\nname = 3', "printable"),
        ('convention = "standard"\nangle = "mm"\n[[joints]]\nd = 1', "angle unit"),
        ('convention = "standard"\nup = [0, 0]\n[[joints]]\nd = 1', "`up`"),
        ('convention = "standard"\ntip = 3\n[[joints]]\nd = 1', "`tip`"),
        ("convention = 3\n[[joints]]\nd = 1", "convention"),
        ('convention = "standard"\njoints = 4', r"\[\[joints\]\]"),
    ):
        refused(path, text, message)
    with pytest.raises(InputError, match="leave these arguments out"):
        Kinematics.from_dh(path, names=["a"])
    for table in (np.zeros((3, 5)), "nothing.csv", [], [["a", 0, 0, 0]], 3):
        with pytest.raises(InputError):
            Kinematics.from_dh(table)
    with pytest.raises(InputError, match="in degrees"):
        Kinematics.from_dh([[0, 0, 0, 90.0]])
    with pytest.raises(InputError, match="standard or modified"):
        Kinematics.from_dh(UR5, "craig")
    with pytest.raises(InputError, match="joint for each"):
        Kinematics.from_dh(UR5, names=["a"])
    assert Kinematics.from_dh([{"theta": 0, "d": "10mm", "name": "a"}]).names == ("a",)


@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
def test_a_franka_from_its_data_sheet(rng):
    """Modified DH as the maker publishes it, against the URDF of the data set."""
    table = [
        [0, 0.333, 0, 0], [0, 0, 0, -np.pi / 2], [0, 0.316, 0, np.pi / 2], [0, 0, 0.0825, np.pi / 2],
        [0, 0.384, -0.0825, -np.pi / 2], [0, 0, 0, np.pi / 2], [0, 0, 0.088, np.pi / 2], [0, 0.107, 0, 0],
    ]  # fmt: skip
    chain = Kinematics.from_dh(table, "modified", kinds=["revolute"] * 7 + ["fixed"])
    urdf = Kinematics.from_urdf(Path(os.environ["UQ_HANDEYE_DATA"]) / "fr3_philnad" / "model.urdf")
    q = rng.uniform(-2, 2, (10, 7))
    np.testing.assert_allclose(chain.poses(q), urdf.poses(q), atol=1e-10)


# Universal Robots


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "my_calibration.yaml"
    path.write_text(UR5_YAML)
    return path


UR_URDF = """<robot name="ur5"><link name="world"/><link name="base_link"/><link name="inertia"/><link name="l1"/>
<link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/><link name="l6"/><link name="tool0"/>
<joint name="to_world" type="fixed"><parent link="world"/><child link="base_link"/><origin xyz="1 2 3"/></joint>
<joint name="to_inertia" type="fixed"><parent link="base_link"/><child link="inertia"/>
<origin rpy="0 0 3.141592653589793"/></joint>{}
<joint name="to_tool0" type="fixed"><parent link="l6"/><child link="tool0"/><origin xyz="0 0 0.1"/></joint></robot>"""
LINKS = ("inertia", "l1", "l2", "l3", "l4", "l5", "l6")


def ur_urdf(prefix="ur_"):
    from uq_handeye.model.kinematics.descriptions.universal_robots import JOINTS

    return UR_URDF.format(
        "".join(
            f'<joint name="{prefix}{name}" type="revolute"><parent link="{LINKS[k]}"/><child link="{LINKS[k + 1]}"/>'
            '<origin xyz="9 9 9"/><axis xyz="0 0 1"/><limit lower="-3" upper="3"/></joint>'
            for k, name in enumerate(JOINTS.values())
        )
    )


def test_universal_robots(rng, calibration):
    chain = Kinematics.from_ur_calibration(calibration)
    assert chain.names[0] == "shoulder_pan_joint" and chain.names[2] == "elbow_joint"
    assert (chain.base, chain.tip) == ("base", "tool0")
    q = rng.uniform(-3, 3, (5, 6))
    np.testing.assert_allclose(chain.poses(q), Kinematics.from_dh(UR5).poses(q), atol=1e-13)  # as the controller
    other = Kinematics.from_ur_calibration(calibration, base="base_link", tip="flange", prefix="left_")
    turn = motion(np.pi * Z)
    flange = motion(-np.pi / 2 * Z) @ motion(-np.pi / 2 * np.eye(3)[1])
    np.testing.assert_allclose(other.poses(q), turn @ chain.poses(q) @ flange, atol=1e-13)
    assert other.names[0] == "left_shoulder_pan_joint"
    # tool0 behind flange is the frame of the last joint
    np.testing.assert_allclose(flange @ motion(np.pi / 2 * Z) @ motion(np.pi / 2 * X), np.eye(4), atol=1e-15)


def test_universal_robots_in_a_urdf(rng, calibration):
    chain = Kinematics.from_ur_calibration(calibration, ur_urdf(), tip="tool0")
    alone = Kinematics.from_ur_calibration(calibration, base="base_link")
    q = rng.uniform(-3, 3, (5, 6))
    expected = motion(shift=(1, 2, 3)) @ alone.poses(q) @ motion(shift=(0, 0, 0.1))
    np.testing.assert_allclose(chain.poses(q), expected, atol=1e-13)
    assert chain.limits[0].tolist() == [-3.0, 3.0] and chain.names[0] == "ur_shoulder_pan_joint"
    with pytest.raises(InputError, match="expected one joint right_shoulder_pan_joint"):
        Kinematics.from_ur_calibration(calibration, ur_urdf(), prefix="right_")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kinematics:", "transform:", "is it the calibration of a Universal Robots arm"),
        ("  wrist_2:", "  wrist_7:", "expected the field wrist_2"),
        ("roll: 0,", "rol: 0,", "kinematics.shoulder: expected the field roll"),
        ("z: 0.089159", "z: abc", r"kinematics\.shoulder\.z: expected a number"),
        ("z: 0.089159", "z: .nan", "finite"),
        ("z: 0.089159", "z: 89.159", "millimetres"),
        ("roll: 1.5707963267948966", "roll: 90", "degrees"),
        ("kinematics:", "kinematics: &a", "anchors"),
        ("hash: calib_1", "hash: !!python/object/apply:os.system [x]", ""),
    ],
)
def test_damaged_calibrations(calibration, old, new, message):
    calibration.write_text(UR5_YAML.replace(old, new, 1))
    if not message:  # a tag makes nothing
        assert Kinematics.from_ur_calibration(calibration).n_joints == 6
        return
    with pytest.raises(InputError, match=message):
        Kinematics.from_ur_calibration(calibration)


def test_other_frames_need_the_urdf(calibration):
    with pytest.raises(InputError, match="give the URDF for other frames"):
        Kinematics.from_ur_calibration(calibration, base="world")
