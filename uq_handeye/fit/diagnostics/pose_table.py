"""Table with a line per pose (or motion): residual, distance from its prediction by others, leverage, weight, flag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
from scipy.special import bdtrc, chdtrc, chdtri

from ...core.files.records import Record
from ...core.geometry.se3 import Array
from ...core.levels import CONTRADICTED, DOUBTFUL
from ...core.limits import MAX_LISTED
from ...core.presentation.document import Document, Paragraph, Table, document_of
from ...core.presentation.numbers import column
from ...core.presentation.shown import Shown
from ...core.presentation.units import MM_PER_M
from ...errors import InputError
from ...findings import GROSS_EXCESS, Finding, Severity
from ...model.errors.columns import times
from ...model.errors.joint_covariance import joint_of
from ..graph.gauss_helmert import Fit
from ..graph.robust import FULL, RobustFit, is_weak_minority, largest_by_chance, pose_distances

if TYPE_CHECKING:
    import pandas as pd


FLAGS = ("kept", "outlier", "downweighted", "rejected", "excluded")
# Rows that a table in a report has at most; the file of poses has all.
MAX_TABLE_ROWS = 100
# Where the noise is estimated from the same poses, the largest distance has a heavier tail, by this factor.
TAIL_OF_ESTIMATED = 1.25


@dataclass(frozen=True, eq=False, repr=False)
class PoseTable(Record, Shown):
    """Arrays (n,), in the order of the data.

    The residual is that of ``G X C = W`` (of ``A X = X B`` for motions) after the fit, with the estimates of the errors
    that poses share applied. ``distance2`` is the squared
    Mahalanobis distance of the pose from where the other poses predict it: chi-square with 6 degrees of freedom for a
    good pose and true noise. ``flag`` is "kept", "outlier" (``distance2`` beyond its 99.9 % quantile, 22.5; no robust
    estimation was asked for), "downweighted" (``weight`` says how far), "rejected", or "excluded": left out by
    request, with its residual against the fit to the others. An excluded pose has the weight and leverage 0.
    """

    _where: ClassVar[str] = "poses"

    item: str  # "pose" or "motion"
    rotation: Annotated[Array, "n"]  # length of the rotation residual, rad
    translation: Annotated[Array, "n"]  # length of the translation residual, m
    distance2: Annotated[Array, "n"]
    leverage: Annotated[Array, "n"]  # share in the information about all unknowns; the sum is 1
    weight: Annotated[Array, "n"]  # in [0, 1]; 0: rejected or excluded
    flag: tuple[str, ...]
    limit: float = FULL  # of distance2, beyond which one is flagged
    scale: float = 1.0  # so many times the noise given was taken to judge by; 1 unless most residuals are that large

    def __len__(self) -> int:
        return len(self.flag)

    @property
    def counts(self) -> str:
        """Count of the poses with each flag: "25 poses: 24 kept, 1 rejected"."""
        found = [(self.flag.count(flag), flag) for flag in FLAGS if flag in self.flag]
        said = ", ".join(f"{count:,} {flag}" for count, flag in found)
        return f"{len(self):,} {self.item}{'' if len(self) == 1 else 's'}{': ' if said else ''}{said}"

    def __repr__(self) -> str:
        return f"PoseTable({self.counts})"

    @property
    def flagged(self) -> list[int]:
        """Numbers, from 0, of those that stand out: neither simply kept nor excluded by the user."""
        return [k for k, flag in enumerate(self.flag) if flag not in ("kept", "excluded")]

    @property
    def excluded(self) -> list[int]:
        """Numbers, from 0, of those that the user left out."""
        return [k for k, flag in enumerate(self.flag) if flag == "excluded"]

    @property
    def counted(self) -> list[int]:
        """Numbers, from 0, of those that are not excluded: the data of the fit."""
        return [k for k, flag in enumerate(self.flag) if flag != "excluded"]

    def status(self, row: int) -> str:
        """The flag, with the weight of what is down-weighted: "downweighted (0.40)"."""
        flag = self.flag[row]
        return f"{flag} ({min(self.weight[row], 0.99):.2f})" if flag == "downweighted" else flag

    @property
    def rejected(self) -> list[int]:
        """Numbers, from 0, of the outliers that take no part in the estimate."""
        return [k for k in self.counted if self.weight[k] == 0]

    @property
    def findings(self) -> list[Finding]:
        """Findings about rows that stand out, and what was done about them; empty if none does (one in 1000 does by
        chance).
        """
        found = []
        for flag in ("rejected", "downweighted", "outlier"):
            rows = [k for k in np.argsort(-self.distance2).tolist() if self.flag[k] == flag]
            if not rows or (flag == "outlier" and self.distance2[rows[0]] < self.limit_of_all):
                continue
            worst = [
                {
                    "row": k,
                    "rotation": self.rotation[k],
                    "translation": self.translation[k],
                    "distance2": self.distance2[k],
                }
                for k in rows[:5]
            ]
            values = {"item": self.item, "flag": flag, "n": len(self.counted), "count": len(rows), "limit": self.limit}
            # one of many good poses is beyond the limit of one pose in many data sets
            of_chance = flag == "downweighted" and self.distance2[rows[0]] < self.limit * self._of_set
            severity: Severity = "note" if of_chance else "caution"
            if flag == "rejected" and is_weak_minority(len(self.counted) - len(rows), len(self.counted)):
                severity = "failure"
            found.append(Finding("diagnostics.flagged", severity, values | {"worst": worst}))
        if self.scale > 1:
            severity = "failure" if self.scale > GROSS_EXCESS else "caution"
            values = {"scale": self.scale, "p_value": self._p_of_scale}
            found.append(Finding("diagnostics.noise_too_small", severity, values))
        return found

    @property
    def _p_of_scale(self) -> float:
        """Probability that half of the distances are so large if the noise is as given: their median has the scale."""
        n, least = len(self.counted), float(chdtri(6, 0.5)) * self.scale**2
        return float(bdtrc(n // 2 - 1, n, chdtrc(6, least)))

    @property
    def _of_set(self) -> float:
        """Factor of the limit of one pose (one good pose in 1000) to that of all poses: one good data set in 100."""
        level = DOUBTFUL.probability / max(10, len(self.counted))
        return TAIL_OF_ESTIMATED * float(chdtri(6, level) / chdtri(6, CONTRADICTED.probability))

    @property
    def limit_of_all(self) -> float:
        """The d^2 that the largest of so many good poses exceeds once in 1000 data sets."""
        return largest_by_chance(len(self.counted))

    def among(self, n: int, numbers: Sequence[int], rotation: Array, translation: Array, distance2: Array) -> PoseTable:
        """Return the table of all n poses of a data set, of which this one has all but those ``numbers``.

        Those are excluded; ``rotation``, ``translation`` and ``distance2`` are their residuals against the fit.
        """
        others = np.setdiff1d(np.arange(n), numbers)

        def whole(own: Array, excluded: Array | float) -> Array:
            column = np.empty(n)
            column[others], column[list(numbers)] = own, excluded
            return column

        flag = np.full(n, "excluded", dtype=object)
        flag[others] = self.flag
        return replace(
            self,
            rotation=whole(self.rotation, rotation),
            translation=whole(self.translation, translation),
            distance2=whole(self.distance2, distance2),
            leverage=whole(self.leverage, 0.0),
            weight=whole(self.weight, 0.0),
            flag=tuple(flag.tolist()),
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A pandas table, one row per pose, units in the names of the columns."""
        import pandas as pd

        return pd.DataFrame(
            {
                self.item: np.arange(len(self)),
                "rotation_deg": np.degrees(self.rotation),
                "translation_mm": MM_PER_M * self.translation,
                "distance2": self.distance2,
                "leverage": self.leverage,
                "weight": self.weight,
                "flag": self.flag,
            }
        )

    def _possible(self) -> PoseTable:
        if not set(self.flag) <= set(FLAGS) or len(self.flag) != len(self.weight):
            raise InputError(f"Expected the flags of poses to be {', '.join(FLAGS)}, got {set(self.flag)!r:.60}.")
        return self


