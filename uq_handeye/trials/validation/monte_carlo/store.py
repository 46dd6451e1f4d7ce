r"""Identity of a run, and the folder that keeps it: a manifest, one file per chunk, and the result.

The identity of a run is what its numbers depend on, large arrays by their SHA-256; a run is gone on with only where it
is the same. ``manifest.json`` holds it. ``chunks/000000.npz`` holds the trials of chunk 0: ``errors`` (m, 6), ``ok``
(m,) and the sums over them; behind these arrays stand 32 bytes, the SHA-256 of run, number and content. Every file is
written whole or not at all: from what any end of the program leaves, ``resume`` goes on. A chunk that is damaged, or
belongs to another run or place, is computed again and never used.

Files are not trusted: nothing is read before its size and its SHA-256 are those of a chunk, and no pickles ever.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
import zipfile
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ....core.files.atomic import FileLock, write_atomically
from ....core.files.open import as_path, reason, shown
from ....errors import InputError
from ....model.noise.joint_covariance import JointCovariance
from ....model.noise.models import Noise, noise_to_dict
from ....model.poses.motions import Motions
from ....model.poses.pose_pairs import PosePairs
from .chunks import Chunk, Work
from .sums import BELOW, Sums

FORMAT = "uq-handeye monte carlo run 2"
MOST_MANIFEST = 1_000_000  # bytes
MOST_NAMED = 5  # differences in a message
MOST_TRIALS = 10**15  # that a manifest may name
DIGEST = 32  # bytes at the end of a chunk
# Bytes of a chunk: per trial, and at most of all else.
PER_TRIAL, BESIDE = 6 * 8 + 1, 24 * BELOW.size + 8192


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


def sha256_of_noise(noise: Noise) -> str:
    """Hash the covariances of a noise; those that poses share, and a prior, by the numbers that they are made of."""
    sides = ("robot", "camera") if hasattr(noise, "robot") else ("A", "B")
    covariances = {name: getattr(noise, name) for name in sides}
    if noise.prior is None and JointCovariance not in map(type, covariances.values()):
        return sha256(covariances)
    return hashlib.sha256(json.dumps(noise_to_dict(noise), sort_keys=True).encode()).hexdigest()


def sha256_of_data(data: PosePairs | Motions, **more: Any) -> str:
    """Hash the poses, or the motions and the poses that they were made of."""
    names = ("A", "B", "robot", "camera")
    holders = [data] if data.poses is None or data.poses is data else [data, data.poses]
    return sha256(more | {name: getattr(of, name) for of in holders for name in names if hasattr(of, name)})


def require_same(path: Path, there: Mapping[str, Any], mine: Mapping[str, Any], what: str) -> None:
    """Raise the `InputError` that names what differs between the identity in a file or folder and that of this run."""
    names = [name for name in {**mine, **there} if there.get(name) != mine.get(name)]
    if names:
        found = [f"{_short(name)} ({_short(there.get(name))}, now {_short(mine.get(name))})" for name in names]
        more = [f"and {len(names) - MOST_NAMED} more"] if len(names) > MOST_NAMED else []
        raise InputError(
            f"{shown(path)} holds another run, which differs in {', '.join(found[:MOST_NAMED] + more)}: ask for the "
            f"same, or name a new {what}."
        )


def _short(value: Any) -> str:
    """Return a name or value for a message, on one line; of hashes and other long ones the beginning."""
    text = "none" if value is None else str(value) if type(value) in (str, int, float) else type(value).__name__
    text = text if len(text) <= 40 else f"{text[:8]}..."
    return text if text.isprintable() else ascii(text)


def identity(work: Work) -> dict[str, Any]:
    """Return what the numbers of a run depend on, except for the number of trials."""
    e = work.experiment
    setup = getattr(e.truth, "setup", None)
    return {
        "data": f"{e.count} motions" if setup is None else f"{e.count} poses, {setup}",
        "data sha256": sha256_of_data(e.truth, X=e.X, W=e.W, pairs=e.pairs),
        "noise": type(e.noise).__name__,
        "noise sha256": sha256_of_noise(e.noise),
        "method": e.method,
        "scale": e.scale,
        "covariance tested": "of each trial" if work.tested is None else sha256({"tested": work.tested}),
        "seed": work.seed,
        "trials per chunk": work.chunk,
        **{f"version of {name}": version for name, version in work.versions.items()},
    }


class RunFolder:
    """The folder of one run, open for as long as the run goes on.

    Parameters
    ----------
    directory : path
        Made if missing. It must be empty, or hold the same run if ``resume``.
    work : Work
    resume : bool
        Whether to go on with what is there. More trials may be asked for than before, not fewer.

    Raises `InputError` for a folder of something else, of another run (naming what differs), or in use by another
    process.
    """

    def __init__(self, directory: str | os.PathLike[str], work: Work, resume: bool) -> None:
        self.path = as_path(directory)
        self._chunks, self._work = self.path / "chunks", work
        self._identity = identity(work)
        self._run = hashlib.sha256(json.dumps(self._identity, sort_keys=True).encode()).digest()
        self.damaged: list[str] = []  # names of chunks that were there but not used
        self.resumed = 0  # trials of chunks that were used
        with ExitStack() as stack:
            try:
                self.path.mkdir(parents=True, exist_ok=True)
                stack.callback(FileLock(self.path / "manifest.json").release)
                self._require_ours(resume)
                self._chunks.mkdir(exist_ok=True)
                for folder in (self.path, self._chunks):  # of a process that was killed: nobody else is at work here
                    for leftover in folder.glob(".uq-handeye-*.tmp"):
                        leftover.unlink(missing_ok=True)
            except FileExistsError as error:
                where = self._chunks if self.path.is_dir() else self.path
                raise InputError(f"Cannot write into {shown(where)}: expected a folder, got a file.") from error
            except OSError as error:
                raise InputError(f"Cannot write into {shown(self.path)}: {reason(error)}.") from error
            manifest = {"format": FORMAT, "sha256": self._run.hex(), "trials": work.trials, "run": self._identity}
            self.write("manifest.json", (json.dumps(manifest, indent=2) + "\n").encode())
            self.close = stack.pop_all().close  # lets go of the folder

    def _require_ours(self, resume: bool) -> None:
        found = {name for name in os.listdir(self.path) if not name.startswith(".uq-handeye-")}
        if found and not resume:
            raise InputError(
                f"{shown(self.path)} is not empty: go on with the run in it by resume=True (--resume), or name a new "
                "folder."
            )
        if (self.path / "result.json").is_dir():
            raise InputError(f"{shown(self.path / 'result.json')}: it is a folder, expected a file; remove it.")
        if found and "manifest.json" not in found:
            raise InputError(
                f"{shown(self.path)} holds no run to resume, as there is no manifest.json in it, but other files: name "
                "another folder."
            )
        if not found:
            return
        there, trials = self._manifest(self.path / "manifest.json")
        require_same(self.path, there, self._identity, "folder")
        if trials > self._work.trials:
            there_are = len(list(self._chunks.glob("*.npz"))) * self._work.chunk
            done = "" if there_are >= trials else f", of which {there_are:,} are done"
            raise InputError(
                f"{shown(self.path)} holds a run that was asked for {trials:,} trials{done}: resume it with as many or "
                f"more, got {self._work.trials:,}."
            )

    def _manifest(self, file: Path) -> tuple[dict[str, Any], int]:
        """Return the identity and the trials of the run that is there."""
        try:
            manifest = json.loads(_bytes(file, MOST_MANIFEST))
            if manifest["format"] == FORMAT and 0 < manifest["trials"] <= MOST_TRIALS:
                return dict(manifest["run"]), int(manifest["trials"])
        except OSError as error:
            raise InputError(f"Cannot read {shown(file)}: {reason(error)}.") from error
        except (ValueError, TypeError, LookupError, RecursionError):
            pass
        raise InputError(f"{shown(file)} is not the manifest of a Monte Carlo run, or is damaged: name a new folder.")

    def write(self, name: str, content: bytes) -> None:
        """Write a file of the folder. A link, pipe or device of its name is replaced: nothing is written elsewhere."""
        file = self.path / name
        foreign = file.is_symlink() or (file.exists() and not (file.is_file() or file.is_dir()))
        place = file.with_name(f".uq-handeye-{file.name}.tmp") if foreign else file
        write_atomically(place, content)
        if foreign:
            os.replace(place, file)

    def _digest(self, index: int, content: bytes) -> bytes:
        return hashlib.sha256(b"%b %d " % (self._run, index) + content).digest()

    def save(self, index: int, chunk: Chunk) -> None:
        """Write one chunk."""
        buffer = io.BytesIO()
        arrays = {"errors": chunk.errors, "ok": chunk.ok, "own": chunk.own, **chunk.sums.to_arrays()}
        np.savez(buffer, allow_pickle=False, **arrays)
        content = buffer.getvalue()
        self.write(f"chunks/{index:06d}.npz", content + self._digest(index, content))

    def load(self, index: int) -> Chunk | None:
        """The chunk, or None where there is none to rely on; `damaged` names those that were there."""
        file = self._chunks / f"{index:06d}.npz"
        try:
            data = _bytes(file, self._work.chunk * PER_TRIAL + BESIDE)
            content = io.BytesIO(data[:-DIGEST])
            if self._digest(index, content.getvalue()) != data[-DIGEST:]:
                raise ValueError("it is not what this run wrote")
            with zipfile.ZipFile(content) as archive:
                if sum(member.file_size for member in archive.infolist()) > len(data):
                    raise ValueError("it is compressed")
            found = dict(np.load(content, allow_pickle=False))
            chunk = Chunk(found.pop("errors"), found.pop("ok"), found.pop("own"), Sums.from_arrays(found))
        except Exception as error:  # reading a file that anyone may have made can raise nearly everything
            if type(error) is FileNotFoundError and not file.is_symlink():
                return None
            if file.is_dir():
                raise InputError(f"{shown(file)}: it is a folder, expected a file; remove it.") from error
            self.damaged.append(file.name)
            with suppress(OSError):
                file.unlink()  # it may be no file at all, and not to be written to
            return None
        if len(chunk.errors) != self._work.size(index):  # the last one, before more trials were asked for
            return None
        self.resumed += len(chunk.errors)
        return chunk


def _bytes(file: Path, most: int) -> bytes:
    """Return the content of an ordinary file; ValueError for another, which might never end, or a longer one."""
    if not stat.S_ISREG(file.stat().st_mode):
        raise ValueError("it is no file")
    with open(file, "rb") as stream:
        content = stream.read(most + 1)
    if len(content) > most:
        raise ValueError("it is too long")
    return content
