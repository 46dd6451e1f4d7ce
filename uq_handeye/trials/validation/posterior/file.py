r"""The HDF5 file of a chain: emcee's own backend, written whole or not at all, refused when damaged or another run's.

The chain is an ``emcee.backends.HDFBackend`` (group ``mcmc``), which any program that knows emcee reads; it is in the
sampler's whitened coordinates. The group's attributes also hold our manifest: ``format``, what the numbers depend on
(``identity``: data and noise by their SHA-256, model, seed, walkers, versions), the proposal and the length of the
burn-in that the chain was begun with, and a SHA-256 of everything. No pickles.

emcee writes at every step, and a process that is killed in the middle of that leaves a file that HDF5 may not open
again. So it writes into an image of the file in memory, which after whole rounds of steps takes the place of the file
in one step of the file system. What is guaranteed: whenever the process ends, also by kill -9, the file is that of the
last writing, complete; the steps since then are lost, and sampled again with the same random numbers.

While a process is at work on a file, it holds its lock (`files.lock`).
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar, NamedTuple
from weakref import WeakValueDictionary

import h5py
import numpy as np
from emcee.backends import Backend, HDFBackend

from ....core.files.atomic import FileLock, write_atomically
from ....core.files.open import as_path, reason, shown
from ....core.geometry.se3 import Array
from ....errors import InputError
from .moves import Proposal

FORMAT, FORMER = "uq-handeye posterior 2", "uq-handeye posterior 1"
GROUP = "mcmc"
ARRAYS = ("chain", "log_prob", "accepted")


class Chain(NamedTuple):
    """A chain, and what it was begun with."""

    backend: Backend  # of emcee: steps, walkers, d whitened coordinates; log density; state of the random numbers
    proposal: Proposal
    burn_in: int  # steps before the first one

    @property
    def steps(self) -> int:
        """Length."""
        return int(self.backend.iteration)

    @property
    def y(self) -> Array:
        """(steps, walkers, d) whitened coordinates."""
        return np.asarray(self.backend.get_chain())

    @property
    def log_density(self) -> Array:
        """(steps, walkers)"""
        return np.asarray(self.backend.get_log_prob())


class HeldBackend(HDFBackend):  # type: ignore[misc]
    """emcee's backend, on an image of its file in memory that stays open; `image` is what the file is to hold."""

    def __init__(self, content: bytes = b"") -> None:
        super().__init__(None, name=GROUP)
        self._image = io.BytesIO(content)
        self._file = h5py.File(self._image, "r+" if content else "w")

    @property
    def initialized(self) -> bool:
        return GROUP in self._file

    @contextmanager
    def open(self, mode: str = "r") -> Iterator[Any]:
        yield self._file

    def image(self) -> bytes:
        """The content of the file."""
        self._file.flush()
        return self._image.getvalue()


