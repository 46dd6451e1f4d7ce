"""Residuals of a calibration as tables: of the pairs of poses, of each pose, and the poses that are flagged."""

from __future__ import annotations

from collections.abc import Sequence

from ...core.limits import MAX_LISTED
from ...core.presentation.document import Block, Paragraph, Table
from ...core.presentation.numbers import column, fixed
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...fit.diagnostics.pose_table import PoseTable
from ..result import Calibration


def pair_table(result: Calibration) -> Table:
    """Residuals of the pairs."""
    r = result.residuals
    looked_at = "the" if r.pairs == result.n_pairs else f"{r.pairs:,} of the {result.n_pairs:,}"
    less = ", less the estimated shared errors" if result.shared else ""
    caption = f"Residuals of AX = XB over {looked_at} pairs{less}: how well X explains them, not how accurate it is"
    sizes = [
        ["rotation (deg)", *(fixed(DEG_PER_RAD * x) for x in (r.rotation_rms, r.rotation_median, r.rotation_max))],
        [
            "translation (mm)",
            *(fixed(MM_PER_M * x) for x in (r.translation_rms, r.translation_median, r.translation_max)),
        ],
    ]
    return Table(caption, ["", "RMS", "median", "largest"], sizes)


def pose_table(table: PoseTable, shown: Sequence[int], caption: str) -> Table:
    """Residual, distance, leverage, weight and flag of the poses ``shown``."""
    k = list(shown)
    columns = (
        [str(i) for i in k],
        column(DEG_PER_RAD * table.rotation[k]),
        column(MM_PER_M * table.translation[k]),
        column(table.distance2[k]),
        column(100 * table.leverage[k], 2),
        [f"{table.weight[i]:.3f}" for i in k],
        [table.status(i) for i in k],
    )
    head = [table.item, "rotation (deg)", "translation (mm)", "d^2", "leverage (%)", "weight", "flag"]
    marked = frozenset(row for row, i in enumerate(k) if table.flag[i] != "kept")
    return Table(caption, head, list(zip(*columns, strict=True)), frozenset({6}), marked)


def flagged_blocks(result: Calibration) -> list[Block]:
    """The poses that are flagged."""
    table = result.table
    if table is None:
        return []
    if not table.flagged:
        count = len(table.counted)
        none = Paragraph(f"No {table.item} stands out: all {count} lie within their 99.9 % ellipsoids.")
        return [none, *_excluded_blocks(table)]
    order = sorted(table.flagged, key=lambda k: -table.distance2[k])
    caption = (
        f"{len(order)} of {len(table.counted)} {table.item}s stand out (numbered from 0; d^2 is 6 on average, beyond "
        f"{table.limit:.3g} rare):"
    )
    more = len(order) - MAX_LISTED
    rest = [Paragraph(f"and {more} more; see the table of the result", indent="  ")] if more > 0 else []
    return [pose_table(table, order[:MAX_LISTED], caption), *rest, *_excluded_blocks(table)]


def _excluded_blocks(table: PoseTable) -> list[Block]:
    """The poses that were excluded by request."""
    if not table.excluded:
        return []
    caption = f"{len(table.excluded)} of {len(table)} {table.item}s are excluded, with residuals against the fit:"
    more = len(table.excluded) - MAX_LISTED
    rest = [Paragraph(f"and {more} more; see the table of the result", indent="  ")] if more > 0 else []
    return [pose_table(table, table.excluded[:MAX_LISTED], caption), *rest]
