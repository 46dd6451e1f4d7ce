"""The same numbers from one process, several, and a Dask cluster, also when workers die; nothing hangs."""

import multiprocessing
import os
import pickle
import random
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from importlib import import_module
from multiprocessing.context import SpawnProcess

import numpy as np
import pytest
from fixtures.trials import PROGRAM, assert_same, pairs_problem, start
from support import SEED

from uq_handeye import DegenerateMotionError, InputError, MissingExtraError, NotConvergedError
from uq_handeye.core.executors import connect_to_dask
from uq_handeye.core.threads import one_thread
from uq_handeye.trials.simulation.experiment import experiment
from uq_handeye.trials.validation.monte_carlo import crew as workers
from uq_handeye.trials.validation.monte_carlo import run as module
from uq_handeye.trials.validation.monte_carlo.chunks import Work, compute_chunks, from_bytes, to_bytes, versions
from uq_handeye.trials.validation.monte_carlo.crew import Crew, WorkersLostError
from uq_handeye.trials.validation.monte_carlo.run import monte_carlo
from uq_handeye.trials.validation.sentences import INTERRUPTED, WORKERS_LOST

TRIALS = 40_500


@pytest.fixture(scope="module")
def problem():
    return pairs_problem()


@pytest.fixture(scope="module")
def alone(problem):
    motions, noise = problem
    return monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED)


@pytest.fixture
def at_once(monkeypatch):
    """Workers are started however short the run is, and get small groups."""
    monkeypatch.setattr(workers, "START_SECONDS", 0.0)
    monkeypatch.setattr(workers, "MAX_GROUP_CHUNKS", 3)


def work_of(problem, trials=TRIALS):
    made = experiment(problem[0], problem[1])
    return Work(made, SEED, trials, 1000, made.predicted())


# ------------------------------------------------------------------------------------------------------------ chunks


def test_a_chunk_draws_from_the_child_that_spawn_gives(problem):
    work = work_of(problem)
    child = np.random.SeedSequence(SEED).spawn(4)[3]
    assert (
        np.random.SFC64(child).random_raw()
        == np.random.SFC64(np.random.SeedSequence(SEED, spawn_key=(3,))).random_raw()
    )
    assert [work.size(index) for index in (0, work.count - 1)] == [1000, 500]
    np.testing.assert_array_equal(work.compute(3).errors, from_bytes(to_bytes(work)).compute(3).errors)


def test_a_worker_with_other_versions_is_refused(problem):
    work = work_of(problem)
    work.versions["numpy"] = "0.1"
    with one_thread(), pytest.raises(InputError, match=rf"numpy {np.__version__}, not 0\.1"):
        compute_chunks(to_bytes(work), [0])


def test_our_errors_survive_pickling():
    """Errors arrive as they are where a worker raises them."""
    directions = np.eye(6)[:2]
    for error in (
        InputError("a"),
        MissingExtraError("b"),
        DegenerateMotionError("c", directions, {"X": 1}),
        NotConvergedError("d", [2]),
    ):
        found = pickle.loads(pickle.dumps(error))
        assert type(found) is type(error) and str(found) == str(error)
        assert getattr(found, "partial", None) == getattr(error, "partial", None)
    np.testing.assert_array_equal(
        pickle.loads(pickle.dumps(DegenerateMotionError("c", directions))).directions, directions
    )


def test_linear_algebra_keeps_to_one_thread():
    from threadpoolctl import threadpool_info

    def threads():
        return [library["num_threads"] for library in threadpool_info()]

    before = threads()
    with one_thread():
        assert set(threads()) == {1}
    assert threads() == before


# ------------------------------------------------------------------------------------------------------- the order


