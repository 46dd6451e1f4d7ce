"""The file that poses came from."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """One file: its name without folders, format, size and hash, and what was made of it."""

    name: str
    format: str  # one of `uq_handeye.read.FORMATS`
    size: int  # bytes
    sha256: str
    notes: tuple[str, ...] = ()  # what the reader found out by itself, in words
