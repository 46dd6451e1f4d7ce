"""Files of joint values: columns by name, units, limits, and what is refused."""

import json
import os
import re
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from fixtures.pages import DOCS

from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.kinematics.chain import Joint, Kinematics
from uq_handeye.model.kinematics.joints_file import NamedJoints, read_joints

# A revolute joint, an elbow that does not reach 0, and a slide.
ARM = Kinematics(
    "arm",
    "base",
    "tip",
    (
        Joint("shoulder", "revolute", np.eye(4), [0, 0, 1], -3.0, 3.0),
        Joint("elbow", "revolute", np.eye(4), [0, 1, 0], -2.8, -0.2),
        Joint("slide", "prismatic", np.eye(4), [0, 0, 1], 0.0, 0.4),
    ),
    np.eye(4),
)
Q = np.array([[0.1, -1.0, 0.2], [1.2, -0.5, 0.3], [-2.0, -2.5, 0.0]])
TIMES = np.array([10.0, 10.5, 11.0])


def table(header, columns, separator=","):
    rows = np.column_stack(columns).tolist()
    return "\n".join([header, *(separator.join(map(repr, row)) for row in rows), ""])


@pytest.fixture
def read(tmp_path):
    def reader(content, arm=ARM, units=None):
        path = tmp_path / "joints.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_joints(path, arm, units)

    return reader


def test_an_arm_without_names_of_its_joints_takes_one_numbered_series(read):
    """Every driver has its own names, and those of the table of arms and of DH parameters are ours."""
    arm, columns = ["joint_1", "joint_2", "joint_3"], [TIMES, Q[:, 1], Q[:, 0], Q[:, 2]]
    for header in (
        "timestamp,fr3_joint2,fr3_joint1,fr3_joint3",
        "timestamp,J2,J1,J3",
        "t,q2_deg,q1_deg,q3_deg",
        "timestamp,joint_2_l,joint_1_s,joint_3_u",
        "timestamp,meca_axis_2_joint,meca_axis_1_joint,meca_axis_3_joint",
    ):
        unit = np.radians(1.0) if "deg" in header else 1.0
        found = read(table(header, [TIMES, *(column / unit for column in columns[1:])]), arm)
        np.testing.assert_allclose(found.q, Q, rtol=1e-12)
        assert "columns by the numbers of the joints" in found.notes
    for header, words in (
        ("q1,q2,q3,j1,j2,j3", "from 'q1' and 'j1' on may both be the joints"),
        ("a,b,c,d,e,f", "no column of joint joint_1"),
        ("q1,q2,q4,q5,q6,q7", "no column of joint joint_1"),
        ("q1,q1,q2,q3,x,y", "one column of joint joint_1, got 'q1, q1'"),
    ):
        with pytest.raises(InputError, match=words):
            read(table(header, np.hstack([Q, Q]).T), arm)


def test_joints_with_names_of_their_own_take_a_vector_of_joint_values(read):
    found = read(table("actual_q_0,actual_q_1,actual_q_2", Q.T), ["pan", "lift", "elbow"])
    np.testing.assert_array_equal(found.q, Q)
    for header in ("joint1,joint2,joint3", "target_q_0,target_q_1,target_q_2", "x1,x2,x3"):
        with pytest.raises(InputError, match="no column of joint pan"):
            read(table(header, Q.T), ["pan", "lift", "elbow"])


SIX = Q.ravel()[None, :6] * [[1.0], [0.5]]


@pytest.mark.parametrize(
    "header",
    [
        "q_0,q_1,q_2,q_3,q_4,q_5",
        "q[0],q[1],q[2],q[3],q[4],q[5]",
        "/joint_states/position[0],/joint_states/position[1],/joint_states/position[2],/joint_states/position[3],"
        "/joint_states/position[4],/joint_states/position[5]",
        "joint_0,joint_1,joint_2,joint_3,joint_4,joint_5",
    ],
)
def test_a_series_with_the_number_0_begins_there(read, header):
    found = read(table(header, SIX.T), Kinematics.from_name("ur5e"))
    np.testing.assert_array_equal(found.q, SIX)
    assert f"columns by the numbers of the joints, counted from 0: {header.partition(',')[0]} is joint 1" in found.notes


