"""Matrices in text: a line per pose, or lines of four numbers, as people, NumPy, MATLAB, Eigen and KITTI write them.

One line: 16 numbers of a 4x4, 12 of its first three rows (KITTI odometry: devkit ``readme.txt``), or 9 + 3 of rotation
and translation, also with a row number or a time in front, with names of columns above (`columns`) or without. Several
lines: 4 lines of 4 numbers, 3 lines of 4, or any other division, such as that of ``print`` in Python. Brackets, commas,
semicolons, names (``T1 =``), labels and comments (``#``, ``%``, ``//``) do not matter. A transposed matrix is
recognised by the places of its numbers (`layout`).
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...core.files.trees import is_json
from ...core.geometry.se3 import Array
from ...core.limits import HEAD_BYTES, MIN_POSES
from ...errors import InputError
from ..contents import Contents
from .layout import COUNTS, MAX_NUMBERS_BEFORE, fitting, matrices_in
from .matrix_contents import HELP, contents_of
from .named_columns import names_matrices, read_columns
from .number_lines import NotNumbersError, NumberLine, number_lines

_PER_LINE = tuple(count + before for count in COUNTS for before in range(MAX_NUMBERS_BEFORE + 1))
_YAML = re.compile(r"^\s*(- |---\s*$|%YAML)|^\s*\{\s*([\"'A-Za-z]|$)")
# An entry of YAML that holds a list, or an item of a list.
_ENTRY = re.compile(r"^\s*(- )*[\"']?\w+[\"']?\s*:\s*([\[{][^\]}\n]*,|\n\s*- )", re.MULTILINE)


def is_matrix_text(head: str) -> bool:
    """Return whether a text is of numbers of matrices, and of no other format."""
    if head.lstrip()[:1] == "<" or is_tree(head):
        return False
    if names_matrices(head):
        return True
    cut = len(head) > 0.9 * HEAD_BYTES  # characters of more than one byte
    lines: list[NumberLine] = []
    try:
        for line in number_lines(head[: head.rfind("\n")] if cut and "\n" in head else head, ""):
            lines.append(line)
    except NotNumbersError as error:
        return error.printed_once or _begins(lines)
    lines = _without_names(lines)
    if not lines:
        return False
    counts = {len(line.values) for line in lines}
    if len(counts) == 1:
        (count,) = counts
        table = np.array([line.values for line in lines])
        if count == 12 and len(lines) >= MIN_POSES and not (fitting(table) or _almost_matrices(table)):
            return not np.ptp(table, axis=0).any()  # else the poses of robot and camera, of six numbers each
        if count in COUNTS:
            # 9E9 in a robtarget or a jointtarget of ABB says "no external axis"
            return bool(np.abs(table).max() < 1e8) or not np.isfinite(table).all()
        if count in _PER_LINE:
            return fitting(table)
        if count == 4 and len(lines) >= 3:
            return True
        if count > 3:  # all matrices on one line, or poses of other forms
            return any(count >= 2 * one and fitting(table[:1, :one]) for one in COUNTS)
    blocks = _blocks(lines)
    return (blocks is not None and fitting(blocks[0])) or _begins(lines[:-1])


def _almost_matrices(table: Array) -> bool:
    """Return whether most rows (n, 12) hold three vectors of a length near 1, as a damaged rotation does."""
    with np.errstate(all="ignore"):
        lengths = np.linalg.norm(table.reshape(-1, 3, 4)[:, :, :3], axis=2)
    return bool(np.median(np.abs(lengths - 1.0)) < 0.2)


def _begins(lines: Sequence[NumberLine]) -> bool:
    """Return whether a text that is damaged further on begins with matrices."""
    if not lines:
        return False
    if len(lines[0].values) in _PER_LINE:
        return fitting(np.array([lines[0].values]))
    rows = [line.values for line in lines[:5] if len(line.values) == 4][:4]
    flat = np.array(rows).reshape(1, -1)
    return len(lines[0].values) <= 4 and any(flat.shape[1] >= count and fitting(flat[:, :count]) for count in COUNTS)


def _without_names(lines: Sequence[NumberLine]) -> list[NumberLine]:
    """The lines without numbers of columns, as pandas writes them above."""
    counted = len(lines) > 1 and len(lines[0].values) > 2 and lines[0].values == tuple(range(len(lines[0].values)))
    return list(lines[1:] if counted else lines)


def is_tree(head: str) -> bool:
    """Return whether a text is JSON or YAML."""
    first = next((line for line in head.split("\n", 200) if line.strip() and not line.lstrip().startswith("#")), "")
    if _YAML.match(first) or _ENTRY.search(head):
        return True
    return head.lstrip().startswith("[") and is_json(head)


def read_matrix_text(text: str, name: str) -> Contents:
    """Return the poses of a text."""
    if names_matrices(text):
        return read_columns(text, name)
    lines = list(number_lines(text, name))
    if not lines:
        raise InputError(f"{name}: expected numbers of matrices, got none ({HELP}).")
    lines = _without_names(lines)
    counts = {len(line.values) for line in lines}
    if len(counts) == 1 and (count := next(iter(counts))) in _PER_LINE:
        table = np.array([line.values for line in lines])
        numbers = np.array([line.line for line in lines])
        found = matrices_in(table)
        if found is None:
            raise _no_layout(table[0], f"{name}, line {lines[0].line}", count)
        return contents_of(found, name, numbers, "line")
    if (blocks := _blocks(lines)) is None:
        raise _uneven(lines, name)
    table, numbers, note = blocks
    found = matrices_in(table)
    if found is None:
        raise _no_layout(table[0], f"{name}, line {numbers[0]}", table.shape[1])
    return contents_of(found, name, numbers, "the matrix of line", note)


def _blocks(lines: Sequence[NumberLine]) -> tuple[Array, NDArray[np.int64], str] | None:
    """Numbers (n, 16) or (n, 12) of matrices over several lines, the line where each begins, what is to be said."""
    fours = [line for line in lines if len(line.values) == 4]
    few = [line for line in lines if len(line.values) < 4]
    note = ""
    if fours and few and len(fours) + len(few) == len(lines):
        note = "the numbers between the matrices are not used"
        for rows in (4, 3):
            groups = _groups(lines, rows)
            if groups is not None and fitting(groups[0]):
                return *groups, note
    flat = np.concatenate([line.values for line in lines])
    owners = np.repeat([line.line for line in lines], [len(line.values) for line in lines])
    first = None
    for count in COUNTS:
        if len(flat) % count == 0:
            table = flat.reshape(-1, count)
            begins = owners[::count]
            if fitting(table):
                return table, begins, ""
            first = first or ((table, begins, "") if {len(line.values) for line in lines} == {4} else None)
    return first


def _groups(lines: Sequence[NumberLine], rows: int) -> tuple[Array, NDArray[np.int64]] | None:
    """Matrices of ``rows`` lines of four numbers, with lines of fewer numbers before them only."""
    matrices: list[list[float]] = []
    begins: list[int] = []
    for line in lines:
        whole = not matrices or len(matrices[-1]) == 4 * rows
        if len(line.values) < 4:
            if not whole:
                return None
            continue
        if whole:
            matrices.append([])
            begins.append(line.line)
        matrices[-1] += line.values
    if not matrices or len(matrices[-1]) != 4 * rows:
        return None
    return np.array(matrices), np.array(begins)


def _no_layout(row: Array, where: str, count: int) -> InputError:
    numbers = ", ".join(f"{value:g}" for value in row[-4:])
    if count - 16 in range(MAX_NUMBERS_BEFORE + 1):
        return InputError(
            f"{where}: expected a matrix 4x4 whose last row (or, column by column, every fourth number) is 0, 0, 0, 1; "
            f"the numbers end with {numbers} ({HELP})."
        )
    return InputError(
        f"{where}: expected 12 numbers of a matrix 3x4, or of a rotation and a translation, got no rotation among "
        f"them; the numbers end with {numbers}. Are digits lost, or is it another table ({HELP})?"
    )


def _uneven(lines: Sequence[NumberLine], name: str) -> InputError:
    """Return the error of lines that do not divide into matrices."""
    counts = [len(line.values) for line in lines]
    usual = max(set(counts), key=counts.count)
    if usual == 4 and set(counts) == {4}:
        over = len(lines) % 4
        return InputError(
            f"{name}: expected 4 lines of 4 numbers for each matrix (or 3), got {len(lines)} lines; the last one "
            f"has {over}, line {lines[-over].line} and after. Is the file cut off ({HELP})?"
        )
    odd = next((line for line in lines if len(line.values) != usual), lines[-1])
    if usual in (*_PER_LINE, 4):
        return InputError(
            f"{name}, line {odd.line}: expected {usual} numbers as in the other lines, got {len(odd.values)}. Is the "
            f"file cut off ({HELP})?"
        )
    return InputError(
        f"{name}, line {odd.line}: expected matrices of 16 or 12 numbers, on one line or in rows of 4, got "
        f"{len(odd.values)} numbers ({HELP})."
    )
