"""The generator: the checked-in package is what the derivations print, and `--check` sees any difference."""

import ast
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import sympy

from uq_handeye.methods import _closed_form
from uq_handeye.symbolic import functions, generate
from uq_handeye.symbolic.cache import derived
from uq_handeye.symbolic.matrices import FORMS, RUN
from uq_handeye.symbolic.printing import BANNER

PACKAGE = Path(_closed_form.__file__).parent
same_sympy = pytest.mark.skipif(
    f"SymPy {sympy.__version__};" not in (PACKAGE / "__init__.py").read_text(encoding="utf-8"),
    reason="the checked-in files were printed with another SymPy",
)


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A copy of the generated package in a checkout of its own, as the working directory."""
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "uq-handeye"\n')
    shutil.copytree(
        PACKAGE, tmp_path / "uq_handeye" / "methods" / "_closed_form", ignore=shutil.ignore_patterns("__*__")
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@same_sympy
def test_text_depends_on_nothing_else(checkout, tmp_path):
    """Another process, another hash seed, a cold cache, a folder below the checkout: the same bytes."""
    environment = os.environ | {"PYTHONHASHSEED": "12345", "UQ_HANDEYE_CACHE": str(tmp_path / "cold")}
    command = [sys.executable, "-m", "uq_handeye.symbolic.generate", "--check"]
    result = subprocess.run(
        command, cwd=checkout / "uq_handeye", env=environment, capture_output=True, text=True, timeout=120
    )
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.slow
@same_sympy
@pytest.mark.parametrize(
    ("name", "damage", "shown"),
    [
        ("problem2.py", lambda text: text.replace(b"4*e43**2", b"4*e43**3", 1), "4*e43**2"),
        ("so4.py", lambda text: text[:-1], "return out"),
        ("derivatives.py", lambda text: text.replace(b"\n", b"\r\n"), "derivatives.py"),
        ("octonion.py", lambda text: b"\xff" + text, "octonion.py"),
    ],
    ids=["entry", "last byte", "line ends", "not UTF-8"],
)
def test_check_sees_one_changed_byte(checkout, capsys, name, damage, shown):
    path = checkout / "uq_handeye" / "methods" / "_closed_form" / name
    before = path.read_bytes()
    path.write_bytes(damage(before))
    assert path.read_bytes() != before
    assert generate.main(["--check"]) == 1
    out = capsys.readouterr().out
    assert out.startswith(f"--- checked-in/{name}\n+++ derived/{name}\n@@ ")
    assert shown in out
    assert generate.main([]) == 0  # writing repairs
    assert path.read_bytes() == before


@pytest.mark.slow
def test_check_sees_missing_and_extra_files(checkout, capsys):
    folder = checkout / "uq_handeye" / "methods" / "_closed_form"
    assert generate.main([]) == 0
    (folder / "so4.py").unlink()
    (folder / "extra.py").touch()
    assert generate.main(["--check"]) == 1
    out = capsys.readouterr().out
    assert "so4.py" in out
    assert "extra.py" in out
    assert generate.main([]) == 0
    assert not (folder / "extra.py").exists()
    assert generate.main(["--check"]) == 0


@pytest.mark.slow
def test_only_what_the_package_runs_is_checked_in():
    """Every name read from `_closed_form` by a module of the package is there, and nothing else."""
    modules = [path for path in PACKAGE.parents[1].rglob("*.py") if PACKAGE not in path.parents]
    read = {
        node.attr
        for path in modules
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "_closed_form"
    }
    assert read == RUN == set(_closed_form.__all__)


def test_the_others_are_made_without_derivation_once_they_are_cached(tmp_path, monkeypatch):
    """A study that wants them waits for the cache alone."""
    monkeypatch.setenv("UQ_HANDEYE_CACHE", str(tmp_path))
    form = FORMS["J_23"]
    values = [np.random.default_rng(k).normal(size=(4, 4)) for k in range(2)]
    first = functions._compile("J_23")(*values)

    def derive(form):
        raise AssertionError("derived again")

    monkeypatch.setattr(functions, "derived", partial(derived, build=derive))
    np.testing.assert_array_equal(functions._compile("J_23")(*values), first)
    assert first.shape == form.shape
    with pytest.raises(AttributeError, match="no attribute 'J_55'"):
        functions.J_55  # noqa: B018


def test_no_checkout(tmp_path, monkeypatch, capsys):
    """One line, exit 2, nothing written: neither above the working directory nor above the module."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(generate, "__file__", str(tmp_path / "site-packages" / "generate.py"))
    assert generate.main([]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "error: no checkout of uq-handeye above the working directory or this module\n"
    assert list(tmp_path.iterdir()) == []


def test_find_checkout(tmp_path):
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    (inner / "pyproject.toml").write_text("not toml")
    (tmp_path / "a" / "pyproject.toml").write_text('[project]\nname = "another"\n')
    assert generate.find_checkout(inner) is None
    (tmp_path / "pyproject.toml").write_text('[project]\nname = "uq-handeye"\n')
    assert generate.find_checkout(inner) == tmp_path
    assert generate.find_checkout(Path(tmp_path.anchor), inner) == tmp_path


@pytest.mark.slow
def test_banner_and_docstrings():
    for name, text in generate.texts().items():
        assert text.startswith(BANNER), name
        assert text.endswith("\n")
    assert "python -m uq_handeye.symbolic.generate" in BANNER
    for name, form in FORMS.items():
        doc = getattr(functions, name).__doc__
        assert doc.startswith(form.meaning)
        assert f"Returns (..., {', '.join(map(str, form.shape))})" in doc
