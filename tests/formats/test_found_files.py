"""Files as people's programs, spreadsheets and logs leave them: read to the last digits, or refused by their cause."""

import json
import warnings

import numpy as np
import pytest
import scipy.io
from fixtures.controller_texts import beside, drawn, rz_ry_rx
from scipy.spatial.transform import Rotation
from support import SEED

from uq_handeye.core.files.pose_names import pose_name
from uq_handeye.errors import InputError
from uq_handeye.formats.contents import finished
from uq_handeye.formats.controllers.forms import CONTROLLERS
from uq_handeye.formats.controllers.written import written_poses
from uq_handeye.formats.detect import read_contents
from uq_handeye.formats.opencv_storage import matrix_lines
from uq_handeye.read import read_poses, write_pose_file
from uq_handeye.read.robot_poses import read_robot_poses

X, W = np.eye(4), np.eye(4)
X[:3, :3], X[:3, 3] = rz_ry_rx(0.2, 0.3, -0.4), [0.05, -0.02, 0.1]
W[:3, :3], W[:3, 3] = rz_ry_rx(2.0, 0.3, 3.0), [0.5, 0.1, 0.02]
NUMBERS, T = drawn("kuka", np.random.default_rng(SEED))
ROWS = [list(map(repr, row)) for row in NUMBERS.tolist()]
QUATERNIONS = Rotation.from_matrix(T[:, :3, :3]).as_quat().tolist()
VECTORS = Rotation.from_matrix(T[:, :3, :3]).as_rotvec().tolist()
PLACES = T[:, :3, 3].tolist()


def read(tmp_path, text, name="robot.txt"):
    path = tmp_path / name
    if isinstance(text, str):
        path.write_text(text)
    write_pose_file(tmp_path / "camera.csv", beside(T, X, W))
    return read_poses(path, tmp_path / "camera.csv", pair="rows")


def spaced(numbers):
    return f"[{' '.join(map(repr, numbers))}]"


def below(numbers):
    return "[[" + "]\n [".join(map(repr, numbers)) + "]]"


