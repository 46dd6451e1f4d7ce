"""Patterns match as those of glob, and end on a whole disk; names and lines that no program should choke on."""

import glob
import json
import subprocess
import sys
from pathlib import Path

import pytest

import uq_handeye as uq
from uq_handeye.core.files import patterns
from uq_handeye.core.files.json_files import parsed
from uq_handeye.core.files.open import as_path
from uq_handeye.core.files.patterns import matching
from uq_handeye.errors import InputError
from uq_handeye.use.live_session.json_lines import pair_of

TREE = ("a1.txt", "a2.txt", "b.csv", ".hidden.txt", "sub/a3.txt", "sub/deep/a4.txt", "sub/.dot/a5.txt", "s[1]/a6.txt")


@pytest.fixture
def tree(tmp_path, monkeypatch):
    for name in TREE:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "pattern",
    ["*.txt", "a?.txt", "**/*.txt", "sub/**/*.txt", "*/a*.txt", "**/a[34].txt", "s[[]1]/*.txt", "none*", "**"],
)
def test_patterns_match_as_glob(tree, pattern):
    for whole in (pattern, str(tree / pattern)):
        expected = {Path(name) for name in glob.glob(whole, recursive=True) if Path(name).is_file()}
        assert {one for one in matching(whole) if one.is_file()} == expected


def test_a_pattern_over_too_many_names_is_refused(tree, monkeypatch):
    monkeypatch.setattr(patterns, "MAX_NAMES", 5)
    with pytest.raises(InputError, match="Name the folder"):
        matching("**/*.txt")


def test_names_that_are_too_long_or_move_the_cursor():
    with pytest.raises(InputError, match="file name too long"):
        as_path("a" * 300 + ".csv")
    poses = uq.simulate(5, seed=1)
    for name in ("l\x1b[31mred", "a" * 300, ""):
        with pytest.raises(InputError, match="printable characters"):
            uq.PosePairs(poses.robot, poses.camera, names=poses.names._replace(camera=name))


def test_numbers_beyond_any_are_refused(tmp_path):
    (tmp_path / "a.json").write_text('{"t": 1e400}')
    with pytest.raises(InputError, match="1e400"):
        parsed(tmp_path / "a.json")


def test_a_deeply_nested_line_is_one_line_of_error():
    with pytest.raises(InputError, match="line 3"):
        pair_of("[" * 9000 + "]" * 9000, "line 3")
    with pytest.raises(InputError, match="line 4"):
        pair_of(json.dumps({"robot": 1}), "line 4")


@pytest.mark.slow
def test_python_without_docstrings_says_so():
    done = subprocess.run([sys.executable, "-OO", "-m", "uq_handeye", "--help"], capture_output=True, text=True)
    assert done.returncode == 2 and "PYTHONOPTIMIZE" in done.stderr
