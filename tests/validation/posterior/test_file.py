"""The file of a chain: resumed bit by bit, after kill -9 too; refused when damaged or another run's."""

import os
import signal
import subprocess
import sys
import time

import emcee
import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.errors import InputError, NotConvergedError
from uq_handeye.validation.posterior import run as posterior_run
from uq_handeye.validation.posterior.density import ScalePrior
from uq_handeye.validation.posterior.file import Chain, ChainFile
from uq_handeye.validation.posterior.moves import single
from uq_handeye.validation.posterior.sample import sample_posterior

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
POSES = uq.simulate(8, noise=NOISE, seed=5)
OPTIONS = {"samples": 1500, "walkers": 32}
IDENTITY = {"data": "a", "seed": 1}


@pytest.fixture(scope="module")
def whole():
    return sample_posterior(POSES, NOISE, **OPTIONS)


def same(one, other):
    return np.array_equal(one.chain, other.chain) and np.array_equal(one.log_density, other.log_density)


def some_chain(rng, steps=7):
    state = np.random.RandomState(4).get_state()
    proposal = single(rng.normal(size=6), np.eye(6))
    y = rng.normal(size=(steps, 20, 6))
    return Chain(y, rng.normal(size=(steps, 20)), np.ones(20), state, proposal, 40)


