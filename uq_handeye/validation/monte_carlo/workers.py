r"""Who works the chunks out: this process, worker processes beside it, or a Dask cluster; and the order kept.

A team takes groups of chunks and hands back what is done, in any order; `in_order` feeds it, a bounded number ahead,
and passes the chunks on by number. Chunks depend on their number alone (`chunks`): the team changes no digit, and what
a lost worker had in hand is worked out again by another.
"""

from __future__ import annotations

import logging
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from queue import SimpleQueue
from typing import Any, Protocol

from ...errors import InputError, MissingExtraError
from ...files.open import reason
from .chunks import Answer, Chunk, Failure, Work, answer, from_bytes

Done = list[tuple[int, Chunk]]

# Groups that each worker has at hand: one to work on and one to go on with.
AHEAD = 2
# Chunks that may wait for an earlier one, as multiples of those in flight.
WINDOW = 2
# A group is to take so many seconds, which is long beside what its transport takes.
GROUP_SECONDS, MOST_IN_GROUP = 0.08, 64
# Workers that may be lost before the run stops.
MOST_LOST = 5
# Seconds to reach a Dask scheduler.
CONNECT = 10.0
# Seconds without any Dask worker after which the run stops.
PATIENCE = 60.0


class WorkersLostError(Exception):
    """No worker is left; the message says what is known of why."""


class Team(Protocol):
    """Works out groups of chunks."""

    @property
    def capacity(self) -> int:
        """Groups that it wants to have in flight."""
        ...

    @property
    def group(self) -> int:
        """Chunks in a group."""
        ...

    @property
    def ready(self) -> bool:
        """Whether there is somebody to work, or a reason why not; else this process goes on meanwhile."""
        ...

    def submit(self, group: list[int]) -> None: ...

    def wait(self) -> Done:
        """At least one group that is done; raises `WorkersLostError` if none will ever be."""
        ...

    def close(self) -> None:
        """At once; what is in flight is dropped."""
        ...


def in_order(
    team: Team, total: int, stored: Callable[[int], Chunk | None], arrived: Callable[[int, Chunk], None]
) -> Iterator[Chunk]:
    """Chunks 0 to ``total`` - 1 by number: those that are ``stored``, and the others by the team.

    ``arrived`` is told of each that was worked out, at once and in whatever order.
    """
    ready: dict[int, Chunk] = {}
    group: list[int] = []
    asked, flying = 0, 0
    for wanted in range(total):
        while wanted not in ready:
            room = team.capacity * team.group
            if asked < min(total, wanted + WINDOW * room) and flying + len(group) < room:
                chunk = stored(asked)
                if chunk is None:
                    group.append(asked)
                else:
                    ready[asked] = chunk
                asked += 1
                if len(group) < team.group:
                    continue
            if group:
                team.submit(group)
                flying += len(group)
                group = []
                continue
            for index, chunk in team.wait():
                flying -= 1
                ready[index] = chunk
                arrived(index, chunk)
        yield ready.pop(wanted)


class Alone:
    """This process, and ``others`` once what is left would take it ``patience`` seconds longer than them.

    It works out at least one chunk, which tells how long they take, and raises what is wrong with them as it is. The
    others are started only once that chunk has been handed over, so that it is kept if they do not start; it goes on by
    itself until they are ready.
    """

    ready = True

    def __init__(
        self, work: Work, others: Callable[[int], Team] | None = None, gain: float = 0.0, patience: float = 0.0
    ) -> None:
        self._work, self._start, self._gain, self._patience = work, others, gain, patience
        self._groups: list[list[int]] = []
        self._team: Team | None = None
        self._due = 0  # chunks in a group of the others, once they are wanted

    @property
    def capacity(self) -> int:
        return 1 if self._team is None or not self._team.ready else self._team.capacity

    @property
    def group(self) -> int:
        return 1 if self._team is None or not self._team.ready else self._team.group

    def submit(self, group: list[int]) -> None:
        if self._due and self._start is not None:
            self._team, self._due = self._start(self._due), 0
        if self._team is None or not self._team.ready:
            self._groups.append(group)
        else:
            self._team.submit(group)

    def wait(self) -> Done:
        if self._team is not None and not self._groups:
            return self._team.wait()
        group = self._groups.pop(0)
        started = time.perf_counter()
        found = [(index, self._work.compute(index)) for index in group]
        each = (time.perf_counter() - started) / len(group)
        left = self._work.count - 1 - group[-1]
        if self._team is None and self._start is not None and left > 0 and each * left * self._gain > self._patience:
            self._due = max(1, min(MOST_IN_GROUP, int(GROUP_SECONDS / max(each, 1e-9))))
        return found

    def close(self) -> None:
        if self._team is not None:
            self._team.close()


