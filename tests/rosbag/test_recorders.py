"""MCAP files of recorders other than ROS: read by the definitions that they hold, or named.

The files in ``samples`` were written by ``samples/write_recordings.py`` with foxglove-sdk 0.30.3, mcap 1.6.0,
mcap-protobuf-support 0.6.0 and rosbags 0.11.9; all hold the rig of ``rig.npz``.
"""

import json
import struct
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from support import difference

import uq_handeye as uq
from uq_handeye.core.limits import MAX_MESSAGE_BYTES
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.read.rosbag.decompression import DamagedError
from uq_handeye.read.rosbag.listing import command_of, text_of
from uq_handeye.read.rosbag.protobuf import MessageTypes
from uq_handeye.read.rosbag.recording import read_recording
from uq_handeye.read.rosbag.sensors import Sensors
from uq_handeye.read.rosbag.streams import camera_stream, robot_stream

SAMPLES = Path(__file__).parent / "samples"
# Robot and camera of each file, as the listing names them.
FILES = {
    "foxglove": ("base:tool0", "/board"),
    "json": ("base:tool0", "/board"),
    "protobuf": ("base:tool0", "camera:board"),
    "ros1": ("/robot", "/board"),
    "ros2": ("/robot", "/board"),
}


@pytest.fixture(scope="module")
def rig():
    return dict(np.load(SAMPLES / "rig.npz"))


@pytest.mark.parametrize("name", FILES)
def test_what_outside_libraries_write(rig, name):
    recording = read_recording(SAMPLES / f"{name}.mcap")
    robot, camera = FILES[name]
    for stream, side in (
        (robot_stream(recording, robot), "robot"),
        (camera_stream(recording, camera).stream, "camera"),
    ):
        np.testing.assert_allclose(stream.timestamps, rig["times"], rtol=0, atol=1e-6)
        np.testing.assert_allclose(stream.poses, rig[side], rtol=0, atol=1e-12)
    assert f"--robot {robot} --camera" in command_of(recording, ["cell.mcap"])
    assert not recording.notes


def test_intrinsics_and_joints_of_foxglove(rig):
    recording = read_recording(SAMPLES / "foxglove.mcap")
    (info,) = recording.infos.values()
    assert (info.frame, info.image_size, info.model) == ("camera", (1280, 720), "plumb_bob")
    np.testing.assert_array_equal(info.K, [900.0, 900.0, 640.0, 360.0])
    np.testing.assert_array_equal(info.D, [0.1, 0.0, 0.0, 0.0, 0.0])
    (track,) = recording.joint_tracks("/joints")  # the gripper has no position, and is none of them
    assert track.names == [f"j{k}" for k in range(6)]
    np.testing.assert_array_equal(track.values[:, 1:], rig["joints"])


@pytest.mark.slow
def test_a_rig_of_foxglove_gives_x_within_its_region(rig):
    recording = read_recording(SAMPLES / "foxglove.mcap")
    sides = robot_stream(recording, "base:tool0"), camera_stream(recording, "/board").stream
    pairs = Sensors("foxglove.mcap", *sides, ("robot", "camera")).taken_one_by_one("eye-in-hand")
    result = uq.calibrate(pairs)
    error = difference(result.X, rig["X"])
    assert error @ np.linalg.solve(result.covariance, error) < chi2.ppf(0.95, 6)


# ------------------------------------------------------------------------------------------- files made for the tests


def text(value):
    return struct.pack("<I", len(value)) + value


def record(opcode, content):
    return bytes([opcode]) + struct.pack("<Q", len(content)) + content


def mcap(path, *topics, end=True):
    """Write a file without index: topics are (name, type, form of the definition, definition, encoding, messages)."""
    data = b"\x89MCAP0\r\n" + record(1, text(b"") + text(b"test"))
    for k, (topic, kind, form, definition, encoding, messages) in enumerate(topics, start=1):
        if kind:
            data += record(3, struct.pack("<H", k) + text(kind) + text(form) + text(definition))
        schema = k if kind else 0
        data += record(4, struct.pack("<HH", k, schema) + text(topic) + text(encoding) + text(b""))
        for j, message in enumerate(messages):
            data += record(5, struct.pack("<HIQQ", k, 0, 10**9 * (j + 1), 0) + message)
    footer = record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n"
    path.write_bytes(data + (footer if end else b""))
    return path