class Scrambled(Executor):
    """Executor that runs what it has at hand in any order, in bytes as between processes, when there is somebody
    waiting for it.
    """

    def __init__(self):
        self.tasks, self.most, self.changed = [], 0, threading.Condition()
        self.random, self.open = random.Random(SEED), True
        threading.Thread(target=self.work, daemon=True).start()

    def submit(self, function, /, *args, **kwargs):
        assert self.open
        future = Future()
        with self.changed:
            self.tasks.append((future, pickle.dumps((function, args, kwargs))))
            self.most = max(self.most, len(self.tasks))
            self.changed.notify()
        return future

    def work(self):
        while True:
            with self.changed:
                self.changed.wait_for(lambda: self.tasks or not self.open)
                if not self.open:
                    return
            time.sleep(0.002)  # for more to come
            with self.changed:
                future, task = self.tasks.pop(self.random.randrange(len(self.tasks)))
            if future.set_running_or_notify_cancel():
                function, args, kwargs = pickle.loads(task)
                try:
                    future.set_result(pickle.loads(pickle.dumps(function(*args, **kwargs))))
                except (InputError, ImportError, KilledWorkerOfToy) as error:
                    future.set_exception(error)

    def shutdown(self, wait=True, *, cancel_futures=False):
        with self.changed:
            self.open = False
            self.changed.notify()


class KilledWorkerOfToy(BrokenExecutor):
    pass


class Numbered:
    """Work whose chunks are text."""

    def __init__(self, count, wrong=()):
        self.count, self.wrong, self.versions = count, dict(wrong), versions()

    def compute(self, index):
        if index in self.wrong:
            raise self.wrong[index]
        return f"chunk {index}"


@pytest.fixture
def scrambled():
    with Scrambled() as executor:
        yield executor


@pytest.mark.slow
@pytest.mark.parametrize(("ahead", "group"), [(1, 1), (3, 1), (4, 7)])
@pytest.mark.parametrize("there", [(), (0, 1, 2), (5, 17, 18, 99), range(100)])
def test_chunks_come_in_order_and_a_bounded_number_ahead(scrambled, monkeypatch, ahead, group, there):
    monkeypatch.setattr(workers, "MIN_GROUPS_AHEAD", ahead)
    monkeypatch.setattr(workers, "MAX_GROUP_CHUNKS", group)
    work, arrived, looked_at = Numbered(100), [], []
    stored = {index: f"chunk {index}" for index in there}

    def look(index):
        looked_at.append(index)
        return stored.get(index)

    crew = Crew(work, to_bytes(work), look, lambda index, chunk: arrived.append(index), 1, scrambled)
    found = []
    for chunk in crew.chunks():
        assert len(looked_at) <= len(found) + workers.GROUPS_PER_WORKER * max(ahead, workers.GROUPS_PER_WORKER) * group
        found.append(chunk)
    assert found == [f"chunk {index}" for index in range(100)]
    assert looked_at == list(range(100))
    assert sorted(arrived) == sorted(set(range(100)) - set(there))
    assert scrambled.most <= max(ahead, workers.GROUPS_PER_WORKER)
    if group == 1 and ahead == 3 and not there:
        assert arrived != sorted(arrived)


def test_large_work_is_in_flight_only_a_few_times(scrambled, monkeypatch):
    monkeypatch.setattr(workers, "MAX_BYTES_AHEAD", 3_000)
    monkeypatch.setattr(workers, "MAX_GROUP_CHUNKS", 1)
    work = Numbered(50)
    crew = Crew(work, to_bytes(work) + bytes(1000), lambda _: None, lambda *_: None, 500, scrambled)
    assert len(list(crew.chunks())) == 50 and scrambled.most == 2


@pytest.mark.parametrize(
    ("error", "raised", "words"),
    [
        (
            KilledWorkerOfToy("it was\nkilled."),
            WorkersLostError,
            "the executor failed: KilledWorkerOfToy: it was killed$",
        ),
        (InputError("no such data"), InputError, "^no such data$"),
        (ImportError("no uq_handeye"), InputError, r"cannot import what it needs \(no uq_handeye\): install the same"),
    ],
)
def test_what_goes_wrong_in_a_worker_is_told(scrambled, error, raised, words):
    work = Numbered(50, {20: error})
    crew = Crew(work, to_bytes(work), lambda _: None, lambda *_: None, 1, scrambled)
    with pytest.raises(raised, match=words):
        list(crew.chunks())


