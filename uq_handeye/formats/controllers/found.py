"""Poses that stand in a robot's program, as one side of a pose file."""

from __future__ import annotations

import re
import warnings
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ...core.files.lines import MAX_ROWS, floats
from ...errors import InputError, InputWarning
from ..contents import Contents, Side
from ..number_table import NUMBER
from .forms import PoseForm
from .readings import interpret
from .tables import HELP

# One number, or what a controller or a program writes in its place.
VALUE = rf"(?:{NUMBER}|\*+|[+-]?(?:nan|inf)\b)"
# Joint targets hold no pose.
JOINTS = (
    "joint values hold no pose: give them by --joints with --urdf or --dh, or let the controller convert them "
    f"to positions; {HELP}"
)


@dataclass
class Found:
    """Poses of a program in their order.

    Parameters
    ----------
    lines : line of each
    labels : name of each, or ""
    numbers : x, y, z and the rotation of each
    joints : joint targets that were met
    tools : tool and frame of each, where the program names them
    notes : what was found out
    """

    lines: list[int] = field(default_factory=list)
    labels: list[str] = field(default_factory=list)
    numbers: list[Sequence[float]] = field(default_factory=list)
    joints: int = 0
    tools: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, line: int, label: str, values: Sequence[str], name: str) -> None:
        """Add a pose; raises `InputError` for a value that is no number."""
        if (numbers := floats(values)) is None:
            wrong = next(value for value in values if floats([value]) is None)
            raise InputError(
                f"{name}, line {line}: expected a number in the pose {label}, got {wrong[:20]!r}; leave out poses "
                "that were not taught, on both sides."
            )
        if len(self.lines) >= MAX_ROWS:
            raise InputError(f"{name}, line {line}: expected at most {MAX_ROWS} poses; split the file.")
        self.lines.append(line)
        self.labels.append(label)
        self.numbers.append(numbers)


class Lines:
    """Line numbers of places in a text."""

    def __init__(self, text: str) -> None:
        self.ends = [match.start() for match in re.finditer("\n", text)]

    def at(self, place: int) -> int:
        """Return the number of the line, from 1."""
        return bisect_right(self.ends, place - 1) + 1


def contents_of(found: Found, name: str, form: PoseForm, length: str | None = None, sure: bool = True) -> Contents:
    """Return the poses of a program in the convention of its maker, or, unless ``sure``, of those that it may have.

    Raises `InputError` where there are none, and says so where there are joint targets instead.
    """
    if not found.lines:
        if found.joints:
            raise InputError(f"{name}: got joint targets ({found.joints}) and no positions; {JOINTS}.")
        raise InputError(f"{name}: expected poses as {form.maker} writes them, got none; {HELP}.")
    used = Counter(found.tools)
    if len(used) > 1:
        warnings.warn(
            f"{name}: the poses are of several tools or frames: "
            f"{', '.join(f'{tool} ({count} poses)' for tool, count in used.most_common(6))}. Give poses of one tool in "
            f"one frame ({HELP}).",
            InputWarning,
            stacklevel=2,
        )
    numbers = np.array(found.numbers, dtype=float)
    translation, rotation = numbers[:, :3], numbers[:, 3:]
    angle = form.rotation[-3:] if form.rotation[-3:] in ("deg", "rad") else None
    known = form if sure else None
    read = interpret("unsaid", translation, rotation, known, length, None if form.name == "ur" else angle)
    notes = [*found.notes, *read.notes]
    if found.joints:
        notes.append(f"joint targets left out: {found.joints}")
    labels = tuple(
        f"line {line}" + (f" ({label})" if label else "") for line, label in zip(found.lines, found.labels, strict=True)
    )
    if any(found.labels):
        notes.append(f"{len(labels)} poses, {found.labels[0] or labels[0]} to {found.labels[-1] or labels[-1]}")
    columns = ("timestamp", "x", "y", "z", *form.columns)
    rows = np.array(found.lines, dtype=np.int64)
    side = Side(
        name, translation, rotation, None, rows, "line", "xyzw", columns, units=length, readings=read.readings,
        labels=labels,
    )  # fmt: skip
    return Contents(only=side, notes=tuple(notes))