TABLES = {
    "dates": "timestamp,x,y,z,qx,qy,qz,qw\n" + "\n".join(
        f"2024-03-01T10:{k:02}:11.5Z,{','.join(map(repr, [*p, *q]))}"
        for k, (p, q) in enumerate(zip(PLACES, QUATERNIONS, strict=True))),
    "German dates": "Zeitstempel;X;Y;Z;A;B;C\n" + "\n".join(
        f"01.03.2024 10:{k:02}:11;{';'.join(row)}".replace(".", ",").replace("01,03,", "01.03.")
        for k, row in enumerate(ROWS)),
    "minus and spaces of a word processor": "X;Y;Z;A;B;C\n" + "\n".join(
        ";\u00a0".join(row).replace("-", "\u2212") for row in ROWS),
    "arrays of pandas": "frame,rvec,tvec\n" + "\n".join(
        f'{k},"{spaced(r)}","{spaced(p)}"' for k, (r, p) in enumerate(zip(VECTORS, PLACES, strict=True))),
    "columns of pandas": "frame,rvec,tvec\n" + "\n".join(
        f'{k},"{below(r)}","{below(p)}"' for k, (r, p) in enumerate(zip(VECTORS, PLACES, strict=True))),
    "lists behind names": "\n".join(
        f"# Pose {k}\nPosition: {p}\nOrientation (quaternion): {q}"
        for k, (p, q) in enumerate(zip(PLACES, QUATERNIONS, strict=True))),
    "a log of RAPID": "\n".join(
        f"Pos {k}: {[1e3 * x for x in p]} Orient: {[q[3], *q[:3]]}"
        for k, (p, q) in enumerate(zip(PLACES, QUATERNIONS, strict=True))),
    "points of Epson": "ENCODING=UTF8\n" + "\n".join(
        f'Point{k} {{\n\tnNumber={k}\n\tsLabel="c"\n'
        + "".join(f"\tr{a}={v}\n" for a, v in zip("XYZUVW", row, strict=True))
        + "\trR=0\n\tnHand=1\n}" for k, row in enumerate(ROWS)),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", TABLES)
def test_tables_and_logs(tmp_path, kind):
    poses = read(tmp_path, TABLES[kind])
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    if kind.endswith("dates"):
        np.testing.assert_allclose(np.diff(poses.timestamps), 60.0)


def test_both_sides_in_one_table(tmp_path):
    camera = beside(T, X, W)
    seen = np.hstack([camera[:, :3, 3], Rotation.from_matrix(camera[:, :3, :3]).as_quat()]).tolist()
    names = ",".join(f"{side}_{name}" for side in ("robot", "cam") for name in ("x", "y", "z", "qx", "qy", "qz", "qw"))
    rows = [",".join(map(repr, [*p, *q, *s])) for p, q, s in zip(PLACES, QUATERNIONS, seen, strict=True)]
    (tmp_path / "both.csv").write_text("\n".join([names, *rows]))
    poses = read_poses(tmp_path / "both.csv")
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(poses.camera, camera, rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="those of left, right"):
        read(tmp_path, "\n".join([names.replace("robot", "left").replace("cam", "right"), *rows]))


@pytest.mark.slow
def test_one_number_per_line_and_a_robot_at_rest(tmp_path):
    for k, (p, r) in enumerate(zip(PLACES, VECTORS, strict=True)):
        (tmp_path / f"pose_{k}.txt").write_text("\n".join(map(repr, [*p, *r])))
    np.testing.assert_allclose(read(tmp_path, None, "pose_*.txt").robot, T, rtol=0, atol=1e-9)
    for k, (p, q) in enumerate(zip(PLACES, QUATERNIONS, strict=True)):
        blocks = [
            f"At time 17.{j}\n- Translation: {[x + 1e-6 * (j - 1) for x in p]}\n- Rotation: in Quaternion {q}\n"
            for j in range(3)
        ]
        (tmp_path / f"tf_{k}.txt").write_text("".join(blocks))
    np.testing.assert_allclose(read(tmp_path, None, "tf_*.txt").robot, T, rtol=0, atol=1e-9)
    unset = "At time 17.0\n- Translation: [0.1, 0.2, 0.3]\n- Rotation: in Quaternion [0.0, 0.0, 0.0, 0.0]\n"
    with pytest.raises(InputError, match="orientation is missing"):
        read(tmp_path, 3 * unset)


ARRAYS = {
    "rotations by the last axis": {"R": np.moveaxis(T[:, :3, :3], 0, -1), "t": T[:, :3, 3].T},
    "columns": dict(zip(("X", "Y", "Z", "qx", "qy", "qz", "qw"), np.hstack([PLACES, QUATERNIONS]).T, strict=True)),
    "frames": {"T_base_tcp": np.moveaxis(T, 0, -1)},
}


@pytest.mark.parametrize("kind", ARRAYS)
def test_matlab(tmp_path, kind):
    scipy.io.savemat(tmp_path / "robot.mat", ARRAYS[kind])
    np.testing.assert_allclose(read(tmp_path, None, "robot.mat").robot, T, rtol=0, atol=1e-9)


def test_storages_of_opencv(tmp_path):
    numbered = [line for k, pose in enumerate(T) for line in matrix_lines(f"RobotPose_{k}", pose)]
    text = "\n".join(["%YAML:1.0", "---", f"count: {len(T)}", *numbered, ""])
    np.testing.assert_allclose(read(tmp_path, text, "robot.yml").robot, T, rtol=0, atol=1e-9)
    views = matrix_lines("extrinsic_parameters", np.hstack([VECTORS, PLACES]))
    (tmp_path / "views.yml").write_text("\n".join(["%YAML:1.0", "---", *views, ""]))
    write_pose_file(tmp_path / "robot.csv", beside(T, X, W))
    np.testing.assert_allclose(read_poses(tmp_path / "robot.csv", tmp_path / "views.yml").camera, T, rtol=0, atol=1e-9)
    for k, (p, r) in enumerate(zip(PLACES, VECTORS, strict=True)):
        lines = matrix_lines("rvec", np.array([r]).T) + matrix_lines("tvec", np.array([p]).T)
        (tmp_path / f"T_{k}.yml").write_text("\n".join(["%YAML:1.0", "---", *lines, ""]))
    np.testing.assert_allclose(read(tmp_path, None, "T_*.yml").robot, T, rtol=0, atol=1e-9)


def test_names_of_both_frames():
    robot, camera = ("robot", "base_T_gripper"), ("camera", "camera_T_target")
    for name in ("robot_poses", "T_base_ee", "base_T_tool0", "H_gripper2base", "endEffectorInBase"):
        assert pose_name(name) == robot, name
    for name in ("target2cam", "T_camera_optical_board", "marker_pose", "tag_poses", "camera"):
        assert pose_name(name) == camera, name
    assert pose_name("base2gripper") == ("robot", "gripper_T_base")
    assert pose_name("T_tag_cam") == ("camera", "target_T_camera")
    for name in ("R_gripper2base", "t_gripper2base", "camera_matrix", "T_gripper_camera", "base", "poses", ""):
        assert pose_name(name) is None, name


TOOLS = {
    "fanuc": "/POS\n" + "\n".join(
        f"P[{k}]{{\n GP1:\n UF : 0, UT : {1 + (k > 7)}, CONFIG : 'N U T, 0, 0, 0',\n"
        + ", ".join(f"{a} = {v}" for a, v in zip("XYZWPR", row, strict=True)) + "\n};" for k, row in enumerate(ROWS)),
    "kuka": "\n".join(
        f"DECL E6POS XP{k}={{{', '.join(f'{a} {v}' for a, v in zip('XYZABC', row, strict=True))}}}\n"
        f"DECL FDAT FP{k}={{TOOL_NO {1 + (k > 7)},BASE_NO 0}}" for k, row in enumerate(ROWS)),
    "yaskawa": "/JOB\n//POS\n///TOOL 0\n///RECTAN\n" + "\n".join(
        "///TOOL 1\n" * (k == 8) + f"C{k:05}={','.join(row)}" for k, row in enumerate(ROWS)),
    "abb": "\n".join(
        f"MoveL [[{','.join(row[:3])}],[{','.join(map(repr, [q[3], *q[:3]]))}],[0,0,0,0],[9E9,9E9]],v100,fine,"
        f"{'tGrip' if k > 7 else 'tool0'}\\WObj:=wobj0;"
        for k, (row, q) in enumerate(zip(ROWS, QUATERNIONS, strict=True))),
}  # fmt: skip


@pytest.mark.parametrize("maker", TOOLS)
def test_poses_of_two_tools_are_said(tmp_path, maker):
    path = tmp_path / "robot.txt"
    path.write_text(TOOLS[maker])
    write_pose_file(tmp_path / "camera.csv", beside(T, X, W))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        read_poses(path, tmp_path / "camera.csv")
    assert any("several tools or frames: " in str(one.message) and "(8 poses)" in str(one.message) for one in caught)


def entry(p, r):
    return {"id": 3, "tcp": [*p, *r]}


TREES = {
    "beside other maps": lambda each, rows: {"meta": {"robot": "arm"}, "data": each},
    "columns": lambda each, rows: dict(zip(NAMES, rows.T.tolist(), strict=True)),
    "columns of pandas": lambda each, rows: {
        name: {str(k): value for k, value in enumerate(column)}
        for name, column in zip(NAMES, rows.T.tolist(), strict=True)
    },
    "a dictionary of a robot's library": lambda each, rows: {
        str(k): {"tcp_coords": [*one["tcp"]], "joint_coords": [0.1] * 6} for k, one in enumerate(each)
    },
    "a quaternion by its order": lambda each, rows: [
        {"translation": p, "rotation_quaternion_wxyz": [q[3], *q[:3]]} for p, q in zip(PLACES, QUATERNIONS, strict=True)
    ],
    "axis and angle": lambda each, rows: [
        {"Rotation": {"Angle": float(np.linalg.norm(r)), "Axis": (r / np.linalg.norm(r)).tolist()}, "Translation": p}
        for p, r in zip(PLACES, np.array(VECTORS), strict=True)
    ],
}
NAMES = ("x", "y", "z", "rx", "ry", "rz")


@pytest.mark.slow
@pytest.mark.parametrize("kind", TREES)
def test_trees(tmp_path, kind):
    each = [entry(p, r) for p, r in zip(PLACES, VECTORS, strict=True)]
    text = json.dumps(TREES[kind](each, np.hstack([PLACES, VECTORS])))
    poses = read(tmp_path, text, "robot.json")
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    assert ("poses from 'data'" in poses.sources[0].notes) == (kind == "beside other maps")


def test_both_sides_as_opencv_names_them_in_each_entry(tmp_path):
    camera = beside(T, X, W)
    each = [
        {"R_gripper2base": g[:3, :3].tolist(), "t_gripper2base": g[:3, 3].tolist(),
         "R_target2cam": c[:3, :3].tolist(), "t_target2cam": c[:3, 3].tolist()}
        for g, c in zip(T, camera, strict=True)
    ]  # fmt: skip
    (tmp_path / "both.json").write_text(json.dumps(each))
    poses = read_poses(tmp_path / "both.json")
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(poses.camera, camera, rtol=0, atol=1e-9)


def test_arrays_in_the_convention_of_a_maker_and_of_quaternions(tmp_path):
    write_pose_file(tmp_path / "camera.csv", beside(T, X, W))
    np.save(tmp_path / "robot.npy", NUMBERS)
    poses = read_poses(tmp_path / "robot.npy", tmp_path / "camera.csv", format=("kuka", None))
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    np.save(tmp_path / "matrices.npy", T)
    (tmp_path / "named.json").write_text(
        json.dumps({"data": [dict(zip("xyzabc", row, strict=True)) for row in NUMBERS]})
    )
    for file, maker, got in (
        ("robot.npy", "abb", "got 3 numbers per rotation"),
        ("matrices.npy", "kuka", "got matrices"),
        ("named.json", "fanuc", r"got the numbers a, b, c \(ZYX\)"),
    ):
        with pytest.raises(InputError, match=got):
            read_poses(tmp_path / file, tmp_path / "camera.csv", format=(maker, None))
    read_contents(tmp_path / "named.json", "mitsubishi")  # whose names are the same
    text = json.dumps({"meta": {"n": 3}, "data": [{"tcp": row} for row in NUMBERS.tolist()]})
    (tmp_path / "robot.json").write_text(text)
    poses = read_poses(tmp_path / "robot.json", tmp_path / "camera.csv", format=("kuka", None))
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    np.savez(tmp_path / "robot.npz", positions=PLACES, quaternions=QUATERNIONS)
    np.testing.assert_allclose(read(tmp_path, None, "robot.npz").robot, T, rtol=0, atol=1e-9)


def test_what_kuka_measured_and_codes_of_halcon(tmp_path):
    def tag(name, row):
        return f"<{name} " + " ".join(f'{a}="{v}"' for a, v in zip("XYZABC", row, strict=True)) + "/>"

    lines = [f"<Rob>{tag('RSol', ['0.0'] * 6)}{tag('RIst', row)}<IPOC>{k}</IPOC></Rob>" for k, row in enumerate(ROWS)]
    sensor = "\n".join(lines)
    np.testing.assert_allclose(read(tmp_path, sensor).robot, T, rtol=0, atol=1e-9)
    angles = Rotation.from_matrix(T[:, :3, :3]).as_euler("XYZ", degrees=True) % 360.0
    tuples = "\n".join(f"{[*p, *a, 0]}" for p, a in zip(PLACES, angles.tolist(), strict=True))
    np.testing.assert_allclose(read(tmp_path, tuples).robot, T, rtol=0, atol=1e-9)


def test_names_that_say_less_than_they_seem(tmp_path):
    """Taught positions called BASE, features of PolyScope, a column called Point, an export's own first line."""
    taught = "\n".join(
        f"DECL E6POS XBASE{k}={{{', '.join(f'{a} {v}' for a, v in zip('XYZABC', row, strict=True))}}}"
        for k, row in enumerate(ROWS)
    )
    np.testing.assert_allclose(read(tmp_path, taught).robot, T, rtol=0, atol=1e-9)
    listed = "Point;X;Y;Z;A;B;C\n" + "\n".join(f"P{k};{';'.join(row)}" for k, row in enumerate(ROWS))
    np.testing.assert_allclose(read(tmp_path, listed).robot, T, rtol=0, atol=1e-9)
    script = "global Base=p[0,0,0,0,0,0]\n" + "\n".join(
        f"global Waypoint_{k}_p=p[{', '.join(map(repr, [*p, *r]))}]"
        for k, (p, r) in enumerate(zip(PLACES, VECTORS, strict=True))
    )
    np.testing.assert_allclose(read(tmp_path, script).robot, T, rtol=0, atol=1e-9)
    for maker in ("mitsubishi", "doosan", "kuka"):
        own = written_poses(T[:1], maker, ["base_T_camera"], ["base_T_camera: X, as Kuka writes it; test."])
        own = own.replace("Kuka", CONTROLLERS[maker].maker)
        (tmp_path / "own.txt").write_text(own)
        side = read_contents(tmp_path / "own.txt", None)[0].only
        np.testing.assert_allclose(finished(side, "robot", None, None, "base_T_gripper"), T[:1], rtol=0, atol=1e-9)


def test_robot_poses_alone_follow_the_format_of_the_calibration(tmp_path):
    path = tmp_path / "at.csv"
    path.write_text("x,y,z,rx,ry,rz\n" + "\n".join(
        ",".join(map(repr, [*p, *r])) for p, r in zip(PLACES, VECTORS, strict=True)))  # fmt: skip
    np.testing.assert_allclose(read_robot_poses(path, "ur")[1], T, rtol=0, atol=1e-9)
    np.testing.assert_allclose(read_robot_poses(path, rotation="rotvec-rad")[1], T, rtol=0, atol=1e-9)
    with pytest.raises(InputError, match="--format"):
        read_robot_poses(path, "kuka")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("X;Y;Z;A;B;C\n" + ";".join(ROWS[0]) + "\nmean;1;2\n", ["line 3", "expected 6 fields", "controller.md"]),
        ("X,Y,Z,Rx,Ry,Rz,X,Y,Z,Rx,Ry,Rz\n" + ",".join(2 * ROWS[0]) + "\n", ["twice", "Keep one"]),
        ("x,y,z,q1,q2,q3\n" + ",".join(ROWS[0]) + "\n", ["controller.md"]),
        ("<li><span class='x'>1</span></li>\n", ["FileStorage", "docs/formats.md"]),
        ("robot: [1, 2\n", ["not YAML", "docs/formats.md"]),
    ],
)
def test_refusals_name_the_cause_and_the_page(tmp_path, text, parts):
    with pytest.raises(InputError) as caught:
        read(tmp_path, text)
    assert all(part in str(caught.value) for part in parts), caught.value
