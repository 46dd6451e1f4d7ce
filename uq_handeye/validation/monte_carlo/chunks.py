r"""A run of Monte Carlo in chunks of a fixed number of trials, each with random numbers of its own.

Chunk k draws from ``SFC64(SeedSequence(seed, spawn_key=(k,)))``, the k-th child of ``SeedSequence(seed).spawn``, and so
needs no other chunk. It is computed with one thread of linear algebra, on a copy of the problem that was written to
bytes and read again, wherever that happens. Hence the same numbers, bit by bit, in one process or in many, on one
machine or on several with the same type of processor and the same versions of the libraries.
"""

from __future__ import annotations

import pickle
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..._version import __version__
from ...errors import InputError
from ...geometry.se3 import Array
from ...runtime.threads import one_thread
from ...simulation.experiment import Experiment
from ...simulation.run import run
from .consistency import Sums

# Trials per chunk: the largest of these for which trials times poses (or pairs) stay below `MOST`. Each divides the
# 10,000 trials of a sequence of JCGM 101.
SIZES, MOST = (1000, 100, 10), 1_000_000


def versions() -> dict[str, str]:
    """Return the versions on which the last bits of a result depend."""
    return {
        "uq_handeye": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "machine": platform.machine(),
    }


def chunk_size(experiment: Experiment) -> int:
    """Trials per chunk, by the size of the problem only."""
    return next((size for size in SIZES if size * experiment.size <= MOST), SIZES[-1])


class Chunk(NamedTuple):
    """Trials of one chunk."""

    errors: Array  # (m, 6), zeros where not ok
    ok: NDArray[np.bool_]  # (m,)
    own: Array  # (6, 6) sum of the trials' own covariances; zeros where they are not what is tested
    sums: Sums


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