def test_seven_columns_of_six_axes_are_not_read_shifted_by_one_without_a_word(read):
    """q_0 to q_6: of seven axes, or with a gripper; six axes take the first six, and a warning says so."""
    seven = np.column_stack([SIX, [0.7, 0.8]])
    header = ",".join(f"q_{k}" for k in range(7))
    with pytest.warns(InputWarning, match="'q_0' to 'q_6' are 7 columns, and the arm has 6 joints: 'q_0' is read as"):
        found = read(table(header, seven.T), Kinematics.from_name("ur5e"))
    np.testing.assert_array_equal(found.q, SIX)
    with pytest.warns(InputWarning, match="'joint_0' to 'joint_6' are 7 columns"):
        found = read(table(header.replace("q_", "joint_"), seven.T), Kinematics.from_name("irb120"))
    np.testing.assert_array_equal(found.q, SIX)


def test_names_of_drivers(read):
    """A JointState is often in the alphabetical order of the names."""
    arm = Kinematics.from_name("ur5e")
    header = "elbow_joint,shoulder_lift_joint,shoulder_pan_joint,wrist_1_joint,wrist_2_joint,wrist_3_joint"
    for prefix in ("", "left_", "ur5e_"):
        names = ",".join(prefix + name for name in header.split(","))
        found = read(table(names, SIX[:, [2, 1, 0, 3, 4, 5]].T), arm)
        np.testing.assert_array_equal(found.q, SIX)
        assert "columns by the names of the joints of Universal Robots" in found.notes
    of_topic = NamedJoints(
        "/joint_states in cell.mcap", tuple(header.split(",")), TIMES[:2], SIX[:, [2, 1, 0, 3, 4, 5]]
    )
    np.testing.assert_array_equal(read_joints(of_topic, arm).q, SIX)
    found = read(table("S,L,U,R,B,T", 10 * SIX.T), Kinematics.from_name("gp7"), "deg")
    np.testing.assert_allclose(found.q, np.radians(10 * SIX))
    found = read(
        table("joint_1_s,joint_2_l,joint_3_u,joint_4_r,joint_5_b,joint_6_t", SIX.T), Kinematics.from_name("gp7")
    )
    np.testing.assert_array_equal(found.q, SIX)
    for name, names in (("irb120", header), ("ur5e", "S,L,U,R,B,T"), ("panda", header)):
        with pytest.raises(InputError, match=r"are those of the 6 joints of .* and the arm .* is another one"):
            read(table(names, SIX.T), Kinematics.from_name(name))


def test_a_recording_of_ur_rtde_has_targets_velocities_and_poses_beside_the_joints(read):
    arm, parts = (
        Kinematics.from_name("ur5e"),
        ("actual_q", "actual_qd", "target_q", "actual_TCP_pose", "actual_current"),
    )
    header = "timestamp," + ",".join(f"{part}_{k}" for part in parts for k in range(6))
    found = read(table(header, [TIMES[:2], *SIX.T, *np.full((24, 2), 9.0)]), arm)
    np.testing.assert_array_equal(found.q, SIX)
    np.testing.assert_array_equal(found.timestamps, TIMES[:2])
    spaces = table(header.replace(",", " "), [TIMES[:2], *SIX.T, *np.full((24, 2), 9.0)], " ")
    np.testing.assert_array_equal(read(spaces, arm).q, SIX)


def test_columns_by_name_in_any_order(read):
    found = read(table("timestamp,slide,extra,shoulder,elbow", [TIMES, Q[:, 2], Q[:, 0], Q[:, 0], Q[:, 1]]))
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_array_equal(found.timestamps, TIMES)
    assert found.notes == ("columns sorted by the names of the joints", "not used: the columns 'extra'")
    plain = read(table("shoulder,elbow,slide", Q.T))
    np.testing.assert_array_equal(plain.q, Q)
    assert plain.timestamps is None and plain.notes == ("no timestamp column",)
    names = read(table("b;a", [Q[:, 0], Q[:, 1]], ";"), ["a", "b"])
    np.testing.assert_array_equal(names.q, Q[:, 1::-1])


@pytest.mark.parametrize(
    ("header", "units"),
    [
        ("shoulder [deg],elbow (deg),slide [mm]", None),
        ("shoulder_deg,elbow_deg,slide_mm", None),
        ("shoulder_deg,elbow_deg,slide_mm", "deg"),
        ("shoulder,elbow,slide", "deg,mm"),
        ("shoulder [deg],elbow,slide_mm", "deg"),
    ],
)
def test_units(read, header, units):
    found = read(table(header, [np.rad2deg(Q[:, 0]), np.rad2deg(Q[:, 1]), 1e3 * Q[:, 2]]), units=units)
    np.testing.assert_allclose(found.q, Q, atol=1e-15)
    assert "revolute joints in deg" in found.notes and "prismatic joints in mm" in found.notes