def of_json(x=0.1, **more):
    pose = {"position": {"x": x, "y": 0, "z": 0.5}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    return json.dumps({"frame_id": "camera", "pose": pose} | more).encode()


def test_topics_that_cannot_be_read_are_named(tmp_path):
    path = mcap(
        tmp_path / "cell.mcap",
        (b"/bare", b"", b"", b"", b"protobuf", [b"\x0a\x00"]),
        (b"/lost", b"foxglove.PoseInFrame", b"", b"", b"protobuf", [b"\x0a\x00"]),
        (b"/flat", b"foxglove.PoseInFrame", b"flatbuffer", b"abc", b"flatbuffer", [b"\x0a\x00"]),
        (b"/broken", b"foxglove.PoseInFrame", b"protobuf", b"\x0a\xff", b"protobuf", [b"\x0a\x00"]),
        (b"/other", b"foxglove.PoseInFrame", b"protobuf", b"", b"cbor", [b"\x0a\x00"]),
        (b"/board", b"foxglove.PoseInFrame", b"jsonschema", b"{}", b"json", [of_json(0.1), of_json(0.2)]),
    )
    recording = read_recording(path)
    problems = {name: topic.problem for name, topic in recording.topics.items()}
    assert problems["/bare"] == "messages in protobuf without their schema"
    assert problems["/lost"] == "messages in protobuf without their schema"
    assert "flatbuffer" in problems["/flat"] and "cbor" in problems["/other"]
    assert problems["/broken"].startswith("definition of its type: a number that is cut off")
    assert problems["/board"] == "" and len(camera_stream(recording, "/board").stream) == 2
    listing = text_of(recording, [str(path)])
    assert "messages in protobuf without their schema" in listing and "reindex" not in listing
    with pytest.raises(InputError, match="--camera /bare: the topic has messages in protobuf without their schema"):
        camera_stream(recording, "/bare")


def test_a_message_without_a_stamp_is_of_the_time_of_its_recording(tmp_path):
    stamp = {"timestamp": {"sec": 7, "nsec": 500_000_000}}
    written = [
        of_json(0.1),
        of_json(0.2, **stamp),
        of_json(0.3, timestamp="1970-01-01T00:00:09Z"),
        b'{"frame_id": "c"}',
    ]
    path = mcap(tmp_path / "cell.mcap", (b"/board", b"foxglove.PoseInFrame", b"jsonschema", b"{}", b"json", written))
    recording = read_recording(path)
    found = camera_stream(recording, "/board").stream
    np.testing.assert_array_equal(found.timestamps, [1.0, 7.5, 9.0])
    assert recording.notes == ["/board: expected a pose or a transform: 1 messages are left out"]


def test_files_that_are_cut_off_are_read_as_far_as_they_go(tmp_path):
    written = [of_json(0.01 * k) for k in range(50)]
    topic = (b"/board", b"foxglove.PoseInFrame", b"jsonschema", b"{}", b"json", written)
    data = mcap(tmp_path / "whole.mcap", topic, end=False).read_bytes()
    path = tmp_path / "cut.mcap"
    for share in (0.3, 0.7, 1.0):
        path.write_bytes(data[: int(share * len(data))])
        with pytest.warns(InputWarning, match="the file was cut off; what is complete before the cut is read"):
            found = read_recording(path)
        assert len(camera_stream(found, "/board").stream) == pytest.approx(50 * share, abs=2)
    damaged = bytearray(data + record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n")
    damaged[len(data) // 2 :: 7] = b"\xee" * len(damaged[len(data) // 2 :: 7])
    damaged[-37:] = record(2, bytes(20)) + b"\x89MCAP0\r\n"
    path.write_bytes(damaged)
    with pytest.raises(InputError, match=r"not a bag that can be read \(.*mcap doctor"):
        read_recording(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_damaged_files_are_read_or_refused_in_one_line(tmp_path, rng, name):
    whole = (SAMPLES / f"{name}.mcap").read_bytes()
    path = tmp_path / "cell.mcap"
    for k in range(150):
        data = bytearray(whole)
        for place in rng.integers(8, len(data), 1 + k % 4):
            data[place] = rng.integers(256)
        path.write_bytes(data if k % 3 else data[: rng.integers(20, len(data))])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            said = "cell.mcap"
            try:
                text_of(read_recording(path), [str(path)])
            except InputError as error:
                said = str(error)
            assert "\n" not in said and "cell.mcap" in said


@pytest.mark.slow
def test_sizes_that_a_file_declares_are_bounded(tmp_path):
    """Nothing of a sparse file is read but what its records may hold, and definitions are bounded together."""
    path = tmp_path / "cell.mcap"
    begin = b"\x89MCAP0\r\n" + record(1, text(b"") + text(b"test"))
    size = 3_000_000_000
    for opcode in (3, 4, 5, 6):  # definition, channel, message, chunk
        with path.open("wb") as file:
            file.write(begin + bytes([opcode]) + struct.pack("<Q", size))
            file.seek(len(begin) + 9 + size)
            file.write(record(15, bytes(4)) + record(2, bytes(20)) + b"\x89MCAP0\r\n")
        started = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            said = "no messages"
            try:
                assert not read_recording(path).poses
            except InputError as error:
                said = str(error)
        assert "\n" not in said and time.perf_counter() - started < 5.0
    large = [(b"/a%d" % k, b"a.B", b"protobuf", bytes(2_000_000), b"protobuf", []) for k in range(12)]
    with pytest.raises(InputError, match="definitions of more than 20 MB"):
        read_recording(mcap(path, *large))


# ------------------------------------------------------------------------------------------------------- protobuf


def varint(value):
    data = b""
    while value > 0x7F:
        data += bytes([value & 0x7F | 0x80])
        value >>= 7
    return data + bytes([value])


def entry(number, value, wire=2):
    if wire == 0:
        return varint(number << 3) + varint(value)
    return varint(number << 3 | wire) + (varint(len(value)) if wire == 2 else b"") + value


def descriptors(*types):
    """Return a set of one file; types are (name, [(field, number, type, repeated, type name)])."""
    file = entry(2, b"p")
    for name, fields in types:
        one = entry(1, name)
        for field, number, kind, repeated, of in fields:
            parts = entry(1, field) + entry(3, number, 0) + entry(4, 3 if repeated else 1, 0) + entry(5, kind, 0)
            one += entry(2, parts + (entry(6, of) if of else b""))
        file += entry(4, one)
    return entry(1, file)


NUMBERS = [(b"d", 1, 1), (b"f", 2, 2), (b"i", 3, 5), (b"s", 4, 17), (b"b", 5, 8), (b"x", 6, 15), (b"t", 7, 9)]


def test_numbers_of_every_encoding():
    decode = MessageTypes(descriptors((b"M", [(*one, False, b"") for one in NUMBERS]))).decoder("p.M")
    assert decode(b"") == {"d": 0.0, "f": 0.0, "i": 0, "s": 0, "b": 0, "x": 0, "t": ""}  # as proto3 leaves them out
    data = entry(1, struct.pack("<d", -2.5), 1) + entry(2, struct.pack("<f", 0.5), 5) + entry(3, 2**64 - 3, 0)
    data += entry(4, 5, 0) + entry(5, 1, 0) + entry(6, struct.pack("<i", -7), 5) + entry(7, b"tool") + entry(99, b"?")
    assert decode(data) == {"d": -2.5, "f": 0.5, "i": -3, "s": -3, "b": 1, "x": -7, "t": "tool"}


def test_lists_packed_or_not_and_messages_left_out():
    types = (b"M", [(b"v", 1, 1, True, b""), (b"n", 2, 13, True, b""), (b"m", 3, 11, False, b".p.M")])
    decode = MessageTypes(descriptors(types)).decoder("p.M")
    packed = entry(1, struct.pack("<2d", 1.0, 2.0)) + entry(1, struct.pack("<d", 3.0), 1)
    assert decode(packed + entry(2, varint(300) + varint(4))) == {"v": [1.0, 2.0, 3.0], "n": [300, 4]}
    assert decode(entry(3, b"")) == {"v": [], "n": [], "m": {"v": [], "n": []}}


def test_hostile_messages_and_descriptors():
    loop = descriptors((b"M", [(b"m", 1, 11, False, b".p.M"), (b"d", 2, 1, False, b"")]))
    decode = MessageTypes(loop).decoder("p.M")
    deep = b""
    for _ in range(100):
        deep = entry(1, deep)
    cases = (
        deep,
        b"\x0a\xff",
        b"\x0a" + b"\xff" * 20,
        b"\x0b",
        entry(2, b"123"),
        entry(1, 7, 0),
        bytes(MAX_MESSAGE_BYTES + 1),
    )
    for data in cases:
        with pytest.raises(DamagedError):
            decode(data)
    nested = entry(1, b"M")
    for _ in range(50):
        nested = entry(1, b"M") + entry(3, nested)
    for data, name in ((entry(1, entry(4, nested)), "M"), (bytes(MAX_MESSAGE_BYTES + 1), "M"), (loop, "p.Other")):
        with pytest.raises(DamagedError):
            MessageTypes(data).decoder(name)
    lacks = MessageTypes(descriptors((b"M", [(b"m", 1, 11, False, b".p.Other")]))).decoder("p.M")
    with pytest.raises(DamagedError, match=r"lack the type 'p\.Other'"):
        lacks(entry(1, b""))
