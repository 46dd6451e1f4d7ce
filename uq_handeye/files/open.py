"""Files that people name: every failure to open one as a single line that says which file and why."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from ..errors import InputError

StrPath = str | os.PathLike[str]


def as_path(path: Any) -> Path:
    """``path`` as a `Path` that the system can be asked for; raises `InputError` for anything else."""
    try:
        result = Path(path)
    except TypeError as error:
        raise InputError(f"Expected the path of a file, got {type(path).__name__}.") from error
    try:
        usable = b"\0" not in os.fsencode(result)
    except UnicodeEncodeError:
        usable = False
    if not usable:
        raise InputError(f"Expected the path of a file, got {str(path)!a}, which no file system can hold.")
    return result


def shown(path: Path) -> str:
    """A path for messages: as it is if it prints on one line, otherwise escaped."""
    text = str(path)
    return text if text.isprintable() else ascii(text)


def reason(error: OSError) -> str:
    """Why the system refused, in the words of the system: ``permission denied``."""
    text = error.strerror or str(error) or type(error).__name__
    return text[0].lower() + text[1:]


@contextmanager
def opened(path: Path, max_bytes: int) -> Iterator[BinaryIO]:
    """A file opened for reading bytes.

    Raises `InputError` in one line for a missing file, a folder, a file of more than ``max_bytes``, and
    whatever the system refuses, also while the file is read.
    """
    try:
        if path.is_dir():
            raise InputError(f"Cannot read {shown(path)}: it is a folder, expected a file.")
        with open(path, "rb") as file:
            require_size(os.fstat(file.fileno()).st_size, max_bytes, path)
            yield file
    except FileNotFoundError as error:
        raise InputError(f"Cannot read {shown(path)}: there is no such file; check the path.") from error
    except OSError as error:
        raise InputError(f"Cannot read {shown(path)}: {reason(error)}.") from error


class Hashed(io.RawIOBase):
    """What is read from a file, counted and hashed (SHA-256)."""

    def __init__(self, file: BinaryIO) -> None:
        self.file = file
        self.size = 0
        self.digest = hashlib.sha256()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        data = self.file.read(len(buffer))
        buffer[: len(data)] = data
        self.size += len(data)
        self.digest.update(data)
        return len(data)


def require_size(size: int, max_bytes: int, path: Path) -> None:
    """Raise `InputError` if ``size``, known before or counted while reading, exceeds ``max_bytes``."""
    if size > max_bytes:
        raise InputError(f"{shown(path)}: expected at most {max_bytes / 1e6:g} MB, got more; split the file.")
