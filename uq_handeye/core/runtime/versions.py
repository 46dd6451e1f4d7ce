"""Versions of what ran."""

from __future__ import annotations

import platform
from functools import cache
from importlib import metadata

# Packages whose version can change a number of a result.
PACKAGES = ("uq-handeye", "numpy", "scipy")


@cache
def versions() -> dict[str, str]:
    """Python's and those of the packages that can change a number."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # run from a checkout that is not installed
            found[name] = "not installed"
    return found
