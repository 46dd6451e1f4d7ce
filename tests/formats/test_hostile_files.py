"""Whatever the bytes, a reader gives poses or one line that says what is wrong; the memory stays bounded."""

import io
import json
import struct
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import strategies as st
from support import holds_for

from uq_handeye.errors import InputError
from uq_handeye.formats import numpy_poses
from uq_handeye.formats.detect import read_contents
from uq_handeye.read import FORMATS

SAMPLES = Path(__file__).parent / "samples"
POSE = np.eye(4).tolist()
MESSAGE = {"translation": {"x": 0.0, "y": 0, "z": 0}, "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}
STORAGE = "%YAML:1.0\n---\n"


@pytest.fixture
def file(tmp_path):
    def make(content, name="poses.dat"):
        path = tmp_path / name
        if isinstance(content, dict | list):
            content = json.dumps(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return make


def message(path, format=None):
    """The message of the error, which must be one line that names the file."""
    with pytest.raises(InputError) as caught:
        read_contents(path, format)
    text = str(caught.value)
    assert "\n" not in text
    assert text.isprintable()
    assert len(text) < 900
    assert path.name in text
    return text


def samples(**changes):
    part = json.loads(json.dumps(MESSAGE, allow_nan=True))
    for key, value in changes.items():
        part["translation" if key in "xyz" else "rotation"][key[-1]] = value
    other = {"robot": part, "tracking": MESSAGE}
    return json.loads(json.dumps({"samples": [{"robot": MESSAGE, "tracking": MESSAGE}, other]}))


def npz(**arrays):
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def npy(array, **options):
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return buffer.getvalue()


MATRIX = "!!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: {dt}\n   data: {data}\n"


def storage(R, t="[ 1., 2., 3. ]", rows=3, cols=3, dt="d"):
    return (
        STORAGE
        + "R_gripper2base: "
        + MATRIX.format(rows=rows, cols=cols, dt=dt, data=R)
        + "t_gripper2base: "
        + MATRIX.format(rows=3, cols=1, dt="d", data=t)
    )


EYE = "[ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]"


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ("", ["the file is empty"]),
        ("# only\n\n", ["the file is empty"]),
        (b"\x1f\x8b\x08", ["gzip", "unpack"]),
        (b"\x89PNG\r\n\x1a\n", ["is a picture", "--images", "docs/how-to/camera.md"]),
        ("some words\n", ["not a pose file", "'some words'"]),
        # tables
        ("0 1 2 3 0 0 0 1\n1 1 2\n", ["line 2", "expected 8 fields separated by spaces", "got 3"]),
        (" ".join("1" * 12), ["line 1", "no rotation", "Matrices in text"]),
        ("0 1 2 3 0 0 0 1\n1 1 x 3 0 0 0 1\n", ["line 2", "column ty", "'x'"]),
        ("0 1 2 3 0 0 0 1\n1 1 1_0 3 0 0 0 1\n", ["line 2", "column ty", "'1_0'"]),
        ("0 1 2 nan 0 0 0 1\n", ["line 1", "column tz", "finite"]),
        ("0 1 2 3 0 0 0 1\n0 1 2 4 0 0 0 1\n", ["line 2", "column timestamp", "repeats", "line 1"]),
        ("0 1 2 1e300 0 0 0 1\n", ["line 1", "translation below 1e+75", "1e+300"]),
        ("0 1 2 3 90 0 0 1\n", ["line 1", "columns qx,qy,qz,qw", "unit quaternion"]),
        ("0,1,2,3,0,0,0,1\n", ["abb (wxyz, m), table (xyzw, m)", "--format"]),
        ("timestamp;x;y;z;qx;qy;qz;qw\n", ["no rows after the header"]),
        ("timestamp tx ty tz qx qy qz qw\n", ["no rows after the header"]),
        ("0 1 2 3 0 0 0 1\ntimestamp tx ty tz qx qy qz qw\n", ["line 2", "column timestamp", "'timestamp'"]),
        # YAML
        ("a: [1, 2\nb: 3\n", ["line 2", "not YAML"]),
        ("a: &x [1]\nb: *x\n", ["line 1", "anchors and aliases"]),
        ("a: 1\na: 2\n", ["line 2", "'a'", "twice"]),
        ("- " * 40 + "1", ["levels of nesting"]),
        ("a: 1\n? [1, 2]\n: 3\n", ["line 2", "key"]),
        ("a: 1\n---\nb: 2\n", ["names of a format that is known", "a list of 2"]),
        ("a: \x01\n", ["not YAML"]),
        ("nothing: here\n", ["names of a format that is known", "'nothing'", "--format"]),
        (b"a: \xff\n", ["UTF-8"]),
        (yaml.safe_dump({"samples": []}), ["samples", "a list of 0"]),
        (yaml.safe_dump({"samples": [1]}), ["sample 0", "map with robot"]),
        (yaml.safe_dump(samples(x="far")), ["sample 1, robot, translation.x", "a number", "'far'"]),
        (yaml.safe_dump(samples(x=float("nan"))), ["sample 1, robot, translation.x", "finite"]),
        (yaml.safe_dump(samples(rw=float("inf"))), ["sample 1, robot, rotation.w", "finite"]),
        (yaml.safe_dump(samples(rw=2.0)), ["sample 1", "rotation.x,rotation.y", "norm 2"]),
        (yaml.safe_dump(samples(rw=True)), ["rotation.w", "'True'"]),
        (
            yaml.safe_dump({"samples": [{"robot": {"translation": {}}, "tracking": 1}]}),
            ["robot, translation", "field x"],
        ),
        (
            "parameters: {calibration_type: eye}\nsamples: " + json.dumps(samples()["samples"]),
            ["calibration_type", "'eye'"],
        ),
        ("parameters: {}\ntransform: {}\n", ["a result of easy_handeye", "samples"]),
        (yaml.safe_dump({"hand_world_samples": [MESSAGE]}), ["field camera_marker_samples"]),
        (
            json.dumps({"hand_world_samples": [MESSAGE], "camera_marker_samples": [MESSAGE] * 2}),
            ["as many", "1 and 2"],
        ),
        (yaml.safe_dump([{"effector_wrt_world": [1.0] * 16}]), ["sample 0", "object_wrt_sensor"]),
        (
            yaml.safe_dump([{"effector_wrt_world": [1.0] * 15, "object_wrt_sensor": [1.0] * 16}]),
            ["sample 0, effector_wrt_world", "4x4", "list of 15"],
        ),
        (
            yaml.safe_dump([{"effector_wrt_world": [1.0] * 16, "object_wrt_sensor": [1.0] * 16}]),
            ["sample 0", "last row"],
        ),
        ("joint_names: [a]\njoint_values: [[1]]\n", ["joint states", "Save samples"]),
        # JSON
        ("{", ["line 1", "not JSON"]),
        ("[" * 100_000, ["not JSON|deep"]),
        ('{"robot": [1' + "0" * 5000 + "]}", ["robot, pose 0"]),
        ('{"a": 1, "a": 2}', ["'a'", "twice"]),
        ({"robot": []}, [", robot", "list of 0"]),
        ({"robot": [POSE, POSE[:3]]}, ["robot, pose 1", "4x4", "list of 3"]),
        ({"robot": [[[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]}, ["robot, pose 0", "not orthogonal"]),
        ({"robot": [POSE], "timestamps": [1, 2]}, ["timestamps", "list of 1 numbers"]),
        ({"robot": [POSE, POSE], "timestamps": [1, 1]}, ["pose 1", "repeats"]),
        ({"robot": [POSE], "base_T_gripper": [POSE]}, ["robot poses once"]),
        ({"robot": [POSE], "setup": "eye"}, ["setup", "'eye'"]),
        ({"robot": [{"translation": [1, 2, 3]}]}, ["pose 0", "quaternion_xyzw"]),
        ({"robot": [{"translation": [1, 2], "quaternion_xyzw": [0, 0, 0, 1]}]}, ["pose 0, translation", "list of 3"]),
        ({"robot": [{"translation": [1, 2, 1e999], "quaternion_xyzw": [0, 0, 0, 1]}]}, ["translation[2]", "finite"]),
        ({"format": "uq-handeye calibration 3"}, ["a result of uq-handeye"]),
        ({"robot": [POSE], "R_gripper2base": 1}, ["R_gripper2base"]),
        # OpenCV
        (storage("[ 1., 0. ]"), ["R_gripper2base", "9 numbers for 3 x 3", "list of 2"]),
        (storage(EYE, dt="q"), ["R_gripper2base, dt", "'q'"]),
        (storage(EYE, rows="many"), ["R_gripper2base, size", "'many'"]),
        (storage(EYE, rows=1e300, cols=1e300), ["R_gripper2base", "expected"]),
        (storage("[ 1., 0., 0., 0., .Nan, 0., 0., 0., 1. ]"), ["R_gripper2base, data[4]", "finite"]),
        (storage("[ 1., 0., 0., 0., -1., 0., 0., 0., 1. ]"), ["pose 0", "left-handed"]),
        (storage("[ 90., 0., 0. ]", rows=3, cols=1), ["rad", "degrees"]),
        (STORAGE + "R_gripper2base: 1\n", ["t_gripper2base beside"]),
        (STORAGE + "R_gripper2base: 1\nt_gripper2base: 2\n", ["t_gripper2base", "a matrix of OpenCV"]),
        ("<html/>", ["opencv_storage", "html"]),
        ("<opencv_storage><a></opencv_storage>", ["line 1", "not XML"]),
        ('<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage/>', ["document type"]),
        ("<opencv_storage>" + "<a>" * 50, ["levels"]),
        ("<opencv_storage/>", ["names of a format that is known"]),
        # NumPy
        (npy(np.eye(5)), ["shape (n, 4, 4)", "(5, 5)"]),
        (npy(np.empty((0, 4, 4))), ["(0, 4, 4)"]),
        (npy(np.full((2, 4, 4), np.nan)), ["pose 0", "finite"]),
        (npy(np.zeros((2, 4, 4), dtype=complex)), ["complex"]),
        (npy(np.array([None])), ["Python objects"]),
        (npy(np.tile(np.eye(4), (2, 1, 1)))[:-8], ["cut off"]),
        (npy(np.eye(4))[:20], ["not an array of NumPy"]),
        (b"\x93NUMPY\x01\x00", ["not an array of NumPy"]),
        (npz(robot=np.eye(3)), ["robot", "(n, 4, 4)", "(3, 3)"]),
        (npz(a=np.eye(4), b=np.eye(4)), ["robot and camera", "'a, b'"]),
        (npz(robot=np.eye(4)[None], base_T_gripper=np.eye(4)[None]), ["robot poses once", "base_T_gripper"]),
        (npz(robot=np.eye(4)[None], timestamps=np.arange(2.0)), ["a time for each of the 1 poses", "got 2"]),
        (npz(robot=np.eye(4)[None], timestamps=np.array(["now"])), ["timestamps", "seconds"]),
        (npz(robot=np.eye(4)[None], setup="eye"), ["setup", "'eye'"]),
        (npz(robot=np.array(["text"])), ["robot", "numbers"]),
        (npz(robot=np.array([None])), ["robot", "Python objects"]),
        (npz(robot=np.eye(4)[None])[:-30], ["damaged"]),
        (b"PK\x03\x04", ["damaged"]),
    ],
)
def test_one_line_says_what_is_wrong(file, content, parts):
    path = file(content)
    with pytest.raises(InputError) as caught:  # numbers are looked at when the side is finished
        finish(read_contents(path, None)[0])
    text = str(caught.value)
    assert text.isprintable()
    assert len(text) < 900
    assert "poses.dat" in text
    for part in parts:
        assert any(one in text for one in part.split("|")), (part, text)


def finish(contents):
    from uq_handeye.formats.contents import finished

    for side, role in ((contents.robot, "robot"), (contents.camera, "camera"), (contents.only, "robot")):
        if side is not None:
            poses = finished(side, role, "m", None, {"robot": "base_T_gripper", "camera": "camera_T_target"}[role])
            assert poses.shape == (len(side), 4, 4)
            assert np.isfinite(poses).all()


def test_content_of_two_formats_asks_for_the_flag(file):
    text = message(file({"robot": [POSE], "effector_wrt_world": 1, "samples": []}))
    assert "fits easy_handeye2 and moveit and json" in text
    assert "--format" in text


def test_a_wrong_format_says_what_it_looks_like(file):
    tum = "0 1 2 3 0 0 0 1\n"
    assert "It looks like tum: leave `format` (--format) out" in message(file(tum), "csv")
    assert "It looks like npz" in message(file(npz(robot=np.eye(4)[None])), "csv")
    assert "It looks like easy_handeye2" in message(file(samples()), "moveit")
    assert "It looks like YAML, JSON or XML" in message(file(samples()), "tum")
    for format in FORMATS:
        message(file(b"\0\1\2\3"), format)


def test_the_suffix_names_the_reader_of_a_content_that_says_nothing(file):
    assert "line 1: expected the header timestamp,x,y,z" in message(file("some words\n", "poses.csv"))


def test_names_with_control_characters(tmp_path):
    path = tmp_path / "a\x1b[31m\nb.tum"
    path.write_text("0 1 2 3 0 0 0 2\n")
    with pytest.raises(InputError) as caught:
        finish(read_contents(path, None)[0])
    assert str(caught.value).isprintable()
    path.write_text("0 1 2 3 0 0 0 1\n")
    assert read_contents(path, None)[1].name.isprintable()


def zipped(name, content, method=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        archive.writestr(name, content)
    return buffer.getvalue()


def huge_header(shape):
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header


def test_sizes_are_checked_before_anything_is_unpacked(file, monkeypatch):
    monkeypatch.setattr(numpy_poses, "MAX_TABLE_BYTES", 1_000_000)
    bomb = file(zipped("robot.npy", bytes(50_000_000)))
    assert bomb.stat().st_size < 100_000
    many = file(npz(**{f"a{k}": np.eye(4)[None] for k in range(101)}), "many.npz")
    declares = file(zipped("robot.npy", huge_header("(100000000, 4, 4)")), "declares.npz")
    negative = file(huge_header("(-1, 4, 4)") + bytes(128), "negative.npy")
    tracemalloc.start()
    try:
        assert "expected at most 100 arrays of 1 MB together" in message(bomb)
        assert "100 arrays" in message(many)
        assert "declares more numbers than it holds" in message(declares)
        message(negative)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_trees_of_limited_size(file, monkeypatch):
    monkeypatch.setattr("uq_handeye.formats.detect.MAX_DESCRIPTION_BYTES", 100)
    assert "expected at most" in message(file("a: " + "1" * 100))


def test_yaml_runs_nothing(file):
    text = "samples: !!python/object/apply:os.system ['echo']\n"
    assert "sample 0" in message(file(text))


def test_deep_yaml_ends_early(file):
    assert "levels of nesting" in message(file("a: " + "[" * 200_000))
    assert "nesting" in message(file("- " * 20_000 + "1"))


CONTENTS = [path.read_bytes() for path in sorted(SAMPLES.iterdir()) if path.suffix != ".md"]


@pytest.mark.slow
@holds_for(
    examples=400,
    data=st.one_of(
        st.binary(max_size=200),
        st.text(alphabet="0123456789.,-eE:[]{}&*!|>'\"#% \n_TRxyzwnai<>/", max_size=120).map(str.encode),
        st.builds(
            lambda base, at, cut, insert: base[: at % (len(base) + 1)] + insert + base[at % (len(base) + 1) + cut :],
            st.sampled_from(CONTENTS),
            st.integers(0, 10_000),
            st.integers(0, 40),
            st.binary(max_size=6),
        ),
    ),
    format=st.sampled_from([None, None, *FORMATS]),
)
def test_any_bytes_give_poses_or_an_input_error(tmp_path_factory, data, format):
    path = tmp_path_factory.getbasetemp() / "fuzz.dat"
    path.write_bytes(data)
    try:
        contents, source = read_contents(path, format)
        finish(contents)
        assert source.size == len(data)
    except InputError as error:
        text = str(error)
        assert text.isprintable()
        assert len(text) < 1500
