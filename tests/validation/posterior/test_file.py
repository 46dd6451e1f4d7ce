"""The file of a chain: resumed bit by bit, after kill -9 too; refused when damaged or another run's."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time

import emcee
import h5py
import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.errors import InputError, NotConvergedError
from uq_handeye.trials.validation.posterior import sampling as posterior_run
from uq_handeye.trials.validation.posterior.chain import Chain, HeldBackend, _require_plain, chain_of, content_of
from uq_handeye.trials.validation.posterior.density import ScalePrior
from uq_handeye.trials.validation.posterior.proposal import single
from uq_handeye.trials.validation.posterior.sample import sample_posterior
from uq_handeye.trials.validation.resumable import Run

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
POSES = uq.simulate(8, noise=NOISE, seed=5)
OPTIONS = {"samples": 1500, "walkers": 32}
IDENTITY = {"data": "a", "seed": 1}


@pytest.fixture(scope="module")
def whole():
    return sample_posterior(POSES, NOISE, **OPTIONS)


def same(one, other):
    return np.array_equal(one.chain, other.chain) and np.array_equal(one.log_density, other.log_density)


def run_in(path, resume=False):
    return Run(path, IDENTITY, resume, "chain", pieces=None)


def load(path):
    with contextlib.closing(run_in(path, resume=True)) as run:
        return run.load("chain", chain_of)


def save(path, chain):
    with contextlib.closing(run_in(path)) as run:
        assert run.load("chain", chain_of) is None
        run.save("chain", content_of(chain))


def some_chain(rng, steps=7):
    """Filled through emcee's interface, as its sampler does."""
    chain = Chain(HeldBackend(), single(rng.normal(size=6), np.eye(6)), 40)
    random = np.random.RandomState(4)
    chain.backend.reset(20, 6)
    chain.backend.grow(steps, None)
    for _ in range(steps):
        y, log_density = rng.normal(size=(20, 6)), rng.normal(size=20)
        state = emcee.State(y, log_prob=log_density, random_state=random.get_state())
        chain.backend.save_step(state, rng.random(20) < 0.5)
        random.normal()
    return chain


def test_round_trip_and_emcee_reads_it(rng, tmp_path):
    chain = some_chain(rng)
    save(tmp_path / "chain.h5", chain)
    found = load(tmp_path / "chain.h5")
    backend = emcee.backends.HDFBackend(str(tmp_path / "chain.h5"), read_only=True)
    for other in (found.backend, backend):
        assert other.iteration == chain.steps == 7
        np.testing.assert_array_equal(other.get_chain(), chain.y)
        np.testing.assert_array_equal(other.get_log_prob(), chain.log_density)
        np.testing.assert_array_equal(other.accepted, chain.backend.accepted)
        for one, same_one in zip(other.random_state, chain.backend.random_state, strict=True):
            np.testing.assert_array_equal(one, same_one)
    assert found.burn_in == 40
    for one, same_one in zip(found.proposal, chain.proposal, strict=True):
        np.testing.assert_array_equal(one, same_one)
    with h5py.File(tmp_path / "chain.h5") as there:
        assert there["mcmc"].attrs["version"] == emcee.__version__
    assert json.dumps(IDENTITY).encode() in (tmp_path / "chain.h5").read_bytes()  # the manifest
    assert os.listdir(tmp_path) == ["chain.h5"]


def test_a_file_of_an_earlier_version_is_refused_by_name(tmp_path):
    path = tmp_path / "chain.h5"
    with h5py.File(path, "w") as file:
        file.create_group("mcmc").attrs["version"] = "uq-handeye posterior 1"
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"not the file of a chain, is damaged, or of another version: name a"):
        sample_posterior(POSES, NOISE, file=path, resume=True, **OPTIONS)
    assert path.read_bytes() == before


@pytest.mark.parametrize("change", ["more", "shorter", "no steps", "sparse", "compressed", "other type"])
def test_arrays_that_are_no_chain_are_refused(rng, tmp_path, change):
    path = tmp_path / "chain.h5"
    save(path, some_chain(rng))
    with h5py.File(path, "a") as there:
        group = there["mcmc"]
        if change == "more":
            group["more"] = np.zeros(3)
        elif change == "shorter":
            group["log_prob"].resize(6, axis=0)
        elif change == "no steps":
            group.attrs["iteration"] = 0
        else:
            del group["chain"]
            options = {"sparse": {}, "compressed": {"compression": "gzip"}, "other type": {}}[change]
            of = np.float32 if change == "other type" else np.float64
            steps = 10**9 if change == "sparse" else 7
            group.create_dataset("chain", (steps, 20, 6), of, maxshape=(None, 20, 6), **options)
            if change != "sparse":
                group["chain"][:] = 1.0
    with h5py.File(path) as there, pytest.raises(ValueError, match="unexpected"):
        _require_plain(there["mcmc"], path.stat().st_size)
    with pytest.raises(InputError, match="damaged"):
        load(path)


