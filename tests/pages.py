"""Pages of the documentation, run as a reader would: their commands and Python blocks, in order, in one folder.

A block ```` ```text ```` whose first line starts with ``uq-handeye`` holds commands, one per line; any other such block
shows what the blocks before it printed; ```` ```python ```` is executed, all blocks of a page in one namespace. Other
blocks (``bash``, ``py``, ...) need what a test has not, and are left alone.
"""

import contextlib
import io
import re
import shlex
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest

from uq_handeye import InputWarning
from uq_handeye.cli.app import main

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


@dataclass
class Block:
    """One block of a page; ``printed`` is what it printed, for shown output what the blocks before it did."""

    kind: str  # command, python or shown
    text: str
    printed: str = ""


def blocks(page):
    """The blocks of a page that are run or compared."""
    found = re.findall(r"^```(text|python)\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    kinds = (
        "python" if tag == "python" else "command" if text.startswith("uq-handeye ") else "shown" for tag, text in found
    )
    return [Block(kind, text) for kind, (_, text) in zip(kinds, found, strict=True)]


def run_command(line):
    """Return what a command prints, both streams; it must end well, or with one line that says what to do."""
    out, err = io.StringIO(), io.StringIO()
    program, *arguments = shlex.split(line)
    assert program == "uq-handeye"
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with warnings.catch_warnings(), streams[0], streams[1], pytest.raises(SystemExit) as end:
        main(arguments)
    code = end.value.code
    assert code in (0, None) or (code == 2 and "uq-handeye: error:" in err.getvalue()), err.getvalue()
    return out.getvalue() + err.getvalue()


def run_page(page):
    """Run a page in the current folder and return its blocks with what was printed."""
    names = {"__name__": "page"}
    found, recent = blocks(page), ""
    for k, block in enumerate(found):
        if block.kind == "shown":
            block.printed = recent
            continue
        if k and found[k - 1].kind == "shown":
            recent = ""
        if block.kind == "command":
            block.printed = "\n".join(map(run_command, block.text.splitlines()))
        else:
            out = io.StringIO()
            with warnings.catch_warnings(), contextlib.redirect_stdout(out):
                warnings.simplefilter("ignore", InputWarning)
                exec(compile(block.text, str(page), "exec"), names)
            block.printed = out.getvalue()
        recent += block.printed
    for k, block in enumerate(found):  # an error is what the page shows, or the page is wrong
        if block.kind == "command" and "uq-handeye: error:" in block.printed:
            shown = found[k + 1].text if k + 1 < len(found) else ""
            assert "uq-handeye: error:" in shown, block.printed
    return found


def missing(block):
    """The parts of shown output that were not printed; line breaks are the page's own, ``...`` leaves something out."""
    printed = " ".join(block.printed.split())
    parts = [" ".join(part.split()) for part in re.split(r"^\.\.\.$", block.text, flags=re.MULTILINE)]
    return [part for part in parts if part not in printed]
