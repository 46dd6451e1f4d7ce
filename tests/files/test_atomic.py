"""Files are written whole or not at all."""

import os
import stat
import subprocess
import sys

import pytest

from uq_handeye.core.files.atomic import require_writable_file, require_writable_folder, write_atomically, write_files
from uq_handeye.errors import InputError


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_text_bytes_and_callback(tmp_path):
    path = tmp_path / "a.txt"
    for content, expected in (
        ("ä\n", "ä\n".encode()),
        (b"\0\r\n", b"\0\r\n"),
        (lambda file: file.write(b"x"), b"x"),
        ("", b""),
    ):
        write_atomically(path, content)
        assert path.read_bytes() == expected
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, InputError])
@pytest.mark.parametrize("exists", [True, False])
def test_exception_leaves_the_old_file(tmp_path, error, exists):
    path = tmp_path / "a.txt"
    if exists:
        path.write_text("old")

    def write(file):
        file.write(b"new")
        raise error("stop")

    with pytest.raises(error, match="stop"):
        write_atomically(path, write)
    assert names(tmp_path) == (["a.txt"] if exists else [])
    assert not exists or path.read_text() == "old"


KILLED = """
import os, signal, sys
from uq_handeye.core.files.atomic import write_files

def write(file):
    file.write(b"new" * 100_000)
    file.flush()
    os.kill(os.getpid(), signal.SIGKILL)

write_files(sys.argv[1], {"a.txt": "new", "b.txt": write})
"""


@pytest.mark.skipif(os.name != "posix", reason="needs SIGKILL")
def test_killed_process_leaves_the_old_files(tmp_path):
    for name in ("a.txt", "b.txt"):
        (tmp_path / name).write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert done.returncode == -9
    assert (tmp_path / "a.txt").read_text() == (tmp_path / "b.txt").read_text() == "old"
    rest = [name for name in names(tmp_path) if name not in ("a.txt", "b.txt")]
    assert rest
    assert all(name.startswith(".uq-handeye-") for name in rest)


def test_disk_full_is_one_line(tmp_path):
    def write(file):
        raise OSError(28, "No space left on device")

    with pytest.raises(InputError, match=r"Cannot write .*a\.txt: no space left on device\.$"):
        write_atomically(tmp_path / "a.txt", write)
    assert names(tmp_path) == []


def test_places_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match=r"missing.a\.txt: there is no folder .*missing; make it first"):
        write_atomically(tmp_path / "missing" / "a.txt", "x")
    with pytest.raises(InputError, match="is a folder"):
        write_atomically(tmp_path, "x")
    with pytest.raises(InputError, match="file name too long"):
        write_atomically(tmp_path / ("a" * 300), "x")
    with pytest.raises(InputError, match="Expected the path"):
        write_atomically(None, "x")
    assert names(tmp_path) == []


