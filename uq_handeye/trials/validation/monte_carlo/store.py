r"""The folder of a Monte Carlo run: a manifest, one file per chunk, and the result.

``manifest.json`` says what the run is: everything that its numbers depend on, large arrays by their SHA-256. The
SHA-256 of that is the identity of the run. ``chunks/000000.npz`` holds the trials of chunk 0: ``errors`` (m, 6), ``ok``
(m,), the sums over them, and the SHA-256 of identity, number and content. Every file is written whole or not at all:
from what any end of the program leaves, ``resume`` goes on. A chunk that is damaged, or belongs to another run or
place, is computed again and never used.

Files are not trusted: no pickles, no compression, and nothing is read before its size is known to be that of a chunk.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....core.files.atomic import FileLock, write_atomically
from ....core.files.open import as_path, reason, shown
from ....errors import InputError
from ....model.noise.joint_covariance import JointCovariance
from ....model.noise.models import Noise, PairNoise, noise_to_dict
from ....model.poses.pose_pairs import PosePairs
from .chunks import Chunk, Work
from .consistency import Sums

FORMAT = "uq-handeye monte carlo run 1"
MOST_MANIFEST = 1_000_000  # bytes
MOST_NAMED = 5  # differences in a message
DIGEST = "sha256"
MOST_TRIALS = 10**15  # that a manifest may name


def identity(work: Work) -> dict[str, Any]:
    """Return what the numbers of a run depend on, except for the number of trials."""
    e = work.experiment
    truth: dict[str, Any] = {"X": e.X, "W": e.W, "pairs": e.pairs}
    if isinstance(e.truth, PosePairs):
        truth |= {"robot": e.truth.robot, "camera": e.truth.camera}
        where = f"{e.truth.n} poses, {e.truth.setup}"
    else:
        truth |= {"A": e.truth.A, "B": e.truth.B}
        where = f"{e.truth.N} motions"
    return {
        "data": where,
        "data sha256": sha256(truth),
        "noise": type(e.noise).__name__,
        "noise sha256": sha256_of_noise(e.noise),
        "method": e.method,
        "scale": e.scale,
        "covariance tested": "of each trial" if work.tested is None else sha256({"tested": work.tested}),
        "seed": work.seed,
        "trials per chunk": work.chunk,
        **{f"version of {name}": version for name, version in work.versions.items()},
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


def sha256_of_noise(noise: Noise) -> str:
    """Hash the covariances of a noise; those that poses share, and a prior, by the numbers that they are made of."""
    sides = ("A", "B") if isinstance(noise, PairNoise) else ("robot", "camera")
    covariances = {name: getattr(noise, name) for name in sides}
    if noise.prior is None and not any(isinstance(S, JointCovariance) for S in covariances.values()):
        return sha256(covariances)
    return hashlib.sha256(json.dumps(noise_to_dict(noise), sort_keys=True).encode()).hexdigest()


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
        self._chunks = self.path / "chunks"
        self._work = work
        self._identity = identity(work)
        self._run = hashlib.sha256(json.dumps(self._identity, sort_keys=True).encode()).hexdigest()
        self._lock: FileLock | None = None
        self.damaged: list[str] = []  # names of chunks that were there but not used
        self.resumed = 0  # trials of chunks that were used
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = FileLock(self.path / "manifest.json")
            self._require_ours(resume)
            self._chunks.mkdir(exist_ok=True)
            for folder in (self.path, self._chunks):  # of a process that was killed: nobody else is at work here
                for leftover in folder.glob(".uq-handeye-*.tmp"):
                    leftover.unlink(missing_ok=True)
            self._write_manifest()
        except FileExistsError as error:
            self.close()
            where = self._chunks if self.path.is_dir() else self.path
            raise InputError(f"Cannot write into {shown(where)}: expected a folder, got a file.") from error
        except OSError as error:
            self.close()
            raise InputError(f"Cannot write into {shown(self.path)}: {reason(error)}.") from error
        except BaseException:
            self.close()
            raise

    def _require_ours(self, resume: bool) -> None:
        found = {name for name in os.listdir(self.path) if not name.startswith(".uq-handeye-")}
        if found and not resume:
            raise InputError(
                f"{shown(self.path)} is not empty: go on with the run in it by resume=True (--resume), or name a new "
                "folder."
            )
        if (self.path / "result.json").is_dir():
            raise InputError(f"{shown(self.path / 'result.json')}: it is a folder, expected a file; remove it.")
        if "manifest.json" in found:
            self._compare()
        elif found:
            raise InputError(
                f"{shown(self.path)} holds no run to resume, as there is no manifest.json in it, but other files: name "
                "another folder."
            )

    def _compare(self) -> None:
        """Refuse the manifest of another run."""
        file = self.path / "manifest.json"
        try:
            if not stat.S_ISREG(file.stat().st_mode):  # a pipe would be waited for, a device read for ever
                raise ValueError("no file")
            with open(file, "rb") as stream:
                text = stream.read(MOST_MANIFEST + 1)
            manifest = json.loads(text) if len(text) <= MOST_MANIFEST else None
        except OSError as error:
            raise InputError(f"Cannot read {shown(file)}: {reason(error)}.") from error
        except (ValueError, RecursionError):
            manifest = None
        there = manifest.get("run") if isinstance(manifest, dict) and manifest.get("format") == FORMAT else None
        trials = manifest.get("trials") if isinstance(manifest, dict) else None
        if not isinstance(there, dict) or type(trials) is not int or not 0 < trials <= MOST_TRIALS:
            raise InputError(
                f"{shown(file)} is not the manifest of a Monte Carlo run, or is damaged: name a new folder."
            )
        names = [name for name in {**self._identity, **there} if there.get(name) != self._identity.get(name)]
        if names:
            differences = [
                f"{_short(name)} ({_short(there.get(name))}, now {_short(self._identity.get(name))})"
                for name in names[:MOST_NAMED]
            ]
            if len(names) > MOST_NAMED:
                differences.append(f"and {len(names) - MOST_NAMED} more")
            raise InputError(
                f"{shown(self.path)} holds another run, which differs in {', '.join(differences)}: ask for the "
                "same, or name a new folder."
            )
        if trials > self._work.trials:
            there_are = len(list(self._chunks.glob("*.npz"))) * self._work.chunk
            done = "" if there_are >= trials else f", of which {there_are:,} are done"
            raise InputError(
                f"{shown(self.path)} holds a run that was asked for {trials:,} trials{done}: resume it with as many or "
                f"more, got {self._work.trials:,}."
            )

    def _write_manifest(self) -> None:
        manifest = {"format": FORMAT, "sha256": self._run, "trials": self._work.trials, "run": self._identity}
        self._put(self.path / "manifest.json", (json.dumps(manifest, indent=2) + "\n").encode())

    def write_result(self, text: str) -> None:
        """Write ``result.json``."""
        self._put(self.path / "result.json", text.encode())

    def _put(self, file: Path, content: bytes) -> None:
        """Write a file of the folder. A link, pipe or device of its name is replaced: nothing is written elsewhere."""
        with suppress(FileNotFoundError):
            mode = file.lstat().st_mode
            if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
                aside = file.with_name(f".uq-handeye-{file.name}.tmp")
                write_atomically(aside, content)
                os.replace(aside, file)
                return
        write_atomically(file, content)

    def close(self) -> None:
        """Let go of the folder."""
        if self._lock is not None:
            self._lock.release()

    def _file(self, index: int) -> Path:
        return self._chunks / f"{index:06d}.npz"

    def _digest(self, index: int, arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.uint8]:
        text = sha256({"run": np.frombuffer(bytes.fromhex(self._run), np.uint8), "index": np.int64(index), **arrays})
        return np.frombuffer(bytes.fromhex(text), np.uint8)

    def save(self, index: int, chunk: Chunk) -> None:
        """Write one chunk."""
        arrays = _arrays(chunk)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays, **{DIGEST: self._digest(index, arrays)})
        self._put(self._file(index), buffer.getvalue())

    def load(self, index: int) -> Chunk | None:
        """The chunk, or None where there is none to rely on; `damaged` names those that were there."""
        file = self._file(index)
        try:
            found = _read(file, self._work.chunk)
            digest = found.pop(DIGEST)
            if not np.array_equal(digest, self._digest(index, found)):
                raise ValueError("it is not what this run wrote")
            chunk = Chunk(found.pop("errors"), found.pop("ok"), found.pop("own"), Sums.from_arrays(found))
        except Exception as error:  # reading a file that anyone may have made can raise nearly everything
            if isinstance(error, FileNotFoundError) and not file.is_symlink():
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


def _arrays(chunk: Chunk) -> dict[str, NDArray[Any]]:
    return {"errors": chunk.errors, "ok": chunk.ok, "own": chunk.own, **chunk.sums.to_arrays()}


@cache
def _layout() -> dict[str, NDArray[Any]]:
    """An array of the right type and shape, but for the trials, by every name in a file."""
    errors, ok = np.zeros((0, 6)), np.zeros(0, dtype=bool)
    arrays = _arrays(Chunk(errors, ok, np.zeros((6, 6)), Sums.of(errors, ok, np.eye(6))))
    return {**arrays, DIGEST: np.zeros(32, np.uint8)}


def _read(file: Path, most: int) -> dict[str, NDArray[Any]]:
    """The arrays of a file that holds those of a chunk of at most so many trials, and nothing else."""
    layout = _layout()
    limit = 64 * most + sum(array.nbytes + 2048 for array in layout.values())
    about = file.stat()
    if not stat.S_ISREG(about.st_mode) or about.st_size > limit:
        raise ValueError("it is too long")
    arrays = {}
    with open(file, "rb") as stream, zipfile.ZipFile(stream) as archive:
        members = archive.infolist()
        if sorted(member.filename for member in members) != sorted(f"{name}.npy" for name in layout):
            raise ValueError("it does not hold the arrays of a chunk")
        for member in members:
            if member.compress_type != zipfile.ZIP_STORED or member.file_size > limit:
                raise ValueError(f"{member.filename} is too long")
            data = io.BytesIO(archive.read(member))
            if np.lib.format.read_magic(data) != (1, 0):
                raise ValueError(f"{member.filename} has an unknown format")
            shape, fortran, dtype = np.lib.format.read_array_header_1_0(data)
            name = member.filename.removesuffix(".npy")
            wanted = layout[name]
            size = int(np.prod(shape)) if name in ("errors", "ok") else wanted.size
            whole = data.getbuffer().nbytes - data.tell()
            if dtype != wanted.dtype or fortran or not 0 <= size == whole / dtype.itemsize <= limit:
                raise ValueError(f"{name} has another type or size")
            if shape[name in ("errors", "ok") :] != wanted.shape[name in ("errors", "ok") :]:
                raise ValueError(f"{name} has another shape")
            arrays[name] = np.frombuffer(data.getvalue(), dtype, offset=data.tell()).reshape(shape)
    return arrays


def _short(value: Any) -> str:
    """A name or value for a message, on one line; of hashes and other long ones the beginning."""
    text = "none" if value is None else str(value) if isinstance(value, str | int | float) else type(value).__name__
    text = text if len(text) <= 40 else f"{text[:8]}..."
    return text if text.isprintable() else ascii(text)
