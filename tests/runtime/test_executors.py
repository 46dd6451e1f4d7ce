"""Worker processes that end with whoever asked for them; a Dask scheduler that is not there."""

import multiprocessing
import os
import signal
import struct
import sys
import threading
import time
from concurrent.futures import BrokenExecutor

import pytest

from uq_handeye import InputError, MissingExtraError
from uq_handeye.core import executors
from uq_handeye.core.executors import LocalProcesses, connect_to_dask


@pytest.mark.slow
def test_leaving_ends_worker_processes_at_once():
    """Work that was handed to them is broken or cancelled, not waited for."""
    started = time.monotonic()
    with LocalProcesses(2) as pool:
        assert pool.submit(max, 1, 2).result(60) == 2
        sleeping = [pool.submit(time.sleep, 600) for _ in range(5)]
        time.sleep(0.5)
    assert time.monotonic() - started < 100 and multiprocessing.active_children() == []
    assert all(one.cancelled() or isinstance(one.exception(5), BrokenExecutor) for one in sleeping)


def _half_a_result() -> None:
    """Write what a process leaves that is ended while it writes: a length, and nothing of what is announced."""
    os.write(sys._getframe(1).f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 1000))
    time.sleep(600)


@pytest.mark.slow
def test_half_a_result_is_not_waited_for():
    with LocalProcesses(1) as pool:
        assert pool.submit(max, 1, 2).result(60) == 2
        pool.submit(_half_a_result)
        time.sleep(1.0)
        ended = threading.Thread(target=pool.end, daemon=True)
        ended.start()
        ended.join(60)
        assert not ended.is_alive()


def test_workers_have_one_thread_and_no_ctrl_c():
    program = sys.modules["__main__"]
    with LocalProcesses(1) as pool:
        assert pool.submit(os.getenv, "OPENBLAS_NUM_THREADS").result(60) == "1"
        assert pool.submit(signal.getsignal, signal.SIGINT).result(60) == signal.SIG_IGN
    assert sys.modules["__main__"] is program


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"\.\[cluster\]"), connect_to_dask("tcp://127.0.0.1:9"):
        pass


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of distributed
def test_a_scheduler_that_is_not_there(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "MAX_WAIT_S", 0.5)
    words = r"Cannot reach the Dask scheduler 'tcp://127\.0\.0\.1:9'"
    with pytest.raises(InputError, match=words), connect_to_dask("tcp://127.0.0.1:9"):
        pass
