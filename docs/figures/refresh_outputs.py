"""Refresh the outputs that the documentation shows.

    python docs/figures/refresh_outputs.py [--printed FOLDER] [PAGE ...]

Runs the commands and Python blocks of each page as `tests/test_docs.py` does (all pages with shown output if none is
named, such as `docs/how-to/ros.md`) and writes what is printed now in place of what is shown. Parts of a block between
lines with "..." are replaced by the lines of the new output that resemble them most; a part without such lines stays
as it is and is named, and the exit status is 1. With --printed, the whole output of each block goes to
FOLDER/PAGE_NUMBER.txt. Read the difference (`git diff docs`) before you commit it: the sentences around an output may
quote it. Needs the extra `test`.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from fixtures.pages import FLAGS, SHOWN, Block, missing, prepare, run_page  # noqa: E402

ALIKE = 0.45  # least share of words that two texts have in common, for one to replace the other
WIDTH = 120


def words(text: str) -> list[str]:
    """Return the words of a text, numbers alike."""
    return re.sub(r"\d+(\.\d+)?(e[+-]?\d+)?", "0", text).split()


def windows(lines: Sequence[str], longest: int) -> Iterator[tuple[int, int, list[str]]]:
    """Yield each run of lines (first, end) with its words, up to a number of words."""
    for first in range(len(lines)):
        found: list[str] = []
        for end in range(first + 1, len(lines) + 1):
            found = found + words(lines[end - 1])
            if lines[first].strip() and lines[end - 1].strip():
                yield first, end, found
            if len(found) > longest:
                break


def replacement(part: str, lines: Sequence[str]) -> tuple[int, int] | None:
    """Return the run of printed lines (first, end) that resembles a part most, or None."""
    wanted = Counter(words(part))
    size = sum(wanted.values())
    best, found = ALIKE, None
    for first, end, got in windows(lines, 2 * size + 20):
        alike = 2 * (wanted & Counter(got)).total() / (size + len(got))
        if alike > best:
            best, found = alike, (first, end)
    if found and part.rstrip().endswith((".", ":")):  # whole sentences
        first, end = found
        while end < len(lines) and lines[end].strip() and not lines[end - 1].rstrip().endswith((".", ":")):
            end += 1
        found = first, end
    return found


def refreshed(block: Block) -> tuple[str, list[str]]:
    """Return the text of a shown block as it is printed now, and the parts that have no counterpart."""
    lines = block.printed.splitlines()
    pieces = re.split(r"^(\.\.\.\n)", block.text, flags=re.MULTILINE)
    wrong, start = missing(block), 0
    lost = []
    for k, piece in enumerate(pieces):
        if " ".join(piece.split()) not in wrong:
            continue
        found = replacement(piece, lines[start:]) or replacement(piece, lines)
        if found is None:
            lost.append(piece)
            continue
        taken = lines[start:][slice(*found)]
        start += found[1]
        if any(len(line) > WIDTH for line in taken):
            taken = textwrap.wrap(" ".join(taken), WIDTH)
        pieces[k] = "".join(f"{line.rstrip()}\n" for line in taken)
    return "".join(pieces), lost


def refresh(page: Path, printed: Path | None) -> int:
    """Rewrite the shown blocks of a page, and return the number of parts that a person must look at."""
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)
        prepare(page, Path(scratch))
        found = run_page(page, check=False)
        os.chdir(ROOT)
    text, count = page.read_text(encoding="utf-8"), 0
    blocks = iter(enumerate(found))

    def rewritten(match: re.Match[str]) -> str:
        nonlocal count
        k, block = next(blocks)
        if printed and block.printed:
            printed.mkdir(parents=True, exist_ok=True)
            (printed / f"{page.stem}_{k:02d}_{block.kind}.txt").write_text(block.printed, encoding="utf-8")
        if block.kind != "shown":
            return match[0]
        new, lost = refreshed(block)
        for part in lost:
            count += 1
            print(f"{page.relative_to(ROOT)}: nothing printed resembles:\n{textwrap.indent(part, '    ')}", flush=True)
        return f"```{match[1]}\n{new}```"

    changed = re.sub(r"^```(text|python)\n(.*?)^```", rewritten, text, flags=FLAGS)
    if changed != text:
        page.write_text(changed, encoding="utf-8")
        print(f"{page.relative_to(ROOT)}: refreshed", flush=True)
    return count


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="page (default: all with shown output)")
    parser.add_argument("--printed", type=Path, metavar="FOLDER", help="folder for the whole output of each block")
    given = parser.parse_args()
    printed = given.printed and given.printed.resolve()
    pages = [page.resolve() for page in given.pages] or [ROOT / page for page in SHOWN]
    sys.exit(1 if sum(refresh(page, printed) for page in pages) else 0)


if __name__ == "__main__":
    main()
