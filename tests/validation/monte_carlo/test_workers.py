"""The same numbers from one process, several, and a Dask cluster, also when workers die; nothing hangs."""

import os
import pickle
import random
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from monte_carlo_cases import PROGRAM, assert_same, pairs_problem, start
from support import SEED

from uq_handeye import InputError, MissingExtraError
from uq_handeye.simulation.experiment import experiment
from uq_handeye.validation.monte_carlo import run as module
from uq_handeye.validation.monte_carlo import workers
from uq_handeye.validation.monte_carlo.chunks import Failure, Work, answer, from_bytes, one_thread, to_bytes
from uq_handeye.validation.monte_carlo.run import monte_carlo

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
    monkeypatch.setattr(module, "START_SECONDS", 0.0)
    monkeypatch.setattr(workers, "MOST_IN_GROUP", 3)


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
    with one_thread():
        failure = answer(work, [0])
    assert isinstance(failure, Failure) and failure.of_input and f"numpy {np.__version__}, not 0.1" in failure.text


def test_what_goes_wrong_in_a_worker_is_told(problem):
    with one_thread():
        failure = answer(work_of(problem), [-1])  # there is no such chunk
    assert isinstance(failure, Failure)
    with pytest.raises(RuntimeError, match=r"A worker failed\.\nTraceback"):
        workers.checked(failure)


def test_linear_algebra_keeps_to_one_thread():
    from threadpoolctl import threadpool_info

    def threads():
        return [library["num_threads"] for library in threadpool_info()]

    before = threads()
    with one_thread():
        assert set(threads()) == {1}
    assert threads() == before


# ------------------------------------------------------------------------------------------------------- the order


class Shuffled:
    """A team that hands back one group at a time, in any order."""

    def __init__(self, capacity, group):
        self.capacity, self.group, self.flying, self.most = capacity, group, [], 0
        self.random = random.Random(SEED)

    def submit(self, group):
        assert 1 <= len(group) <= self.group
        self.flying.append(group)
        self.most = max(self.most, sum(map(len, self.flying)))

    def wait(self):
        group = self.flying.pop(self.random.randrange(len(self.flying)))
        return [(index, f"chunk {index}") for index in group]

    def close(self):
        self.flying.clear()


@pytest.mark.parametrize(("capacity", "group"), [(1, 1), (3, 1), (4, 7)])
@pytest.mark.parametrize("there", [(), (0, 1, 2), (5, 17, 18, 99), range(100)])
def test_chunks_come_in_order_and_a_bounded_number_ahead(capacity, group, there):
    team, arrived = Shuffled(capacity, group), []
    stored = {index: f"chunk {index}" for index in there}
    found = list(workers.in_order(team, 100, stored.get, lambda index, chunk: arrived.append(index)))
    assert found == [f"chunk {index}" for index in range(100)]
    assert sorted(arrived) == sorted(set(range(100)) - set(there))
    assert team.most <= capacity * group


# ---------------------------------------------------------------------------------------------------- local workers


@pytest.mark.parametrize("count", [2, 4])
def test_same_bits(problem, alone, at_once, count):
    motions, noise = problem
    assert_same(monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, workers=count), alone)


def test_a_worker_that_is_killed_changes_nothing(problem, alone, at_once, monkeypatch):
    """Two workers are killed on the way; what they had in hand is done by others."""
    ordinary, waits = workers.Local.wait, []

    def wait(self):
        waits.append(1)
        if len(waits) in (2, 4):
            os.kill(self.workers[0].process.pid, signal.SIGKILL)
        return ordinary(self)

    monkeypatch.setattr(workers.Local, "wait", wait)
    motions, noise = problem
    assert_same(monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, workers=2), alone)


def test_too_many_lost_workers_end_the_run(problem, alone, at_once, monkeypatch):
    monkeypatch.setattr(workers, "MOST_LOST", 0)
    ordinary, waits = workers.Local.wait, []

    def wait(self):
        waits.append(1)
        if len(waits) == 3:
            os.kill(self.workers[0].process.pid, signal.SIGKILL)
        return ordinary(self)

    monkeypatch.setattr(workers.Local, "wait", wait)
    motions, noise = problem
    result = monte_carlo(motions, noise=noise, trials=10**6, seed=SEED, workers=2)
    assert not result.complete and "signal 9" in result.reason and 0 < result.trials < 10**6
    np.testing.assert_array_equal(result.errors[:4000], alone.errors[: len(result.errors)][:4000])


def test_workers_end_with_the_one_that_started_them(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    process = start(program, tmp_path / "run", 10**8, 2)
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


def test_a_program_needs_no_guard(tmp_path):
    """Workers do not import the program that asks for them; it may come from anywhere."""
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.replace('if __name__ == "__main__":', "if True:"))
    process = start(program, tmp_path / "run", 20_000, 2)
    assert process.communicate(timeout=60) == ("ready\nTrue all trials done 20000\n", "")


