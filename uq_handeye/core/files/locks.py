"""Locks of files that are read and written back, so that nothing of another process is lost in between.

The lock of NAME is a lock of the operating system on ``.uq-handeye-NAME.lock`` in the same folder, which is removed at
the end. The system releases it when the process ends, however it ends: a lock file that a killed process left behind
locks nothing. On a file system without locks, files are written without one.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ...errors import InputError
from ..limits import MAX_WAIT_S
from .atomic import require_writable_file
from .open import StrPath, as_path, shown

_OF_ANOTHER = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)

if sys.platform == "win32":
    import msvcrt

    def _take(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def locked(path: StrPath, patience: float = 0.0) -> Iterator[None]:
    """Hold the lock of one file within the block, until its end or that of the process.

    Parameters
    ----------
    path : path of the file
        It need not exist; its folder must. A link is followed.
    patience : float
        Seconds to wait for another holder, in this process or another.

    Raises
    ------
    InputError
        Another process holds it.
    OSError
        No lock file can be made.
    """
    file = Path(os.path.realpath(as_path(path)))
    lock = file.with_name(f".uq-handeye-{file.name}.lock")
    end = time.monotonic() + patience
    while (descriptor := _taken(lock)) is None:
        if time.monotonic() >= end:
            raise InputError(f"{shown(file)} is in use by another run: wait for its end.")
        time.sleep(0.05)
    try:
        yield
    finally:  # the file is removed first, so that nobody takes a lock of a file that is gone
        with suppress(OSError):
            lock.unlink()
        os.close(descriptor)
        if os.name == "nt":  # which removes no file that is open
            with suppress(OSError):
                lock.unlink()


def _taken(lock: Path) -> int | None:
    """Return the descriptor of a lock; None: another one has it."""
    flags = os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    while True:
        try:
            descriptor = os.open(lock, flags | os.O_RDWR, 0o666)
        except PermissionError:
            if os.name == "nt":  # just being removed
                return None
            if not lock.exists():
                raise
            descriptor = os.open(lock, os.O_RDONLY)  # of another user
        try:
            _take(descriptor)
        except OSError as error:
            if error.errno not in _OF_ANOTHER:  # a file system without locks
                return descriptor
            os.close(descriptor)
            return None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.stat(lock), os.fstat(descriptor)):
                return descriptor
        os.close(descriptor)  # the one who held it has just removed it


@contextmanager
def held(path: StrPath, patience: float = MAX_WAIT_S) -> Iterator[None]:
    """Hold the lock of a file that is read and written back within the block; wait for another holder.

    Raises `InputError` where the file cannot be written, and where another process holds it for longer than
    ``patience`` (s). A device or pipe has no lock.
    """
    target = as_path(path)
    require_writable_file(target)
    if target.exists() and not target.is_file():
        yield
        return
    with locked(target, patience):
        yield
