"""Files that a pattern such as ``poses/**/*.txt`` matches, with bounds on what is looked at.

As `glob`, but a pattern over a whole disk ends: after so many names, or so long.
"""

from __future__ import annotations

import fnmatch
import glob
import os
import time
from collections.abc import Iterator
from pathlib import Path

from ...errors import InputError
from .open import shown

# Names that a pattern may look at, and seconds that it may take.
MAX_NAMES, MAX_SECONDS = 200_000, 10.0


class _Bounds:
    """Count of the names looked at, and the time."""

    def __init__(self, pattern: Path) -> None:
        self.pattern, self.left, self.until = pattern, MAX_NAMES, time.monotonic() + MAX_SECONDS

    def listed(self, folder: str) -> list[os.DirEntry[str]]:
        """Return the names in a folder; raises `InputError` beyond the bounds."""
        try:
            with os.scandir(folder or os.curdir) as entries:
                found = []
                for entry in entries:
                    self.left -= 1
                    if self.left < 0 or time.monotonic() > self.until:
                        raise InputError(
                            f"{shown(self.pattern)} looks at more than {MAX_NAMES} names, or for more than "
                            f"{MAX_SECONDS:.0f} s. Name the folder of the files."
                        )
                    found.append(entry)
                return found
        except OSError:  # may not be read, or is gone
            return []


def matching(pattern: str) -> list[Path]:
    """Return what a pattern matches: ``*``, ``?`` and ``[...]`` in names, ``**`` for folders below one another.

    Names that begin with a dot are matched where the pattern has the dot; ``**`` does not follow links.
    """
    whole = Path(pattern)
    bounds = _Bounds(whole)
    start, parts = (whole.anchor, whole.parts[1:]) if whole.anchor else ("", whole.parts)
    return [Path(found) for found in _below(start, list(parts), bounds)]


def _below(folder: str, parts: list[str], bounds: _Bounds) -> Iterator[str]:
    if not parts:
        yield folder
        return
    part, rest = parts[0], parts[1:]
    if part == "**":
        yield from _below(folder, rest, bounds) if rest else ([folder] if folder else [])
        for entry in bounds.listed(folder):
            if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False):
                yield from _below(entry.path if folder else entry.name, parts, bounds)
            elif not rest and not entry.name.startswith("."):
                yield entry.path if folder else entry.name
        return
    if not glob.has_magic(part):
        path = os.path.join(folder, part)
        if os.path.lexists(path):
            yield from _below(path, rest, bounds)
        return
    for entry in bounds.listed(folder):
        hidden = entry.name.startswith(".") and not part.startswith(".")
        if not hidden and fnmatch.fnmatch(entry.name, part) and (not rest or entry.is_dir()):
            yield from _below(entry.path if folder else entry.name, rest, bounds)