def test_workers_that_cannot_start(problem, at_once, monkeypatch):
    monkeypatch.setattr(sys, "path", ["nowhere"])
    with pytest.raises(InputError, match=r"A worker process could not start \(exit status 1\)"):
        monte_carlo(problem[0], noise=problem[1], workers=2)


def test_a_question_that_ends_in_the_middle_ends_a_worker_silently(problem):
    """As when the one that asks is killed while it sends the data."""
    message = pickle.dumps(to_bytes(work_of(problem)), protocol=5)
    program = "from uq_handeye.validation.monte_carlo.workers import serve; serve()"
    for end in (0, 1, 10, len(message) // 2, len(message) - 1):
        done = subprocess.run(
            [sys.executable, "-c", program], input=message[:end], capture_output=True, check=False, timeout=60
        )
        assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_the_first_chunk_is_handed_over_before_workers_start(problem, at_once, monkeypatch, tmp_path):
    def fails(*_):
        assert os.listdir(tmp_path / "run" / "chunks") == ["000000.npz"]
        raise OSError(11, "No more processes")

    monkeypatch.setattr(workers, "Worker", fails)
    with pytest.raises(InputError, match="Cannot start a worker process: no more processes"):
        monte_carlo(problem[0], noise=problem[1], workers=2, directory=tmp_path / "run")


def children(pid):
    done = subprocess.run(
        ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    return [int(line.split()[0]) for line in done.stdout.splitlines() if "validation.workers" in line]


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

    options = {"processes": True, "n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**options, silence_logs=50) as made, Client(made) as client:
        yield client


@pytest.mark.filterwarnings("ignore")  # of distributed
def test_dask_gives_the_same_bits_though_a_worker_is_killed(problem, alone, at_once, cluster, monkeypatch):
    pids = list(cluster.run(os.getpid).values())
    ordinary, waits = workers.Cluster.wait, []

    def wait(self):
        waits.append(1)
        if len(waits) == 2:
            os.kill(pids[0], signal.SIGKILL)
        return ordinary(self)

    monkeypatch.setattr(workers.Cluster, "wait", wait)
    motions, noise = problem
    result = monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, client=cluster)
    assert len(waits) > 2
    assert_same(result, alone)


@pytest.mark.filterwarnings("ignore")
def test_dask_by_its_address(problem, alone, at_once, cluster):
    motions, noise = problem
    result = monte_carlo(motions, noise=noise, trials=TRIALS, seed=SEED, client=cluster.scheduler.address)
    assert_same(result, alone)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("trials", [100, 10_000])
def test_a_scheduler_that_is_not_there(problem, monkeypatch, trials):
    pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "CONNECT", 0.5)
    with pytest.raises(InputError, match=r"Cannot reach the Dask scheduler 'tcp://127.0.0.1:9'"):
        monte_carlo(problem[0], noise=problem[1], trials=trials, client="tcp://127.0.0.1:9")


@pytest.mark.filterwarnings("ignore")
def test_a_client_that_is_closed(problem, cluster):
    from distributed import Client

    client = Client(cluster.scheduler.address, set_as_default=False)
    client.close()
    with pytest.raises(InputError, match="to be connected to a Dask scheduler, but it is closed"):
        monte_carlo(problem[0], noise=problem[1], client=client)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_scheduler_that_dies_leaves_the_trials_so_far(problem, alone, at_once, monkeypatch, how):
    """It and a worker in one process of their own."""
    pytest.importorskip("distributed")
    process = subprocess.Popen([sys.executable, "-c", SCHEDULER], stdout=subprocess.PIPE, text=True)
    ordinary, waits = workers.Cluster.wait, []

    def wait(self):
        waits.append(1)
        if len(waits) == 4:
            process.send_signal(how)
        return ordinary(self)

    monkeypatch.setattr(workers.Cluster, "wait", wait)
    try:
        address = process.stdout.readline().strip()
        result = monte_carlo(problem[0], noise=problem[1], trials=10**6, seed=SEED, client=address)
    finally:
        process.kill()
        process.communicate()
    assert not result.complete and result.ended_early and "Dask" in result.reason and "\n" not in result.reason
    count = min(len(result.errors), len(alone.errors))
    assert count >= 1000
    np.testing.assert_array_equal(result.errors[:count], alone.errors[:count])


SCHEDULER = """
import time
from distributed import LocalCluster
cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None,
                       protocol="tcp", host="127.0.0.1", silence_logs=50)
print(cluster.scheduler_address, flush=True)
time.sleep(100)
"""


def test_without_dask_the_extra_is_named(problem, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"uq-handeye\[cluster\]"):
        monte_carlo(problem[0], noise=problem[1], client="tcp://127.0.0.1:9")


def test_a_client_that_is_none(problem):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="Expected `client` to be"):
        monte_carlo(problem[0], noise=problem[1], client=3)
