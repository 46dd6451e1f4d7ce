r"""The HDF5 file of a chain: written whole or not at all, refused when it is another run's or damaged.

Layout of emcee's ``HDFBackend`` (group ``mcmc``: ``chain`` (steps, walkers, d) in the sampler's whitened coordinates,
``log_prob``, ``accepted``, and the random state after the last step), which also reads it. emcee's own backend writes
into the file at every step, and a process killed in the middle of that leaves a file that HDF5 may not open again. Here
the file is made in memory after a round of steps and takes the place of the old one in one step of the file system, so
that ``kill -9`` costs the steps since then and nothing else.

While a process is at work on a file, it holds the lock of ``.uq-handeye-NAME.lock`` beside it, which is removed at the
end; one that a killed process left behind is in nobody's way.

The group's attributes hold what the numbers depend on (``identity``: data and noise by their SHA-256, model, seed,
walkers, versions), the proposal that the chain was begun with, and a SHA-256 of the content. No pickles.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import stat
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any, ClassVar, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError, MissingExtraError
from ...files.atomic import write_atomically
from ...files.open import as_path, reason, shown
from ...geometry.se3 import Array
from .moves import Proposal

FORMAT = "uq-handeye posterior 1"
GROUP = "mcmc"
RandomState = tuple[str, NDArray[np.uint32], int, int, float]


class Chain(NamedTuple):
    """A chain at the end of a round: all that it needs to go on."""

    y: Array  # (steps, walkers, d) whitened coordinates
    log_density: Array  # (steps, walkers)
    accepted: Array  # (walkers,) number of proposals accepted
    random_state: RandomState
    proposal: Proposal
    burn_in: int  # steps before the first one


class ChainFile:
    """Where a chain is kept, held against other processes until `close`, or until nothing refers to it.

    In the same process a new one takes the file over from the old one, which can then write no more: after an
    exception its traceback may keep the old one alive.

    Raises `InputError` where there is a file already and not ``resume``, where the path names no ordinary file, and
    where another process is at work on it.
    """

    _open: ClassVar[WeakValueDictionary[str, ChainFile]] = WeakValueDictionary()  # by the real path

    def __init__(self, path: str | os.PathLike[str], identity: dict[str, Any], resume: bool) -> None:
        _h5py()
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
            self._let_go = weakref.finalize(self, _unlocked, *_locked(Path(real)))
        except FileNotFoundError as error:
            folder = shown(self.path.parent)
            raise InputError(f"Cannot write {shown(self.path)}: there is no folder {folder}; make it first.") from error
        except OSError as error:
            raise InputError(f"Cannot write {shown(self.path)}: {reason(error)}.") from error
        self._open[real] = self

    def close(self) -> None:
        """Let go of the file."""
        self._let_go()

    def save(self, chain: Chain) -> None:
        """Write the chain in place of what is there; raises `InputError` once it is closed."""
        if not self._let_go.alive:
            raise InputError(f"{shown(self.path)} was taken over by a later run.")
        arrays = {"chain": chain.y, "log_prob": chain.log_density, "accepted": chain.accepted}
        attributes = {
            "version": FORMAT,
            "nwalkers": chain.y.shape[1],
            "ndim": chain.y.shape[2],
            "has_blobs": False,
            "iteration": len(chain.y),
            **{f"random_state_{k}": value for k, value in enumerate(chain.random_state)},
            "identity": json.dumps(self._identity, sort_keys=True),
            **{f"proposal_{name}": value for name, value in chain.proposal._asdict().items()},
            "burn_in": chain.burn_in,
        }
        buffer = io.BytesIO()
        with _h5py().File(buffer, "w") as file:
            group = file.create_group(GROUP)
            for name, values in arrays.items():
                group.create_dataset(name, data=values)
            group.attrs.update(attributes | {"sha256": _digest(arrays, attributes)})
        write_atomically(self.path, buffer.getvalue())

    def load(self) -> Chain | None:
        """The chain that is there, None where there is no file yet; raises `InputError` for anything else."""
        if not self.path.exists():
            return None
        h5py = _h5py()
        damaged = f"{shown(self.path)} is not the file of a posterior, or is damaged: name a new file."
        try:
            with h5py.File(self.path, "r") as file:
                group = file[GROUP]
                attributes = {name: group.attrs[name] for name in group.attrs}
                steps, walkers, d = (int(attributes[name]) for name in ("iteration", "nwalkers", "ndim"))
                shapes = {"chain": (steps, walkers, d), "log_prob": (steps, walkers), "accepted": (walkers,)}
                arrays = {name: _plain(group[name], shape) for name, shape in shapes.items()}
            there = json.loads(attributes["identity"])
            digest = attributes.pop("sha256")
            if attributes["version"] != FORMAT or digest != _digest(arrays, attributes) or not isinstance(there, dict):
                raise InputError(damaged)
        except PermissionError as error:
            raise InputError(f"Cannot read {shown(self.path)}: {reason(error)}.") from error
        except (OSError, KeyError, ValueError, TypeError, AttributeError, RuntimeError, MemoryError) as error:
            raise InputError(damaged) from error
        self._compare(there)
        kind, key, *position = (attributes[f"random_state_{k}"] for k in range(5))
        state = (str(kind), np.asarray(key, dtype=np.uint32), int(position[0]), int(position[1]), float(position[2]))
        return Chain(
            arrays["chain"],
            arrays["log_prob"],
            arrays["accepted"],
            state,
            Proposal(*(np.asarray(attributes[f"proposal_{name}"]) for name in Proposal._fields)),
            int(attributes["burn_in"]),
        )

    def _compare(self, there: dict[str, Any]) -> None:
        names = [name for name in {**self._identity, **there} if there.get(name) != self._identity.get(name)]
        if names:
            raise InputError(
                f"{shown(self.path)} holds another run: its {', '.join(names)} "
                f"{'differs' if len(names) == 1 else 'differ'}. Ask for the same, or name a new file."
            )


def _locked(file: Path) -> tuple[Path, int | None]:
    """The lock of a chain's file, and its descriptor once this process holds it; None where there are no locks."""
    lock = file.with_name(f".uq-handeye-{file.name}.lock")
    try:
        import fcntl
    except ImportError:
        return lock, None
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(descriptor)
            raise InputError(f"{shown(file)} is in use by another run: wait for its end.") from error
        except OSError:  # a file system without locks
            return lock, descriptor
        with suppress(FileNotFoundError):
            if os.path.samestat(os.stat(lock), os.fstat(descriptor)):
                return lock, descriptor
        os.close(descriptor)  # the one who held it has just removed it


def _unlocked(lock: Path, descriptor: int | None) -> None:
    """Remove a lock, and only then let go of it."""
    if descriptor is not None:
        with suppress(OSError):
            lock.unlink()
        os.close(descriptor)


def _plain(dataset: Any, shape: tuple[int, ...]) -> Array:
    """A dataset of doubles with this shape, of which every byte is in the file."""
    if dataset.shape != shape or dataset.dtype != np.float64 or dataset.id.get_storage_size() != 8 * np.prod(shape):
        raise ValueError("unexpected shape or type")
    return np.asarray(dataset[...])


def _digest(arrays: dict[str, Array], attributes: dict[str, Any]) -> str:
    digest = hashlib.sha256()
    for name, value in sorted({**arrays, **attributes}.items()):
        digest.update(name.encode() + b"\n")
        digest.update(value.encode() if isinstance(value, str) else np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def _h5py() -> Any:
    try:
        import h5py
    except ImportError as error:
        raise MissingExtraError('The file of a posterior needs h5py: pip install "uq-handeye[posterior]".') from error
    return h5py
