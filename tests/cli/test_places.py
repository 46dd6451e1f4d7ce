"""Checks of the output places of a command, before it reads or computes anything."""

import errno

import pytest
from fixtures.commands import run

# There are no such input files, so that an error about the output shows that it came first.
FILES = ("robot.csv", "camera.csv")
COMMANDS = [
    ("calibrate", *FILES, "--report"),
    ("calibrate", *FILES, "-o"),
    ("demo", "--report"),
    ("demo", "-o"),
    ("camera", "corners.csv", "-o"),
    ("compare", *FILES, "-o"),
    ("plan", *FILES, "-o"),
    ("validate", *FILES, "-o"),
    ("validate", *FILES, "--figure"),
    ("posterior", *FILES, "-o"),
    ("cross-check", *FILES, "-o"),
    ("cross-check", *FILES, "--report"),
    ("sync", *FILES, "-o"),
    ("codegen", "--language", "c", "--all", "-o"),
    ("simulate", "-o"),
    ("report", "result.json"),
    ("export", "result.json"),
]
ENDINGS = {"--report": ".html", "--figure": ".png", "result.json": ".html"}


def refused(command, place, cwd):
    """One line and status 2 about the place, and nothing written."""
    name = f"{place}/new{ENDINGS.get(command[-1], '')}"
    before = sorted(cwd.rglob("*"))
    done = run(*command, name, cwd=cwd)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith("uq-handeye: error: Cannot ") and place in done.stderr
    assert sorted(cwd.rglob("*")) == before
    return done.stderr


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_place_that_is_no_folder(command, tmp_path):
    (tmp_path / "file").write_text("")
    assert "file" in refused(command, "file", tmp_path)


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_folder_without_permission(command, tmp_path, monkeypatch):
    folder = tmp_path / "locked"
    folder.mkdir()
    # the tests may run as root, who may write everywhere
    monkeypatch.setattr("uq_handeye.core.files.atomic.os.access", lambda path, _: not str(path).endswith("locked"))
    assert "no permission to write" in refused(command, "locked", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_what_shows_only_in_writing_is_one_line_too(number, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(number, "the system says no")

    monkeypatch.setattr("uq_handeye.core.files.atomic.os.fsync", refuse)
    for option, place in (("--report", "r.html"), ("-o", "folder")):
        done = run("demo", option, place, cwd=tmp_path)
        assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
        assert "the system says no" in done.stderr
        assert list(tmp_path.iterdir()) == []
