"""Poses as robots' controllers and people write them, read to the last digits; refusals and warnings of wrong ones."""

import json

import numpy as np
import pytest
from fixtures.controller_texts import CONVENTIONS, NAMES, RXYZ, beside, csv, drawn, program, rz_ry_rx
from support import SEED

from uq_handeye.cli.app import main
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.formats.contents import finished
from uq_handeye.formats.controllers.forms import CONTROLLERS
from uq_handeye.formats.controllers.registry import PROGRAMS
from uq_handeye.formats.detect import read_contents
from uq_handeye.read import read_poses, write_pose_file

X = np.eye(4)
X[:3, :3], X[:3, 3] = rz_ry_rx(0.2, 0.3, -0.4), [0.05, -0.02, 0.1]
W = np.eye(4)
W[:3, :3], W[:3, 3] = rz_ry_rx(2.0, 0.3, 3.0), [0.5, 0.1, 0.02]


@pytest.fixture(scope="module")
def rigs():
    rng = np.random.default_rng(SEED)
    return {maker: drawn(maker, rng) for maker in CONVENTIONS}


@pytest.fixture
def robot_file(tmp_path):
    def write(text, name="robot.txt"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def check(path, T, format=None, **options):
    """Read the poses with a camera that fits them and compare; returns the notes."""
    camera = path.with_name("camera.csv")
    write_pose_file(camera, beside(T, X, W))
    poses = read_poses(path, camera, format=(format, None), **options)
    np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)
    return poses.sources[0]


def named(numbers, names):
    return "\n".join(
        f"P{k}: " + ", ".join(f"{a}={b!r}" for a, b in zip(names.split(","), row, strict=True))
        for k, row in enumerate(numbers.tolist())
    )