@pytest.mark.parametrize(
    "header",
    [
        "%time,/joint_states/shoulder/position,/joint_states/elbow/position,/joint_states/slide/position",
        "time_ns,position/shoulder,position/elbow,position/slide",
        "stamp [ns],shoulder.pos,elbow.pos,slide.pos",
        "__time [ns],shoulder.position [rad],elbow_rad,slide [m]",
    ],
)
def test_names_of_other_tools(read, header):
    more = ",/joint_states/shoulder/velocity,/joint_states/elbow/effort,shoulder.vel"
    found = read(table(header + more, [1e9 * TIMES, *Q.T, *(9 + Q.T)]))
    np.testing.assert_array_equal(found.q, Q)
    np.testing.assert_allclose(found.timestamps, TIMES)


def test_rows_with_names_of_their_own(read):
    """Rows as ``rostopic echo -p`` writes a JointState, whose order may change."""
    header = "%time,field.header.seq,field.name0,field.name1,field.name2,field.name3," + ",".join(
        f"field.position{k}" for k in range(4)
    )
    rows = [
        f"10000000000,0,elbow,slide,other,shoulder,{Q[0, 1]},{Q[0, 2]},77,{Q[0, 0]}",
        f"10500000000,1,shoulder,other,elbow,slide,{Q[1, 0]},77,{Q[1, 1]},{Q[1, 2]}",
    ]
    found = read("\n".join([header, *rows]).replace("other", "the_other_joint"))
    np.testing.assert_array_equal(found.q, Q[:2])
    np.testing.assert_allclose(found.timestamps, TIMES[:2])
    assert "joints sorted by the names in each row" in found.notes
    with pytest.raises(InputError, match=r"line 2: no column of joint shoulder; nearest: 'shuolder'"):
        read("\n".join([header, rows[0].replace("shoulder", "shuolder")]))
    with pytest.raises(InputError, match="elbow is named twice"):
        read("\n".join([header, rows[0].replace("other", "elbow")]))


def test_headers_in_comments_byte_order_marks_and_decimal_commas(read):
    found = read(b"\xef\xbb\xbf# recorded\r\n# shoulder, elbow, slide\r\n0.1,-1.0,0.2\r\n\r\n")
    np.testing.assert_array_equal(found.q, Q[:1])
    found = read('"shoulder";"elbow";"slide"\n0,1;-1,0;0,2\n')
    np.testing.assert_array_equal(found.q, Q[:1])


