"""Files that are not ordinary: pipes are read as long as something comes, devices and folders are refused."""

import os
import threading

import numpy as np
import pytest

from uq_handeye import Calibration, read_poses, simulate
from uq_handeye.core.files import open as files_open
from uq_handeye.errors import InputError
from uq_handeye.model.camera.corners_file import read_corners
from uq_handeye.model.camera.intrinsics_file import read_intrinsics
from uq_handeye.read import read_noise_file, read_pose_file, read_stream, write_pose_file

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes in folders")

READERS = {
    "poses": read_poses,
    "pose file": read_pose_file,
    "stream": lambda path: read_stream(path, "robot"),
    "noise": read_noise_file,
    "result": Calibration.from_json,
    "corners": read_corners,
    "intrinsics": read_intrinsics,
}


@pytest.fixture
def pipe(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_nothing_that_may_never_end_is_waited_for(read, pipe):
    with pytest.raises(InputError, match=r"Cannot read .*pipe: no process writes to this pipe\.$"):
        read(pipe)
    for device in ("/dev/zero", "/dev/random"):
        with pytest.raises(InputError, match=rf"Cannot read {device}: it is a device or socket, expected a file\.$"):
            read(device)
    with pytest.raises(InputError, match=r"it is a folder, expected a file|No files in the folder"):
        read(pipe.parent)


def feed(pipe, *pieces, finish):
    """Write to a pipe from another thread, and hold it open until the event ``finish``."""

    def write():
        with open(pipe, "wb", buffering=0) as file:
            for piece in pieces:
                file.write(piece)
            finish.wait(60)

    opened = os.open(pipe, os.O_RDWR)  # so that the writer is there before the reader comes
    thread = threading.Thread(target=write)
    thread.start()
    return thread, opened


def test_what_comes_through_a_pipe_is_read_to_its_end(tmp_path, pipe):
    write_pose_file(tmp_path / "robot.csv", simulate(2000, seed=1).robot)  # more than a pipe holds at a time
    content = (tmp_path / "robot.csv").read_bytes()
    assert len(content) > 65536
    done = threading.Event()
    done.set()
    writer, opened = feed(pipe, content[:70_000], content[70_000:], finish=done)
    threading.Timer(0.2, os.close, (opened,)).start()  # the reader waits for what is to come
    np.testing.assert_array_equal(read_pose_file(pipe)[1], read_pose_file(tmp_path / "robot.csv")[1])
    writer.join()


def test_a_writer_that_falls_silent_is_given_up(pipe, monkeypatch):
    monkeypatch.setattr(files_open, "MAX_WAIT_S", 0.1)
    finish = threading.Event()
    writer, opened = feed(pipe, b"timestamp,x,y,z,qx,qy,qz,qw\n", finish=finish)
    try:
        with pytest.raises(InputError, match=r"nothing came through this pipe for 0\.1 s"):
            read_pose_file(pipe)
    finally:
        finish.set()
        os.close(opened)
        writer.join()


def test_a_pipe_without_end_is_bounded(pipe):
    finish = threading.Event()
    writer, opened = feed(pipe, b"x" * 1000, finish=finish)
    try:
        with pytest.raises(InputError, match=r"expected at most 0\.0005 MB"), files_open.opened(pipe, 500) as file:
            file.read()
    finally:
        finish.set()
        os.close(opened)
        writer.join()
