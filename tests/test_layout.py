"""The house: imports go down in the order that the page of the architecture gives."""

import re
import runpy
import tomllib
from graphlib import TopologicalSorter

import pytest
from fixtures.pages import DOCS, ROOT

PAGE = (DOCS / "explanation" / "architecture.md").read_text(encoding="utf-8")
SCRIPT = runpy.run_path(str(DOCS / "figures" / "architecture.py"))
SOURCES = SCRIPT["sources"]()
# Rows of the table of packages, ground floor first; after them the public names and the program.
ROWS = re.findall(r"^\| (`.*?`) \|", PAGE.partition("## Packages")[2].partition("## ")[0], re.MULTILINE)
ORDER = [name.removesuffix(".py").replace("/", ".") for row in ROWS for name in re.findall(r"`([\w./]+?)/?`", row)]
FOLDERS = set(re.findall(r"^\| \*\*(\w+)\*\* \|", PAGE, re.MULTILINE))
FLOORS = [*ORDER[: ORDER.index("cli")], "__init__", "cli", "__main__"]


def package(module):
    """Return the package by name, also inside a folder of packages; a module at the top stands for itself."""
    parts = module.split(".")[1:]
    inner = ".".join(parts[:2])
    return inner if inner in FLOORS else parts[0] if parts else "__init__"


def test_every_package_is_on_the_page_in_its_place():
    assert len(FLOORS) == len(set(FLOORS))
    assert {package(module) for module in SOURCES} == set(FLOORS) | FOLDERS


@pytest.mark.docs
@pytest.mark.parametrize("name", FLOORS)
def test_imports_go_down(name):
    """Imports at the top of a module, in functions and for type checkers, but for the door to the report."""
    upward = [
        f"{SOURCES[module].relative_to(ROOT)}:{line} imports {other}"
        for module in SOURCES
        if package(module) == name
        for line, other in SCRIPT["imports"](module)
        if FLOORS.index(package(other)) > FLOORS.index(name)
    ]
    assert upward == []


@pytest.mark.docs
def test_no_circle_of_files():
    TopologicalSorter({m: {other for _, other in SCRIPT["imports"](m)} - {m} for m in SOURCES}).prepare()


@pytest.mark.parametrize("door", sorted(SCRIPT["DOORS"]))
def test_the_doors_to_the_report_are_lazy(door):
    result, page = door
    text = SOURCES[result].read_text(encoding="utf-8")
    found = re.findall(rf"^( *)from \.+{page.removeprefix('uq_handeye')} import (.*)$", text, re.MULTILINE)
    assert (
        "        ",
        {"page": "write_report", "figures": "figure_of"}[page.rpartition(".")[2]],
    ) in found
    assert all(indent for indent, _ in found)


def test_every_folder_is_installed():
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]["packages"]
    folders = {module if path.name == "__init__.py" else module.rpartition(".")[0] for module, path in SOURCES.items()}
    assert set(listed) == folders | {"uq_handeye.data", "uq_handeye.symbolic.templates"}  # which hold no Python


@pytest.mark.docs
def test_the_picture_of_the_architecture_is_drawn_from_the_imports():
    kept = (DOCS / "images" / "architecture.svg").read_text(encoding="utf-8")
    assert SCRIPT["picture"](SCRIPT["graph"]()) == kept, "run: python docs/figures/architecture.py"


def test_every_file_that_the_page_names_is_there():
    named = {name for name in re.findall(r"`([\w/]+/\w+\.py)`", PAGE) if not name.startswith("tests/")}
    assert len(named) > 25 and all((ROOT / "uq_handeye" / name).exists() for name in named), named
