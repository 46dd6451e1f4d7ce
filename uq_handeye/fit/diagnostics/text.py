"""Tables of poses and of points in words, with units."""

from __future__ import annotations

import numpy as np

from ...core.formatting.numbers import column, concise, digits
from ...core.presentation.document import Document, Paragraph, Table, document_of
from .pose_table import PoseTable
from .task_space import PointUncertainty

# Rows that are shown at first; of more, those with the largest d^2.
FIRST, MOST = 12, 100


@document_of.register(PoseTable)
def pose_table_document(table: PoseTable) -> Document:
    """Return a sentence, the rows with the largest d^2, and all rows."""
    if not len(table):
        return [[Paragraph(f"No {table.item}s.")]]
    rows = _rows(table)
    few = len(table) <= FIRST
    worst = np.argsort(-table.distance2, kind="stable")[:FIRST].tolist() if not few else range(len(table))
    caption = "" if few else f"The {FIRST} with the largest d^2"
    what = f"d^2: squared distance from the prediction of the other {table.item}s, in standard deviations"
    shown = [_table(table, caption, [rows[k] for k in worst])]
    first = [Paragraph(f"{table.counts}. {what}; limit {table.limit:.3g}."), *shown]
    if few:
        return [first]
    more = f" (the first {MOST})" if len(table) > MOST else ""
    return [first, [_table(table, f"All {len(table):,} {table.item}s{more}", rows[:MOST])]]


def _rows(table: PoseTable) -> list[list[str]]:
    columns = [np.degrees(table.rotation), 1e3 * table.translation, table.distance2]
    return [
        [str(k), *numbers, f"{100 * table.leverage[k]:.1f}", table.status(k)]
        for k, numbers in enumerate(zip(*map(column, columns), strict=True))
    ]


def _table(table: PoseTable, caption: str, rows: list[list[str]]) -> Table:
    head = [table.item, "rotation", "translation", "d^2", "leverage", "status"]
    marked = frozenset(k for k, row in enumerate(rows) if row[-1] != "kept")
    return Table(caption, head, rows, frozenset({5}), marked, units=["", "deg", "mm", "", "%", ""])


@document_of.register(PointUncertainty)
def points_document(found: PointUncertainty) -> Document:
    """Return a row per point: coordinates with standard deviations, and the radius that holds 95 %."""
    points, std, radius = found.points.reshape(-1, 3), found.std.reshape(-1, 3), found.radius_95.reshape(-1)
    shown = range(min(len(points), MOST))
    rows = [
        [
            str(k),
            *(concise(1e3 * x, 1e3 * s) for x, s in zip(points[k].tolist(), std[k].tolist(), strict=True)),
            digits(1e3 * radius[k], 2) if np.isfinite(radius[k]) else "open",
        ]
        for k in shown
    ]
    many = len(points) != 1
    caption = f"{len(points):,} point{'s' if many else ''} in the {found.frame_words}, with 1 sigma"
    head, units = ["point", "x", "y", "z", "95 % radius"], ["", "mm", "mm", "mm", "mm"]
    first = Table(caption, head, rows[:FIRST], units=units)
    if len(rows) <= FIRST:
        return [[first]]
    more = f"the first {MOST}" if len(points) > MOST else "all"
    return [[first], [Table(f"Points, {more}", head, rows, units=units)]]
