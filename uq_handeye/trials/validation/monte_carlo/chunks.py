r"""A run of Monte Carlo in chunks of a fixed number of trials, each with random numbers of its own.

Chunk k draws from ``SFC64(SeedSequence(seed, spawn_key=(k,)))``, the k-th child of ``SeedSequence(seed).spawn``, and so
needs no other chunk. It is computed with one thread of linear algebra, on a copy of the problem that was written to
bytes and read again, wherever that happens. Hence the same numbers, bit by bit, in one process or in many, on one
machine or on several with the same type of processor and the same versions of the libraries.

Chunks computed in this process and by an executor beside it, and the order kept.

An executor is any `concurrent.futures.Executor`. It is handed a bounded number of groups of chunks, as bytes and plain
numbers, and may finish them in any order; the chunks are passed on by number. They depend on their number alone
(`chunks`): who computes one changes no digit.
"""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache, lru_cache
from itertools import islice
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ....core.geometry.se3 import Array
from ....core.runtime.executors import LocalProcesses
from ....core.runtime.threads import one_thread
from ....errors import InputError
from ...simulation.experiment import Experiment
from ...simulation.run import run
from ..resumable import identity_of, packed, sha256, unpacked, versions
from .consistency import Sums
from .sums import BELOW

# Trials per chunk: the largest of these for which trials times poses (or pairs) stay below `MOST`. Each divides the
# 10,000 trials of a sequence of JCGM 101.
SIZES, MOST = (1000, 100, 10), 1_000_000


def chunk_size(experiment: Experiment) -> int:
    """Trials per chunk, by the size of the problem only."""
    return next((size for size in SIZES if size * experiment.size <= MOST), SIZES[-1])


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
    def identity(self) -> dict[str, Any]:
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


# Groups in flight for each worker, one to work on and one to go on with; and of an executor that was given, at least.
AHEAD, LEAST_AHEAD = 2, 64
# Bytes of the copies of the work in flight.
MOST_BYTES = 256_000_000
# Chunks that may wait for an earlier one, as multiples of those in flight.
WINDOW = 2
# A group is to take so many seconds, which is long beside what its transport takes.
GROUP_SECONDS, MOST_IN_GROUP = 0.08, 16
# Processes take about so many seconds to start; what ends sooner is done without.
START_SECONDS = 1.0
# Seconds after which a wait begins again, so that Ctrl-C gets through on every system.
PATIENCE = 1.0


class WorkersLostError(Exception):
    """An executor does no more work; the message says what is known of why."""


