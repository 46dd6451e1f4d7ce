"""A calibration in a notebook."""

from __future__ import annotations

import numpy as np

from ...formatting.numbers import concise, digits, fixed
from ...geometry.pose_numbers import POSE_NUMBERS, pose_numbers
from ...presentation.document import Answer, Block, Checks, Document, Paragraph, Points, Table
from ...presentation.notebook import blocks_html, heat_html, html_of, matrix_html, to_html
from ...statement.accuracy import Accuracy
from ..result import Calibration
from .arm import arm_sentences
from .shared_errors import included_words, shared_blocks
from .text import directions

# Parts below this (mm, deg) are nothing.
_SMALLEST = 1e-4


@html_of.register(Calibration)
def calibration_html(result: Calibration) -> str:
    """Return the headline, the checks and the six numbers; full sentences, parts and matrices folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else f"{result.n_poses} poses"
    setup = "" if result.setup is None else f", {result.setup}"
    checks = Checks([(check.status, check.name, check.text) for check in result.checks])
    document: Document = [[Answer(result.headline, _status(result))], [checks], [_numbers(result)]]
    folded = [(title, blocks_html(blocks)) for title, blocks in _folds(result).items() if blocks]
    folded.append(("Matrix X (translation in m)", matrix_html(result.X)))
    if result.covariance is not None and result.correlation is not None:
        S, correlation = result.covariance, result.correlation
        folded += [
            ("Covariance of (theta, tau), rad and m", heat_html(S, correlation, "{:.3e}")),
            ("Correlation", heat_html(correlation.round(2) + 0.0, correlation, "{:+.2f}")),
        ]
    title = f"{result.frame} by {result.method}"
    return to_html(title, document, beside=f"{origin}{setup}", seen=len(document), folded=folded)


def _status(result: Calibration) -> str:
    if not result.usable:
        return "failed"
    doubtful = result.accuracy is None or result.accuracy.lower_limit or result.cautions
    return "caution" if doubtful else "ok"


def _numbers(result: Calibration) -> Table:
    """Return the six numbers of X."""
    values, std = pose_numbers(result.X, result.covariance, opened=result.open_of_X)
    known: list[float | None] = [None] * 6 if std is None else std.tolist()
    rows = [
        [name, concise(value, sd), "?" if sd is None else digits(sd), "mm" if name.startswith("t") else "deg"]
        for name, value, sd in zip(POSE_NUMBERS, values.tolist(), known, strict=True)
    ]
    return Table("", [f"X = {result.frame}" if result.setup else "X", "value", "1 sigma", "unit"], rows)


def _folds(result: Calibration) -> dict[str, list[Block]]:
    """Return what is folded away by title; what `calibrate` warned of is not opened again."""
    count = len(result.cautions)
    return {
        f"Cautions in full ({count})": [Points([str(finding) for finding in result.cautions])] if count else [],
        "Parts of the accuracy": [*_parts(result.accuracy), Paragraph(included_words(result))],
        "Directions": [Paragraph(text) for text in [*directions(result), *arm_sentences(result)]],
        "Shared errors": [*shared_blocks(result)] if result.shared else [],
    }


def _parts(accuracy: Accuracy | None) -> list[Block]:
    """Return a row for each part of the accuracy, and what is not included."""
    if accuracy is None:
        return []
    rows = [
        [name, *(fixed(size, 2) if size >= _SMALLEST else "0" for size in (1e3 * move, float(np.degrees(turn))))]
        for name, move, turn in (
            *((part.name, part.translation, part.rotation) for part in accuracy.parts),
            ("total", accuracy.translation, accuracy.rotation),
            ("total, expanded (95 %)", accuracy.translation_95, accuracy.rotation_95),
        )
    ]
    head = ["1 sigma, worst direction", "translation", "rotation"]
    blocks: list[Block] = [Table("", head, rows, units=["", "mm", "deg"])]
    if accuracy.not_included:
        blocks.append(Paragraph(f"Not included: {', '.join(accuracy.not_included)}."))
    return blocks