def test_arrays(tmp_path):
    path = tmp_path / "q.npy"
    np.save(path, Q)
    found = read_joints(path, ARM)
    np.testing.assert_array_equal(found.q, Q)
    assert found.notes == ("columns in the order of the arm",)
    path = tmp_path / "q.npz"
    degrees = np.column_stack([Q[:, 2], np.rad2deg(Q[:, 1]), np.rad2deg(Q[:, 0])])
    np.savez(path, joints=degrees, names=["slide", "elbow", "shoulder"], timestamps=TIMES)
    found = read_joints(path, ARM, "deg")
    np.testing.assert_allclose(found.q, Q, atol=1e-15)
    np.testing.assert_array_equal(found.timestamps, TIMES)
    for arrays, message in (
        ({"z": Q}, "array q"),
        ({"q": Q[:, :2]}, r"\(n, 3\), got \(3, 2\)"),
        ({"q": Q, "timestamps": TIMES[:2]}, "a time for each"),
        ({"q": Q, "names": ["slide", "elbow", "x"]}, "no column of joint shoulder"),
        ({"q": np.array([["a"]])}, "numbers"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError, match=message):
            read_joints(path, ARM)
    np.save(tmp_path / "o.npy", np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match="Python objects"):
        read_joints(tmp_path / "o.npy", ARM)


def test_degrees_read_as_radians_are_refused(read):
    degrees = [np.rad2deg(Q[:, 0]), np.rad2deg(Q[:, 1]), Q[:, 2]]
    with pytest.raises(InputError, match=r"line 2, joint shoulder: .*in degrees\? Give --joint-units deg"):
        read(table("shoulder,elbow,slide", degrees))
    with pytest.raises(InputError, match=r"in millimetres\? Give --joint-units mm"):
        read(table("shoulder,elbow,slide", [Q[:, 0], Q[:, 1], 1e3 * Q[:, 2]]))
    with pytest.raises(InputError, match=r"elbow: .*in radians\? Give --joint-units rad"):
        read(table("shoulder,elbow,slide", Q.T), units="deg")
    endless = Kinematics("a", "b", "c", (Joint("spin", "revolute", np.eye(4), [0, 0, 1]),), np.eye(4))
    with pytest.raises(InputError, match="in degrees"):
        read("spin\n45.0\n", endless)
    assert read("spin\n45.0\n", endless, "rad").q[0, 0] == 45.0
    with pytest.warns(InputWarning, match=r"joints\.csv: all joints stay within 1\.2 deg of zero.*radians"):
        read("spin [deg]\n0.5\n1.2\n-0.3\n", endless)


def test_limits(read):
    q = Q.copy()
    q[1, 0] = 3.02
    with pytest.warns(InputWarning, match=r"line 3, joint shoulder: 3\.02 rad \(173 deg\) is outside -3 to 3 rad"):
        read(table("shoulder,elbow,slide", q.T))
    q[1, 0] = 3.2
    with pytest.raises(InputError, match=r"line 3, joint shoulder: 3\.2 rad .* is this the arm of the URDF"):
        read(table("shoulder,elbow,slide", q.T))
    q[1] = 0.0, -1.0, 0.6
    with pytest.raises(InputError, match=r"joint slide: 0\.6 m is outside 0 to 0\.4 m"):
        read(table("shoulder,elbow,slide", q.T))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "empty"),
        ("shoulder,elbow,slide\n", "no rows"),
        ("0.1,-1.0,0.2\n", "got numbers; add it as the first line: 'shoulder, elbow, slide'"),
        ("sholder,elbow,slide\n0,0,0\n", "no column of joint shoulder; nearest: 'sholder'"),
        ("name0,position1\nelbow,-1\n", "no column of joint shoulder"),
        ("elbow\n-1\n", "no column of joint shoulder, slide"),
        ("shoulder,elbow,slide,elbow\n0.1,-1,0.2,-1\n", "one column of joint elbow, got 'elbow, elbow'"),
        ("shoulder,elbow_deg,elbow_rad,slide\n0,0,0,0\n", "one column of joint elbow"),
        ("shoulder [deg],elbow,slide\n10,-1,0.2\n", "some revolute joints name a unit, that of elbow does not"),
        ("shoulder,elbow,slide\n0.1,-1\n", "line 2: expected 3 fields separated by commas, got 2"),
        ("shoulder,elbow,slide\n0.1,x,0.2\n", "line 2, column elbow: expected a number, got 'x'"),
        ("shoulder,elbow,slide\n0.1,,0.2\n", "an empty field"),
        ("shoulder,elbow,slide\n0.1,nan,0.2\n", "line 2, joint elbow: expected a finite number"),
        ("shoulder,elbow,slide\n0.1,-1_0,0.2\n", "got '-1_0'"),
        ("time,shoulder,elbow,slide\n1,0.1,-1,0.2\n1,0.2,-1,0.2\n", "line 3: the timestamp repeats that of line 2"),
        ("time,shoulder,elbow,slide\ninf,0.1,-1,0.2\n", "line 2: expected a finite timestamp"),
        ("name,shoulder,elbow,slide\n1,0.1,-1,0.2\n\0\n", "NUL"),
        (b"\xff\xfes\0h\0", "UTF-8"),
        (b"PK\3\4 and no archive", "damaged"),
        (b"\x93NUMPY\1\0", "not an array"),
        ("shoulder,elbow,slide\n" + "1" * 10_001, "lines of at most"),
    ],
)
def test_what_is_refused(read, content, message):
    with pytest.raises(InputError, match=message) as error:
        read(content)
    assert "\n" not in str(error.value) and "joints.csv" in str(error.value)