class Crew:
    """This process, and an executor: one that is given, or worker processes if they save time.

    The first chunk that is missing is computed in this process, which raises what is wrong with it as it is, and tells
    how long the others will take. Where the workers are its own this process stays one of them; a given executor is
    only fed.

    Parameters
    ----------
    work, message
        `from_bytes` of the message, and the message.
    stored : function
        A chunk by its number, or None where it is to be computed.
    arrived : function
        Told of each that was computed, with its number, at once and in whatever order.
    workers : int
        Processes at most, this one among them. Of a given executor: for how many it is to be kept busy, if that is
        more than half of `LEAST_AHEAD`.
    executor : Executor or None
    """

    def __init__(
        self,
        work: Work,
        message: bytes,
        stored: Callable[[int], Chunk | None],
        arrived: Callable[[int, Chunk], None],
        workers: int = 1,
        executor: Executor | None = None,
    ) -> None:
        self._work, self._message, self._stored, self._arrived = work, message, stored, arrived
        self._workers, self._given = workers, executor
        self._executor: Executor | None = None  # once it is wanted
        self._stack = ExitStack()
        self._flying: set[Future[list[tuple[int, Chunk]]]] = set()
        self._most = self._group = 1  # groups in flight, chunks in a group
        self._ready: dict[int, Chunk] = {}
        self._next = 0  # the chunk to be looked at next

    def chunks(self) -> Generator[Chunk, None, None]:
        """All of them, by number. Raises `WorkersLostError` where the executor breaks, or takes no work."""
        with self._stack:
            self._stack.callback(self._cancel)
            for wanted in range(self._work.count):
                while wanted not in self._ready:
                    missing = self._missing(wanted)
                    self._submit(missing)
                    self._collect(wanted, missing)
                yield self._ready.pop(wanted)

    def _missing(self, wanted: int) -> Iterator[int]:
        """Numbers of the next chunks to be computed, not too far ahead of the one that is wanted."""
        while self._next < min(self._work.count, wanted + WINDOW * self._most * self._group):
            index, self._next = self._next, self._next + 1
            chunk = self._stored(index)
            if chunk is None:
                yield index
            else:
                self._ready[index] = chunk

    def _submit(self, missing: Iterator[int]) -> None:
        """Hand out groups while there is room."""
        while self._executor is not None and len(self._flying) < self._most:
            group = list(islice(missing, self._group))
            if not group:
                return
            try:
                self._flying.add(self._executor.submit(compute_chunks, self._message, group))
            except _failures(RuntimeError) as error:  # it was shut down
                raise WorkersLostError(self._describe(error)) from error

    def _collect(self, wanted: int, missing: Iterator[int]) -> None:
        """Take what is done; while nothing is, compute a chunk here, or wait."""
        done, _ = wait(self._flying, timeout=0, return_when=FIRST_COMPLETED)
        if not done and (self._executor is None or self._given is None):
            index = next(missing, None)
            if index is not None:
                self._ready[index] = self._compute(index)
                self._arrived(index, self._ready[index])
        while not done and wanted not in self._ready:
            done, _ = wait(self._flying, timeout=PATIENCE, return_when=FIRST_COMPLETED)
        for future in done:
            self._flying.remove(future)
            for index, chunk in self._result(future):
                self._ready[index] = chunk
                self._arrived(index, chunk)

    def _compute(self, index: int) -> Chunk:
        """A chunk in this process. After the first one, an executor is taken if that saves time."""
        started = time.perf_counter()
        chunk = self._work.compute(index)
        each, left = time.perf_counter() - started, self._work.count - 1 - index
        if self._executor is None and left > 0:
            if self._given is not None:
                self._executor = self._given
                most = min(max(LEAST_AHEAD, AHEAD * self._workers), MOST_BYTES // len(self._message))
                self._most = max(AHEAD, most)
            elif each * left * (1 - 1 / self._workers) > START_SECONDS:
                others = min(self._workers - 1, left)
                self._executor = self._stack.enter_context(LocalProcesses(others))
                self._most = AHEAD * others
            if self._executor is not None:
                self._group = max(1, min(MOST_IN_GROUP, int(GROUP_SECONDS / max(each, 1e-9))))
        return chunk

    def _result(self, future: Future[list[tuple[int, Chunk]]]) -> list[tuple[int, Chunk]]:
        try:
            return future.result()
        except ImportError as error:
            raise InputError(
                f"A worker cannot import what it needs ({error}): install the same uq-handeye for all of them."
            ) from error
        except _failures() as error:
            raise WorkersLostError(self._describe(error)) from error

    def _describe(self, error: BaseException) -> str:
        if self._given is None:
            own = cast(LocalProcesses, self._executor)
            own.end()
            return f"a worker process was lost ({own.describe_loss()}); the memory may have run out"
        text = " ".join(str(error).split()).rstrip(".")
        text = text if len(text) <= 200 else f"{text[:200]}..."
        return f"the executor failed: {type(error).__name__}{f': {text}' if text else ''}"

    def _cancel(self) -> None:
        for future in self._flying:
            future.cancel()


def _failures(*others: type[BaseException]) -> tuple[type[BaseException], ...]:
    """Return the exceptions of an executor that can do no more work. A chunk raises none of these."""
    dask = sys.modules.get("distributed")  # its failures are of no common type
    of_dask = () if dask is None else (dask.KilledWorker, getattr(dask.client, "ClosedClientError", OSError))
    return *others, BrokenExecutor, CancelledError, OSError, *of_dask