def pose_table(fit: Fit, robust: RobustFit | None) -> PoseTable:
    """Return the table of the poses of a fit, robust or not."""
    n = fit.residual.shape[-2]
    if robust is not None:
        distance2, leverage, weight, flag = robust.distances, robust.leverage, robust.weights, robust.flags
    else:
        distance2, leverage = pose_distances(fit)
        weight = np.ones(n)
        flag = tuple("outlier" if far else "kept" for far in (distance2 > FULL).tolist())
    residual = np.linalg.norm(_of_each(fit).reshape(n, 2, 3), axis=-1)
    item = "motion" if fit.W is None else "pose"
    columns = (residual[:, 0], residual[:, 1], distance2, leverage, weight)
    judged = (FULL, 1.0) if robust is None else (robust.limit, robust.scale)
    return PoseTable(item, *columns, flag, *judged)


def _of_each(fit: Fit) -> Array:
    """Residuals (n, 6) that the errors which poses share do not explain: ``r - F z``."""
    S = joint_of(fit.S)
    return fit.residual if S is None else np.asarray(fit.residual - times(S.columns, fit.told_of_shared.z))


@document_of.register(PoseTable)
def pose_table_document(table: PoseTable) -> Document:
    """Return a sentence, the rows with the largest d^2, and all rows."""
    if not len(table):
        return [[Paragraph(f"No {table.item}s.")]]
    rows = _rows(table)
    few = len(table) <= MAX_LISTED
    worst = np.argsort(-table.distance2, kind="stable")[:MAX_LISTED].tolist() if not few else range(len(table))
    caption = "" if few else f"The {MAX_LISTED} with the largest d^2"
    what = f"d^2: squared distance from the prediction of the other {table.item}s, in standard deviations"
    shown = [_table(table, caption, [rows[k] for k in worst])]
    first = [Paragraph(f"{table.counts}. {what}; limit {table.limit:.3g}."), *shown]
    if few:
        return [first]
    more = f" (the first {MAX_TABLE_ROWS})" if len(table) > MAX_TABLE_ROWS else ""
    return [first, [_table(table, f"All {len(table):,} {table.item}s{more}", rows[:MAX_TABLE_ROWS])]]


def _rows(table: PoseTable) -> list[list[str]]:
    columns = [np.degrees(table.rotation), MM_PER_M * table.translation, table.distance2]
    return [
        [str(k), *numbers, f"{100 * table.leverage[k]:.1f}", table.status(k)]
        for k, numbers in enumerate(zip(*map(column, columns), strict=True))
    ]


def _table(table: PoseTable, caption: str, rows: list[list[str]]) -> Table:
    head = [table.item, "rotation", "translation", "d^2", "leverage", "status"]
    marked = frozenset(k for k, row in enumerate(rows) if row[-1] != "kept")
    return Table(caption, head, rows, frozenset({5}), marked, units=["", "deg", "mm", "", "%", ""])