STYLES = {
    "header": lambda n, names: csv(n, names),
    "plain": lambda n, names: csv(n),
    "spaces": lambda n, names: csv(n, None, "   "),
    "semicolons, decimal commas": lambda n, names: csv(n, names, ";").replace(".", ","),
    "tabs, decimal commas, Windows": lambda n, names: "\ufeff" + csv(n, None, "\t", "\r\n").replace(".", ","),
    "index": lambda n, names: csv(np.hstack([np.arange(1.0, len(n) + 1)[:, None], n])),
    "labels": lambda n, names: "name," + csv(n, names).replace("\n", "\np,")[:-2],
    "lists": lambda n, names: "poses = " + json.dumps(n.tolist(), indent=1),
    "numpy": lambda n, names: np.array2string(n, precision=17, threshold=10**6, max_line_width=70),
    "names": named,
    "maps": lambda n, names: "\n".join(str(dict(zip(names.split(","), row, strict=True))) for row in n.tolist()),
    "comment header": lambda n, names: "# of the pendant\n\n% " + csv(n, names, " "),
    "quotes, title, units": lambda n, names: (
        "Cell 3\n" + ",".join(f'"{name}"' for name in names.split(",")) + "\n" + csv(n)
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("maker", CONVENTIONS)
def test_tables(robot_file, rigs, maker):
    numbers, T = rigs[maker]
    for style, write in STYLES.items():
        path = robot_file(write(numbers, NAMES.get(maker, RXYZ)))
        assert check(path, T, maker).format == maker, style


@pytest.mark.slow
@pytest.mark.parametrize("maker", PROGRAMS)
def test_programs(robot_file, rigs, maker):
    numbers, T = rigs[maker]
    path = robot_file(program(maker, numbers))
    assert check(path, T).format == maker  # told by the content
    check(path, T, maker)
    check(robot_file(program(maker, numbers).encode("utf-8") + b"\r\n ;\xe4 comment in another encoding\r\n"), T)


@pytest.mark.parametrize("maker", ["kuka", "fanuc", "abb", "kawasaki", "epson", "comau", "rpy"])
def test_columns_that_say_the_maker(robot_file, rigs, maker):
    numbers, T = rigs[maker]
    source = check(robot_file(csv(numbers, NAMES[maker])), T)
    assert source.format == maker
    assert any(f"read as {CONTROLLERS[maker].rotation}" in note for note in source.notes)


@pytest.mark.slow
@pytest.mark.parametrize("maker", ["ur", "kuka", "fanuc", "abb", "staubli", "kawasaki", "rpy"])
def test_numbers_without_names_are_told_by_the_camera(robot_file, rigs, maker):
    numbers, T = rigs[maker]
    source = check(robot_file(csv(numbers)), T)
    assert source.format == maker  # that of the reading, in which plan prints the next poses
    assert any("robot and camera agree" in note for note in source.notes)


@pytest.mark.parametrize("maker", ["ur", "staubli", "yaskawa"])
def test_rx_ry_rz_are_told_by_the_camera(robot_file, rigs, maker):
    numbers, T = rigs[maker]
    check(robot_file(csv(numbers, RXYZ)), T)


@pytest.mark.parametrize(
    ("maker", "names"), [("nachi", "Rz,Ry,Rx"), ("adept", "yaw,pitch,roll"), ("mecademic", "alpha,beta,gamma")]
)
def test_makers_that_are_asked_for_take_their_columns_in_any_order(robot_file, rigs, maker, names):
    numbers, T = rigs[maker]
    check(robot_file(csv(numbers, f"x,y,z,{names}")), T, maker)
    back = ",".join(names.split(",")[::-1])
    check(robot_file(csv(numbers[:, [0, 1, 2, 5, 4, 3]], f"x,y,z,{back}")), T, maker)


@pytest.mark.parametrize(
    ("maker", "factor", "note"),
    [
        ("ur", 1000.0, "translations in mm"),
        ("kuka", 0.001, "translations in m,"),
        ("rpy", 1000.0, "translations in mm"),
    ],
)
def test_lengths_whose_size_contradicts_the_maker(robot_file, rigs, maker, factor, note):
    numbers, T = rigs[maker]
    scaled = np.hstack([numbers[:, :3] * factor, numbers[:, 3:]])
    assert any(note in one for one in check(robot_file(csv(scaled)), T, maker).notes)


def test_angles_whose_size_contradicts_the_maker(robot_file, rigs):
    numbers, T = rigs["ur"]
    degrees = np.hstack([numbers[:, :3], np.degrees(numbers[:, 3:])])
    assert any("rotvec-deg" in note for note in check(robot_file(csv(degrees)), T, "ur").notes)
    numbers, T = rigs["kuka"]
    radians = np.hstack([numbers[:, :3], np.radians(numbers[:, 3:])])
    assert any("ZYX-rad" in note for note in check(robot_file(csv(radians, "X,Y,Z,A,B,C")), T).notes)
    numbers, T = rigs["rpy"]
    degrees = np.hstack([numbers[:, :3], np.degrees(numbers[:, 3:])])
    assert any("xyz-deg" in note for note in check(robot_file(csv(degrees, NAMES["rpy"])), T).notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "maker", "length", "angle"),
    [
        ("X [mm],Y [mm],Z [mm],A [rad],B [rad],C [rad]", "kuka", 1.0, np.pi / 180),
        ("x_m,y_m,z_m,yaw_deg,pitch_deg,roll_deg", "rpy", 1.0, 180 / np.pi),
        ("tcp.x (cm),tcp.y (cm),tcp.z (cm),rvec_x,rvec_y,rvec_z", "ur", 100.0, 1.0),
        (",".join(f"actual_TCP_pose_{k}" for k in range(6)), "ur", 1.0, 1.0),
        ("X[mm],Y[mm],Z[mm],O[deg],A[deg],T[deg]", "kawasaki", 1.0, 1.0),
        ("X,Y,Z,R,P,Y", "rpy", 1.0, 1.0),
        ("pos_x,pos_y,pos_z,q1,q2,q3,q4", "abb", 0.001, 1.0),
    ],
)
def test_units_and_names_of_columns(robot_file, rigs, names, maker, length, angle):
    numbers, T = rigs[maker]
    numbers = np.hstack([numbers[:, :3] * length, numbers[:, 3:] * angle])
    if "yaw" in names:
        numbers = numbers[:, [0, 1, 2, 5, 4, 3]]
    joints = ",".join(f"actual_q_{k}" for k in range(6))
    check(robot_file(csv(np.hstack([numbers, numbers[:, :6]]), f"{names},{joints}")), T)
    check(robot_file(csv(np.hstack([numbers[:, :6], numbers]), f"{joints},{names}", " ") if "[" not in names else (
        csv(numbers, names))), T)  # fmt: skip


def test_axis_and_angle_times_and_quaternions_first(robot_file, rigs):
    numbers, T = rigs["ur"]
    angle = np.linalg.norm(numbers[:, 3:], axis=1)[:, None]
    axis = np.hstack([numbers[:, :3], numbers[:, 3:] / angle, angle])
    check(robot_file(csv(axis)), T)
    check(robot_file(csv(axis, "x,y,z,ax,ay,az,angle")), T)
    check(robot_file(csv(axis * [1, 1, 1, 1, 1, 1, 180 / np.pi], "x,y,z,ax,ay,az,angle [deg]")), T)
    numbers, T = rigs["abb"]
    check(robot_file(csv(numbers[:, [3, 4, 5, 6, 0, 1, 2]])), T)
    check(robot_file(csv(np.hstack([numbers[:, :3] / 1000, numbers[:, [4, 5, 6, 3]]]))), T)  # xyzw
    times = 1.7e9 + 0.25 * np.arange(len(T))
    path = robot_file(csv(np.hstack([times[:, None], numbers])))
    assert read_contents(path, "abb")[0].only.timestamps.tolist() == times.tolist()


def test_lists_of_position_and_quaternion(robot_file, rigs):
    numbers, T = rigs["abb"]
    rows = [f"[[{','.join(map(repr, row[:3]))}],[{','.join(map(repr, row[3:]))}]]" for row in numbers.tolist()]
    check(robot_file("\n".join(rows)), T)
    check(robot_file("\n".join(f"TCP: {row[1:-1]}" for row in rows)), T, "abb")


def two_groups(text):
    """Add a rail as a second motion group to each position of a TP program."""
    return text.replace("};", "   GP2:\n\tUF : 0, UT : 2,\n\tJ1=     0.000  mm\n};")


def test_measured_columns_beside_commanded_ones(robot_file, rigs):
    numbers, T = rigs["ur"]
    both = np.hstack([numbers + 1e-4, numbers])
    names = [f"{kind}_TCP_pose_{k}" for kind in ("target", "actual") for k in range(6)]
    for order in (slice(None), slice(None, None, -1)):
        source = check(robot_file(csv(both[:, order], ",".join(names[order]))), T)
        assert any("not used: the columns" in note and "target_TCP" in note for note in source.notes)


@pytest.mark.slow
def test_other_forms_of_programs(robot_file, rigs):
    numbers, T = rigs["staubli"]
    rows = [", ".join(map(repr, row)) for row in numbers.tolist()]
    check(robot_file("\n".join(f"  trsf tr[{k}] = {{{row}}}" for k, row in enumerate(rows))), T)
    check(robot_file("\n".join(f"{{{{{row}}},{{lefty,epositive,wpositive}}}}" for row in rows)), T)
    check(robot_file("\n".join(f"{{{row}}}" for row in rows)), T, "staubli")
    numbers, T = rigs["kuka"]
    pairs = [" ".join(f"{a} {b!r}," for a, b in zip("XYZABC", row, strict=True))[:-1] for row in numbers.tolist()]
    check(robot_file("\r\n".join(f"LIN {{{pair}}} C_DIS" for pair in pairs)), T)
    check(robot_file("\r\n".join(f"{{FRAME: {pair}}}" for pair in pairs)), T)
    check(robot_file("\n".join(f"12:00:01 $POS_ACT={{E6POS: {pair}, S 6, T 27, E1 0.0}}" for pair in pairs)), T)
    numbers, T = rigs["fanuc"]
    text = "[*POSREG*]$POSREG  Storage: CMOS  Access: RW  : ARRAY[1,100] OF Position Reg\n"
    for k, row in enumerate(numbers.tolist()):
        text += f"     [1,{k + 1}] =   'cal'   Group: 1   Config: N U T, 0, 0, 0\n"
        text += "  X: {!r}   Y: {!r}   Z: {!r}\n  W: {!r}   P: {!r}   R: {!r}\n".format(*row)
    check(robot_file(text + "     [1,99] =   ''  Uninitialized\n"), T)
    stars = ", ".join(f"{a} = ******** {'mm' if a in 'XYZ' else 'deg'}" for a in "XYZWPR")
    text = program("fanuc", rigs["fanuc"][0])
    untaught = text.replace("/END", f"P[99]{{\n   GP1:\n\t{stars}\n}};\n/END")
    assert "1 position that was not taught left out" in " ".join(check(robot_file(untaught), rigs["fanuc"][1]).notes)
    assert "groups" in " ".join(check(robot_file(two_groups(text)), T).notes)
    numbers, T = rigs["kawasaki"]
    rows = [", ".join(map(repr, row)) for row in numbers.tolist()]
    check(robot_file("\n".join(f"POINT p{k} = TRANS({row})" for k, row in enumerate(rows))), T)
    numbers, T = rigs["ur"]
    rows = [", ".join(map(repr, row)) for row in numbers.tolist()]
    check(robot_file("\n".join(f"movel(p[{row}], a=1.2, v=0.25)" for row in rows)), T)
    check(robot_file("\n".join(f"12:00:{k:02d}.5 INFO p[{row}]" for k, row in enumerate(rows))), T)


@pytest.mark.slow
def test_tables_of_other_programs(robot_file, rigs):
    numbers, T = rigs["kuka"]
    rows = [list(map(repr, row)) for row in numbers.tolist()]
    pendant = "\n\n".join(
        f"Point {k}\n" + "\n".join(f" {a} {value}" for a, value in zip("XYZABC", row, strict=True))
        for k, row in enumerate(rows)
    )
    check(robot_file(pendant), T, "kuka")
    for sep in (" | ", ";"):
        text = sep.join("XYZABC") + "\n" + "\n".join(sep.join(row) for row in rows)
        check(robot_file(text), T)
        check(robot_file(text.replace("\n", "\r").encode("utf-16")), T)
    check(
        robot_file("X (mm);Y (mm);Z (mm);A (°);B (°);C (°)\n".encode("latin-1") + csv(numbers, None, ";").encode()), T
    )
    check(robot_file("X,Y,Z,A,B,C,S,T\n" + "\n".join(",".join([*row, "2", "35"]) for row in rows)), T)
    check(robot_file("\n".join(",".join([*row, "2", "35", *"000000"]) for row in rows)), T, "kuka")
    text = "\n".join(f"<Rob><RIst {' '.join(f'{a}={v!r}' for a, v in zip('XYZABC', row, strict=True))} /></Rob>"
                     for row in rows)  # fmt: skip
    check(robot_file(text.replace("'", '"')), T)
    text = "\n".join(f"[INFO] pose {k}: " + ", ".join(
        f"{a}: {v} {unit}" for a, v, unit in zip("XYZABC", row, ["mm"] * 3 + ["deg"] * 3, strict=True)
    ) for k, row in enumerate(rows))  # fmt: skip
    check(robot_file(text), T)


@pytest.mark.parametrize(
    ("maker", "line"),
    [
        ("mitsubishi", "P{k}=({0},{1},{2},{3},{4},{5})(7,0)"),
        ("denso", "P[{k}] = P({0}, {1}, {2}, {3}, {4}, {5}, -1)"),
        ("epson", "P{k} : XY({0},{1},{2},{3},{4},{5}) /R"),
        ("doosan", "set_velx(30)\nmovel(posx({0},{1},{2},{3},{4},{5}), v=100, a=200)"),
        ("dobot", "0,{{{0},{1},{2},{3},{4},{5}}},GetPose();"),
        ("dobot", '{{"joint": [1, 2, 3, 4, 5, 6], "pose": [{0}, {1}, {2}, {3}, {4}, {5}]}}'),
        ("xarm", "(0, [{0}, {1}, {2}, {3}, {4}, {5}])"),
        ("techman", 'Point["P{k}"].Value={{{0},{1},{2},{3},{4},{5}}}'),
        ("jaka", "joint: [1.5,2.5,3.5,4.5,5.5,6.5] tcp: [{0}, {1}, {2}, {3}, {4}, {5}] time: {k}"),
    ],
)
def test_poses_in_the_lines_of_programs_and_logs(robot_file, rigs, maker, line):
    numbers, T = rigs[maker]
    check(robot_file("\n".join(line.format(*map(repr, row), k=k) for k, row in enumerate(numbers.tolist()))), T, maker)


def test_matrices_of_matlab_and_rules_of_tables(robot_file, rigs):
    numbers, T = rigs["kuka"]
    rows = csv(numbers, None, " ").replace("\n", ";\n")
    check(robot_file(f"P = [\n{rows}];\n"), T, "kuka")
    check(robot_file(f"P = [{rows.replace(chr(10), ' ')}];\n"), T, "kuka")
    rows = "".join(f"| {' | '.join(map(repr, row))} |\n" for row in numbers.tolist())
    check(robot_file(f"| X | Y | Z | A | B | C |\n|---|---|---|---|---|---|\n{rows}"), T)


def test_one_file_per_pose(tmp_path, rigs):
    numbers, T = rigs["kuka"]
    folder = tmp_path / "poses"
    folder.mkdir()
    for k, row in enumerate(numbers):
        (folder / f"pose{k}.csv").write_text(csv(row[None]))
    write_pose_file(tmp_path / "camera.csv", beside(T, X, W))
    for format in (None, "kuka"):
        poses = read_poses(folder, tmp_path / "camera.csv", format=(format, None))
        np.testing.assert_allclose(poses.robot, T, rtol=0, atol=1e-9)


def test_a_wrong_maker_is_named(robot_file, rigs):
    numbers, T = rigs["fanuc"]
    path = robot_file(csv(numbers))
    write_pose_file(path.with_name("camera.csv"), beside(T, X, W))
    with pytest.warns(InputWarning, match="--rotation robot=xyz-deg"):
        read_poses(path, path.with_name("camera.csv"), format=("kuka", None))


def test_the_camera_in_a_maker_form(tmp_path, rigs):
    numbers, T = rigs["kuka"]
    (tmp_path / "camera.txt").write_text(csv(numbers))
    write_pose_file(tmp_path / "robot.csv", W @ np.linalg.inv(X @ T))
    poses = read_poses(tmp_path / "robot.csv", tmp_path / "camera.txt", format=(None, "kuka"))
    np.testing.assert_allclose(poses.camera, T, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("maker", "flags"), [("kuka", []), ("yaskawa", ["--format", "robot=yaskawa"])])
def test_command_line(robot_file, rigs, maker, flags, tmp_path, capsys):
    numbers, T = rigs[maker]
    path = robot_file(csv(numbers) if flags else program(maker, numbers), "robot.dat")
    write_pose_file(tmp_path / "camera.csv", beside(T, X, W))
    noise = ["--robot-noise", "0.01deg,0.05mm", "--camera-noise", "0.1deg,0.5mm"]
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path), str(tmp_path / "camera.csv"), *flags, *noise, "--method", "park", "--json"])
    assert ended.value.code == 0
    np.testing.assert_allclose(json.loads(capsys.readouterr().out)["X"], X, rtol=0, atol=1e-9)