def checked(found: Answer) -> Done:
    """The chunks of an answer, or its error."""
    if isinstance(found, Failure):
        raise found.error()
    return found


class Local:
    """Worker processes on this machine, which talk through their standard input and output.

    Each is a new Python that imports this module and nothing of the program that asked. The end of either side ends the
    other, also after kill -9.
    """

    def __init__(self, work: bytes, workers: int, group: int) -> None:
        self._work, self.group = work, group
        self._answers: SimpleQueue[tuple[Worker, Answer | None]] = SimpleQueue()
        self.workers: list[Worker] = []
        self._lost = 0
        self.capacity = AHEAD * workers
        try:
            for _ in range(workers):
                self._start()
            for worker in self.workers:  # once all are starting: one takes large data only when it has started
                worker.send(work)
        except BaseException:
            self.close()
            raise

    @property
    def ready(self) -> bool:
        return any(worker.started for worker in self.workers) or not self._answers.empty()

    def _start(self) -> Worker:
        try:
            with _interrupts_blocked():
                self.workers.append(Worker(self._answers))
        except OSError as error:
            raise InputError(f"Cannot start a worker process: {reason(error)}; use fewer workers.") from error
        return self.workers[-1]

    def submit(self, group: list[int]) -> None:
        worker = min(self.workers, key=lambda one: len(one.groups))
        worker.groups.append(group)
        worker.send(group)

    def wait(self) -> Done:
        while True:
            worker, found = self._answers.get()
            if found is not None:
                worker.groups.pop(0)
                return checked(found)
            self._replace(worker)

    def _replace(self, worker: Worker) -> None:
        """A new worker for one that is lost, with what that had in hand."""
        self.workers.remove(worker)
        code = worker.close()
        if code > 0 and not worker.started:
            raise InputError(f"A worker process could not start (exit status {code}); use one worker.")
        self._lost += 1
        if self._lost > MOST_LOST:
            how = f"signal {-code}" if code < 0 else f"exit status {code}"
            raise WorkersLostError(
                f"{self._lost} worker processes were lost, the last one by {how}; the memory may have run out"
            )
        self._start().send(self._work)
        for group in worker.groups:
            self.submit(group)

    def close(self) -> None:
        for worker in self.workers:
            worker.process.terminate()
        while self.workers:
            self.workers.pop().close()


