"""Locks of files that are read and written back, so that nothing of another process is lost in between.

The lock of NAME is that of the system on ``.uq-handeye-NAME.lock`` beside it, which is removed at the end. The system
lets go of it when the process ends, however it ends: what a killed process left behind is in nobody's way. A
file system without locks is written to as before.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ..errors import InputError
from .atomic import require_writable_file
from .open import StrPath, as_path, reason, shown

PATIENCE, PAUSE = 60.0, 0.05  # seconds: of `held`, and between two looks
_OF_ANOTHER = (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK)

if sys.platform == "win32":
    import msvcrt

    def _take(descriptor: int) -> None:
        msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def _take(descriptor: int) -> None:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


class FileLock:
    """Lock of one file, held from the making of this object until `release`, or until the process ends.

    Parameters
    ----------
    path : path of the file
        It need not exist; its folder must. A link is not followed.
    patience : float
        Seconds to wait for another holder, in this process or another.

    Raises
    ------
    InputError
        Another process holds it.
    OSError
        No lock file can be made.
    """

    def __init__(self, path: StrPath, patience: float = 0.0) -> None:
        file = as_path(path)
        self._lock = file.with_name(f".uq-handeye-{file.name}.lock")
        end = time.monotonic() + patience
        while (found := self._taken()) is None:
            if time.monotonic() >= end:
                raise InputError(f"{shown(file)} is in use by another run: wait for its end.")
            time.sleep(PAUSE)
        self._descriptor: int | None = found

    def _taken(self) -> int | None:
        """Return the descriptor of the lock; None: another one has it."""
        flags = os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        while True:
            try:
                descriptor = os.open(self._lock, flags | os.O_RDWR, 0o666)
            except PermissionError:
                if os.name == "nt":  # just being removed
                    return None
                if not self._lock.exists():
                    raise
                descriptor = os.open(self._lock, os.O_RDONLY)  # of another user
            try:
                _take(descriptor)
            except OSError as error:
                if error.errno not in _OF_ANOTHER:  # a file system without locks
                    return descriptor
                os.close(descriptor)
                return None
            with suppress(FileNotFoundError):
                if os.path.samestat(os.stat(self._lock), os.fstat(descriptor)):
                    return descriptor
            os.close(descriptor)  # the one who held it has just removed it

    def release(self) -> None:
        """Remove the lock file, and only then let go of it."""
        if self._descriptor is None:
            return
        with suppress(OSError):
            self._lock.unlink()
        os.close(self._descriptor)
        self._descriptor = None
        if os.name == "nt":  # which removes no open file, and none that another one holds by now
            with suppress(OSError):
                self._lock.unlink()


@contextmanager
def held(path: StrPath, patience: float = PATIENCE) -> Iterator[None]:
    """Hold the lock of a file that is read and written back within the block; wait for another holder.

    Raises `InputError` where the file cannot be written, and where another process holds it for longer than
    ``patience`` (s). A device or pipe has no lock.
    """
    target = as_path(path)
    require_writable_file(target)
    if target.exists() and not target.is_file():
        yield
        return
    try:
        lock = FileLock(os.path.realpath(target), patience)
    except OSError as error:
        raise InputError(f"Cannot write {shown(target)}: {reason(error)}.") from error
    try:
        yield
    finally:
        lock.release()