KUKA = "DECL E6POS XP1={X 1,Y 2,Z 300,A 4,B 5,C 6}\n"
PAGE = "docs/how-to/controller.md"


@pytest.mark.parametrize(
    ("text", "format", "parts"),
    [
        ("DECL E6AXIS XP1={A1 1,A2 2,A3 3,A4 4,A5 5,A6 6}\n", None, ["joint targets (1)", "--joints", "--urdf", PAGE]),
        ("/POS\nP[1]{\n GP1:\n J1= 1.0 deg, J2= 2.0 deg\n};\n/END\n", None, ["joint targets (1)", "--urdf"]),
        ("CONST jointtarget j1:=[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]];", None, ["joint targets (1)", "--joints"]),
        ("/JOB\n///PULSE\nC00000=1,2,3,4,5,6\n", None, ["joint targets (1)", "--joints"]),
        ("C00000=1,2,3,4,5,6\n", "yaskawa", ["joint targets (1)"]),
        (".JOINTS\n#p 1 2 3 4 5 6\n.END\n", None, ["joint targets (1)"]),
        ("movej([1,2,3,4,5,6], a=1)\n", None, ["joint targets (1)"]),
        ("", "kuka", ["no line of at least 6 numbers", PAGE]),
        ("nothing here\n", "fanuc", [PAGE]),
        ("x,y,z,a,b,c\n", "kuka", ["no rows"]),
        ("x,y,z,a,b,c\n1,2,3,4,5\n", "kuka", ["line 2", "6 fields", "got 5", PAGE]),
        ("x,y,z,a,b,c\n1,2,3,4,5,6\n1,2,3,4,five,6\n", "kuka", ["line 3", "column b", "'five'"]),
        ("x,y,z,a,b,c\n1,2,3,40,5,nan\n", "kuka", ["line 2", "column c", "finite"]),
        ("x_mm,y_m,z_m,a,b,c\n1,2,3,4,5,6\n", "kuka", ["different units of x, y, z", PAGE]),
        ("x,y,z,a [deg],b [rad],c [deg]\n1,2,3,4,5,6\n", "kuka", ["different units of the rotation"]),
        ("x,y,z,w,p,r\n1,2,3,4,5,6\n", "kuka", ["A, B, C (KUKA)", "w, p, r", PAGE]),
        ("x,y,z,a,b,c\n1,2,3,4,5,6\n", "abb", ["q1, q2, q3, q4 (ABB)", "a, b, c"]),
        ("1,2,3,1,0,0,0\n", "kuka", ["A, B, C", "quaternion", PAGE]),
        ("1,2,3,4,5\n1,2,3,4,5\n", "kuka", [PAGE]),
        ("1,2,3,4,5,6,7,8,9,10,11\n" * 2, "ur", ["11 numbers without names", "x,y,z,rx,ry,rz", PAGE]),
        ("1,2,3,4,5,6\n1,2,3,4\n", "ur", ["line 2", "got 4"]),
        ("x,y,z,roll,pitch,yaw\n1,2,3,4,5,6\n", "ur", ["rx, ry, rz", "roll, pitch, yaw", "--format robot=rpy", PAGE]),
        ("1,2,3,x(7)y,4,5,6\n", "kuka", ["line 1", "'x(7)y'", PAGE]),
        (KUKA.replace(",C 6", ""), None, ["expected poses as KUKA", PAGE]),
        ("P[1]{\n X = 1 mm, Y = 2 mm, Z = 3 mm, W = 4 deg, P = 5 deg };\n", None, ["P[1]", "R is missing"]),
        ("P[1]{\n X = 1 mm, Y = ***** mm, Z = 3 mm, W = 4 deg, P = 5 deg, R = 6 deg };\n", None, ["P[1]", "'*****'"]),
        ("P[1]{\n X = 1 mm, Y = 2 m, Z = 3 mm, W = 4 deg, P = 5 deg, R = 6 deg };\n", None, ["one unit", "m, mm"]),
        ("/JOB\n///RECTAN\nC00000=1.0,2.0,3.0\n", None, ["line 3", "C00000", "got 3"]),
        (".TRANS\np1 1 2 3 4 5\n.END\n", None, ["line 2", "x y z o a t"]),
        ("p[1,2,3,0,0,nan]\n", None, ["line 1", "finite"]),
        ("CONST robtarget p:=[[1,2,300],[1,1,0,0],[0,0,0,0],[9E9]];", None, ["line 1 (p)", "norm 1.41", "q1,q2,q3,q4"]),
        ("CONST robtarget p:=[[1,2,300],[1,0", None, ["expected poses as ABB"]),
        ("1 " * 20_000, "kuka", ["10000 characters"]),
        ("[" * 5_000, "kuka", [PAGE]),
        (b"\x00\xff" * 50, "kuka", [PAGE]),
    ],
)
def test_one_line_says_what_is_wrong(robot_file, text, format, parts):
    with pytest.raises(InputError) as caught:
        finished(read_contents(robot_file(text), format)[0].only, "robot", None, None, "base_T_gripper")
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 600
    for part in parts:
        assert part in message, (part, message)


@pytest.mark.parametrize("text", ["1,2,3,4,5,6\n" * 3, "x,y,z,rx,ry,rz\n" + "1,2,3,4,5,6\n" * 3])
def test_doubt_without_another_side_names_the_candidates(robot_file, text):
    with pytest.raises(InputError, match=r"ur \(rotvec-.*--format robot=|yaskawa"):
        finished(read_contents(robot_file(text), None)[0].only, "robot", None, None, "base_T_gripper")


@pytest.mark.slow
@pytest.mark.parametrize("maker", PROGRAMS)
def test_cut_off_programs_end_in_one_line_or_are_read(robot_file, rigs, maker):
    text = program(maker, rigs[maker][0][:3])
    for end in range(0, len(text), max(1, len(text) // 25)):
        try:
            contents, _ = read_contents(robot_file(text[:end]), maker)
        except InputError:
            continue
        assert len(contents.only) <= 3
