"""Declarations of a file about its own poses: units, form of the rotations, frames and setup, which are believed.

They stand as entries of JSON and YAML (``distance_unit: mm``, ``convention: base2gripper``), also in a map of their
own (``units: {translation: mm, rotation: deg}``), or in comments of a table (``# units: mm``). Names and values are
those of ``declared.toml``; frames are recognised by `pose_name`. What the names of columns say is not replaced.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from ..core.files.pose_names import pose_name
from ..core.files.tree_values import Tree, fields_of
from ..core.files.trees import parse_toml
from ..core.limits import MAX_NAME_CHARACTERS
from ..errors import InputError
from .contents import Contents, Reading, Side
from .rotations import SEQUENCES, rotation_form

# Names of maps within a file that say something of all of it.
ABOUT = ("metadata", "meta", "info", "header", "about", "conventions", "convention", "format", "settings")
_COMMENT = re.compile(r"^\s*(?:#|%|//|;)+\s*([A-Za-z][\w -]{0,40}?)\s*[:=]\s*([^#\n]{1,80})$", re.MULTILINE)


@dataclass
class Declared:
    """Declarations of a file about its poses; None and empty: nothing."""

    units: str | None = None
    angle: str | None = None
    rotation: str | None = None  # form without the unit of angles
    frames: dict[str, str] = field(default_factory=dict)  # by side
    setup: str | None = None

    def take(self, key: str, value: str) -> None:
        """Take one entry, as far as it is known."""
        keys = _table()["keys"]
        key, plain = key.strip().lower().replace(" ", "_"), value.strip().strip("\"'").lower()
        for name in ("units", "angle", "setup"):
            if key in keys[name] and (meant := _meaning(name, plain)) is not None:
                setattr(self, name, meant)
        if key in keys["rotation"] and (form := _form(value.strip().strip("\"'"))) is not None:
            self.rotation = form
        if key in keys["frame"] and (known := pose_name(value.strip().strip("\"'"))) is not None:
            self.frames[known[0]] = known[1]


@cache
def _table() -> dict[str, dict[str, list[str]]]:
    return parse_toml(Path(__file__).with_name("declared.toml"))


def _meaning(name: str, value: str) -> str | None:
    return next((meant for meant, words in _table()[name].items() if value in words), None)


def _form(value: str) -> str | None:
    """Return a form of rotations; of Euler angles the case of the letters says which axes."""
    stem = re.sub(r"(?i)^euler[ _-]*|[ _-]*(?:deg|rad|degrees|radians)$", "", value)
    return stem if stem in SEQUENCES else _meaning("rotation", value.lower())


def of_tree(tree: Tree) -> Declared:
    """Return what the entries of a tree declare."""
    found = Declared()
    for key, value in _texts(tree):
        found.take(key, value)
    return found


def of_comments(head: str) -> Declared:
    """Return what the comments at the beginning of a text declare."""
    found = Declared()
    for match in _COMMENT.finditer(head):
        found.take(match[1], match[2])
    return found


def _texts(tree: Tree) -> Iterator[tuple[str, str]]:
    """Yield the entries of a map, and of maps in it that say something of all of it, that are short texts."""
    for key, value in fields_of(tree).items():
        about = str(key).strip().lower() in (*ABOUT, *_table()["keys"]["units"])
        for inner, one in (fields_of(value).items() if about else ()) or [(key, value)]:
            if isinstance(one, str) and len(one) <= MAX_NAME_CHARACTERS:
                yield str(inner), one


def believed(contents: Contents, said: Declared, name: str) -> Contents:
    """Return contents with what their file declares; raises `InputError` where that contradicts its columns."""
    notes: list[str] = []
    sides = {
        role: _believed(side, said, name, notes)
        for role in ("robot", "camera", "only")
        if (side := getattr(contents, role)) is not None
    }
    setup = contents.setup
    if said.setup is not None and setup is None:
        setup = said.setup
        notes.append(f"{setup}, as the file says")
    if not notes:
        return contents
    return replace(
        contents,
        robot=sides.get("robot"),
        camera=sides.get("camera"),
        only=sides.get("only"),
        setup=setup,
        notes=(*contents.notes, *dict.fromkeys(notes)),
    )


def _believed(side: Side, said: Declared, name: str, notes: list[str]) -> Side:
    if said.units is not None and side.units not in (None, said.units):
        raise InputError(f"{name} declares lengths in {said.units}, and its columns name {side.units}. Correct one.")
    if said.units is not None and side.units is None:
        side = replace(side, units=said.units)
        notes.append(f"lengths in {said.units}, as the file says")
    frame = next((one for one in said.frames.values() if one != side.frame), None)
    if frame is not None and side.frame is None:
        side = replace(side, frame=frame)
        notes.append(f"poses are {frame}, as the file says")
    readings = _readings(side, said)
    if readings != side.readings:
        side = replace(side, readings=readings, others=())
        notes.append(f"rotations are {readings[0].rotation}, as the file says")
    return side


def _readings(side: Side, said: Declared) -> tuple[Reading, ...]:
    """Return the readings of a side that its file leaves."""
    numbers = side.rotation.shape[1]
    if side.rotation.ndim != 2 or (said.rotation is None and said.angle is None):
        return side.readings

    def fits(text: str) -> bool:
        stem, _, unit = text.partition("-")
        return said.rotation in (None, stem) and (not unit or said.angle in (None, unit))

    left = tuple(one for one in side.readings if fits(one.rotation))
    if left or said.rotation is None:
        return left or side.readings
    text = said.rotation if numbers == 4 else f"{said.rotation}-{said.angle or 'rad'}"
    if rotation_form(text).numbers != numbers:
        return side.readings
    units = side.readings[0].units if side.readings else side.units
    return (Reading("table", text, units),)
