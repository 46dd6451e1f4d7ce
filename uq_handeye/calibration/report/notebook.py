"""A calibration in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from ...formatting.numbers import concise, digits
from ...geometry.pose_numbers import pose_numbers
from ...presentation.document import Caution, Paragraph, Table
from ...presentation.notebook import heat_html, matrix_html, to_html
from .text import answer, directions

if TYPE_CHECKING:
    import pandas as pd

    from ..result import Calibration


class Number(NamedTuple):
    """One of the six numbers of X."""

    name: str
    value: float
    std: float | None
    unit: str


def six_numbers(result: Calibration) -> list[Number]:
    """Translation in mm and rotation vector in degrees of X, with standard deviations to first order."""
    values, std = pose_numbers(result.X, result.covariance)
    names = [f"{name} {axis}" for name in ("translation", "rotation vector") for axis in "xyz"]
    known = [None] * 6 if std is None else std.tolist()
    return [Number(*number) for number in zip(names, values.tolist(), known, ["mm"] * 3 + ["deg"] * 3, strict=True)]


def calibration_table(result: Calibration) -> pd.DataFrame:
    """Six rows, translation and rotation vector of X; columns value, std (missing: not determined), unit, concise."""
    import pandas as pd

    numbers = six_numbers(result)
    table = pd.DataFrame(
        {
            "value": [number.value for number in numbers],
            "std": pd.array([number.std for number in numbers], dtype="Float64"),
            "unit": [number.unit for number in numbers],
            "concise": [concise(number.value, number.std, number.unit) for number in numbers],
        },
        index=pd.Index([number.name for number in numbers], name=result.frame),
    )
    return table


def calibration_html(result: Calibration) -> str:
    """The answer, what is wrong, the six numbers; matrix, covariance and correlation folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else f"{result.n_poses} poses"
    setup = "" if result.setup is None else f", {result.setup}"
    rows = [
        [number.name, concise(number.value, number.std), "?" if number.std is None else digits(number.std), number.unit]
        for number in six_numbers(result)
    ]
    table = Table("", ["", "value(deviation)", "1 sigma", "unit"], rows)
    folded = [("Matrix X (translation in m)", matrix_html(result.X))]
    if result.covariance is not None and result.correlation is not None:
        S, correlation = result.covariance, result.correlation
        folded += [
            ("Covariance of (theta, tau), rad and m", heat_html(S, correlation, "{:.3e}")),
            ("Correlation", heat_html(correlation.round(2) + 0.0, correlation, "{:+.2f}")),
        ]
    return to_html(
        f"{result.frame} by {result.method}",
        [Paragraph(answer(result)), *map(Caution, result.warnings), [table, *map(Paragraph, directions(result))]],
        beside=f"{origin}{setup}",
        seen=len(result.warnings) + 2,
        folded=folded,
    )
