"""Common parts of the studies: a command line, and a folder of tables, figures and findings that can be read again.

A study measures tables; everything that it says or draws comes from the tables as they stand in its CSV files. So a
sentence of the documentation that quotes a study can be held against the files beside it, and a figure can be drawn
again without measuring again.
"""

from __future__ import annotations

import argparse
import io
import json
import platform
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

import uq_handeye as uq
from uq_handeye.core.files.atomic import Content, write_files
from uq_handeye.core.files.json_files import json_text
from uq_handeye.core.presentation.ellipses import render

Tables = Mapping[str, pd.DataFrame]
FINDINGS, RUN, KEPT = "findings.md", "run.json", "kept.jsonl"
_PACKAGES = ("numpy", "scipy")


@dataclass(frozen=True)
class Study:
    """``measure(full)`` gives the tables by name, the other two what follows from them.

    ``name`` is that of the module below ``studies``; ``packages`` are those whose versions matter beside NumPy and
    SciPy. With ``resumes``, ``measure`` also gets the file in which it keeps what it has measured, so that a run that
    was interrupted is continued by the same command; the file is removed once the tables are written.
    """

    name: str
    measure: Callable[..., Tables]
    findings: Callable[[Tables], str]
    figures: Callable[[Tables], Mapping[str, Figure]]
    packages: Sequence[str] = ()
    resumes: bool = False

    def run(self, description: str | None, argv: Sequence[str] | None = None) -> None:
        """The command line: measure, or read what was measured; write and print."""
        summary, _, rest = (description or "").partition("\n\n")
        parser = argparse.ArgumentParser(
            prog=f"python -m studies.{self.name}",
            description=summary,
            epilog=rest,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        parser.add_argument("--full", action="store_true", help="the size that the documentation quotes")
        parser.add_argument(
            "-o",
            "--output",
            default="results",
            metavar="FOLDER",
            help=f"for the folder {self.name}; default: results",
        )
        parser.add_argument(
            "--redraw", action="store_true", help="findings and figures anew from the CSV files that are there"
        )
        options = parser.parse_args(argv)
        folder = Path(options.output, *self.name.split("."))
        if options.redraw:
            if not (folder / RUN).exists():
                parser.error(f"there is no {folder / RUN}: run the study without --redraw first, or say -o FOLDER.")
        else:
            try:
                folder.mkdir(parents=True, exist_ok=True)  # now, not after minutes
            except OSError as error:
                parser.error(f"cannot make the folder {folder}: {error.strerror}.")
            try:
                self._measure(folder, options.full)
            except uq.MissingExtraError as missing:
                parser.error(str(missing))
        text, names = self.write(folder)
        print(f"{text}\nWritten to {folder}: {', '.join(names)}")

    def _measure(self, folder: Path, full: bool) -> None:
        started = time.perf_counter()
        kept = folder / KEPT
        tables = self.measure(full, kept) if self.resumes else self.measure(full)
        seconds = time.perf_counter() - started
        names = (*_PACKAGES, *self.packages)
        about = {
            "study": self.name,
            "full": full,
            "seconds": round(seconds, 1),
            "tables": sorted(tables),
            "versions": {"uq-handeye": uq.__version__, "python": platform.python_version()}
            | {name: version_of(name) for name in names},
        }
        contents: dict[str, Content] = {
            f"{name}.csv": table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
            for name, table in tables.items()
        }
        write_files(folder, {**contents, RUN: json_text(about)})
        kept.unlink(missing_ok=True)

    def write(self, folder: Path) -> tuple[str, list[str]]:
        """Findings and figures from the tables in ``folder``; returns the findings and the names of all files."""
        tables, text = read_tables(folder), self.text(folder)
        drawn: dict[str, Content] = {
            f"{name}.png": render(figure, "png") for name, figure in self.figures(tables).items()
        }
        write_files(folder, {FINDINGS: text, **drawn})
        return text, [*(f"{name}.csv" for name in tables), *drawn, FINDINGS, RUN]

    def text(self, folder: Path) -> str:
        """Return the text that `write` writes: the findings, and the run that they belong to."""
        about = about_run(folder)
        versions = ", ".join(f"{name} {version}" for name, version in about["versions"].items())
        command = f"python -m studies.{self.name}" + (" --full" if about["full"] else "")
        footer = f"`{command}`, {about['seconds']:,.0f} s; {versions}."
        return f"{self.findings(read_tables(folder)).strip()}\n\n{footer}\n"


def version_of(package: str) -> str:
    """Return the installed version, e.g. ``2.4.1``; "not installed" otherwise."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def about_run(folder: Path) -> dict[str, Any]:
    """Size, time, tables and versions of the run whose results are in ``folder``."""
    found: dict[str, Any] = json.loads((folder / RUN).read_text(encoding="utf-8"))
    return found


def read_tables(folder: Path) -> dict[str, pd.DataFrame]:
    """The tables of a study by name. Empty cells are NaN in columns of numbers and empty in columns of text.

    Those of its last run only: an earlier one may have left others, e.g. of data that are no longer there.
    """
    names = about_run(folder)["tables"]
    return {name: read_table((folder / f"{name}.csv").read_text(encoding="utf-8")) for name in names}


def read_table(text: str) -> pd.DataFrame:
    table = pd.read_csv(io.StringIO(text), keep_default_na=False, na_values=[""])
    words = table.select_dtypes(exclude=["number", "bool"]).columns
    table[words] = table[words].fillna("")
    return table


def markdown(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table; cells are shown as they are."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