@pytest.mark.slow
def test_an_executor_that_is_shut_down(problem, alone):
    executor = ThreadPoolExecutor(1)
    executor.shutdown()
    result = monte_carlo(problem[0], noise=problem[1], trials=TRIALS, seed=SEED, executor=executor)
    assert result.ended.code == WORKERS_LOST and "cannot schedule new futures after shutdown" in result.reason
    assert not result.complete and result.trials == 1000
    np.testing.assert_array_equal(result.errors, alone.errors[:1000])


@pytest.mark.slow
def test_what_is_left_is_cancelled(problem, scrambled, monkeypatch):
    """The executor stays usable."""
    monkeypatch.setattr(workers, "MIN_GROUPS_AHEAD", 4)
    after(monkeypatch, 2, interrupt)
    result = monte_carlo(problem[0], noise=problem[1], trials=10**6, seed=SEED, executor=scrambled)
    assert result.ended.code == INTERRUPTED and result.trials == 2000
    wait_for(lambda: not scrambled.tasks)
    assert scrambled.submit(max, 1, 2).result(5) == 2


# ------------------------------------------------------------------------------------------------------- executors


def spawning():
    return ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn"))


def loky():
    return pytest.importorskip("loky").ProcessPoolExecutor(2)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of loky
@pytest.mark.parametrize("make", [Scrambled, partial(ThreadPoolExecutor, 3), spawning, loky])
def test_the_same_bits_by_any_executor(problem, alone, make):
    with make() as executor:
        result = monte_carlo(problem[0], noise=problem[1], trials=TRIALS, seed=SEED, executor=executor)
        assert_same(result, alone)


@pytest.mark.slow
def test_covariances_of_each_trial_by_an_executor(problem, scrambled):
    options = {"noise": problem[1], "trials": 3_500, "covariance": "each", "seed": SEED}
    assert_same(monte_carlo(problem[0], **options, executor=scrambled), monte_carlo(problem[0], **options))


@pytest.mark.slow
def test_what_an_executor_did_is_resumed(problem, alone, scrambled, monkeypatch, tmp_path):
    options = {"noise": problem[1], "trials": TRIALS, "seed": SEED, "directory": tmp_path / "run"}
    with monkeypatch.context() as context:
        after(context, 5, interrupt)
        assert monte_carlo(problem[0], **options, executor=scrambled).trials == 5_000
    assert len(list(tmp_path.glob("run/chunks/*.npz"))) >= 5
    result = monte_carlo(problem[0], **options, executor=scrambled, resume=True)
    assert result.resumed >= 5_000
    assert_same(result, alone)


def test_an_executor_that_is_none(problem):
    with pytest.raises(InputError, match=r"Expected `executor` to be a concurrent\.futures\.Executor, .* got int"):
        monte_carlo(problem[0], noise=problem[1], executor=3)


# ---------------------------------------------------------------------------------------------------- local workers


def interrupt():
    raise KeyboardInterrupt


def after(monkeypatch, chunks, do):
    """Once so many chunks are in the tally."""
    ordinary, added = module.Tally.add, []

    def add(self, chunk):
        ordinary(self, chunk)
        added.append(1)
        if len(added) == chunks:
            do()

    monkeypatch.setattr(module.Tally, "add", add)


@pytest.mark.slow
@pytest.mark.parametrize("count", [2, 4])
def test_same_bits(problem, alone, at_once, count):
    motions, noise = problem
    assert_same(monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, workers=count), alone)
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_a_worker_that_is_killed_ends_the_run_with_what_is_done(problem, alone, at_once, monkeypatch, tmp_path):
    def kill():
        os.kill(multiprocessing.active_children()[0].pid, signal.SIGKILL)

    options = {"noise": problem[1], "seed": SEED, "workers": 3, "directory": tmp_path / "run"}
    with monkeypatch.context() as context:
        after(context, 6, kill)
        result = monte_carlo(problem[0], trials=10**6, **options)
    assert result.ended.code == WORKERS_LOST and "a worker process was lost (signal 9)" in result.reason
    assert not result.complete and 6_000 <= result.trials < 10**6 and multiprocessing.active_children() == []
    count = min(result.trials, TRIALS)
    np.testing.assert_array_equal(result.errors[:count], alone.errors[:count])
    again = monte_carlo(problem[0], trials=10**6, digits=1, resume=True, **options)
    assert again.complete and again.resumed >= 6_000


