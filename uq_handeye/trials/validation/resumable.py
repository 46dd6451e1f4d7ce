r"""A run that can be interrupted at any moment, also by kill -9, and resumed to the same bits.

Model: a run is a set of pieces (the trials of a chunk, a chain). Each depends on its own name and on the identity of
the run only: all input of the computation, large arrays by their SHA-256. A run is resumed only where its identity is
the same. It is kept as

- a folder: ``manifest.json`` with the identity, and a folder with one file per piece (``chunks/000000.npz``), or
- a single file for a single piece, with the manifest as a line behind its content, or
- nothing, where no path is given.

A piece ends in 32 bytes, the SHA-256 of identity, name and content. Every file is written whole or not at all:
``resume`` continues from whatever an interruption leaves. A piece that is damaged, or belongs to another run or
place, is never used but computed again.

Files are not trusted: nothing is read before its size and its SHA-256 are those of a piece, and pickles never are.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import stat
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from ..._version import __version__
from ...core.files.atomic import write_atomically
from ...core.files.json_values import Json, JsonObject
from ...core.files.locks import locked
from ...core.files.open import as_path, reason, shown
from ...core.limits import MAX_DESCRIPTION_BYTES, MAX_NAMED
from ...errors import InputError
from ...model.errors.joint_covariance import JointCovariance
from ...model.errors.models import Noise, noise_to_dict
from ...model.poses.motions import Motions
from ...model.poses.pose_pairs import PosePairs

# Largest number of trials of a run: years of work, and less than what would overflow a sum.
MAX_TRIALS = 10**12
# Bytes of the SHA-256 at the end of a piece.
DIGEST = hashlib.sha256().digest_size
START = b'\n{"format": '  # of the manifest in a single file

T = TypeVar("T")


class NotKeptError(InputError):
    """A run that cannot be kept where it was to be, or not be gone on with."""


@contextmanager
def _keeping() -> Iterator[None]:
    try:
        yield
    except InputError as error:
        raise NotKeptError(str(error)) from error


def versions() -> dict[str, str]:
    """Return the versions on which the last bits of a result depend."""
    return {
        "uq_handeye": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "machine": platform.machine(),
    }


def sha256(arrays: Mapping[str, Any]) -> str:
    """Hash the names, types, shapes and bytes of arrays; None is different from anything."""
    digest = hashlib.sha256()
    for name, value in arrays.items():
        array = None if value is None else np.ascontiguousarray(value)
        head = None if array is None else [array.dtype.str, np.shape(value)]
        digest.update(json.dumps([name, head]).encode() + b"\n")
        if array is not None:
            digest.update(array.tobytes())
    return digest.hexdigest()


def _sha256_of_noise(noise: Noise) -> str:
    """Hash the covariances of a noise; those that poses share, and a prior, by the numbers that they are made of."""
    if noise.prior is None and JointCovariance not in map(type, noise.sides.values()):
        return sha256(noise.sides)
    return hashlib.sha256(json.dumps(noise_to_dict(noise), sort_keys=True).encode()).hexdigest()


def identity_of(data: PosePairs | Motions, noise: Noise | None, arrays: Mapping[str, Any], **more: Json) -> JsonObject:
    """Return the identity of a run: the input that its numbers depend on.

    Parameters
    ----------
    data : PosePairs or Motions
        Motions count with the poses that they were made of.
    noise : Noise or None
        None: estimated from the data.
    arrays : mapping
        What belongs to the data.
    more
        Everything else, as plain values.
    """
    names = ("A", "B", "robot", "camera")
    holders = [data] if data.poses is None or data.poses is data else [data, data.poses]
    of_data = {name: getattr(of, name) for of in holders for name in names if hasattr(of, name)}
    setup = getattr(data.poses, "setup", None)
    return {
        "data": f"{len(data)} {'poses' if data.poses is data else 'motions'}{'' if setup is None else f', {setup}'}",
        "data sha256": sha256({**arrays, **of_data}),
        "noise": "estimated" if noise is None else type(noise).__name__,
        "noise sha256": None if noise is None else _sha256_of_noise(noise),
        **more,
        **{f"version of {name}": version for name, version in versions().items()},
    }


def _require_same(path: Path, there: Mapping[str, Json], mine: Mapping[str, Json], what: str) -> None:
    """Raise the `InputError` that names what differs between the identity in a file or folder and that of this run."""
    names = [name for name in {**mine, **there} if there.get(name) != mine.get(name)]
    if names:
        found = [f"{_short(name)} ({_short(there.get(name))}, now {_short(mine.get(name))})" for name in names]
        more = [f"and {len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
        raise InputError(
            f"{shown(path)} holds another run, which differs in {', '.join(found[:MAX_NAMED] + more)}: ask for the "
            f"same, or name a new {what}."
        )


def _short(value: Json) -> str:
    """Return a name or value for a message, on one line; of hashes and other long ones the beginning."""
    text = "none" if value is None else str(value) if type(value) in (str, int, float) else type(value).__name__
    text = text if len(text) <= 40 else f"{text[:8]}..."
    return text if text.isprintable() else ascii(text)


class Run:
    """Folder or file of one run, open and locked against other processes until `close`.

    Parameters
    ----------
    path : path or None
        Folder, made if missing, or file. None keeps nothing.
    identity : mapping
        What the numbers depend on (`identity_of`).
    resume : bool
        Whether to continue what is there. Otherwise nothing may be there.
    kind : str
        Name of such a run in its manifest and in messages.
    pieces : str or None
        Folder of the pieces in the folder of the run; empty: it holds further runs (`within`). None: ``path`` is the
        single file of a single piece.
    asked : int
        Number of trials. A run may be resumed for more than before, not for fewer.
    size : int
        Trials in a whole piece, to say what is there.

    Raises `NotKeptError` for something else at ``path``, for another run (naming what differs), and for one in use by
    another process.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        identity: Mapping[str, Json],
        resume: bool,
        kind: str,
        *,
        pieces: str | None = "chunks",
        asked: int = 0,
        size: int = 0,
    ) -> None:
        self.path, self._pieces, self._kind, self._size = path if path is None else as_path(path), pieces, kind, size
        self.damaged: list[str] = []  # names of pieces that were there but not used
        self._key = hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()
        self._manifest: dict[str, Any] = {
            "format": f"uq-handeye {kind} 3",
            "sha256": self._key,
            "trials": asked,
            "run": dict(identity),
        }
        if resume and path is None:
            place = "file" if pieces is None else "directory"
            raise InputError(f"Expected a `{place}` with resume=True, that of the {kind} to go on with.")
        with ExitStack() as stack:
            if self.path is not None:
                try:
                    with _keeping():
                        (self._claim_file if pieces is None else self._claim_folder)(self.path, resume, stack)
                except OSError as error:
                    into = "" if pieces is None else "into "
                    raise NotKeptError(f"Cannot write {into}{shown(self.path)}: {reason(error)}.") from error
            self.close = stack.pop_all().close  # lets go of it

    def _claim_file(self, path: Path, resume: bool, stack: ExitStack) -> None:
        if path.exists() and not stat.S_ISREG(path.stat().st_mode):  # a pipe would be waited for
            what = "a folder" if path.is_dir() else "a device or pipe"
            raise InputError(f"Expected `file` to name a file, got {shown(path)}, {what}.")
        if not path.parent.is_dir():
            raise InputError(f"Cannot write {shown(path)}: there is no folder {shown(path.parent)}; make it first.")
        stack.enter_context(locked(path))
        if path.exists() and not resume:
            raise InputError(
                f"{shown(path)} exists: go on with the {self._kind} in it by resume=True (--resume), or name a new "
                "file."
            )
        if path.exists():
            self._require_ours(path, path)

    def _claim_folder(self, path: Path, resume: bool, stack: ExitStack) -> None:
        _make(path)
        stack.enter_context(locked(path / "manifest.json"))
        found = {name for name in os.listdir(path) if not name.startswith(".uq-handeye-")}
        if found and not resume:
            raise InputError(
                f"{shown(path)} is not empty: go on with the run in it by resume=True (--resume), or name a new folder."
            )
        if (path / "result.json").is_dir():
            raise InputError(f"{shown(path / 'result.json')}: it is a folder, expected a file; remove it.")
        if found and "manifest.json" not in found:
            raise InputError(
                f"{shown(path)} holds no run to resume, as there is no manifest.json in it, but other files: name "
                "another folder."
            )
        if found:
            self._require_ours(path, path / "manifest.json")
        self.write("manifest.json", (json.dumps(self._manifest, indent=2) + "\n").encode())
        _make(path / str(self._pieces))  # after the manifest, without which there is no run
        for folder in (path, path / str(self._pieces)):  # of a process that was killed: nobody else is at work here
            for leftover in folder.glob(".uq-handeye-*.tmp"):
                leftover.unlink(missing_ok=True)

    def _require_ours(self, path: Path, file: Path) -> None:
        """Raise `InputError` where the manifest is none, of another run, or of one with more trials."""
        try:
            content = _read(file, None if self._pieces is None else MAX_DESCRIPTION_BYTES)
            if self._pieces is None:
                content = START + content[:-DIGEST].rpartition(START)[2]
            manifest = json.loads(content)
            there, trials = dict(manifest["run"]), int(manifest["trials"])
            if manifest["format"] != self._manifest["format"] or not 0 <= trials <= MAX_TRIALS:
                raise ValueError("it is of another kind or version")
        except (ValueError, TypeError, LookupError, RecursionError) as error:
            raise self._foreign(file) from error
        mine, asked = self._manifest["run"], self._manifest["trials"]
        _require_same(path, there, mine, "file" if self._pieces is None else "folder")
        if trials > asked:
            there_are = self._size * sum(1 for _ in (path / str(self._pieces)).glob("*.npz"))
            done = "" if there_are >= trials or not self._size else f", of which {there_are:,} are done"
            raise InputError(
                f"{shown(path)} holds a run that was asked for {trials:,} trials{done}: resume it with as many or "
                f"more, got {asked:,}."
            )

    def _foreign(self, file: Path) -> InputError:
        what = "file" if self._pieces is None else "manifest"
        return InputError(
            f"{shown(file)} is not the {what} of a {self._kind}, is damaged, or of another version: name a new "
            f"{'file' if self._pieces is None else 'folder'}."
        )

    def write(self, name: str, content: bytes) -> None:
        """Write a file of the folder. A link, pipe or device of its name is replaced: nothing is written elsewhere."""
        assert self.path is not None
        file = self.path / name
        foreign = file.is_symlink() or (file.exists() and not (file.is_file() or file.is_dir()))
        place = file.with_name(f".uq-handeye-{file.name}.tmp") if foreign else file
        with _keeping():
            write_atomically(place, content)
        if foreign:
            os.replace(place, file)

    def _digest(self, name: str, content: bytes) -> bytes:
        return hashlib.sha256(f"{self._key} {name} ".encode() + content).digest()

    def save(self, name: str, content: bytes) -> None:
        """Keep a piece, if anything is kept."""
        if self.path is None:
            return
        if self._pieces is not None:
            self.write(f"{self._pieces}/{name}.npz", content + self._digest(name, content))
        else:
            content += b"\n" + json.dumps(self._manifest).encode()
            with _keeping():
                write_atomically(self.path, content + self._digest(name, content))

    def load(self, name: str, read: Callable[[bytes], T], most: int | None = None) -> T | None:
        """Return what ``read`` makes of a piece of at most ``most`` bytes; None where there is none to rely on.

        `damaged` names those that were there; a single file is refused by `InputError`.
        """
        if self.path is None:
            return None
        file = self.path if self._pieces is None else self.path / self._pieces / f"{name}.npz"
        if not os.path.lexists(file):
            return None
        if file.is_dir():
            raise InputError(f"{shown(file)}: it is a folder, expected a file; remove it.")
        try:
            data = _read(file, most)
            content = data[:-DIGEST]
            if self._digest(name, content) != data[-DIGEST:]:
                raise ValueError("it is not what this run wrote")
            return read(content if self._pieces is not None else content[: content.rindex(START)])
        except Exception as error:  # reading a file that anyone may have made can raise nearly everything
            if self._pieces is None:
                raise self._foreign(file) from error
            self.damaged.append(file.name)
            with suppress(OSError):
                file.unlink()  # it may be no file at all, and not to be written to
            return None

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence about the pieces that were there but not used, if there were any."""
        if not self.damaged:
            return ()
        names = ", ".join(self.damaged[:3]) + (f" and {len(self.damaged) - 3} more" if len(self.damaged) > 3 else "")
        what = str(self._pieces).capitalize()
        return (f"{what} that were damaged or of another run were computed again: {names}.",)

    def within(self, name: str, keyword: str = "directory") -> dict[str, Any]:
        """Return the keywords of a further run, in a folder or file of this one, that goes on with what is there."""
        return {} if self.path is None else {keyword: self.path / name, "resume": True}


def packed(arrays: Mapping[str, ArrayLike]) -> bytes:
    """Arrays as the content of an npz file."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def unpacked(content: bytes) -> dict[str, NDArray[Any]]:
    """The arrays that `packed` took. Raises ValueError for a file that is compressed, and could be of any size."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(member.file_size for member in archive.infolist()) > len(content):
            raise ValueError("it is compressed")
    return dict(np.load(io.BytesIO(content), allow_pickle=False))


def _make(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"Cannot write into {shown(folder)}: expected a folder, got a file.")
    folder.mkdir(parents=True, exist_ok=True)


def _read(file: Path, most: int | None) -> bytes:
    """Return the content of an ordinary file; ValueError for another, which might never end, or a longer one."""
    if not stat.S_ISREG(file.stat().st_mode):
        raise ValueError("it is no file")
    with open(file, "rb") as stream:
        content = stream.read(-1 if most is None else most + 1)
    if most is not None and len(content) > most:
        raise ValueError("it is too long")
    return content
