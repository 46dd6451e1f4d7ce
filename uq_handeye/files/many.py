"""Several files that people name at once: a folder, or a pattern such as ``poses/*.txt``."""

from __future__ import annotations

import glob
import os
import re
from pathlib import Path
from typing import Any

from ..errors import InputError
from .open import shown

MOST = 100_000
# Files in the folder of a ROS bag.
BAGS = (".mcap", ".db3", ".zstd")


def natural(path: Path) -> tuple[Any, ...]:
    """Sorts numbers within names by their value: img2 before img10."""
    parts = re.split(r"(\d+)", str(path))
    return tuple((int(part), "") if k % 2 else (0, part) for k, part in enumerate(parts)), str(path)


def is_many(path: Path) -> bool:
    """Return whether a path means several files: a folder, or a pattern that is no name of a file."""
    return path.is_dir() or (glob.has_magic(str(path)) and not path.exists())


def paths_of(path: Path) -> list[Path]:
    """The files of a folder or a pattern, in the natural order of their names, without hidden ones.

    Raises `InputError` for none, and for a folder whose files have different suffixes.
    """
    if path.is_dir():
        found = [child for child in path.iterdir() if child.is_file() and not child.name.startswith(".")]
        if any(child.name == "metadata.yaml" for child in found) and any(child.suffix in BAGS for child in found):
            raise InputError(
                f"{shown(path)} is a ROS bag: give it as --bag {shown(path)}; uq-handeye bag {shown(path)} lists what "
                "is in it."
            )
        suffixes = sorted({child.suffix.lower() for child in found})
        if len(suffixes) > 1:
            raise InputError(
                f"Expected files of one kind in the folder {shown(path)}, got {', '.join(suffixes[:6])}. Name "
                f"those that are meant by a pattern in quotes, e.g. '{shown(path / ('*' + suffixes[-1]))}'."
            )
    else:
        found = [Path(name) for name in glob.glob(str(path), recursive=True) if not os.path.isdir(name)]
    if not found:
        what = f"No files in the folder {shown(path)}." if path.is_dir() else f"No file matches {shown(path)}."
        raise InputError(f"{what} Check the folder and the ending.")
    if len(found) > MOST:
        raise InputError(f"Expected at most {MOST} files, got {len(found)} by {shown(path)}.")
    return sorted(found, key=natural)
