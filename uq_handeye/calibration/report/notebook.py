"""A calibration in a notebook."""

from __future__ import annotations

from ...formatting.numbers import concise, digits
from ...geometry.pose_numbers import POSE_NUMBERS, pose_numbers
from ...presentation.document import Caution, Paragraph, Table
from ...presentation.notebook import heat_html, html_of, matrix_html, to_html
from ..result import Calibration
from .arm import arm_sentences
from .shared_errors import shared_blocks
from .text import answer, directions


@html_of.register(Calibration)
def calibration_html(result: Calibration) -> str:
    """The answer, what is wrong, the six numbers; matrix, covariance and correlation folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else f"{result.n_poses} poses"
    setup = "" if result.setup is None else f", {result.setup}"
    values, std = pose_numbers(result.X, result.covariance, opened=result.open_of_X)
    known: list[float | None] = [None] * 6 if std is None else std.tolist()
    rows = [
        [name, concise(value, sd), "?" if sd is None else digits(sd), "mm" if name.startswith("t") else "deg"]
        for name, value, sd in zip(POSE_NUMBERS, values.tolist(), known, strict=True)
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
        [
            Paragraph(answer(result)),
            *map(Caution, result.warnings),
            [table, *map(Paragraph, [*directions(result), *arm_sentences(result)])],
            shared_blocks(result),
        ],
        beside=f"{origin}{setup}",
        seen=len(result.warnings) + 3,
        folded=folded,
    )