def test_bad_arguments(read, tmp_path):
    content = table("shoulder,elbow,slide", Q.T)
    for units in ("degrees", "deg,rad", 3, "", "deg,mm,m"):
        with pytest.raises(InputError, match="--joint-units"):
            read(content, units=units)
    with pytest.raises(InputError, match="is in rad, and `units`"):
        read(content.replace("shoulder", "shoulder_rad"), units="deg")
    for arm in ("shoulder", [], 3, [1]):
        with pytest.raises(InputError, match="`arm`"):
            read(content, arm)
    with pytest.raises(InputError, match="no such file"):
        read_joints(tmp_path / "none.csv", ARM)


def test_a_long_name_takes_no_time(read):
    start = time.process_time()
    with pytest.raises(InputError, match="no column"):
        read("a" + " " * 4000 + "b,c" + "\t" * 4000 + "d\n1,2\n", [f"j{k}" for k in range(60)])
    assert time.process_time() - start < 1.0


@pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")
@pytest.mark.parametrize("name", ["fr3_philnad", "industrial_kinematic", "recode_dvrk_points", "mukca_panda/panda_2"])
def test_real_files(name):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    model = folder / "model.urdf"
    arm = Kinematics.from_urdf(model if model.exists() else folder.parent / "model.urdf")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        found = read_joints(folder / "joints.csv", arm)
    np.testing.assert_array_equal(found.q, np.loadtxt(folder / "joints.csv", delimiter=",", skiprows=1)[:, 1:])
    assert found.timestamps is not None and found.notes == ()


def test_another_arm(read):
    names = ",".join(f"joint_{k}" for k in range(1, 7))
    with pytest.raises(InputError, match=re.escape("no column of joint axis_1, axis_2")):
        read(f"{names}\n0,0,0,0,0,0\n", Kinematics.from_urdf(SIX_AXES))


def test_the_examples_of_the_page(tmp_path):
    page = (DOCS / "formats.md").read_text(encoding="utf-8").partition("## Joints and arms")[2].partition("## X out")[0]
    joints, table, toml = (text for _, text in re.findall(r"^```(csv|toml)\n(.*?)^```", page, re.DOTALL | re.MULTILINE))
    for name, text in (("joints.csv", joints), ("dh.csv", table), ("dh.toml", toml)):
        (tmp_path / name).write_text(text)
    found = read_joints(tmp_path / "joints.csv", ["shoulder", "elbow", "wrist"])
    np.testing.assert_allclose(found.q[0], np.deg2rad([5.7, 30.5, -12.0]))
    assert Kinematics.from_dh(tmp_path / "dh.csv").names == ("shoulder", "elbow")
    np.testing.assert_allclose(Kinematics.from_dh(tmp_path / "dh.toml").joints[0].upper, np.deg2rad(166))


def test_a_record_that_repeats_its_rows(read):
    """ur-rtde 1.6.5 at 500 Hz writes rows at a rate of its own, six decimals, separated by blanks."""
    names = " ".join(f"actual_q_{k}" for k in range(6))
    rows = [f"{0.002 * k:.6f} " + " ".join(f"{0.1 * joint + 0.001 * k:.6f}" for joint in range(6)) for k in range(5)]
    written = [rows[k] for k in (0, 0, 1, 2, 2, 2, 3, 4)]
    found = read("\n".join([f"timestamp {names}", *written, ""]), [f"joint_{k + 1}" for k in range(6)])
    np.testing.assert_allclose(found.timestamps, 0.002 * np.arange(5))
    np.testing.assert_allclose(found.q[:, 1], 0.1 + 0.001 * np.arange(5))
    assert "3 rows that repeat a time and its numbers are left out" in found.notes


ORDERED = [f"joint_{k + 1}" for k in range(6)]
JSON_ROWS = (np.arange(24.0).reshape(4, 6) - 10.0) / 20.0


@pytest.mark.parametrize(
    "tree",
    [
        [dict(zip(ORDERED, row, strict=True)) for row in JSON_ROWS.tolist()],
        [dict(reversed(list(zip(ORDERED, row, strict=True)))) for row in JSON_ROWS.tolist()],
        JSON_ROWS.tolist(),
        {"joint_names": ORDERED, "positions": JSON_ROWS.tolist(), "note": "a"},
        {"joint_names": ORDERED[::-1], "q": JSON_ROWS[:, ::-1].tolist()},
        {"poses": [{"joints": row, "image": "a.png"} for row in JSON_ROWS.tolist()]},
        [{"name": ORDERED[::-1], "position": row[::-1]} for row in JSON_ROWS.tolist()],
        [{"joint_states": dict(zip(ORDERED, row, strict=True))} for row in JSON_ROWS.tolist()],
    ],
)
def test_joints_in_json(read, tree):
    found = read(json.dumps(tree), ORDERED)
    np.testing.assert_array_equal(found.q, JSON_ROWS)
    assert found.timestamps is None