def test_round_trip_and_emcee_reads_it(rng, tmp_path):
    chain = some_chain(rng)
    file = ChainFile(tmp_path / "chain.h5", IDENTITY, resume=False)
    assert file.load() is None
    file.save(chain)
    found = file.load()
    for one, other in zip(found[:3], chain[:3], strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.random_state[0] == chain.random_state[0]
    np.testing.assert_array_equal(found.random_state[1], chain.random_state[1])
    assert found.random_state[2:] == chain.random_state[2:]
    assert found.burn_in == 40
    np.testing.assert_array_equal(found.proposal.location, chain.proposal.location)
    backend = emcee.backends.HDFBackend(str(tmp_path / "chain.h5"), read_only=True)
    np.testing.assert_array_equal(backend.get_chain(), chain.y)
    np.testing.assert_array_equal(backend.get_log_prob(), chain.log_density)
    file.close()
    assert os.listdir(tmp_path) == ["chain.h5"]


def test_resumed_chain_is_the_same(whole, tmp_path):
    for steps in (5, 33, 60):
        file = tmp_path / f"{steps}.h5"
        with pytest.raises(NotConvergedError, match="resume") as caught:
            sample_posterior(POSES, NOISE, file=file, max_steps=steps, **OPTIONS)
        assert not caught.value.partial.converged
        resumed = sample_posterior(POSES, NOISE, file=file, resume=True, **OPTIONS)
        assert same(resumed, whole)
        again = sample_posterior(POSES, NOISE, file=file, resume=True, **OPTIONS)
        assert same(again, resumed)


def test_interrupt_keeps_whole_rounds(whole, tmp_path, monkeypatch):
    file = tmp_path / "chain.h5"
    calls = []
    original = posterior_run._Run.round

    def interrupted(self, steps):
        calls.append(steps)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return original(self, steps)

    monkeypatch.setattr(posterior_run._Run, "round", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sample_posterior(POSES, NOISE, file=file, **OPTIONS)
    monkeypatch.undo()
    assert file.exists()
    assert same(sample_posterior(POSES, NOISE, file=file, resume=True, **OPTIONS), whole)


PROGRAM = """
import sys
import uq_handeye as uq
from uq_handeye.validation.posterior import run as posterior_run
from uq_handeye.validation.posterior.sample import sample_posterior
posterior_run.PAUSE = 0.0
noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
print("begun", flush=True)
sample_posterior(uq.simulate(8, noise=noise, seed=5), noise, samples=12_000, walkers=32, file=sys.argv[1], resume=True)
print("ended", flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="no kill -9")
def test_killed_at_any_moment(tmp_path, rng):
    reference = sample_posterior(POSES, NOISE, samples=12_000, walkers=32)
    file = tmp_path / "chain.h5"
    wait = [0.0, *rng.uniform(0.05, 0.4, 2)]
    for seconds in wait:
        with subprocess.Popen([sys.executable, "-c", PROGRAM, str(file)], stdout=subprocess.PIPE) as process:
            assert process.stdout.readline() == b"begun\n"
            while seconds and not file.exists() and process.poll() is None:
                time.sleep(0.005)
            time.sleep(seconds)
            process.send_signal(signal.SIGKILL)
    assert file.exists()
    assert same(sample_posterior(POSES, NOISE, samples=12_000, walkers=32, file=file, resume=True), reference)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"seed": 3}, "seed"),
        ({"walkers": 34}, "walkers"),
        ({"scales": True}, "scale prior"),
        ({"scales": ScalePrior(2.0, 2.0)}, "scale prior"),
        ({"student_t": 4.0}, "Student-t"),
        ({"noise": uq.PoseNoise.isotropic(camera=("1mrad", "1mm"))}, "noise"),
        ({"data": uq.simulate(8, noise=NOISE, seed=6)}, "data"),
        ({"data": uq.PosePairs(POSES.robot, POSES.camera, "eye-to-hand")}, "data"),
    ],
)
def test_another_run_is_refused(change, named, tmp_path_factory):
    file = tmp_path_factory.getbasetemp() / "of-another-run.h5"
    if not file.exists():
        with pytest.raises(NotConvergedError):
            sample_posterior(POSES, NOISE, file=file, max_steps=20, **OPTIONS)
    before = file.read_bytes()
    arguments = {"data": POSES, "noise": NOISE, **OPTIONS} | change
    with pytest.raises(InputError, match=f"another run.*{named}"):
        sample_posterior(arguments.pop("data"), arguments.pop("noise"), file=file, resume=True, **arguments)
    assert file.read_bytes() == before


def test_more_may_be_asked_for(tmp_path):
    file = tmp_path / "chain.h5"
    few = sample_posterior(POSES, NOISE, file=file, samples=500, walkers=32)
    more = sample_posterior(POSES, NOISE, file=file, resume=True, samples=9000, walkers=32)
    assert len(more.samples) > len(few.samples)
    assert same(more, sample_posterior(POSES, NOISE, samples=9000, walkers=32))


def test_damage_is_refused(rng, tmp_path):
    path = tmp_path / "chain.h5"
    file = ChainFile(path, IDENTITY, resume=False)
    file.save(some_chain(rng, 20))
    good = path.read_bytes()
    y = good.find(file.load().y.tobytes())
    assert y > 0
    damaged = [good[:100], good[: len(good) // 2], b"", b"no HDF5", good[: y + 50] + b"\1\2" + good[y + 52 :]]
    damaged += [good[:k] + bytes([good[k] ^ 255]) + good[k + 1 :] for k in rng.integers(y, y + 20_000, 20)]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(InputError, match="damaged"):
            file.load()
    for k in rng.integers(0, len(good), 200):  # anywhere: refused, or harmless
        path.write_bytes(good[:k] + bytes([good[k] ^ 255]) + good[k + 1 :])
        try:
            found = file.load()
        except InputError:
            continue
        path.write_bytes(good)
        np.testing.assert_array_equal(found.y, file.load().y)


def test_what_is_there_is_not_overwritten(rng, tmp_path):
    path = tmp_path / "chain.h5"
    path.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"exists.*resume"):
        ChainFile(path, IDENTITY, resume=False)
    with pytest.raises(InputError, match="folder"):
        ChainFile(tmp_path, IDENTITY, resume=True)
    with pytest.raises(InputError, match="needs the `file`"):
        sample_posterior(POSES, NOISE, resume=True)
    with pytest.raises(InputError, match="no folder"):
        sample_posterior(POSES, NOISE, file=tmp_path / "missing" / "chain.h5", max_steps=5)
    assert path.read_bytes() == b"mine"


def test_one_process_at_a_time(rng, tmp_path):
    pytest.importorskip("fcntl")
    path, program = tmp_path / "chain.h5", [sys.executable, "-c", HOLDER, str(tmp_path / "chain.h5")]
    with subprocess.Popen(program, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        for resume in (False, True):
            with pytest.raises(InputError, match=r"chain.h5 is in use by another run: wait for its end\.$"):
                ChainFile(path, IDENTITY, resume=resume)
        process.kill()
    assert os.listdir(tmp_path) == [".uq-handeye-chain.h5.lock"]  # of the one that was killed
    first = ChainFile(path, IDENTITY, resume=False)
    second = ChainFile(path, IDENTITY, resume=False)  # in one process, where a traceback may hold the first
    with pytest.raises(InputError, match="taken over by a later run"):
        first.save(some_chain(rng))
    del first
    second.save(some_chain(rng))
    del second
    assert os.listdir(tmp_path) == ["chain.h5"]


HOLDER = """
import sys, time
from uq_handeye.validation.posterior.file import ChainFile
file = ChainFile(sys.argv[1], {}, resume=True)
print("held", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(os.name == "nt", reason="no pipes in folders")
def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "device"):
        with pytest.raises(InputError, match=f"{name}, a device or pipe"):
            ChainFile(tmp_path / name, IDENTITY, resume=True)