class Worker:
    """One of them, with the groups that it has in hand, in their order."""

    def __init__(self, answers: SimpleQueue[tuple[Worker, Answer | None]]) -> None:
        self.groups: list[list[int]] = []
        self.started = False
        program = f"import sys; sys.path[:] = sys.argv[1:]; from {__name__} import serve; serve()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", program, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")},
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # Windows: no Ctrl-C
        )
        self._listener = threading.Thread(target=self._listen, args=(answers,), daemon=True)
        self._listener.start()

    def _listen(self, answers: SimpleQueue[tuple[Worker, Answer | None]]) -> None:
        assert self.process.stdout is not None
        with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
            self.started = pickle.load(self.process.stdout)  # once it knows the work
            while True:
                answers.put((self, pickle.load(self.process.stdout)))
        answers.put((self, None))

    def send(self, message: Any) -> None:
        assert self.process.stdin is not None
        with suppress(OSError):  # of one that is lost, which the listener notices
            pickle.dump(message, self.process.stdin, protocol=5)
            self.process.stdin.flush()

    def close(self) -> int:
        """End it, and give its exit status."""
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.terminate()
        try:
            code = self.process.wait(2.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._listener.join()
        with suppress(OSError):
            self.process.stdin.close()
        self.process.stdout.close()
        return code


def serve() -> None:
    """A worker: answers groups of chunks until the other side is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that was started by hand
    warnings.simplefilter("ignore")  # that process has run a chunk too, and warned
    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not reach the answers
    with suppress(EOFError, OSError, pickle.UnpicklingError):  # the other side is gone, maybe in mid-sentence
        work = from_bytes(pickle.load(questions))
        pickle.dump(True, answers)
        answers.flush()
        while True:
            pickle.dump(answer(work, pickle.load(questions)), answers, protocol=5)
            answers.flush()
    os._exit(0)  # nothing to clean up, and nothing to say


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Ctrl-C waits; a process that is started meanwhile never sees it, not even while it imports."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Cluster:
    """The workers of a Dask scheduler, given as a ``distributed.Client`` or as its address.

    The work is the result of a task, which the scheduler can repeat (data that are only scattered are lost with their
    worker), and so are the chunks: those of a lost worker come from another. Raises `InputError` for a cluster that
    cannot be reached or has no workers.
    """

    ready = True

    def __init__(self, work: bytes, client: Any) -> None:
        distributed = _distributed()
        self.group = 1
        self._own, self._closed = isinstance(client, str), False
        self._groups: dict[Any, list[int]] = {}
        self._seen = time.monotonic()
        if self._own:
            try:
                client = distributed.Client(client, timeout=CONNECT)
            except (OSError, ValueError, TypeError) as error:
                raise InputError(f"Cannot reach the Dask scheduler {client!r}: {error}") from error
        if not isinstance(client, distributed.Client) or client.asynchronous:
            raise InputError(
                f"Expected `client` to be a distributed.Client or an address, got {type(client).__name__}."
            )
        if client.status != "running":
            raise InputError(f"Expected `client` to be connected to a Dask scheduler, but it is {client.status}.")
        self._client = client
        try:
            client.wait_for_workers(1, timeout=PATIENCE / 2)
            self._cores: int = sum(client.ncores().values())
            self._work = client.submit(from_bytes, work, pure=False)
        except TimeoutError as error:
            self.close()
            raise InputError("The Dask scheduler has no workers; start some with `dask worker ADDRESS`.") from error
        except self._failures() as error:
            self.close()
            raise InputError(f"The Dask scheduler cannot be used: {_words(error)}.") from error
        except BaseException:
            self.close()
            raise

    @staticmethod
    def _failures() -> tuple[type[BaseException], ...]:
        """What the end of a scheduler or of all workers shows as: tasks that are cancelled, a client that closes."""
        client = _distributed().client
        closed: type[BaseException] = getattr(client, "ClosedClientError", OSError)  # of new versions
        return OSError, CancelledError, _distributed().KilledWorker, closed

    def of_groups(self, group: int) -> Cluster:
        """Itself, with so many chunks in a group."""
        self.group = group
        return self

    @property
    def capacity(self) -> int:
        return AHEAD * max(1, self._cores)

    def submit(self, group: list[int]) -> None:
        try:
            future = self._client.submit(answer, self._work, group, pure=False)
        except self._failures() as error:
            raise WorkersLostError(f"the Dask scheduler is gone: {_words(error)}") from error
        self._groups[future] = group

    def wait(self) -> Done:
        while True:
            try:
                done, _ = _distributed().wait(list(self._groups), timeout=5, return_when="FIRST_COMPLETED")
                answers = self._client.gather(list(done))
            except TimeoutError:
                self._require_workers()
                continue
            except self._failures() as error:
                if self._client.status != "running":
                    raise WorkersLostError("the connection to the Dask scheduler was lost") from error
                raise WorkersLostError(f"the Dask cluster failed: {_words(error)}") from error
            except ImportError as error:
                raise InputError(
                    f"A Dask worker cannot import what it needs ({error}): install the same uq-handeye on all of them."
                ) from error
            for future in done:
                del self._groups[future]
            self._require_workers(every=5.0)
            return [part for found in answers for part in checked(found)]

    def _require_workers(self, every: float = 0.0) -> None:
        """Count the cores anew, and give up where there have been none for long."""
        now = time.monotonic()
        if now - self._seen < every:
            return
        try:
            self._cores = sum(self._client.ncores().values())
        except self._failures() as error:
            raise WorkersLostError(f"the Dask scheduler is gone: {_words(error)}") from error
        if self._cores:
            self._seen = now
        elif now - self._seen > PATIENCE:
            raise WorkersLostError(f"the Dask scheduler had no worker for {PATIENCE:g} s")

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        with suppress(TimeoutError, *self._failures()):
            self._client.cancel(list(self._groups))
        self._groups.clear()
        self._work = None
        if self._own:
            log = logging.getLogger("distributed.client")
            before = log.level
            log.setLevel(logging.CRITICAL)  # a scheduler that is gone has been told of, without a traceback
            with suppress(TimeoutError, *self._failures()):
                self._client.close()
            log.setLevel(before)


def _words(error: BaseException) -> str:
    """An error of Dask in one line that is not too long."""
    text = " ".join(str(error).split()).rstrip(".") or type(error).__name__
    return text if len(text) <= 200 else f"{text[:200]}..."


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError(
            "Dask is not installed; a cluster needs the extra `cluster`: pip install 'uq-handeye[cluster]'."
        ) from error
    return distributed