def test_joints_in_json_with_times_and_units(read):
    tree = [{"timestamp_ms": 1000 * k, **dict(zip((f"{n}_deg" for n in ORDERED), row, strict=True))}
            for k, row in enumerate(np.degrees(JSON_ROWS).tolist())]  # fmt: skip
    found = read(json.dumps(tree), ORDERED)
    np.testing.assert_allclose(found.q, JSON_ROWS, atol=1e-15)
    np.testing.assert_array_equal(found.timestamps, [0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("[]", "expected a list with the joint values of each pose"),
        ('{"a": 1}', "expected a list with the joint values of each pose, got the keys 'a'"),
        ("[[1, 2, 3]", "not JSON|not YAML|line 1"),
        ("[[1, 2, 3, 4, 5, 6], [1, 2, 3]]", "pose 1: expected the 6 numbers of pose 0, got 3"),
        ('[[1, 2, 3, 4, 5, "x"]]', r"pose 0\[5\]: expected a number, got 'x'"),
        ("[[1, 2, 3]]", r"shape \(n, 6\)"),
        ('[{"joint_1": 1, "joint_2": 2}]', "no column of joint joint_3"),
        ('[{"a": "b"}]', "pose 0: expected joint values by their names"),
        ("[" * 5000, "deep|nest"),
    ],
)
def test_joints_in_json_that_are_wrong(read, content, words):
    with pytest.raises(InputError, match=words) as caught:
        read(content, ORDERED)
    assert "\n" not in str(caught.value) and "joints.json" not in str(caught.value)


def test_rows_without_names_are_in_the_order_of_the_arm(read):
    text = "\r\n".join(", ".join(map(repr, row)) for row in JSON_ROWS.tolist())
    found = read(text, ORDERED)
    np.testing.assert_array_equal(found.q, JSON_ROWS)
    assert "no names of joints: columns in the order of the arm" in found.notes
    with pytest.raises(InputError, match="expected a header with the names of the joints, got numbers"):
        read(text, ORDERED[:5])


def echoed(q, names, form):
    """Messages JointState as ROS 1 or ROS 2 prints them, the joints in the order of ``names``."""
    values = [dict(zip(("shoulder", "elbow", "slide"), row, strict=True)) for row in q.tolist()]
    text = ""
    for k, row in enumerate(values):
        if form == "rostopic":
            text += f"header: \n  seq: {k}\n  stamp: \n    secs: {10 + k}\n    nsecs: 500000000\n  frame_id: ''\n"
            text += f"name: [{', '.join(names)}]\nposition: [{', '.join(str(row[one]) for one in names)}]\n"
        else:
            text += f"header:\n  stamp:\n    sec: {10 + k}\n    nanosec: 500000000\n  frame_id: ''\nname:\n"
            text += "".join(f"- {one}\n" for one in names)
            text += "position:\n" + "".join(f"- {row[one]}\n" for one in names)
        text += "velocity: []\neffort: []\n---\n"
    return text


@pytest.mark.parametrize("form", ["rostopic", "ros2"])
def test_messages_as_ros_prints_them(read, form):
    found = read(echoed(Q, ("slide", "elbow", "shoulder"), form))
    np.testing.assert_allclose(found.q, Q)
    np.testing.assert_allclose(found.timestamps, [10.5, 11.5, 12.5])
    cut = read(echoed(Q, ("slide", "elbow", "shoulder"), form)[:-60])
    np.testing.assert_allclose(cut.q, Q[:2])
    assert "the last message is cut off, and left out" in cut.notes


def test_other_messages_are_refused(read):
    with pytest.raises(InputError, match=r"message at line 1: expected a JointState .*, got the fields header, pose"):
        read("header:\n  stamp:\n    sec: 1\npose:\n  x: 1.0\n---\n")
    with pytest.raises(InputError, match="the same joints in all messages"):
        read(echoed(Q[:1], ("slide", "elbow", "shoulder"), "ros2") + echoed(Q[:1], ("slide", "elbow"), "ros2"))
