"""The poses that a program or data file of a controller holds, collected while its text is read."""

from __future__ import annotations

import re
import warnings
from bisect import bisect_right
from collections import Counter
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from ...core.files.lines import floats
from ...core.limits import MAX_NAME_CHARACTERS, MAX_ROWS
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


class ProgramPoses:
    """Poses of a program, in their order: line, name or "", and the joint targets, tools and notes met between them."""

    def __init__(self, text: str, name: str) -> None:
        self.text, self.name = text, name
        self.poses: list[tuple[int, str, list[float]]] = []
        self.joints = 0  # joint targets that were met
        self.tools: list[str] = []  # tool and frame of each pose, where the program names them
        self.notes: list[str] = []

    @cached_property
    def _ends(self) -> list[int]:
        return [match.start() for match in re.finditer("\n", self.text)]

    def line(self, place: int) -> int:
        """Return the number of the line of a place in the text, from 1."""
        return bisect_right(self._ends, place - 1) + 1

    def before(self, match: re.Match[str]) -> str:
        """Return what stands before a match in its line."""
        start = self.text.rfind("\n", 0, match.start()) + 1
        return self.text[max(start, match.start() - MAX_NAME_CHARACTERS) : match.start()]

    def add(self, line: int, label: re.Match[str] | None, values: Sequence[str], named: str = "") -> None:
        """Add a pose; raises `InputError` for a value that is no number."""
        named = named if label is None else label[1]
        if (numbers := floats(values)) is None:
            wrong = next(value for value in values if floats([value]) is None)
            raise InputError(
                f"{self.name}, line {line}: expected a number in the pose {named}, got {wrong[:20]!r}; leave out poses "
                "that were not taught, on both sides."
            )
        if len(self.poses) >= MAX_ROWS:
            raise InputError(f"{self.name}, line {line}: expected at most {MAX_ROWS} poses; split the file.")
        self.poses.append((line, named, numbers))

    def note(self, count: int, words: str) -> None:
        """Say what was left out, if something was."""
        if count:
            self.notes.append(f"{count} {words}")

    def contents(self, form: PoseForm, length: str | None, sure: bool) -> Contents:
        """Return the poses in the convention of their maker, or, unless ``sure``, of those that it may have.

        Raises `InputError` where there are none, and says so where there are joint targets instead.
        """
        name = self.name
        if not self.poses:
            if self.joints:
                raise InputError(f"{name}: got joint targets ({self.joints}) and no positions; {JOINTS}.")
            raise InputError(f"{name}: expected poses as {form.maker} writes them, got none; {HELP}.")
        used = Counter(self.tools)
        if len(used) > 1:
            warnings.warn(
                f"{name}: the poses are of several tools or frames: "
                f"{', '.join(f'{tool} ({count} poses)' for tool, count in used.most_common(6))}. Give poses of one "
                f"tool in one frame ({HELP}).",
                InputWarning,
                stacklevel=2,
            )
        lines, names, rows = zip(*self.poses, strict=True)
        numbers = np.array(rows, dtype=float)
        translation, rotation = numbers[:, :3], numbers[:, 3:]
        angle = form.rotation[-3:] if form.rotation.endswith("-deg") else None
        readings, said, _ = interpret("unsaid", translation, rotation, form if sure else None, length, angle)
        notes = [*self.notes, *said]
        if self.joints:
            notes.append(f"joint targets left out: {self.joints}")
        labels = [f"line {line}" + (f" ({one})" if one else "") for line, one in zip(lines, names, strict=True)]
        if any(names):
            notes.append(f"{len(labels)} poses, {names[0] or labels[0]} to {names[-1] or labels[-1]}")
        side = Side(
            name, translation, rotation, None, np.array(lines, dtype=np.int64), "line", "xyzw",
            ("timestamp", "x", "y", "z", *form.columns), units=length, readings=readings, labels=tuple(labels),
        )  # fmt: skip
        return Contents(only=side, notes=tuple(notes))


def fields_of_list(text: str) -> list[str]:
    return [value.strip() for value in re.split("[,;]", text)]
