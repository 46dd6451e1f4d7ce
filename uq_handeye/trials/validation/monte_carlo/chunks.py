"""Chunks of a Monte Carlo run: a fixed number of trials each, with random numbers independent of the other chunks.

Chunk k draws from ``SFC64(SeedSequence(seed, spawn_key=(k,)))``, the k-th child of ``SeedSequence(seed).spawn``, and so
needs no other chunk. It is computed with one thread of linear algebra, on a copy of the problem that was written to
bytes and read again, in every process. Hence the results are the same, bit by bit, in one process or in many, on one
machine or on several with the same type of processor and the same versions of the libraries.
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....core.files.json_values import JsonObject
from ....core.geometry.se3 import Array
from ....core.threads import one_thread
from ....errors import InputError
from ...simulation.experiment import Experiment
from ...simulation.run import run
from ..resumable import identity_of, packed, sha256, unpacked, versions
from .consistency import Sums
from .stopping import BLOCK_TRIALS
from .sums import BELOW

# Poses (or pairs) of all trials of a chunk.
MAX_CHUNK_POSES = 1_000_000


def chunk_size(experiment: Experiment) -> int:
    """Trials per chunk, by the size of the problem only: 1,000, 100 or 10, which divide the blocks of JCGM 102."""
    sizes = (BLOCK_TRIALS // 10, BLOCK_TRIALS // 100, BLOCK_TRIALS // 1000)
    return next((size for size in sizes if size * experiment.size <= MAX_CHUNK_POSES), sizes[-1])


class Chunk(NamedTuple):
    """Trials of one chunk."""

    errors: Array  # (m, 6), zeros where not ok
    ok: NDArray[np.bool_]  # (m,)
    own: Array  # (6, 6) sum of the trials' own covariances; zeros where they are not what is tested
    sums: Sums

    def to_bytes(self) -> bytes:
        """Return the chunk as a file keeps it."""
        return packed({"errors": self.errors, "ok": self.ok, "own": self.own, **self.sums.to_arrays()})

    @classmethod
    def from_bytes(cls, content: bytes) -> Chunk:
        """Return the chunk that `to_bytes` gave."""
        arrays = unpacked(content)
        return cls(arrays.pop("errors"), arrays.pop("ok"), arrays.pop("own"), Sums.from_arrays(arrays))


@dataclass(frozen=True, eq=False)
class Work:
    """Everything that a chunk is made from."""

    experiment: Experiment
    seed: int
    trials: int
    chunk: int  # trials per chunk; the last one may have fewer
    tested: Array | None  # (6, 6) the covariance that is put to the test; None: each trial's own
    versions: dict[str, str] = field(default_factory=versions)

    @property
    def count(self) -> int:
        """Number of chunks."""
        return -(-self.trials // self.chunk)

    def size(self, index: int) -> int:
        """Trials of a chunk."""
        return min(self.chunk, self.trials - index * self.chunk)

    @property
    def most_bytes(self) -> int:
        """Bytes of a chunk at most: of each trial, and of all else."""
        return self.chunk * (6 * 8 + 1) + 24 * BELOW.size + 8192

    @property
    def identity(self) -> JsonObject:
        """Everything that the numbers of a run depend on, except for the number of trials."""
        e = self.experiment
        tested = "of each trial" if self.tested is None else sha256({"tested": self.tested})
        what = {"method": e.method, "scale": e.scale, "covariance tested": tested}
        more = {"seed": self.seed, "trials per chunk": self.chunk}
        return identity_of(e.truth, e.noise, {"X": e.X, "W": e.W, "pairs": e.pairs}, **what, **more)

    def compute(self, index: int) -> Chunk:
        """Draw and solve the trials of one chunk."""
        rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence(self.seed, spawn_key=(index,))))
        errors, ok, covariances = run(self.experiment, rng, self.size(index), each=self.tested is None)
        if self.tested is not None:
            return Chunk(errors, ok, np.zeros((6, 6)), Sums.of(errors, ok, self.tested))
        assert covariances is not None
        return Chunk(errors, ok, covariances[ok].sum(axis=0), Sums.of(errors, ok, covariances))


def to_bytes(work: Work) -> bytes:
    """Serialise work for `from_bytes`: every process, also the one that asks, works on the result of that."""
    return pickle.dumps(work, protocol=5)


def from_bytes(data: bytes) -> Work:
    """The copy to work on. Reading it again settles how its arrays lie in memory, which rounding depends on."""
    work: Work = pickle.loads(data)
    return work


@lru_cache(maxsize=1)
def _received(message: bytes) -> Work:
    """The work of the run at hand, read once in each process."""
    return from_bytes(message)


def compute_chunks(message: bytes, indices: Sequence[int]) -> list[tuple[int, Chunk]]:
    """Some chunks with their numbers: what an executor is given to do.

    Raises `InputError` where the versions of the libraries are not those of the process that asked.
    """
    work = _received(message)
    if work.versions != versions():
        other = [f"{name} {mine}, not {work.versions[name]}" for name, mine in versions().items()
                 if mine != work.versions[name]]  # fmt: skip
        raise InputError(f"A worker has other versions, and its last digits would differ: {', '.join(other)}.")
    one_thread_from_now_on()
    return [(index, work.compute(index)) for index in indices]


@cache
def one_thread_from_now_on() -> None:
    """The same for a worker process, whose threads (of Dask) would else lift the limit for each other."""
    one_thread()