@pytest.mark.slow
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


@pytest.mark.slow
def test_interrupt_keeps_whole_rounds(whole, tmp_path, monkeypatch):
    file = tmp_path / "chain.h5"
    calls = []
    original = posterior_run.sample_steps

    def interrupted(sampler, state, steps):
        calls.append(steps)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return original(sampler, state, steps)

    monkeypatch.setattr(posterior_run, "sample_steps", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sample_posterior(POSES, NOISE, file=file, **OPTIONS)
    monkeypatch.undo()
    assert file.exists()
    assert same(sample_posterior(POSES, NOISE, file=file, resume=True, **OPTIONS), whole)


PROGRAM = """
import sys
import uq_handeye as uq
from uq_handeye.trials.validation.posterior import sampling as posterior_run
from uq_handeye.trials.validation.posterior.sample import sample_posterior
posterior_run.MIN_PAUSE_S = 0.0
noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("1mrad", "1mm"))
print("begun", flush=True)
sample_posterior(uq.simulate(8, noise=noise, seed=5), noise, samples=5_000, walkers=32, file=sys.argv[1], resume=True)
print("ended", flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="no kill -9")
def test_killed_at_any_moment(tmp_path, rng):
    reference = sample_posterior(POSES, NOISE, samples=5_000, walkers=32)
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
    assert same(sample_posterior(POSES, NOISE, samples=5_000, walkers=32, file=file, resume=True), reference)


@pytest.mark.slow
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


@pytest.mark.slow
def test_more_may_be_asked_for(tmp_path):
    file = tmp_path / "chain.h5"
    few = sample_posterior(POSES, NOISE, file=file, samples=500, walkers=32)
    more = sample_posterior(POSES, NOISE, file=file, resume=True, samples=9000, walkers=32)
    assert len(more.samples) > len(few.samples)
    assert same(more, sample_posterior(POSES, NOISE, samples=9000, walkers=32))


@pytest.mark.slow
def test_damage_is_refused(rng, tmp_path):
    path = tmp_path / "chain.h5"
    chain = some_chain(rng, 20)
    save(path, chain)
    good = path.read_bytes()
    y = good.find(chain.y[3, 2, 1].tobytes())
    assert y > 0
    damaged = [good[:100], good[: len(good) // 2], b"", b"no HDF5", good[: y + 50] + b"\1\2" + good[y + 52 :]]
    damaged += [good[:k] + bytes([good[k] ^ 255]) + good[k + 1 :] for k in range(y, y + 8)]
    for content in damaged:
        path.write_bytes(content)
        with pytest.raises(InputError, match="damaged"):
            load(path)
    for k in rng.integers(0, len(good), 200):
        path.write_bytes(good[:k] + bytes([good[k] ^ 255]) + good[k + 1 :])
        with pytest.raises(InputError):
            load(path)


def test_what_is_there_is_not_overwritten(rng, tmp_path):
    path = tmp_path / "chain.h5"
    path.write_bytes(b"mine")
    with pytest.raises(InputError, match=r"exists.*resume"):
        run_in(path)
    with pytest.raises(InputError, match="folder"):
        run_in(tmp_path, resume=True)
    with pytest.raises(InputError, match="a `file` with resume=True"):
        sample_posterior(POSES, NOISE, resume=True)
    with pytest.raises(InputError, match="no folder"):
        sample_posterior(POSES, NOISE, file=tmp_path / "missing" / "chain.h5", max_steps=5)
    assert path.read_bytes() == b"mine"


@pytest.mark.slow
def test_one_process_at_a_time(rng, tmp_path):
    path, program = tmp_path / "chain.h5", [sys.executable, "-c", HOLDER, str(tmp_path / "chain.h5")]
    with subprocess.Popen(program, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"held\n"
        for resume in (False, True):
            with pytest.raises(InputError, match=r"chain.h5 is in use by another run: wait for its end\.$"):
                run_in(path, resume)
        process.kill()
    assert os.listdir(tmp_path) == [".uq-handeye-chain.h5.lock"]  # of the one that was killed
    save(path, some_chain(rng))
    assert os.listdir(tmp_path) == ["chain.h5"]


HOLDER = """
import sys, time
from uq_handeye.trials.validation.resumable import Run
run = Run(sys.argv[1], {}, True, "chain", pieces=None)
print("held", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(os.name == "nt", reason="no pipes in folders")
def test_what_is_no_file_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "device").symlink_to("/dev/zero")
    for name in ("pipe", "device"):
        with pytest.raises(InputError, match=f"{name}, a device or pipe"):
            run_in(tmp_path / name, resume=True)
