"""Bags whose compressed parts would fill memory or disk."""

import bz2
import struct
import zlib

import lz4.frame
import numpy as np
import pytest
from fixtures.bags import START, Writer
from rosbags.rosbag2.storage_mcap import zstd

from uq_handeye.errors import InputError
from uq_handeye.read.rosbag import decompression
from uq_handeye.read.rosbag.recording import read_recording

PACKED = {"zstd": lambda data: zstd.compress(data), "lz4": lz4.frame.compress, "bz2": bz2.compress}


@pytest.fixture(autouse=True)
def small(monkeypatch):
    monkeypatch.setattr(decompression, "MAX_CHUNK_BYTES", 2_000_000)


def record(op, body):
    return bytes([op]) + struct.pack("<Q", len(body)) + body


def bombed_mcap(folder, kind, size):
    """A bag whose only chunk is replaced by one that says of itself that it has ``size`` bytes, and has."""
    with Writer(folder, "mcap") as bag:
        bag.pose_stamped("/tcp_pose", START, "base", np.eye(4))
    path = next(bag.path.glob("*.mcap"))
    data = path.read_bytes()
    place = 8
    while data[place] != 0x06:
        place += 9 + struct.unpack_from("<Q", data, place + 1)[0]
    times = data[place + 9 : place + 25]
    plain = record(0x0D, bytes(size))  # data of no kind that is read
    packed = PACKED[kind](plain)
    head = times + struct.pack("<QI", len(plain), zlib.crc32(plain)) + struct.pack("<I", len(kind)) + kind.encode()
    (folder / "bomb.mcap").write_bytes(data[:place] + record(0x06, head + struct.pack("<Q", len(packed)) + packed))
    return folder / "bomb.mcap"


@pytest.mark.parametrize("kind", ["zstd", "lz4"])
def test_chunks_of_mcap(tmp_path, kind):
    path = bombed_mcap(tmp_path, kind, 5_000_000)
    assert path.stat().st_size < 50_000
    with pytest.raises(InputError, match="more than 2 MB"):
        read_recording(path)


@pytest.mark.parametrize("kind", PACKED)
def test_of_each_kind(kind):
    make = {"zstd": zstd.ZstdDecompressor, "lz4": lz4.frame.LZ4FrameDecompressor, "bz2": bz2.BZ2Decompressor}[kind]
    data = np.random.default_rng(0).integers(256, size=5000, dtype=np.uint8).tobytes()
    packed = PACKED[kind](data)
    assert decompression.unpacked(make, packed) == data
    assert decompression.unpacked(make, packed + packed, 10000) == data + data
    with pytest.raises(ValueError, match="cut off"):
        decompression.unpacked(make, packed[:-200])
    with pytest.raises(decompression.DamagedError):
        decompression.unpacked(make, PACKED[kind](bytes(3_000_000)))


def test_compressed_files_of_a_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(decompression, "MAX_TABLE_BYTES", 10_000)
    with Writer(tmp_path, "mcap") as bag:
        bag.pose_stamped("/tcp_pose", START, "base", np.eye(4))
    inner = next(bag.path.glob("*.mcap"))
    meta = (bag.path / "metadata.yaml").read_text()
    meta = meta.replace(inner.name, f"{inner.name}.zstd").replace("compression_mode: ''", "compression_mode: file")
    meta = meta.replace("compression_format: ''", "compression_format: zstd")
    (bag.path / "metadata.yaml").write_text(meta)
    content = inner.read_bytes()
    for data, words in ((content, None), (content + bytes(5_000_000), "more than")):
        (bag.path / f"{inner.name}.zstd").write_bytes(zstd.compress(data))
        inner.unlink(missing_ok=True)
        if words is None:
            assert len(read_recording(bag.path).poses) == 1
        else:
            with pytest.raises(InputError, match=words):
                read_recording(bag.path)


def test_metadata_of_a_megabyte(tmp_path):
    with Writer(tmp_path, "mcap") as bag:
        bag.pose_stamped("/tcp_pose", START, "base", np.eye(4))
    (bag.path / "metadata.yaml").write_text("# x\n" * 300_000)
    with pytest.raises(InputError, match="at most 1 MB"):
        read_recording(bag.path)
