"""The cache of derivations: whatever lies in its folder, results are right and entries repaired."""

import json
import os
import subprocess
import sys

import pytest

from uq_handeye.symbolic import cache
from uq_handeye.symbolic.elimination import derive
from uq_handeye.symbolic.matrices import FORMS

FORM = FORMS["F2"]


class Counter:
    """`derive`, counted."""

    def __init__(self):
        self.calls = 0

    def __call__(self, form):
        self.calls += 1
        return derive(form)


@pytest.fixture
def build():
    return Counter()


@pytest.fixture
def entry(tmp_path, monkeypatch):
    """Path of a valid entry for FORM in a folder of its own."""
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(tmp_path))
    cache.derived(FORM)
    return tmp_path / "symbolic" / "F2.json"


def edited(entry, **fields):
    return json.dumps(json.loads(entry.read_text()) | fields)


def test_second_call_reads(entry, build):
    assert cache.derived(FORM, build) == derive(FORM)
    assert build.calls == 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["J_34", "F2", "dF11q_db", "u"])
def test_round_trip(name, tmp_path, monkeypatch, build):
    """The cache returns what was derived, with the same symbols and the same order of terms."""
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(tmp_path))
    fresh = cache.derived(FORMS[name])
    read = cache.derived(FORMS[name], build)
    assert build.calls == 0
    assert read == fresh
    assert str(read) == str(fresh)


UNFIT = {
    "empty": lambda entry: "",
    "not JSON": lambda entry: "{'schema': 1",
    "truncated": lambda entry: entry.read_text()[:-20],
    "binary": lambda entry: "\0\x01\x02",
    "deep": lambda entry: "[" * 100_000,
    "array": lambda entry: "[1, 2, 3]",
    "number": lambda entry: "17",
    "empty object": lambda entry: "{}",
    "schema": lambda entry: edited(entry, schema=0),
    "key": lambda entry: edited(entry, key="0" * 64),
    "name": lambda entry: edited(entry, name="F1"),
    "shape": lambda entry: edited(entry, shape=[2, 8]),
    "too few": lambda entry: edited(entry, reduced=[0] * 15),
    "entries no list": lambda entry: edited(entry, entries="0" * 16),
    "unknown symbol": lambda entry: edited(entry, entries=["z"] * 16),
    "temporary before its definition": lambda entry: edited(entry, temporaries=[["x0", "x1"], ["x1", "d"]]),
    "temporary that hides a symbol": lambda entry: edited(entry, temporaries=[["r11", "r12"]]),
    "temporary no pair": lambda entry: edited(entry, temporaries=["x0"]),
    "operator": lambda entry: edited(entry, entries=[["sin", "d"]] * 16),
    "code": lambda entry: edited(entry, entries=["__import__('os')"] * 16),
    "float": lambda entry: edited(entry, entries=[0.5] * 16),
    "boolean": lambda entry: edited(entry, entries=[True] * 16),
    "null": lambda entry: edited(entry, entries=[None] * 16),
    "division by zero": lambda entry: edited(entry, entries=[["/", 1, 0]] * 16),
    "huge power": lambda entry: edited(entry, entries=[["^", "d", 10**9]] * 16),
    "power of a number": lambda entry: edited(entry, entries=[["^", 9, 8]] * 16),
    "empty sum": lambda entry: edited(entry, entries=[["+"]] * 16),
    "empty list": lambda entry: edited(entry, entries=[[]] * 16),
}


@pytest.mark.parametrize("content", UNFIT.values(), ids=UNFIT.keys())
def test_unfit_entries_are_rebuilt(entry, build, content):
    valid = entry.read_bytes()
    entry.write_text(content(entry))
    assert cache.derived(FORM, build) == derive(FORM)
    assert build.calls == 1
    assert entry.read_bytes() == valid


def test_huge_entry_is_not_read(entry, build, monkeypatch):
    with entry.open("r+b") as stream:
        stream.truncate(10**12)  # sparse
    monkeypatch.setattr(cache.json, "loads", lambda text: pytest.fail("read"))
    assert cache.derived(FORM, build) == derive(FORM)
    assert build.calls == 1
    assert entry.stat().st_size < cache.MAX_ENTRY_BYTES


def test_folder_in_place_of_an_entry(entry, build):
    entry.unlink()
    entry.mkdir()
    assert cache.derived(FORM, build) == derive(FORM)
    assert entry.is_dir()
    assert list(entry.parent.iterdir()) == [entry]  # no temporary is left behind


def test_unusable_folder(tmp_path, monkeypatch, build):
    (tmp_path / "file").touch()
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(tmp_path / "file" / "below"))
    assert cache.derived(FORM, build) == derive(FORM)
    assert build.calls == 1


def test_read_only_folder(entry, build, monkeypatch):
    """Refusal as by a disk: root, under which tests may run, ignores permissions."""
    entry.write_text("damaged")

    def refuse(*_args, **_kwargs):
        raise PermissionError

    monkeypatch.setattr(cache.tempfile, "mkstemp", refuse)
    assert cache.derived(FORM, build) == derive(FORM)
    assert entry.read_text() == "damaged"


def test_failed_rename_leaves_nothing(entry, monkeypatch):
    entry.write_text("damaged")

    def refuse(*_args):
        raise PermissionError

    monkeypatch.setattr(cache.os, "replace", refuse)
    assert cache.derived(FORM) == derive(FORM)
    assert list(entry.parent.iterdir()) == [entry]


def test_no_home(monkeypatch, build):
    def no_home():
        raise RuntimeError

    monkeypatch.delenv("UQ_HANDEYE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # to be ignored
    monkeypatch.setattr(cache.Path, "home", no_home)
    assert cache.directory() is None
    assert cache.derived(FORM, build) == derive(FORM)


def test_location(monkeypatch, tmp_path):
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(tmp_path / "a"))
    assert cache.directory() == tmp_path / "a" / "symbolic"
    monkeypatch.delenv("UQ_HANDEYE_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "b"))
    assert cache.directory() == tmp_path / "b" / "uq-handeye" / "symbolic"


def test_key_follows_the_sources(monkeypatch):
    before = cache.source_key()
    cache.source_key.cache_clear()
    try:
        monkeypatch.setattr(cache.sympy, "__version__", "0")
        assert cache.source_key() != before
        monkeypatch.undo()
        cache.source_key.cache_clear()
        monkeypatch.setattr(cache, "SOURCES", cache.SOURCES[:-1])
        assert cache.source_key() != before
    finally:
        monkeypatch.undo()
        cache.source_key.cache_clear()
    assert cache.source_key() == before


WRITER = """
from uq_handeye.symbolic import cache
from uq_handeye.symbolic.elimination import derive
from uq_handeye.symbolic.matrices import FORMS
form = FORMS["F2"]
right = derive(form)
path = cache.directory() / "F2.json"
for _ in range(60):
    path.unlink(missing_ok=True)
    assert cache.derived(form, lambda form: right) == right
"""


@pytest.mark.slow
def test_two_processes_write_at_once(entry, build):
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER], stderr=subprocess.PIPE, env=os.environ.copy())
        for _ in range(2)
    ]
    for writer in writers:
        _, stderr = writer.communicate(timeout=60)
        assert writer.returncode == 0, stderr.decode()
    assert cache.derived(FORM, build) == derive(FORM)
    assert build.calls == 0
    assert list(entry.parent.iterdir()) == [entry]
