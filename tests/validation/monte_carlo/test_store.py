"""The folder of a run: kill -9 at any moment loses no more than what was in flight, and nothing foreign is mixed in."""

import io
import json
import os
import random
import shutil
import signal
import time
import zipfile

import numpy as np
import pytest
from fixtures.trials import NOISE, PROGRAM, assert_same, pairs_problem, poses_of_program, start
from support import SEED

from uq_handeye import InputError, InputWarning, PairNoise
from uq_handeye.core.files.locks import locked
from uq_handeye.trials.validation.monte_carlo.run import monte_carlo

TRIALS = 6_500
CHUNKS = [f"{k:06d}.npz" for k in range(7)]


@pytest.fixture(scope="module")
def problem():
    return pairs_problem()


def run(problem, folder=None, trials=TRIALS, seed=SEED, **options):
    return monte_carlo(problem[0], noise=problem[1], trials=trials, seed=seed, directory=folder, **options)


@pytest.fixture(scope="module")
def whole(problem):
    return run(problem)


@pytest.fixture(scope="module")
def finished(problem, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "a" / "run"
    run(problem, folder)
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    return shutil.copytree(finished, tmp_path / "run")


# ------------------------------------------------------------------------------------------------------ kill and resume


def killed_and_resumed(tmp_path, trials, workers, least_kills):
    """The program killed with SIGKILL again and again, at random moments, until it once comes to its end."""
    program, clock, kills = tmp_path / "program.py", random.Random(SEED), 0
    program.write_text(PROGRAM)
    while True:
        process = start(program, tmp_path / "run", trials, workers)
        try:
            process.stdout.readline()
            chunks = len(list((tmp_path / "run").glob("chunks/*.npz")))
            if kills < least_kills:  # once it has written something, at a moment that no one chose
                while len(list((tmp_path / "run").glob("chunks/*.npz"))) < chunks + 2 and process.poll() is None:
                    time.sleep(0.005)
                time.sleep(clock.uniform(0, 0.1))
                os.killpg(process.pid, signal.SIGKILL)
                kills += 1
            out, errors = process.communicate(timeout=60)
        finally:
            process.kill()
        if process.returncode == 0:
            assert kills == least_kills, "it ended before it was killed"
            assert (out, errors) == (f"True all trials done {trials}\n", "")
            return


@pytest.mark.slow
@pytest.mark.parametrize(("trials", "workers", "kills"), [(24_500, 1, 2), (30_500, 2, 1)])
def test_killed_at_any_moment_and_resumed(tmp_path, trials, workers, kills):
    killed_and_resumed(tmp_path, trials, workers, kills)
    assert not list(tmp_path.glob("run/**/.uq-handeye-*"))
    options = {"noise": NOISE, "trials": trials}
    resumed = monte_carlo(poses_of_program(), directory=tmp_path / "run", resume=True, **options)
    assert resumed.resumed == trials and resumed.complete  # nothing was left to do
    assert_same(resumed, monte_carlo(poses_of_program(), **options))


@pytest.mark.slow
def test_files(finished, whole):
    assert sorted(path.name for path in finished.iterdir()) == ["chunks", "manifest.json", "result.json"]
    assert sorted(path.name for path in (finished / "chunks").iterdir()) == CHUNKS
    manifest = json.loads((finished / "manifest.json").read_text())
    assert manifest["trials"] == TRIALS and manifest["run"]["method"] == "4dpa" and manifest["run"]["seed"] == SEED
    assert {f"version of {name}" for name in ("uq_handeye", "numpy", "scipy", "python")} <= set(manifest["run"])
    result = json.loads((finished / "result.json").read_text())
    assert result["covariance"] == whole.covariance.tolist()
    with np.load(finished / "chunks" / CHUNKS[1], allow_pickle=False) as file:
        np.testing.assert_array_equal(file["errors"], whole.errors[1000:2000])


def test_what_is_there_is_not_worked_out_again(problem, folder, whole):
    for name in CHUNKS[2:5]:
        (folder / "chunks" / name).unlink()
    again = run(problem, folder, resume=True)
    assert again.resumed == TRIALS - 3000 and not again.notes
    assert_same(again, whole)


@pytest.mark.slow
def test_a_run_is_extended(problem, folder):
    assert_same(run(problem, folder, trials=9_000, resume=True), run(problem, trials=9_000))
    with pytest.raises(InputError, match=r"asked for 9,000 trials: resume it with as many or more, got 6,500"):
        run(problem, folder, resume=True)


def test_leftovers_are_removed(problem, folder, whole):
    for where in (folder, folder / "chunks"):
        (where / ".uq-handeye-0123456789abcdef.tmp").write_bytes(b"half a chunk")
    assert_same(run(problem, folder, resume=True), whole)
    assert not list(folder.glob("**/.uq-handeye-*"))


@pytest.mark.slow
def test_covariances_of_each_trial_are_resumed(problem, tmp_path):
    first = run(problem, tmp_path / "run", covariance="each", trials=2500)
    again = run(problem, tmp_path / "run", covariance="each", trials=2500, resume=True)
    assert again.resumed == 2500
    assert_same(again, first)


# ----------------------------------------------------------------------------------------------------- damaged chunks


def rewritten(path, change):
    """A chunk with other arrays, its checksum left as it is."""
    with np.load(path) as file:
        arrays = dict(file)
    change(arrays)
    np.savez(path, **arrays)


def flipped(path):
    data = bytearray(path.read_bytes())
    data[random.Random(SEED).randrange(200, 40_000)] ^= 4
    path.write_bytes(data)


def of_other_error(path):
    def change(arrays):
        arrays["errors"] = arrays["errors"] * (1 + 1e-15)

    rewritten(path, change)


def huge(path):
    """A header that promises more than there is memory."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**12, 6)})
    replaced(path, "errors.npy", head.getvalue())


def replaced(path, name, content, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path) as archive:
        members = {member.filename: archive.read(member) for member in archive.infolist()}
    members[name] = content
    with zipfile.ZipFile(path, "w", compression) as archive:
        for member, data in members.items():
            archive.writestr(member, data)


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def pickled(path):
    buffer = io.BytesIO()
    np.save(buffer, np.array([Evil()], dtype=object), allow_pickle=True)
    replaced(path, "errors.npy", buffer.getvalue())


def bomb(path):
    replaced(path, "errors.npy", bytes(10**8), zipfile.ZIP_DEFLATED)


def moved(path):
    path.unlink()
    path.mkdir()


def pipe(path):
    path.unlink()
    os.mkfifo(path)


def link(path):
    """To a file outside that is not there: it must not be made."""
    path.unlink()
    path.symlink_to(path.parents[2] / "outside")


def of_header(text):
    def change(path):
        head = text.encode() + b"\n"
        replaced(path, "errors.npy", b"\x93NUMPY\1\0" + len(head).to_bytes(2, "little") + head)

    return change


DAMAGES = {
    "flipped bit": flipped,
    "other numbers": of_other_error,
    "truncated": lambda path: path.write_bytes(path.read_bytes()[:20_000]),
    "empty": lambda path: path.write_bytes(b""),
    "longer": lambda path: path.write_bytes(path.read_bytes() + bytes(10**6)),
    "of another place": lambda path: shutil.copy(path.with_name(CHUNKS[4]), path),
    "more in it": lambda path: rewritten(path, lambda arrays: arrays.update(more=np.zeros(3))),
    "less in it": lambda path: rewritten(path, lambda arrays: arrays.pop("ok")),
    "other type": lambda path: rewritten(path, lambda arrays: arrays.update(ok=arrays["ok"].astype(float))),
    "huge": huge,
    "pickled": pickled,
    "bomb": bomb,
    "text": lambda path: path.write_text("PK not a chunk"),
    "pipe": pipe,
    "link to nowhere": link,
    "header without end": of_header("(((((((("),
    "header of brackets": of_header("(" * 5000 + ")" * 5000),
    "header of another type": of_header("{1:2,'descr':3}"),
    "header of a number": of_header("-" * 9000 + "1"),
}


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_chunk_is_worked_out_again_and_said(problem, folder, whole, damage, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    damage(folder / "chunks" / CHUNKS[2])
    with pytest.warns(InputWarning, match=r"damaged or of another run were computed again: 000002.npz"):
        again = run(problem, folder, resume=True)
    assert again.resumed == TRIALS - 1000
    assert_same(again, whole)
    assert not (tmp_path / "evil").exists() and not (tmp_path / "outside").exists()
    assert run(problem, folder, resume=True).resumed == TRIALS  # the damage is gone


@pytest.mark.slow
@pytest.mark.parametrize("other", ["seed", "noise", "method"])
def test_a_chunk_of_another_run_is_not_mixed_in(problem, folder, whole, tmp_path, other):
    """A chunk of the same number, and whole, but of another seed, noise or method."""
    noise = PairNoise(problem[1].A, problem[1].B * 1.0001)
    options = {"seed": {"seed": SEED + 1}, "noise": {}, "method": {"method": "efficient"}}[other]
    run((problem[0], noise) if other == "noise" else problem, tmp_path / "other", **options)
    shutil.copy(tmp_path / "other" / "chunks" / CHUNKS[3], folder / "chunks")
    with pytest.warns(InputWarning, match="000003.npz"):
        assert_same(run(problem, folder, resume=True), whole)


def test_a_folder_in_place_of_a_chunk(problem, folder):
    moved(folder / "chunks" / CHUNKS[2])
    with pytest.raises(InputError, match=r"000002.npz: it is a folder, expected a file; remove it"):
        run(problem, folder, resume=True)


# ------------------------------------------------------------------------------------------------------------ refusals


def test_not_empty_without_resume(problem, folder):
    with pytest.raises(InputError, match=r"run is not empty: go on with the run in it by resume=True \(--resume\)"):
        run(problem, folder)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"seed": SEED + 1}, f"seed ({SEED}, now {SEED + 1})"),
        ({"method": "park"}, "method (4dpa, now park)"),
        ({"scale": 1e4}, "scale (none, now 10000.0)"),
        ({"covariance": "each"}, "covariance tested ("),
    ],
    ids=str,
)
def test_another_run_is_refused_and_the_difference_named(problem, folder, change, named):
    before = (folder / "manifest.json").read_bytes()
    with pytest.raises(InputError, match="holds another run, which differs in") as caught:
        run(problem, folder, resume=True, **change)
    assert named in str(caught.value)
    assert (folder / "manifest.json").read_bytes() == before


def test_other_data_and_noise_are_refused(problem, folder):
    motions, noise = problem
    with pytest.raises(InputError, match=r"differs in noise sha256"):
        run((motions, PairNoise(noise.A, noise.B * (1 + 1e-12))), folder, resume=True)
    with pytest.raises(InputError, match=r"differs in data \(20 motions, now 19 motions\), data sha256"):
        run((motions.rows(np.arange(19)), noise), folder, resume=True)


def test_other_versions_are_refused(problem, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["run"]["version of numpy"] = "1.0"
    (folder / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(InputError, match=r"differs in version of numpy \(1.0, now "):
        run(problem, folder, resume=True)


@pytest.mark.parametrize("text", ["", "{", "[]", "7", '{"format": "another"}', "[" * 10**5, "x" * (2 * 10**6)])
def test_a_manifest_that_is_none(problem, folder, text):
    (folder / "manifest.json").write_text(text)
    with pytest.raises(InputError, match=r"not the manifest of a Monte Carlo run, is damaged"):
        run(problem, folder, resume=True)


def test_a_manifest_that_would_be_waited_for(problem, folder):
    for make in (os.mkfifo, lambda path: path.symlink_to("/dev/zero")):
        (folder / "manifest.json").unlink()
        make(folder / "manifest.json")
        with pytest.raises(InputError, match=r"not the manifest of a Monte Carlo run"):
            run(problem, folder, resume=True)


def test_what_a_manifest_says_cannot_fill_the_screen(problem, folder):
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    evil = {"\x1b[31mevil\n": "\x1b[2J", "x" * 100_000: [[1]], "seed": "\ud800"} | {f"more {k}": k for k in range(50)}
    path.write_text(json.dumps(manifest | {"run": manifest["run"] | evil}))
    with pytest.raises(InputError, match=r"and 47 more") as caught:
        run(problem, folder, resume=True)
    assert str(caught.value).isprintable() and len(str(caught.value)) < 500 + len(str(folder))
    path.write_text(json.dumps(manifest | {"trials": 10**3000}))
    with pytest.raises(InputError, match="is damaged"):
        run(problem, folder, resume=True)


@pytest.mark.slow
def test_links_are_replaced_and_not_followed(problem, folder, whole, tmp_path):
    for name in ("manifest.json", "result.json"):
        shutil.move(folder / name, tmp_path / name)
        (folder / name).symlink_to(tmp_path / name)
    before = [(tmp_path / name).read_bytes() for name in ("manifest.json", "result.json")]
    assert_same(run(problem, folder, trials=TRIALS + 1000, resume=True), run(problem, trials=TRIALS + 1000))
    assert [(tmp_path / name).read_bytes() for name in ("manifest.json", "result.json")] == before
    assert not (folder / "manifest.json").is_symlink() and not list(folder.glob("**/.uq-handeye-*"))


def test_a_refusal_lets_go_of_the_folder(problem, folder):
    """The exceptions are kept, and what they refer to with them."""
    shutil.rmtree(folder / "chunks")
    (folder / "chunks").write_text("no folder")
    with pytest.raises(InputError, match="chunks: expected a folder, got a file") as first:
        run(problem, folder, resume=True)
    with pytest.raises(InputError, match="is not empty") as second:
        run(problem, folder)
    with locked(folder / "manifest.json"):
        pass
    assert first.value and second.value


@pytest.mark.slow
def test_a_run_that_ended_early_says_what_is_there(problem, tmp_path):
    run(problem, tmp_path / "run", digits=1, trials=10_000)
    for path in sorted((tmp_path / "run" / "chunks").iterdir())[4:]:
        path.unlink()
    with pytest.raises(InputError, match=r"was asked for 10,000 trials, of which 4,000 are done: .* got 3,000\.$"):
        run(problem, tmp_path / "run", trials=3_000, resume=True)


def test_a_foreign_folder_is_refused(problem, tmp_path):
    (tmp_path / "thesis.tex").write_text("text")
    for resume, words in ((False, "is not empty"), (True, "holds no run to resume")):
        with pytest.raises(InputError, match=words):
            run(problem, tmp_path, resume=resume)
    assert os.listdir(tmp_path) == ["thesis.tex"]
    with pytest.raises(InputError, match="expected a folder, got a file"):
        run(problem, tmp_path / "thesis.tex", resume=True)
    with pytest.raises(InputError, match="resume=True"):
        run(problem, resume=True)


def test_two_at_a_time_are_refused(problem, folder):
    with locked(folder / "manifest.json"), pytest.raises(InputError, match="in use by another run"):
        run(problem, folder, resume=True)
    run(problem, folder, resume=True)


def test_a_full_disk_is_one_line(problem, folder, monkeypatch):
    (folder / "chunks" / CHUNKS[0]).unlink()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"no space left on device\.$"):
        run(problem, folder, resume=True)
