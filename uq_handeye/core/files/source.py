"""Origin of numbers: the file of poses, and the versions of the software."""

from __future__ import annotations

import platform
from functools import cache
from typing import NamedTuple


class Source(NamedTuple):
    """One file: its name without folders, format, size and hash, and what was made of it."""

    name: str
    format: str  # one of `uq_handeye.read.FORMATS`
    size: int  # bytes
    sha256: str
    notes: tuple[str, ...] = ()  # what the reader found out by itself, in words


# Packages whose version can change a number of a result.
PACKAGES = ("uq-handeye", "numpy", "scipy")


@cache
def versions() -> dict[str, str]:
    """Python's and those of the packages that can change a number."""
    from importlib import metadata  # slow to import

    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # run from a checkout that is not installed
            found[name] = "not installed"
    return found
