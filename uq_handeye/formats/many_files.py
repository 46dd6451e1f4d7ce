"""Poses of a folder or a pattern with one file per pose, read as if they were one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from ..core.files.folders import numbers_in
from ..core.files.open import shown
from ..core.files.source import Source
from ..core.geometry.checks import first_duplicate
from ..errors import InputError
from .contents import Contents, Side


def joined_contents(
    name: str, paths: Sequence[Path], parts: Sequence[tuple[Contents, Source]], left: Sequence[str] = ()
) -> tuple[Contents, Source]:
    """The contents of several files as one, in their order; ``left`` are notes of what is not among them.

    Raises `InputError` for a file that holds more than one pose, and for files of different formats, units or sides, by
    the first name that differs.
    """
    contents, sources = zip(*parts, strict=True)
    for path, one, source in zip(paths, contents, sources, strict=True):
        if any((n := len(getattr(one, role))) != 1 for role in _sides_of(one)):
            raise InputError(
                f"Expected one pose in each file of the folder or pattern {name}, got {n} in {shown(path)}. Give a "
                "file of several poses by its own name."
            )
        same = source.format == sources[0].format and one.setup == contents[0].setup
        if not same or _sides_of(one) != _sides_of(contents[0]):
            raise InputError(
                f"{shown(path)} ({source.format}) is not like {shown(paths[0])} ({sources[0].format}): expected "
                f"files of one format, side and setup in {name}."
            )
    total = sha256()
    for source in sources:
        total.update(bytes.fromhex(source.sha256))
    notes = list(dict.fromkeys(note for source in sources for note in source.notes))[:5]
    notes += left
    names = _names(paths)
    notes.append(f"{len(paths)} files, {shown(Path(names[0]))} to {shown(Path(names[-1]))}, by their names")
    size = sum(source.size for source in sources)
    source = Source(shown(Path(Path(name).name)), sources[0].format, size, total.hexdigest(), tuple(notes))
    joined = {role: _joined(name, paths, [getattr(one, role) for one in contents]) for role in _sides_of(contents[0])}
    return replace(contents[0], **joined, notes=tuple(notes)), source


def _sides_of(contents: Contents) -> list[str]:
    return [role for role in ("robot", "camera", "only") if getattr(contents, role) is not None]


def _joined(name: str, paths: Sequence[Path], sides: Sequence[Side]) -> Side:
    first = sides[0]
    for path, side in zip(paths, sides, strict=True):
        kinds = [(one.rotation.shape[1:], one.order, one.units, one.frame) for one in (first, side)]
        if kinds[0] != kinds[1]:
            raise InputError(
                f"{shown(path)} is not like {shown(paths[0])}: other units, frames or numbers of rotations."
            )
    # Of several readings those are left that hold for every file.
    readings = tuple(reading for reading in first.readings if all(reading in side.readings for side in sides))
    if first.readings and not readings:
        raise InputError(f"The files of {name} leave no common reading of the rotations. Give --format.")
    times = [side.timestamps for side in sides if side.timestamps is not None]
    stamps = np.concatenate(times) if len(times) == len(sides) else None
    if stamps is not None and first_duplicate(stamps) is not None:  # each file counts from 0
        stamps = None
    return replace(
        first,
        name=name,
        translation=np.concatenate([side.translation for side in sides]),
        rotation=np.concatenate([side.rotation for side in sides]),
        timestamps=stamps,
        rows=None,
        readings=readings,
        others=tuple(reading for reading in first.others if all(reading in side.others for side in sides)),
        labels=tuple(shown(Path(one)) for one in _names(paths)),
        covariance=None
        if any(side.covariance is None for side in sides)
        else np.concatenate([side.covariance for side in sides if side.covariance is not None]),
        numbers=numbers_in(one.partition("/")[0] for one in _names(paths)),
    )


def _names(paths: Sequence[Path]) -> list[str]:
    """Return the names of files, with their folders where all have one name."""
    same = len({path.name for path in paths}) == 1 < len(paths)
    return [f"{path.parent.name}/{path.name}" if same else path.name for path in paths]
