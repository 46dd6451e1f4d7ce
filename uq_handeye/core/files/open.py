"""Opening of input files for reading: every failure is a one-line error with the name of the file and the reason."""

from __future__ import annotations

import errno
import hashlib
import io
import os
import select
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from ...errors import InputError
from ..limits import MAX_NAME_CHARACTERS, MAX_WAIT_S

# Longest name of a file or folder that common file systems hold.
MAX_PART_BYTES = 255

StrPath = str | os.PathLike[str]


def as_path(path: StrPath) -> Path:
    """``path`` as a `Path` that the system can be asked for; raises `InputError` for anything else."""
    try:
        result = Path(path)
    except TypeError as error:
        raise InputError(f"Expected the path of a file, got {type(path).__name__}.") from error
    try:
        usable = b"\0" not in os.fsencode(result)
    except UnicodeEncodeError:
        usable = False
    if usable and any(len(os.fsencode(part)) > MAX_PART_BYTES for part in result.parts):
        raise InputError(f"Cannot read {shown(result)}: file name too long (above {MAX_PART_BYTES} bytes).")
    if not usable:
        raise InputError(f"Expected the path of a file, got {str(path)!a}, which no file system can hold.")
    return result


def shown(path: Path) -> str:
    """A path for messages: as it is if it prints on one line, otherwise escaped; of a very long one its ends."""
    text = str(path)
    text = text if len(text) <= 2 * MAX_NAME_CHARACTERS else f"{text[:100]}...{text[-100:]}"
    return text if text.isprintable() else ascii(text)


def reason(error: OSError) -> str:
    """Return why the system refused, in the words of the system: ``permission denied``."""
    text = error.strerror or str(error) or type(error).__name__
    return text[0].lower() + text[1:]


@contextmanager
def opened(path: Path, max_bytes: int) -> Iterator[BinaryIO]:
    """A file or pipe, such as ``/dev/stdin``, opened for reading bytes.

    Raises `InputError` in one line for a missing file, a folder, a device, a file or pipe of more than ``max_bytes``, a
    pipe through which nothing comes, and whatever the system refuses, also while the file is read.
    """
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISFIFO(mode):
            with io.BufferedReader(_Pipe(path, max_bytes)) as pipe:
                yield pipe
                return
        if not stat.S_ISREG(mode):  # a device may have no end
            what = "folder" if stat.S_ISDIR(mode) else "device or socket"
            raise InputError(f"Cannot read {shown(path)}: it is a {what}, expected a file.")
        with open(path, "rb") as file:
            require_size(os.fstat(file.fileno()).st_size, max_bytes, path)
            yield file
    except OSError as error:
        why = "there is no such file; check the path" if error.errno == errno.ENOENT else reason(error)
        raise InputError(f"Cannot read {shown(path)}: {why}.") from error


class _Pipe(io.RawIOBase):
    """Content of a pipe until its writers close it: not nothing, at most ``max_bytes``, without long waits.

    It is at its end where no process has it open for writing, so that a pipe without a writer is not waited for.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path, self.max_bytes, self.size = path, max_bytes, 0
        self.descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        while True:
            try:
                data = os.read(self.descriptor, len(buffer))
                break
            except BlockingIOError:
                if not select.select([self.descriptor], [], [], MAX_WAIT_S)[0]:
                    raise InputError(
                        f"Cannot read {shown(self.path)}: nothing came through this pipe for {MAX_WAIT_S} s."
                    ) from None
        if not data and not self.size:
            raise InputError(f"Cannot read {shown(self.path)}: no process writes to this pipe.")
        self.size += len(data)
        require_size(self.size, self.max_bytes, self.path)
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        if not self.closed:
            os.close(self.descriptor)
        super().close()


class Hashed(io.RawIOBase):
    """Reader that counts and hashes (SHA-256) what is read from a file."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.size = 0
        self.digest = hashlib.sha256()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        data = self.file.read(len(buffer))
        buffer[: len(data)] = data
        self.size += len(data)
        self.digest.update(data)
        return len(data)


def require_size(size: int, max_bytes: int, path: Path) -> None:
    """Raise `InputError` if ``size``, known before or counted while reading, exceeds ``max_bytes``."""
    if size > max_bytes:
        raise InputError(f"{shown(path)}: expected at most {max_bytes / 1e6:g} MB, got more; split the file.")
