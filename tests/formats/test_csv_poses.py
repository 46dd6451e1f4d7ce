"""Pose files: what is read, what is written, and the one line that every bad file ends in."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import RigidTransform, Rotation

import uq_handeye as uq
from uq_handeye.core.files import table
from uq_handeye.errors import InputError
from uq_handeye.formats import csv_poses
from uq_handeye.formats.detect import read_contents
from uq_handeye.read import pose_text, read_pose_file, write_pose_file

HEADER = "timestamp,x,y,z,qx,qy,qz,qw"
GOOD = f"{HEADER}\n0.5,1,2,3,0,0,0,1\n1.5,4,5,6,1,0,0,0\n"


@pytest.fixture
def file(tmp_path):
    def make(content):
        path = tmp_path / "robot.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def message(path, **options):
    """The message of the error, which must be one line that names the file."""
    with pytest.raises(InputError) as caught:
        read_pose_file(path, **options)
    text = str(caught.value)
    assert "\n" not in text
    assert text.isprintable()
    assert "robot.csv" in text
    return text


def check_good(path):
    timestamps, poses = read_pose_file(path)
    np.testing.assert_array_equal(timestamps, [0.5, 1.5])
    np.testing.assert_array_equal(poses[:, :3, 3], [[1, 2, 3], [4, 5, 6]])
    np.testing.assert_array_equal(poses[0, :3, :3], np.eye(3))
    np.testing.assert_array_equal(poses[1, :3, :3], np.diag([1, -1, -1]))
    np.testing.assert_array_equal(poses[:, 3], [[0, 0, 0, 1]] * 2)


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.rstrip("\n"),
        GOOD.replace("\n", "\r\n"),
        "\ufeff" + GOOD,
        "\ufeff\n" + GOOD,
        GOOD + "\n \n\r\n",
        "# a comment, \u00e4\n" + GOOD.replace("\n", "\n# more\n"),
        GOOD.replace(",", " ,\t"),
        f"frame_id,{HEADER}\nbase_link,0.5,1,2,3,0,0,0,1\nbase_link,1.5,4,5,6,1,0,0,0\n",
        GOOD.replace("0.5", "+5e-1"),
        GOOD.replace(HEADER, ",".join(f'"{name}"' for name in HEADER.split(","))),
        "qw,timestamp,x,y,z,qx,qy,qz\n1,0.5,1,2,3,0,0,0\n0,1.5,4,5,6,1,0,0\n",
    ],
    ids=[
        "plain",
        "no-end",
        "crlf",
        "bom",
        "bom-blank",
        "blank",
        "comments",
        "spaces",
        "names-in-rows",
        "number",
        "quoted",
        "order",
    ],
)
def test_reads(file, content):
    check_good(file(content))


@pytest.mark.parametrize(
    "content",
    [
        GOOD.replace(",", ";"),
        GOOD.replace(",", ";").replace("0.5", "0,5").replace("1.5", "1,5"),
        GOOD.replace(",", "\t"),
        "\n".join([HEADER, '"0.5","1","2","3","0","0","0","1"', '"1.5","4","5","6","1","0","0","0"']),
        "#" + GOOD,
        "# made by a tool, in a lab\n# " + GOOD,
        "# " + HEADER + "\n" + GOOD,
        GOOD.replace("x,y,z", "x_m,y_m,z_m"),
        "timestamp [ms],x [mm],y [mm],z [mm],qx [],qy [],qz [],qw []\n500,1000,2000,3000,0,0,0,1\n"
        "1500,4000,5000,6000,1,0,0,0\n",
        "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],v [m s^-1]\n"
        "500000000,1,2,3,1,0,0,0,9\n1500000000,4,5,6,0,1,0,0,9\n",
        "%time,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
        "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n"
        "500000000,base,1,2,3,0,0,0,1\n1500000000,base,4,5,6,1,0,0,0\n",
        "name,__time,/p/position/x,/p/position/y,/p/position/z,/p/orientation/x,/p/orientation/y,/p/orientation/z,"
        "/p/orientation/w\na b.png,0.5,1,2,3,0,0,0,1\nc.png,1.5,4,5,6,1,0,0,0\n",
    ],
    ids=[
        *(
            "semicolons",
            "decimal-commas",
            "tabs",
            "quoted-numbers",
            "comment-header",
            "comments-header",
            "both-headers",
        ),
        *("metres", "millimetres", "euroc", "rostopic", "plotjuggler"),
    ],
)
def test_reads_tables_of_other_programs(file, content):
    check_good(file(content))


def test_units_in_the_header_and_units_given(file):
    path = file(GOOD.replace("x,y,z", "x_mm,y_mm,z_mm"))
    _, poses = read_pose_file(path)
    np.testing.assert_array_equal(read_pose_file(path, units="mm")[1], poses)
    assert poses[0, 0, 3] == 0.001
    text = message(path, units="cm")
    assert "in mm" in text
    assert "cm" in text


def test_what_is_not_used_is_said(file):
    contents = read_contents(file(f"id,{HEADER}\n7,0.5,1,2,3,0,0,0,1\n"), None)[0]
    assert "not used: the columns 'id'" in contents.notes


def test_comment_in_any_encoding_is_skipped(file):
    check_good(file(b"# \xe4\xff\n" + GOOD.encode()))


def test_units(file):
    _, poses = read_pose_file(file(GOOD), units="mm")
    np.testing.assert_allclose(poses[0, :3, 3], [1e-3, 2e-3, 3e-3], rtol=1e-15)
    with pytest.raises(InputError, match=r"`units`.*'furlong'"):
        read_pose_file(file(GOOD), units="furlong")


def test_quaternion_is_normalised(file):
    _, poses = read_pose_file(file(f"{HEADER}\n0,0,0,0,0,0,0,0.9995\n"))
    np.testing.assert_array_equal(poses[0], np.eye(4))


ROW = "0,1,2,3,0,0,0,1\n"


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("", ["empty", HEADER]),
        ("\ufeff", ["empty"]),
        ("# nothing\n\n", ["empty"]),
        (HEADER + "\n", ["no rows"]),
        (HEADER, ["no rows"]),
        (ROW, ["line 1", HEADER, "header line is missing"]),
        ("# time x y z\n0 1 2 3 0 0 0 1\n", ["line 2", "header line is missing"]),
        (HEADER.replace(",", ";") + "\n0;1;2\n", ["line 2", "8 fields separated by semicolons", "got 3"]),
        ("x,y,z,qx,qy,qz\n" + ROW, ["line 1", "missing: 'qw'"]),
        (
            "x,y,z,roll,pitch,yaw\n" + ROW,
            [
                "line 1",
                "unknown: 'roll, pitch, yaw'",
                "must be quaternions",
                "--rotation",
                "docs/how-to/controller.md",
            ],
        ),
        (HEADER.replace("x,y", "x_mm,y_m") + "\n" + ROW, ["line 1", "one unit for x, y and z", "m, mm, none"]),
        (HEADER.replace("qx", "qx_deg") + "\n" + ROW, ["line 1", "missing: 'qx'"]),
        ("1,2,3,0,0,0,1\n", ["line 1", "header line is missing", "x,y,z,qx,qy,qz,qw"]),
        (",".join("1" * 16) + "\n", ["line 1", "--format matrix"]),
        (GOOD.replace("\n", "\r"), ["line 1", "line feed"]),
        ("when,x,y,qx,qy,qz,qw\n" + ROW, ["line 1", HEADER, "'when,x,y", "missing: 'z'", "unknown: 'when'"]),
        ("x,x,y,z,qx,qy,qz,qw\n", ["repeated: 'x'"]),
        ("tx,x,y,z,qx,qy,qz,qw\n", ["repeated: 'x'"]),
        (f"{HEADER}\n{ROW}1,2,3\n", ["line 3", "expected 8 fields", "got 3"]),
        (f"{HEADER}\n1,2,3,4,0,0,0,1,5\n", ["line 2", "got 9"]),
        (f"{HEADER}\na,b,c\n", ["line 2", "got 3"]),
        (f"# c\n{HEADER}\n\n0,1,2,3,0,0,zero,1\n", ["line 4", "column qz", "'zero'"]),
        (f"{HEADER}\n0,1,,3,0,0,0,1\n", ["line 2", "column y", "empty field"]),
        (f"{HEADER}\n0,1_000,2,3,0,0,0,1\n", ["line 2", "column x", "'1_000'"]),
        (f"{HEADER}\n0,1,2,\u00a03,0,0,0,1\n", ["line 2", "column z"]),
        (f"{HEADER}\n0,1,2,{'9' * 200}z,0,0,0,1\n", ["line 2", "column z", "..."]),
        (f"qw,{HEADER[:-3]}\nNo,0,1,2,3,0,0,0\n", ["line 2", "column qw", "'No'"]),
        (f"{HEADER}\n{ROW}1,1,2,nan,0,0,0,1\n", ["line 3", "column z", "finite", "nan"]),
        (f"{HEADER}\n0,-inf,2,0,0,0,0,1\n", ["line 2", "column x", "-inf"]),
        (f"{HEADER}\n0,1,2,1e999,0,0,0,1\n", ["line 2", "column z", "inf"]),
        (
            f"{HEADER}\n0,1,2,3,0,0,0,0\n",
            ["line 2", "columns qx,qy,qz,qw", "norm 0", "orientation is missing"],
        ),
        (f"{HEADER}\n{ROW}1,1,2,3,90,0,0,1\n", ["line 3", "qx,qy,qz,qw", "norm 90.0056", "columns shifted"]),
        (f"{HEADER}\n0,1,2,3,1e200,0,0,1\n", ["line 2", "norm inf"]),
        (f"{HEADER}\n{ROW}# x\n0,1,2,4,0,0,0,1\n", ["line 4", "column timestamp", "repeats", "line 2"]),
        (b"\x89PNG\r\n\x1a\n\0\0", ["line 1", "not UTF-8"]),
        (GOOD.encode("utf-16"), ["line 1", "not UTF-8"]),
        (GOOD.encode("utf-16-le"), ["line 1", "NUL"]),
        (HEADER.encode() + b"\n0,1,2,3,\xff,0,0,1\n", ["line 2", "column qx", "not UTF-8"]),
        (HEADER.encode() + b"\n0,1,2,3,0\0,0,0,1\n", ["line 2", "column qx", "NUL"]),
        (HEADER.encode() + b"\n\0\0\n", ["line 2", "NUL"]),
        (HEADER.encode() + b"\n" + b"0" * 10_001 + b"\n", ["10000 characters"]),
        (b" " * 100_000, ["10000 characters"]),
    ],
)
def test_one_line_says_what_is_wrong(file, content, parts):
    text = message(file(content))
    for part in parts:
        assert part in text


def test_longest_line(file):
    check_good(file("#" + "x" * 9_999 + "\r\n" + GOOD))


def test_files_that_cannot_be_read(tmp_path):
    assert "no such file" in message(tmp_path / "robot.csv")
    assert "no such file" in message(tmp_path / "robot.csv\nline")
    (tmp_path / "robot.csv").mkdir()
    assert "folder" in message(tmp_path / "robot.csv")
    for path in (3, None, "robot\0.csv", "\ud800"):
        with pytest.raises(InputError, match="Expected the path of a file"):
            read_pose_file(path)


def test_permission(file, monkeypatch):
    path = file(GOOD)

    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    assert "permission denied" in message(path)


def test_limits(file, monkeypatch):
    path = file(GOOD)
    monkeypatch.setattr(table, "MAX_ROWS", 1)
    assert "line 3: expected at most 1 rows" in message(path)
    monkeypatch.setattr(csv_poses, "MAX_TABLE_BYTES", 10)
    assert "expected at most 1e-05 MB" in message(path)


def test_line_without_end_is_refused_early(file):
    assert "at most 10000 characters" in message(file(b"\0" * 20_000))


numbers = st.floats(-1e6, 1e6)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(data=st.data(), n=st.integers(1, 4))
def test_round_trip(tmp_path_factory, data, n):
    q = data.draw(arrays(float, (n, 4), elements=st.floats(-1, 1)))
    q[np.linalg.norm(q, axis=1) < 1e-3] = [0, 0, 0, 1]
    times = np.array(sorted(data.draw(st.sets(st.floats(-1e18, 1e18), min_size=n, max_size=n))))
    poses = np.tile(np.eye(4), (n, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(q).as_matrix()
    poses[:, :3, 3] = data.draw(arrays(float, (n, 3), elements=numbers))
    path = tmp_path_factory.getbasetemp() / "round_trip.csv"
    write_pose_file(path, poses, times)
    timestamps, again = read_pose_file(path)
    np.testing.assert_array_equal(timestamps, times)
    np.testing.assert_array_equal(again[:, :3, 3], poses[:, :3, 3])
    np.testing.assert_allclose(again[:, :3, :3], poses[:, :3, :3], rtol=0, atol=1e-15)


def test_half_turns_round_trip(tmp_path):
    """Poses where the scalar part vanishes, and next to it."""
    axes = np.random.default_rng(0).normal(size=(200, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = np.pi - np.repeat([0, 1e-12, 1e-8, 1e-4], 50)
    poses = np.tile(np.eye(4), (200, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(axes * angles[:, None]).as_matrix()
    write_pose_file(tmp_path / "a.csv", poses)
    np.testing.assert_allclose(read_pose_file(tmp_path / "a.csv")[1], poses, rtol=0, atol=1e-15)


def test_write_takes_rigid_transforms_and_numbers_rows(tmp_path):
    path = tmp_path / "a.csv"
    write_pose_file(path, RigidTransform.from_translation([[0.1, -0.0, 1e-20], [1, 2, 3]]))
    assert path.read_bytes() == (
        f"{HEADER}\n0.0,0.1,0.0,1e-20,0.0,0.0,0.0,1.0\n1.0,1.0,2.0,3.0,0.0,0.0,0.0,1.0\n".encode()
    )


@pytest.mark.parametrize(
    ("poses", "timestamps", "part"),
    [
        (np.eye(4), None, "`poses`"),
        (np.empty((0, 4, 4)), None, "`poses`"),
        (np.ones((1, 1, 4, 4)) * np.eye(4), None, "n, 4, 4"),
        (np.eye(4)[None] * np.nan, None, "finite"),
        (np.eye(4)[None], [1, 2], "`timestamps` to be 1 finite"),
        (np.eye(4)[None], [np.nan], "`timestamps`"),
        (np.eye(4)[None], ["soon"], "`timestamps` to be numbers"),
        (np.tile(np.eye(4), (3, 1, 1)), [1, 2, 2], "`timestamps` to differ, got 2.0 for poses 1 and 2"),
    ],
)
def test_write_refuses_what_cannot_be_read(tmp_path, poses, timestamps, part):
    with pytest.raises(InputError, match=part):
        write_pose_file(tmp_path / "a.csv", poses, timestamps)
    assert list(tmp_path.iterdir()) == []


def test_pose_text_is_what_is_written(tmp_path):
    write_pose_file(tmp_path / "a.csv", np.eye(4)[None], [7])
    assert (tmp_path / "a.csv").read_text() == pose_text(np.eye(4)[None], [7])


def test_rows_that_repeat_time_and_numbers_are_left_out(file):
    path = file(f"{HEADER}\n{ROW}{ROW}1,1,2,4,0,0,0,1\n{ROW}")
    times, poses = read_pose_file(path)
    np.testing.assert_array_equal(times, [0.0, 1.0])
    np.testing.assert_array_equal(poses[:, :3, 3], [[1, 2, 3], [1, 2, 4]])
    stream = uq.read_stream(path, "robot")
    assert len(stream) == 2
    assert "2 rows that repeat a time and its numbers are left out" in stream.source.notes
