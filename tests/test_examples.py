"""The examples in docstrings run and print what they show."""

import doctest
import importlib
from pathlib import Path

import pytest

pytestmark = pytest.mark.docs

ROOT = Path(__file__).parent.parent
FOLDERS = {"uq_handeye": ROOT / "uq_handeye", "uq_handeye.symbolic": ROOT / "symbolic"}
MODULES = sorted(
    ".".join([package, *file.relative_to(folder).with_suffix("").parts]).removesuffix(".__init__")
    for package, folder in FOLDERS.items()
    for file in folder.rglob("*.py")
    if ">>> " in file.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_print_what_they_show(name, capsys):
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried and not failed, capsys.readouterr().out