def test_read_only(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")
    monkeypatch.setattr("uq_handeye.core.files.atomic.os.access", lambda *_: False)  # the tests may run as root
    with pytest.raises(InputError, match=r"a\.txt: the file is read-only"):
        write_atomically(path, "new")
    assert path.read_text() == "old"


def test_no_permission_in_the_folder(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("builtins.open", refuse)
    with pytest.raises(InputError, match=r"a\.txt: permission denied"):
        write_atomically(tmp_path / "a.txt", "new")


READ_ONLY_FILE_SYSTEM = OSError(30, "Read-only file system")


def test_read_only_file_system(tmp_path, monkeypatch):
    """There even the removal of a temporary file that was never made is refused."""

    def refuse(*_, **__):
        raise READ_ONLY_FILE_SYSTEM

    monkeypatch.setattr("builtins.open", refuse)
    monkeypatch.setattr("pathlib.Path.unlink", refuse)
    monkeypatch.setattr("pathlib.Path.mkdir", refuse)
    with pytest.raises(InputError, match=r"a\.txt: read-only file system\.$"):
        write_atomically(tmp_path / "a.txt", "new")
    with pytest.raises(InputError, match=r"Cannot make the folder .*new: read-only file system\.$"):
        write_files(tmp_path / "new", {"a.txt": "new"})


def test_places_are_refused_before_there_is_anything_to_write(tmp_path, monkeypatch):
    (tmp_path / "a.txt").write_text("old")
    for path, words in (
        (tmp_path / "missing" / "a.txt", "there is no folder .*missing; make it first"),
        (tmp_path, "it is a folder, expected a file"),
        (tmp_path / "a.txt" / "b.txt", "there is no folder"),
    ):
        with pytest.raises(InputError, match=words):
            require_writable_file(path)
    for folder, words in (
        (tmp_path / "a.txt", "expected a folder, got a file"),
        (tmp_path / "a.txt" / "b" / "c", "a.txt is a file"),
    ):
        with pytest.raises(InputError, match=words):
            require_writable_folder(folder)
    require_writable_file(tmp_path / "a.txt")
    require_writable_file(tmp_path / "b.txt")
    require_writable_folder(tmp_path)
    require_writable_folder(tmp_path / "b" / "c")
    # the tests may run as root
    monkeypatch.setattr("uq_handeye.core.files.atomic.os.access", lambda path, _: str(path) != str(tmp_path))
    for path in ("a.txt", "b.txt"):  # one is replaced by a file beside it
        with pytest.raises(InputError, match=rf"{path}: no permission to write into the folder {tmp_path}"):
            require_writable_file(tmp_path / path)
    for folder, words in ((tmp_path, "no permission to write there"), (tmp_path / "b" / "c", f"write in {tmp_path}")):
        with pytest.raises(InputError, match=words):
            require_writable_folder(folder)
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes in folders")
def test_a_pipe_that_nobody_reads_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="it is a pipe that no process reads"):
        write_atomically(tmp_path / "pipe", "x")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(tmp_path / "pipe", "x")
    assert os.read(reader, 10) == b"x"
    os.close(reader)


@pytest.mark.skipif(os.name != "posix", reason="POSIX modes and links")
def test_mode_and_links_are_kept(tmp_path):
    path, link = tmp_path / "a.txt", tmp_path / "link.txt"
    path.write_text("old")
    path.chmod(0o640)
    link.symlink_to(path)
    write_atomically(link, "new")
    assert link.is_symlink()
    assert path.read_text() == "new"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@pytest.mark.skipif(not os.path.exists("/dev/null"), reason="needs a device")
def test_devices_are_written_to_not_replaced():
    write_atomically("/dev/null", "x")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_several_files(tmp_path):
    folder = tmp_path / "new" / "deep"
    write_files(folder, {"a.txt": "a", "b.bin": b"b"})
    assert names(folder) == ["a.txt", "b.bin"]
    write_files(folder, {"a.txt": "c"})
    assert (folder / "a.txt").read_text() == "c"


def fail(file):
    raise RuntimeError("stop")


def test_several_files_all_or_none(tmp_path):
    with pytest.raises(RuntimeError, match="stop"):
        write_files(tmp_path / "new" / "deep", {"a.txt": "a", "b.txt": fail})
    assert names(tmp_path) == []
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "b.txt").mkdir()
    with pytest.raises(InputError, match=r"b\.txt: it is a folder"):
        write_files(tmp_path, {"a.txt": "new", "b.txt": "new"})
    assert (tmp_path / "a.txt").read_text() == "old"
    assert names(tmp_path) == ["a.txt", "b.txt"]


def test_folder_that_is_a_file(tmp_path):
    (tmp_path / "out").write_text("old")
    for folder in (tmp_path / "out", tmp_path / "out" / "deeper"):
        with pytest.raises(InputError, match="folder"):
            write_files(folder, {"a.txt": "a"})
    assert (tmp_path / "out").read_text() == "old"


@pytest.mark.parametrize("name", ["../a.txt", "x/a.txt", "", ".."])
def test_names_stay_in_the_folder(tmp_path, name):
    with pytest.raises(InputError):
        write_files(tmp_path / "out", {name: "a"})
    assert names(tmp_path) == []
