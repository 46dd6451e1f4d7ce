"""Computation of the chunks of a run in this process and by an executor at the same time, returned in their order.

An executor is any `concurrent.futures.Executor`. It is handed a bounded number of groups of chunks, as bytes and plain
numbers, and may finish them in any order; the chunks are passed on by number. They depend on their number alone
(`chunks`): the process that computes one changes no digit.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import ExitStack
from itertools import islice
from typing import cast

from ....core.executors import LocalProcesses
from ....core.rounding import TINY
from ....errors import InputError
from .chunks import Chunk, Work, compute_chunks

# Processes take about this time to start; a run that ends sooner has none.
START_SECONDS = 1.0
# Groups of chunks that an executor is given at once, at least, and chunks of a group at most.
MIN_GROUPS_AHEAD, MAX_GROUP_CHUNKS = 64, 16
# Copies of the work that executors hold at once.
MAX_BYTES_AHEAD = 256_000_000
# Groups for each worker: one to work on, and one to go on with.
GROUPS_PER_WORKER = 2


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
        more than half of `MIN_GROUPS_AHEAD`.
    executor : Executor or None
    group_seconds : float
        Time that a group of chunks is to take, which is long in comparison with its transport.
    """

    def __init__(
        self,
        work: Work,
        message: bytes,
        stored: Callable[[int], Chunk | None],
        arrived: Callable[[int, Chunk], None],
        workers: int,
        executor: Executor | None = None,
        group_seconds: float = 0.08,
    ) -> None:
        self._work, self._message, self._stored, self._arrived = work, message, stored, arrived
        self._workers, self._given, self._group_seconds = workers, executor, group_seconds
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
        while self._next < min(self._work.count, wanted + GROUPS_PER_WORKER * self._most * self._group):
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
        while not done and wanted not in self._ready:  # begins again after a second, so that Ctrl-C gets through
            done, _ = wait(self._flying, timeout=1.0, return_when=FIRST_COMPLETED)
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
                most = min(
                    max(MIN_GROUPS_AHEAD, GROUPS_PER_WORKER * self._workers), MAX_BYTES_AHEAD // len(self._message)
                )
                self._most = max(GROUPS_PER_WORKER, most)
            elif each * left * (1 - 1 / self._workers) > START_SECONDS:
                others = min(self._workers - 1, left)
                self._executor = self._stack.enter_context(LocalProcesses(others))
                self._most = GROUPS_PER_WORKER * others
            if self._executor is not None:
                self._group = max(1, min(MAX_GROUP_CHUNKS, int(self._group_seconds / max(each, TINY))))
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
