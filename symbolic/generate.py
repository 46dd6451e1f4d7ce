"""Write or check the generated package `uq_handeye/methods/_closed_form/` of the checkout.

    python -m uq_handeye.symbolic.generate            write the files
    python -m uq_handeye.symbolic.generate --check    compare; print the difference and exit 1 if there is one

The checkout is the nearest folder above the working directory, else above this file, whose `pyproject.toml`
names `uq-handeye`. Without one the command exits 2: an installed package is never written to.
"""

from __future__ import annotations

import argparse
import difflib
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path

from .cache import derived
from .matrices import FORMS, RUN, TOPICS
from .printing import ARGUMENTS_MODULE, BANNER, numpy_function, numpy_module, numpy_package

PROJECT = "uq-handeye"
PACKAGE_DOCSTRING = """The closed forms that the toolkit runs as plain NumPy, printed from their SymPy derivations.

The registry holds more: `uq_handeye.symbolic.functions` compiles them, `uq-handeye codegen` prints them. Every function
takes arrays with leading batch axes, which broadcast, and returns an array of the same precision. Equation numbers (n)
are those of Wu, Sun, Wang, Liu, "Hand-eye Calibration: 4D Procrustes Analysis Approach", 2019; T1 to T3 are sections of
the theory page.
"""


def texts() -> dict[str, str]:
    """File name -> text of the generated package, derived in memory (or taken from the cache)."""
    by_topic: dict[str, list[str]] = {}
    for form in FORMS.values():
        if form.name in RUN:
            by_topic.setdefault(form.topic, []).append(form.name)
    result = {
        "__init__.py": numpy_package(PACKAGE_DOCSTRING, by_topic),
        "_arguments.py": BANNER + ARGUMENTS_MODULE,
    }
    for topic, names in by_topic.items():
        functions = [numpy_function(FORMS[name], derived(FORMS[name])) for name in names]
        result[f"{topic}.py"] = numpy_module(TOPICS[topic], functions)
    return dict(sorted(result.items()))


def find_checkout(*starts: Path) -> Path | None:
    """The nearest folder at or above a start, tried in order, whose pyproject.toml names the project."""
    for start in starts:
        for folder in (start, *start.parents):
            try:
                project = tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
                if project["name"] == PROJECT:
                    return folder
            except (OSError, ValueError, KeyError, TypeError):
                continue
    return None


def difference(folder: Path, wanted: dict[str, str]) -> str:
    """Unified diff from the files in the folder to the wanted texts; empty if they agree byte for byte."""
    found = {path.name: path.read_bytes() for path in folder.glob("*.py")}
    parts = []
    for name in sorted(found.keys() | wanted.keys()):
        old, new = found.get(name, b""), wanted.get(name, "").encode()
        if old == new and (name in found) == (name in wanted):
            continue
        before, after = (text.decode("utf-8", "backslashreplace").splitlines(True) for text in (old, new))
        diff = "".join(difflib.unified_diff(before, after, f"checked-in/{name}", f"derived/{name}"))
        parts.append(diff or f"checked-in/{name}: extra, missing or different line endings\n")
    return "".join(parts)


def write(folder: Path, wanted: dict[str, str]) -> None:
    """Write the texts, and remove modules that are no longer generated."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.glob("*.py"):
        if path.name not in wanted:
            path.unlink()
    for name, text in wanted.items():
        (folder / name).write_bytes(text.encode())  # bytes: no translation of line ends


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m uq_handeye.symbolic.generate",
        description="Write the generated package uq_handeye/methods/_closed_form of the checkout.",
    )
    parser.add_argument("--check", action="store_true", help="compare; print a diff and exit 1 if different")
    check = parser.parse_args(arguments).check
    checkout = find_checkout(Path.cwd(), Path(__file__).resolve().parent)
    if checkout is None:
        print(f"error: no checkout of {PROJECT} above the working directory or this module", file=sys.stderr)
        return 2
    folder = checkout / "uq_handeye" / "methods" / "_closed_form"
    wanted = texts()
    if not check:
        write(folder, wanted)
        return 0
    diff = difference(folder, wanted)
    sys.stdout.write(diff)
    return 1 if diff else 0


if __name__ == "__main__":
    sys.exit(main())
