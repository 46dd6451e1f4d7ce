"""Files that are either written whole or not at all.

The content goes to a temporary file in the same folder, is forced to disk and takes the place of the old file
in one step of the file system. Whatever happens before that step (an exception, an interrupt, a full disk, a
killed process) leaves the old file as it was; only a killed process leaves its temporary file behind, named
``.uq-handeye-*.tmp``.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

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
    with refusals(target):
        _require_place(target)


def require_writable_folder(directory: StrPath) -> None:
    """The same for `write_files`: ``directory`` is a folder that can be written into, or can be made."""
    folder = as_path(directory)
    with refusals(folder):
        nearest = next(part for part in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(part))
        if not nearest.is_dir():
            what = "expected a folder, got a file" if nearest == folder.absolute() else f"{shown(nearest)} is a file"
            raise InputError(f"Cannot write into {shown(folder)}: {what}.")
        if not os.access(nearest, os.W_OK | os.X_OK):
            where = "there" if nearest == folder.absolute() else f"in {shown(nearest)}"
            raise InputError(f"Cannot write into {shown(folder)}: no permission to write {where}.")


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

    with refusals(target):
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
def refusals(target: Path) -> Iterator[None]:
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
            with refusals(target):
                os.replace(temporary, target)


def _try_to(remove: Callable[[], object]) -> None:
    """Remove a file or folder, if that is possible: the cause that stopped the writing, such as a read-only file
    system, may also prevent the removal.
    """
    with suppress(OSError):
        remove()
