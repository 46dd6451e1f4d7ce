"""Bags that are cut off, damaged, empty or no bags at all: one line that names the file, and no traceback."""

import os
import shutil
import warnings

import numpy as np
import pytest
from fixtures.bags import KINDS, START, Writer

from uq_handeye.errors import InputError, InputWarning
from uq_handeye.read.rosbag import bag as opening
from uq_handeye.read.rosbag import track
from uq_handeye.read.rosbag.listing import text_of
from uq_handeye.read.rosbag.recording import read_recording
from uq_handeye.read.rosbag.streams import read_bag, robot_stream


def cell(folder, kind, n=100):
    with Writer(folder, kind) as bag:
        for k in range(n):
            bag.pose_stamped("/tcp_pose", START + 0.01 * k, "base", np.eye(4))
            bag.tf(START + 0.01 * k, ("base", "tool", np.eye(4)))
    return bag.path


def file_of(path):
    return path if path.is_file() else next(one for one in path.iterdir() if one.suffix in (".mcap", ".db3"))


def assert_one_line(text, path):
    assert "\n" not in text and len(text) < 500 and os.path.basename(path) in text


def refused(path):
    with pytest.raises(InputError) as error:
        read_recording(path)
    text = str(error.value)
    assert_one_line(text, path)
    return text


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_bags_that_are_cut_off_or_damaged(tmp_path, kind):
    whole = file_of(cell(tmp_path, kind))
    data = whole.read_bytes()
    rng = np.random.default_rng(1)
    places = [0, 1, 10, 100, 1000, len(data) // 3, len(data) // 2, len(data) - 100, len(data) - 1]
    cases = [data[:k] for k in places]
    for _ in range(6):
        damaged = bytearray(data)
        for k in rng.integers(0, len(data), 20):
            damaged[k] = rng.integers(256)
        cases.append(bytes(damaged))
    refusals = 0
    for k, case in enumerate(cases):
        path = tmp_path / f"case{k}{whole.suffix}"
        path.write_bytes(case)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                found = read_recording(path)
        except InputError as error:
            refusals += 1
            said = str(error)
            assert_one_line(said, path)
        else:
            assert sum(map(len, found.tree.edges.values())) <= 100
            text_of(found, [str(path)])
        path.unlink()
    assert refusals >= 5


@pytest.mark.slow
def test_what_is_complete_of_a_cut_off_file_is_read(tmp_path):
    with Writer(tmp_path, "mcap") as bag:
        for k in range(9000):  # two chunks
            bag.pose_stamped("/tcp_pose", START + 0.01 * k, "base", np.eye(4))
    data = file_of(bag.path).read_bytes()
    path = tmp_path / "cut.mcap"
    counts = []
    for share in (0.2, 0.75):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.warns(InputWarning, match="cut.mcap: the file was cut off; what is complete before the cut is"):
            found = read_recording(path)
        counts.append(len(robot_stream(found, "/tcp_pose").timestamps))
        assert found.topics["/tcp_pose"].count == counts[-1]
    assert 0 < counts[0] < 2500 and 5000 < counts[1] < 9000
    path.write_bytes(data[:20])
    assert "not a bag that can be read" in refused(path)


def test_files_that_are_no_bags(tmp_path):
    for name, data, words in (
        ("empty.bag", b"", "the file is empty; expected a bag"),
        ("table.bag", b"timestamp,x,y\n1,2,3\n", "no ROS bag; expected a file .bag, .mcap, .db3"),
        ("table.mcap", b"\x00" * 5000, "no ROS bag"),
        ("table.db3", b"SQLite format 3\0" + b"\x07" * 5000, "not a bag that can be read"),
        ("picture.png", b"\x89PNG\r\n\x1a\n" + b"\x07" * 500, "no ROS bag"),
        ("cell.bag", b"SQLite format 3\0" + b"\x07" * 50, "the content is that of a .db3 file"),
        ("cell.mcap.zstd", b"\x28\xb5\x2f\xfd" + b"\x07" * 50, "a compressed file. Give the folder of the bag"),
    ):
        (tmp_path / name).write_bytes(data)
        assert words in refused(tmp_path / name)
    assert "there is no such file or folder" in refused(tmp_path / "none.mcap")
    (tmp_path / "folder").mkdir()
    assert "a folder with metadata.yaml or one file" in refused(tmp_path / "folder")
    (tmp_path / "folder" / "metadata.yaml").write_text("rosbag2_bagfile_information: [1, 2]\n")
    assert "not a bag that can be read" in refused(tmp_path / "folder")
    with pytest.raises(InputError, match="Expected the path of a bag, got int"):
        read_recording(3)
    with pytest.raises(InputError, match="Expected the path of a bag, got none"):
        read_recording([])


@pytest.mark.slow
def test_a_folder_without_metadata_and_a_renamed_file(tmp_path):
    path = cell(tmp_path, "mcap")
    (path / "metadata.yaml").unlink()
    assert read_recording(path).topics["/tf"].count == 100
    shutil.copy(file_of(path), path / "other.mcap")
    assert "got 2 files. ros2 bag reindex writes a metadata.yaml" in refused(path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_topics_without_messages_and_nothing_to_read(tmp_path, kind):
    with Writer(tmp_path, kind) as bag:
        bag.writer.add_connection("/tcp_pose", "geometry_msgs/msg/PoseStamped", typestore=bag.store)
        bag.writer.add_connection("/text", "std_msgs/msg/String", typestore=bag.store)
    recording = read_recording(bag.path)
    assert "Nothing in it is read as poses" in text_of(recording, ["cell"])
    for spec, words in (
        ("/tcp_pose", "the topic has no messages"),
        ("/text", "the topic has"),
        ("base:tool0", "has no transforms"),
        ("", "Expected --robot to be frames"),
        ("base:", "Expected --robot to be frames"),
    ):
        with pytest.raises(InputError, match=words):
            robot_stream(recording, spec)


def test_a_definition_that_would_run_code_is_not_used(tmp_path):
    with Writer(tmp_path, "mcap") as bag:
        bag.pose_stamped("/tcp_pose", START, "base", np.eye(4))
    path = file_of(bag.path)
    data = path.read_bytes()
    good = b"float64 x\nfloat64 y\nfloat64 z"
    assert good in data
    bad = b"float64 x\nfloat64 __import__"[: len(good)]
    for text in (bad, b"float64 x\nfloat64 y;1/0;z   "[: len(good)]):
        path.write_bytes(data.replace(good, text.ljust(len(good))))
        try:
            topic = read_recording(path).topics["/tcp_pose"]
        except InputError:
            continue
        assert topic.kind is None and topic.problem


def test_values_that_are_no_poses(tmp_path):
    wrong = np.eye(4)
    wrong[:3, 3] = np.nan
    with Writer(tmp_path, "mcap") as bag:
        for k in range(3):
            bag.pose_stamped("/tcp_pose", START + k, "base", wrong)
    with pytest.raises(InputError, match=r"/tcp_pose .*expected a finite number, got nan") as error:
        read_bag(bag.path, robot="/tcp_pose", camera="/tcp_pose")
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_huge_bag_is_refused_before_it_fills_the_memory(tmp_path, monkeypatch):
    path = cell(tmp_path, "mcap")
    monkeypatch.setattr(track, "MAX_ROWS", 50)
    with pytest.raises(InputError, match="expected at most 50 rows, got more"):
        read_recording(path)
    monkeypatch.setattr(track, "MAX_ROWS", 1000)
    monkeypatch.setattr(opening, "MAX_DESCRIPTION_BYTES", 10)  # messages that are too long are none of those read here
    assert not read_recording(path).tree.edges
