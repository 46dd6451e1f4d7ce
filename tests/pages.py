"""Pages of the documentation, run as a reader would: their commands and Python blocks, in order, in one folder.

A block ```` ```text ```` whose first line starts with ``uq-handeye`` holds commands, one per line; any other such block
shows what the blocks before it printed; ```` ```python ```` is executed, all blocks of a page in one namespace. Other
blocks (``bash``, ``py``, ...) are not run. `python docs/figures/refresh_outputs.py` writes what is printed into pages.
"""

import contextlib
import io
import re
import shlex
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from picture_cases import write_pictures
from support import SEED

from uq_handeye import Board, InputWarning
from uq_handeye.cli.app import main

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FLAGS = re.DOTALL | re.MULTILINE

# Pages whose shown output is compared, in full or by lines with "..." between them.
SHOWN = [
    "README.md",
    "docs/tutorial/signed_off_report.md",
    *(
        f"docs/how-to/{name}.md"
        for name in (
            "camera",
            "certificate",
            "check",
            "cluster",
            "codegen",
            "controller",
            "eye_to_hand",
            "kinematics",
            "looks_wrong",
            "opencv",
            "points",
            "rig",
            "rig_cell",
            "rig_moved_board",
            "rig_two_arms",
            "rig_two_cameras",
            "ros",
            "shared_errors",
            "update",
            "validation",
            "verify",
            "which_poses",
        )
    ),
]


@dataclass
class Block:
    """One block of a page; ``printed`` is what it printed, for shown output what the blocks before it did."""

    kind: str  # command, python or shown
    text: str
    printed: str = ""


def blocks(page):
    """The blocks of a page that are run or compared."""
    found = re.findall(r"^```(text|python)\n(.*?)^```", page.read_text(encoding="utf-8"), FLAGS)
    kinds = (
        "python" if tag == "python" else "command" if text.startswith("uq-handeye ") else "shown" for tag, text in found
    )
    return [Block(kind, text) for kind, (_, text) in zip(kinds, found, strict=True)]


def run_command(line):
    """Return what a command prints, both streams; it must end well, or say in words why X cannot be used."""
    out, err = io.StringIO(), io.StringIO()
    program, *arguments = shlex.split(line)
    assert program == "uq-handeye"
    streams = contextlib.redirect_stdout(out), contextlib.redirect_stderr(err)
    with warnings.catch_warnings(), streams[0], streams[1], pytest.raises(SystemExit) as end:
        main(arguments)
    code, printed = end.value.code, out.getvalue() + err.getvalue()
    reasons = {2: "uq-handeye: error:", 3: "NOT USABLE", 5: " lies within ", 6: "Not determined: "}
    assert code in (0, None) or reasons[code] in " ".join(printed.split()), printed
    return printed


def prepare(page, folder):
    """Write the pictures and robot poses that a page starts from."""
    if "--images 'img/" in page.read_text(encoding="utf-8"):
        write_pictures(folder, Board(9, 6, 0.02), np.random.default_rng([SEED, 8]), n=8)


def run_page(page, check=True):
    """Run a page in the current folder and return its blocks with what was printed.

    With ``check`` a command may only fail where the page shows the error.
    """
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
    for k, block in enumerate(found):
        if check and block.kind == "command" and "uq-handeye: error:" in block.printed:
            shown = found[k + 1].text if k + 1 < len(found) else ""
            assert "uq-handeye: error:" in shown, block.printed
    return found


def missing(block):
    """Return the parts of shown output that were not printed; line breaks do not count, ``...`` leaves lines out."""
    printed = " ".join(block.printed.split())
    parts = [" ".join(part.split()) for part in re.split(r"^\.\.\.$", block.text, flags=re.MULTILINE)]
    return [part for part in parts if part not in printed]
