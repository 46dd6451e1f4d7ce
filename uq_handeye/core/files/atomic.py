"""Files that are either written whole or not at all.

The content goes to a temporary file in the same folder, is forced to disk and takes the place of the old file
in one step of the file system. Whatever happens before that step (an exception, an interrupt, a full disk, a
killed process) leaves the old file as it was; only a killed process leaves its temporary file behind, named
``.uq-handeye-*.tmp``.

Locks of files that are read and written back, so that nothing of another process is lost in between.

The lock of NAME is that of the system on ``.uq-handeye-NAME.lock`` beside it, which is removed at the end. The system
lets go of it when the process ends, however it ends: what a killed process left behind is in nobody's way. A
file system without locks is written to as before.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from ...errors import InputError
from .open import StrPath, as_path, reason, shown

Content = str | bytes | Callable[[BinaryIO], object]


def write_atomically(path: StrPath, content: Content) -> None:
    """Write one file, or leave it untouched.

    Parameters
    ----------
    path : path of the file
        A link is followed. A device or pipe is written to directly.
    content : str, bytes or callable
        Text is written as UTF-8 with the line ends it has. A callable gets the binary file to write to.

    Raises
    ------
    InputError
        A missing folder, no permission, a full disk, a folder in place of the file: one line. Other
        exceptions of a callable pass through.
    """
    target = as_path(path)
    with ExitStack() as cleaning:
        _replace([_prepare(target, content, cleaning)])


def require_writable_file(path: StrPath) -> None:
    """Raise the `InputError` of `write_atomically` before there is anything to write.

    For a folder in place of the file, no folder to write into, no permission, a file system that is read-only. What
    shows only in writing, such as a full disk, is left to it.
    """
    target = as_path(path)
    with _refusals(target):
        _require_place(target)


def require_writable_folder(directory: StrPath) -> None:
    """The same for `write_files`: ``directory`` is a folder that can be written into, or can be made."""
    folder = as_path(directory)
    with _refusals(folder):
        nearest = next(part for part in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(part))
        if not nearest.is_dir():
            what = "expected a folder, got a file" if nearest == folder.absolute() else f"{shown(nearest)} is a file"
            raise InputError(f"Cannot write into {shown(folder)}: {what}.")
        if not os.access(nearest, os.W_OK | os.X_OK):
            where = "there" if nearest == folder.absolute() else f"in {shown(nearest)}"
            raise InputError(f"Cannot write into {shown(folder)}: no permission to write {where}.")


def json_text(data: Any, path: StrPath | None = None) -> str:
    """Return ``data`` as JSON text, indented, a list of numbers or texts on one line; also write it to ``path``.

    Raises ValueError for NaN and infinity, which JSON has not.
    """
    text = _indented(data, "\n") + "\n"
    if path is not None:
        write_atomically(path, text)
    return text


def _indented(data: Any, start: str) -> str:
    """JSON text whose lines begin with ``start``."""
    inside = f"{start}  "
    if type(data) is dict and data:
        parts = [f"{json.dumps({name: 0})[1:-4]}: {_indented(part, inside)}" for name, part in data.items()]
        return f"{{{inside}{f',{inside}'.join(parts)}{start}}}"
    if type(data) in (list, tuple) and any(type(part) in (dict, list, tuple) for part in data):
        return f"[{inside}{f',{inside}'.join(_indented(part, inside) for part in data)}{start}]"
    return json.dumps(data, allow_nan=False)


def write_files(directory: StrPath, files: Mapping[str, Content]) -> None:
    """Write several files into one folder (made if missing): all of them or none.

    Every file is prepared in full before the first one takes its place, so that only a failure between two
    renamings can leave new files beside old ones. Parameters and errors as in `write_atomically`; the keys of
    ``files`` are names without folders.
    """
    folder = as_path(directory)
    for name in files:
        if Path(name).name != name:
            raise InputError(f"Expected a file name without folders, got {name!a}.")
    with ExitStack() as cleaning:
        _make_folder(folder, cleaning)
        _replace([_prepare(folder / name, content, cleaning) for name, content in files.items()])


def _make_folder(folder: Path, cleaning: ExitStack) -> None:
    require_writable_folder(folder)
    try:
        for missing in [part for part in reversed((folder, *folder.parents)) if not part.exists()]:
            cleaning.callback(_try_to, missing.rmdir)  # in the end it is empty only if the writing failed
            missing.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"Cannot make the folder {shown(folder)}: {reason(error)}.") from error


def _prepare(target: Path, content: Content, cleaning: ExitStack) -> tuple[Path | None, Path]:
    """The temporary file that is to replace ``target``, complete and on disk; ``cleaning`` removes it."""

    def write(file: BinaryIO) -> object:
        if callable(content):
            return content(file)
        return file.write(content.encode("utf-8") if isinstance(content, str) else content)

    with _refusals(target):
        mode = _require_place(target)
        if mode is not None and not stat.S_ISREG(mode):  # nothing to keep whole, and never to be replaced
            with open(target, "wb", opener=_open_at_once) as file:
                write(file)
            return None, target
        real = Path(os.path.realpath(target))
        temporary = real.with_name(f".uq-handeye-{secrets.token_hex(8)}.tmp")
        cleaning.callback(_try_to, temporary.unlink)  # before it exists: no interrupt slips between
        with open(temporary, "xb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        if mode is not None:
            temporary.chmod(stat.S_IMODE(mode))
        return temporary, real


def _require_place(target: Path) -> int | None:
    """The mode of what is at ``target``, None where nothing is; raises `InputError` where no file can be written."""
    mode = target.stat().st_mode if target.exists() else None
    if mode is not None and stat.S_ISDIR(mode):
        raise InputError(f"Cannot write {shown(target)}: it is a folder, expected a file.")
    folder = target.parent
    if not folder.is_dir():
        raise InputError(f"Cannot write {shown(target)}: there is no folder {shown(folder)}; make it first.")
    if mode is not None and not os.access(target, os.W_OK):
        raise InputError(f"Cannot write {shown(target)}: the file is read-only.")
    real = Path(os.path.realpath(target)).parent  # a file is replaced by one beside it; a device is written to
    if (mode is None or stat.S_ISREG(mode)) and not os.access(real, os.W_OK | os.X_OK):
        raise InputError(f"Cannot write {shown(target)}: no permission to write into the folder {shown(real)}.")
    return mode


@contextmanager
def _refusals(target: Path) -> Iterator[None]:
    """Convert what the system refuses within the block into one line about ``target``."""
    try:
        yield
    except OSError as error:
        raise InputError(f"Cannot write {shown(target)}: {reason(error)}.") from error


def _open_at_once(path: str, flags: int) -> int:
    """A pipe that nobody reads is refused, not waited for."""
    if not hasattr(os, "O_NONBLOCK"):
        return os.open(path, flags)
    try:
        descriptor = os.open(path, flags | os.O_NONBLOCK)
    except OSError as error:
        if error.errno != errno.ENXIO:
            raise
        raise InputError(f"Cannot write {shown(Path(path))}: it is a pipe that no process reads.") from error
    os.set_blocking(descriptor, True)
    return descriptor


def _replace(prepared: list[tuple[Path | None, Path]]) -> None:
    for temporary, target in prepared:
        if temporary is not None:
            with _refusals(target):
                os.replace(temporary, target)


def _try_to(remove: Callable[[], object]) -> None:
    """Remove a file or folder, if that is possible: the cause that stopped the writing, such as a read-only file
    system, may also prevent the removal.
    """
    with suppress(OSError):
        remove()


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
        _try_to(self._lock.unlink)
        os.close(self._descriptor)
        self._descriptor = None
        if os.name == "nt":  # which removes no open file, and none that another one holds by now
            _try_to(self._lock.unlink)


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
    with _refusals(target):
        lock = FileLock(os.path.realpath(target), patience)
    try:
        yield
    finally:
        lock.release()
