"""The first screen of a calibration: the answer, the checks and X, on 26 lines of 80 columns.

It shows the statement of the calibration (`statement`): how accurate X is, which tolerance of a point it meets, what
limits it, a line of checks with those that are not ok, X, and the most useful next step. Everything else is in the long
text (`text`) and the report.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

import numpy as np

from ...core.geometry.se3 import Array
from ...core.presentation.document import (
    COLUMNS,
    Answer,
    Block,
    Checks,
    Code,
    Document,
    Heading,
    Paragraph,
    Table,
    to_text,
)
from ...core.presentation.numbers import fixed
from ..accuracy import Accuracy, combined_parts, limit_of, suits_of
from ..result import Calibration
from ..tolerance import NO_VERDICTS, Verdict
from .answer import Answered, verdict_blocks
from .arm import frame_words
from .budget import WITHIN_95

# Lines of a terminal: where the first screen has more, it has no empty ones.
LINES = 26
# Rows of the table of parts; smaller parts are combined.
MAX_PARTS_SHOWN = 4


def first_screen(
    result: Calibration,
    *,
    verdicts: Mapping[str, Verdict] = NO_VERDICTS,
    last: Sequence[str] = (),
    width: int = COLUMNS,
) -> Document:
    """Return the first screen as a document: title, answer, checks, X, and what comes next.

    Parameters
    ----------
    verdicts : mapping of the name of the camera to Verdict
        Shown below the headline where a tolerance was given.
    last : sequence of str
        Last paragraphs: the files written and the next step.
    width : int
        Of the text.
    """
    facts = frame_words(result)
    groups: list[Sequence[Block]] = [
        [Heading(title_of(result, width)), *answer_blocks(result, verdicts)],
        [checks_in_short(result)],
        [*([Paragraph(facts, hang="  ")] if facts else []), *(split_blocks(result) or x_blocks(result, width))],
        [Paragraph(text, hang="  ") for text in last],
    ]
    document: Document = [list(group) for group in groups if group]
    if to_text(document, width).count("\n") <= LINES:
        return document
    return [[block for group in groups for block in group]]


# -------------------------------------------------------------------------------------------------------- the parts


def title_of(result: Calibration, width: int = COLUMNS) -> str:
    """Return the title line, e.g. ``gripper_T_camera from robot.csv, camera.csv: 25 poses``."""
    return title_line(result.frame, source_names(result), fit_words(result), width)


def title_line(subject: str, names: Sequence[str], end: str, width: int = COLUMNS) -> str:
    """Return the title line of any result: what it is of, from files of which names, and how it was made."""
    start = f"{subject} from "
    files = file_words(names, max(width - len(start) - len(end) - 2, 12))
    return _cut(start + (f"{files}: {end}" if files else end), width)


def source_names(result: Calibration) -> list[str]:
    """Return the names of the files of a result."""
    return [] if result.provenance is None else [source.name for source in result.provenance.sources]


def fit_words(result: Calibration) -> str:
    """Return the number of data, the setup and the method of the fit."""
    parts = [
        data_words(result),
        *([] if result.setup is None else [result.setup]),
        result.method + ("" if result.scale is None else f" (d = {result.scale:g})"),
    ]
    return ", ".join(parts)


def file_words(names: Iterable[str], room: int = 70) -> str:
    """Return the names of files in ``room`` characters, the last ones by their number; empty without files."""
    names = list(dict.fromkeys(names))
    shown = ", ".join(names)
    for count in range(len(names) - 1, 0, -1):
        if len(shown) <= room:
            break
        shown = f"{', '.join(names[:count])} + {len(names) - count} more"
    return _cut(shown, room)


def data_words(result: Calibration) -> str:
    """Return how many data the fit is of: ``22 of 25 poses`` where some are excluded."""
    if result.n_poses is None:
        return f"{result.n_pairs:,} motions"
    of = f" of {result.n_poses + len(result.excluded):,}" if result.excluded else ""
    return f"{result.n_poses:,}{of} poses"


def _cut(text: str, width: int) -> str:
    """Return text with its middle left out where it is too long."""
    if len(text) <= width:
        return text
    left = (width - 3 + 1) // 2
    return f"{text[:left]}...{text[len(text) - (width - 3 - left) :]}"


def answer_blocks(result: Calibration, verdicts: Mapping[str, Verdict] = NO_VERDICTS, why: bool = True) -> list[Block]:
    """Return the headline, the verdict on a tolerance or the tolerance that X meets, and with ``why`` what limits X, or
    why it is not usable.
    """
    blocks: list[Block] = [Answer(result.headline, result.status)]
    if verdicts:
        blocks += verdict_blocks(result, verdicts)
    elif (suits := suits_of(result)) is not None:
        blocks.append(Paragraph(suits))
    if why:
        blocks += [Paragraph(str(one)) for one in result.cautions[:1] if one.severity == "failure"]
        if (limit := limit_of(result)) is not None:
            blocks.append(Paragraph(limit))
    return blocks


def accuracy_blocks(result: Calibration, most: int = MAX_PARTS_SHOWN) -> list[Block]:
    """Return the largest parts of the accuracy, and the errors not included; nothing where X is not usable."""
    accuracy = result.accuracy
    if accuracy is None or result.reasons:
        return []
    blocks: list[Block] = []
    if accuracy.parts:
        blocks.append(parts_table(accuracy, most))
    else:
        blocks.append(Paragraph(f"Includes {', '.join(accuracy.included)}.", hang="  "))
    if accuracy.not_included:
        blocks.append(Paragraph(f"Not included: {', '.join(accuracy.not_included)}.", hang="  "))
    return blocks


def parts_table(accuracy: Accuracy, most: int = MAX_PARTS_SHOWN) -> Table:
    """Return the parts of the accuracy, largest first and those beyond ``most`` combined, with what holds 95 %."""
    rows = [[name, *_sizes(move, turn)] for name, move, turn in combined_parts(accuracy.parts, most, sized=True)]
    rows.append([WITHIN_95, *_sizes(accuracy.translation_95, accuracy.rotation_95)])
    return Table("", ["1 sigma, worst direction", "mm", "deg"], rows)


def _sizes(translation: float, rotation: float) -> list[str]:
    turn = float(np.degrees(rotation))
    return [fixed(1e3 * translation, 2) if translation >= 1e-7 else "0", fixed(turn, 2) if turn >= 1e-5 else "0"]


def checks_in_short(result: Answered) -> Checks:
    """Return the checks that are not ok as in `checks_block`, and the others in one line."""
    rows = [row for row in checks_block(result).rows if row[0] not in ("ok", "not run")]
    ok, not_run = ([one.name for one in result.checks if one.status == status] for status in ("ok", "not run"))
    left = f"not run: {', '.join(not_run)}" if not_run else ""
    if ok:
        rest = "others" if rows else "checks"
        rows.append(("ok", rest, "; ".join(filter(None, [f"{', '.join(ok)}", left]))))
    elif left:
        rows.append(("not run", "others" if rows else "checks", ", ".join(not_run)))
    return Checks(rows)


def checks_block(result: Answered) -> Checks:
    """Return the checks, first those that are not ok, by their effect on X; equal ones share a line.

    Statements of the headline are not repeated.
    """
    order = {id(finding): k for k, finding in enumerate(result.cautions)}
    ranks = {
        check.name: min((order.get(id(f), len(order)) for f in check.findings), default=len(order))
        for check in result.checks
    }
    rows = []
    for (status, text), alike in groupby(
        sorted(result.checks, key=lambda check: ranks[check.name]), lambda check: (check.status, check.text)
    ):
        of_text = list(alike)
        said = any(one.phrase in result.reasons[:1] for check in of_text for one in check.findings[:1])
        rows.append((status, ", ".join(check.name for check in of_text), "as the headline says" if said else text))
    return Checks(rows)


def x_blocks(result: Calibration, width: int = COLUMNS) -> list[Block]:
    """Return X: its six numbers with standard uncertainties, and the 4x4."""
    X, lines = result.facts.X, list[str]()
    long, short = [fact.plus_minus for fact in X], [fact.bare for fact in X]
    for forms, gap in ((long, "   "), (long, "  "), (short, "  "), (short, " ")):
        lines = [
            f"{label}  {gap.join(f'{axis} {form}' for axis, form in zip('xyz', part, strict=True))} {unit}"
            for label, part, unit in (
                ("translation    ", forms[:3], "mm"),
                ("rotation vector", forms[3:], "deg"),
            )
        ]
        if max(map(len, lines)) <= width:
            break
    return [Code("", "\n".join(lines), ""), matrix_block(result.X, width)]


def split_blocks(result: Calibration) -> list[Block]:
    """Return the poses before and after a move, where there was one: X of all poses together is neither.

    From which pose on it moved, and by how much, is said by the finding (`rig.moved`).
    """
    rows = [
        [frame, ", ".join(numbers[:3]), *numbers[3:]]
        for frame, *numbers in result.facts.rows({one.frame: one.name for one in result.split})
    ]
    return [Table("", ["before and after the move", "x, y, z (mm)", "+- mm", "deg"], rows)] if rows else []


def matrix_block(T: Array, width: int = COLUMNS) -> Code:
    """Return the 4x4 as lines of numbers (m), with nine decimals where they fit."""
    small = np.where(np.abs(T) < 5e-10, 0.0, T) + 0.0
    places = 9 if width >= 60 else 6
    return Code("", "\n".join(" ".join(f"{x:{places + 5}.{places}f}" for x in line) for line in small), "")