@pytest.mark.slow
def test_workers_end_with_the_one_that_started_them(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    process = start(program, tmp_path / "run", 10**8, 3)
    try:
        assert process.stdout.readline() == "ready\n"
        wait_for(lambda: len(children(process.pid)) >= 2)
        time.sleep(1.0)  # let them begin
        pids = children(process.pid)
        process.kill()
        wait_for(lambda: not any(map(alive, pids)))
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_a_program_needs_no_guard(tmp_path):
    """Workers do not import the program that asks for them; it may come from anywhere."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.replace('if __name__ == "__main__":', "if True:"))
    process = start(program, tmp_path / "run", 20_000, 2)
    assert process.communicate(timeout=60) == ("ready\nTrue all trials done 20000\n", "")


def test_workers_that_cannot_start(problem, at_once, monkeypatch):
    import_module("multiprocessing.resource_tracker")  # what this process imports later would not be found, either
    import_module("threadpoolctl")
    monkeypatch.setattr(sys, "path", ["nowhere"])
    result = monte_carlo(problem[0], noise=problem[1], trials=10**6, workers=2)
    assert not result.complete and "a worker process was lost (exit status 1)" in result.reason


def test_the_first_chunk_is_handed_over_before_workers_start(problem, at_once, monkeypatch, tmp_path):
    def fails(*_):
        assert os.listdir(tmp_path / "run" / "chunks") == ["000000.npz"]
        raise OSError(11, "No more processes")

    monkeypatch.setattr(SpawnProcess, "start", fails)
    with pytest.raises(InputError, match="Cannot start a worker process: No more processes"):
        monte_carlo(problem[0], noise=problem[1], workers=2, directory=tmp_path / "run")


def children(pid):
    done = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    return [int(line.split()[0]) for line in done.stdout.splitlines() if "spawn_main" in line]


def alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_for(condition, seconds=20):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.05)


# -------------------------------------------------------------------------------------------------------------- Dask


@pytest.fixture(scope="module")
def cluster():
    pytest.importorskip("distributed")
    from distributed import Client, LocalCluster

    options = {"processes": True, "n_workers": 2, "threads_per_worker": 1, "dashboard_address": ":0"}
    with LocalCluster(**options, silence_logs=50) as made, Client(made) as client:
        yield client


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of distributed
def test_dask_gives_the_same_bits_though_a_worker_is_killed(problem, alone, at_once, cluster, monkeypatch):
    pids = list(cluster.run(os.getpid).values())
    after(monkeypatch, 3, lambda: os.kill(pids[0], signal.SIGKILL))
    motions, noise = problem
    result = monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, executor=cluster.get_executor())
    assert_same(result, alone)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_dask_by_its_address(problem, alone, at_once, cluster):
    motions, noise = problem
    with connect_to_dask(cluster.scheduler.address) as (executor, cores):
        assert cores >= 1
        assert_same(monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, executor=executor), alone)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_scheduler_that_dies_leaves_the_trials_so_far(problem, alone, at_once, monkeypatch, how):
    """It and a worker in one process of their own."""
    pytest.importorskip("distributed")
    process = subprocess.Popen([sys.executable, "-c", SCHEDULER], stdout=subprocess.PIPE, text=True)
    after(monkeypatch, 4, lambda: process.send_signal(how))
    try:
        with connect_to_dask(process.stdout.readline().strip()) as (executor, _):
            result = monte_carlo(problem[0], noise=problem[1], trials=10**6, seed=SEED, executor=executor)
    finally:
        process.kill()
        process.communicate()
    assert result.ended.code == WORKERS_LOST and result.ended_early and "\n" not in result.reason
    count = min(len(result.errors), len(alone.errors))
    assert count >= 1000
    np.testing.assert_array_equal(result.errors[:count], alone.errors[:count])


SCHEDULER = """
import time
from distributed import LocalCluster
cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0",
                       protocol="tcp", host="127.0.0.1", silence_logs=50)
print(cluster.scheduler_address, flush=True)
time.sleep(100)
"""
