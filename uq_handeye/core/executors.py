"""Executors of `concurrent.futures`: worker processes on this machine, and the workers of a Dask scheduler."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType, TracebackType
from typing import Any

from ..errors import InputError, MissingExtraError
from .limits import MAX_WAIT_S

# Processes that one pool can wait for.
MAX_WORKERS = 61 if sys.platform == "win32" else 10_000

ONE_THREAD = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


class LocalProcesses(ProcessPoolExecutor):
    """Worker processes of one call, with one thread of linear algebra each; leaving the context ends them at once.

    They are new interpreters (never forks of this one and its threads) and do not import the program that asked, which
    so needs no ``if __name__ == "__main__"``. Ctrl-C is left to that program. They end with it, also after kill -9.

    ``submit`` raises `InputError` where a process cannot be started.
    """

    def __init__(self, workers: int) -> None:
        self._context = _Context()
        super().__init__(min(workers, MAX_WORKERS), mp_context=self._context, initializer=_begin)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    def end(self) -> None:
        """Drop what is in flight and end the processes."""
        for process in self._context.processes:
            if process.pid is not None:  # it started
                process.terminate()
        # One that ends while it writes leaves half a result, and the thread that reads waits for the other half as long
        # as anybody could write it: this process could.
        results: Any = self._result_queue
        if results is not None:  # else it was ended before
            results._writer.close()
        self.shutdown(cancel_futures=True)

    def describe_loss(self) -> str:
        """Describe how the first process ended that was not ended by `end`; to be called after that."""
        codes = [process.exitcode for process in self._context.processes]
        code = next((code for code in codes if code not in (None, 0, -signal.SIGTERM)), -signal.SIGTERM)
        assert code is not None
        return f"signal {-code}" if code < 0 else f"exit status {code}"


class _Context(SpawnContext):
    """Starts a `_Worker` for each process, and knows them."""

    def __init__(self) -> None:
        super().__init__()
        self.processes: list[SpawnProcess] = []

    def Process(self, *args: Any, **options: Any) -> SpawnProcess:  # type: ignore[override]
        self.processes.append(_Worker(*args, **options))
        return self.processes[-1]


class _Worker(SpawnProcess):
    def start(self) -> None:
        try:
            with _apart():
                super().start()
        except OSError as error:
            raise InputError(f"Cannot start a worker process: {error.strerror}; use fewer workers.") from error


@contextmanager
def _apart() -> Iterator[None]:
    """A process that is started here sees no Ctrl-C, no ``__main__`` of ours and one thread of linear algebra."""
    main, environment = sys.modules["__main__"], {name: os.environ.get(name) for name in ONE_THREAD}
    blocks = hasattr(signal, "pthread_sigmask") and threading.current_thread() is threading.main_thread()
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if blocks else None
    try:
        sys.modules["__main__"] = ModuleType("__main__")
        os.environ.update(ONE_THREAD)
        yield
    finally:
        sys.modules["__main__"] = main
        for name, value in environment.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)


def _begin() -> None:
    """The first thing that a worker does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter("ignore")  # the one that asks computes too, and warns
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


@contextmanager
def connect_to_dask(address: str) -> Iterator[tuple[Executor, int]]:
    """The executor of a Dask scheduler, and the number of cores of its workers.

    Raises `InputError` for a scheduler that cannot be reached or has no workers, `MissingExtraError` without Dask.
    """
    distributed = _distributed()
    try:
        client = distributed.Client(address, timeout=MAX_WAIT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"Cannot reach the Dask scheduler {address!r}: {error}") from error
    try:
        try:
            client.wait_for_workers(1, timeout=MAX_WAIT_S)
        except TimeoutError as error:
            raise InputError("The Dask scheduler has no workers; start some with `dask worker ADDRESS`.") from error
        yield client.get_executor(pure=False), sum(client.ncores().values())
    finally:
        log = logging.getLogger("distributed.client")
        before = log.level
        log.setLevel(logging.CRITICAL)  # a scheduler that is gone has been told of, without a traceback
        with suppress(OSError, TimeoutError):
            client.close()
        log.setLevel(before)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise MissingExtraError(
            "Dask is not installed; a cluster needs the extra `cluster`: pip install '.[cluster]' in its clone."
        ) from error
    return distributed
