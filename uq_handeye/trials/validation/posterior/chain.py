"""The HDF5 file of a chain: emcee's own backend, kept as the single piece of a `Run`.

The chain is an ``emcee.backends.HDFBackend`` (group ``mcmc``), which any program that knows emcee reads; it is in the
sampler's whitened coordinates. The group's attributes also hold the proposal and the length of the burn-in that the
chain was begun with. The file contains no pickles.

emcee writes at every step, and a process that is killed in the middle of that leaves a file that HDF5 may not open
again. So it writes into an image of the file in memory, which after whole rounds of steps takes the place of the file
in one step of the file system. Whenever the process ends, also by kill -9, the file is that of the last writing,
complete; the steps since then are lost, and sampled again with the same random numbers.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple, cast

import h5py
import numpy as np
from emcee.backends import Backend, HDFBackend

from ....core.geometry.se3 import Array
from .proposal import Proposal

GROUP = "mcmc"


class Chain(NamedTuple):
    """A chain, and the settings that it was begun with."""

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
    def open(self, mode: str = "r") -> Iterator[h5py.File]:
        yield self._file

    def image(self) -> bytes:
        """The content of the file."""
        self._file.flush()
        return self._image.getvalue()


def content_of(chain: Chain) -> bytes:
    """Return the content of the file of a chain whose backend is a `HeldBackend`."""
    backend = cast(HeldBackend, chain.backend)
    with backend.open() as file:
        proposal = {f"proposal_{name}": value for name, value in chain.proposal._asdict().items()}
        file[GROUP].attrs.update(proposal | {"burn_in": chain.burn_in})
    return backend.image()


def chain_of(content: bytes) -> Chain:
    """Return the chain of such a file; raises whatever h5py raises for another."""
    backend = HeldBackend(content)
    with backend.open() as file:
        _require_plain(file[GROUP], len(content))
        attributes = file[GROUP].attrs
        proposal = Proposal(*(np.asarray(attributes[f"proposal_{name}"]) for name in Proposal._fields))
        return Chain(backend, proposal, int(attributes["burn_in"]))


def _require_plain(group: h5py.Group, size: int) -> None:
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