class ChainFile:
    """File of a chain, locked against other processes until `close`, or until nothing refers to it.

    In the same process a new one takes the file over from the old one, which can then write no more: after an
    exception its traceback may keep the old one alive.

    Raises `InputError` where there is a file already and not ``resume``, where the path names no ordinary file, and
    where another process is at work on it.
    """

    _open: ClassVar[WeakValueDictionary[str, ChainFile]] = WeakValueDictionary()  # by the real path

    def __init__(self, path: str | os.PathLike[str], identity: dict[str, Any], resume: bool) -> None:
        self.path: Path = as_path(path)
        self._identity = identity
        try:
            if self.path.is_dir():
                raise InputError(f"Expected `file` to name an HDF5 file, got the folder {shown(self.path)}.")
            there = self.path.exists()
            if there and not stat.S_ISREG(self.path.stat().st_mode):  # a pipe would be waited for
                raise InputError(f"Expected `file` to name an HDF5 file, got {shown(self.path)}, a device or pipe.")
            if there and not resume:
                raise InputError(
                    f"{shown(self.path)} exists: go on with the chain in it by resume=True (--resume), or name a new "
                    "file."
                )
            real = os.path.realpath(self.path)
            if (earlier := self._open.get(real)) is not None:
                earlier.close()
            self._let_go = weakref.finalize(self, FileLock(real).release)
        except FileNotFoundError as error:
            folder = shown(self.path.parent)
            raise InputError(f"Cannot write {shown(self.path)}: there is no folder {folder}; make it first.") from error
        except OSError as error:
            raise InputError(f"Cannot write {shown(self.path)}: {reason(error)}.") from error
        self._open[real] = self

    def close(self) -> None:
        """Let go of the file."""
        self._let_go()

    def begin(self, proposal: Proposal, burn_in: int) -> Chain:
        """An empty chain, to be filled by emcee and written by `save`."""
        return Chain(HeldBackend(), proposal, burn_in)

    def save(self, chain: Chain) -> None:
        """Write the chain in place of what is there; raises `InputError` once it is closed."""
        if not self._let_go.alive:
            raise InputError(f"{shown(self.path)} was taken over by a later run.")
        assert isinstance(chain.backend, HeldBackend)
        with chain.backend.open() as file:
            manifest = {"format": FORMAT, "identity": json.dumps(self._identity, sort_keys=True)}
            proposal = {f"proposal_{name}": value for name, value in chain.proposal._asdict().items()}
            attributes = file[GROUP].attrs
            attributes.update(manifest | proposal | {"burn_in": chain.burn_in})
            attributes["sha256"] = _digest(file[GROUP])
        write_atomically(self.path, chain.backend.image())

    def load(self) -> Chain | None:
        """The chain that is there, None where there is no file yet; raises `InputError` for anything else."""
        if not self.path.exists():
            return None
        damaged = f"{shown(self.path)} is not the file of a posterior, or is damaged: name a new file."
        try:
            content = self.path.read_bytes()
            if not content:
                raise InputError(damaged)
            backend = HeldBackend(content)
            with backend.open() as file:
                attributes = dict(file[GROUP].attrs)
                if attributes["version"] == FORMER:
                    raise InputError(
                        f"{shown(self.path)} has the format {FORMER!r} of an earlier version, which cannot be gone on "
                        f"with; this version writes {FORMAT!r}. Name a new file."
                    )
                _require_plain(file[GROUP], len(content))
                if attributes["format"] != FORMAT or attributes["sha256"] != _digest(file[GROUP]):
                    raise InputError(damaged)
            there = json.loads(attributes["identity"])
            proposal = Proposal(*(np.asarray(attributes[f"proposal_{name}"]) for name in Proposal._fields))
            chain = Chain(backend, proposal, int(attributes["burn_in"]))
        except PermissionError as error:
            raise InputError(f"Cannot read {shown(self.path)}: {reason(error)}.") from error
        except InputError:
            raise
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError) as error:
            raise InputError(damaged) from error
        self._compare(there)
        return chain

    def _compare(self, there: dict[str, Any]) -> None:
        names = [name for name in {**self._identity, **there} if there.get(name) != self._identity.get(name)]
        if names:
            raise InputError(
                f"{shown(self.path)} holds another run: its {', '.join(names)} "
                f"{'differs' if len(names) == 1 else 'differ'}. Ask for the same, or name a new file."
            )


def _require_plain(group: Any, size: int) -> None:
    """Refuse arrays of another type or shape than a chain's, and those that are not all in the file of this size."""
    walkers, d = (int(group.attrs[name]) for name in ("nwalkers", "ndim"))
    shapes = {"chain": (walkers, d), "log_prob": (walkers,), "accepted": ()}
    if sorted(group) != sorted(shapes):
        raise ValueError("unexpected arrays")
    for name, shape in shapes.items():
        array = group[name]
        whole = array.dtype == np.float64 and array.nbytes <= array.id.get_storage_size() <= size
        if not whole or array.shape[1:] != shape or array.id.get_create_plist().get_nfilters():
            raise ValueError(f"unexpected {name}")
    if not len(group["chain"]) == len(group["log_prob"]) >= int(group.attrs["iteration"]) > 0:
        raise ValueError("unexpected number of steps")


def _digest(group: Any) -> str:
    """Hash all arrays and attributes but the digest itself."""
    digest = hashlib.sha256()
    values = {name: group[name][...] for name in ARRAYS} | {k: v for k, v in group.attrs.items() if k != "sha256"}
    for name, value in sorted(values.items()):
        digest.update(name.encode() + b"\n")
        digest.update(value.encode() if isinstance(value, str) else np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()
