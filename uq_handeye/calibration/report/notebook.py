"""A calibration in a notebook."""

from __future__ import annotations

from ...core.formatting.numbers import concise, digits
from ...core.presentation.document import Block, Checks, Document, Paragraph, Points, Table
from ...core.presentation.notebook import blocks_html, heat_html, html_of, matrix_html, to_html
from ..result import Calibration
from . import text as text  # registers the document of a calibration
from .arm import arm_sentences
from .first_screen import accuracy_blocks, answer_blocks, data_words
from .shared_errors import included_words, shared_blocks

# Parts of the accuracy; smaller ones are combined.
MOST_PARTS = 12


@html_of.register(Calibration)
def calibration_html(result: Calibration) -> str:
    """Return the headline, the checks and the six numbers; full sentences, parts and matrices folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else data_words(result)
    setup = "" if result.setup is None else f", {result.setup}"
    checks = Checks([(check.status, check.name, check.text) for check in result.checks])
    document: Document = [answer_blocks(result, why=False), [checks], [_numbers(result)]]
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


def _numbers(result: Calibration) -> Table:
    """Return the six numbers of X."""
    rows = [
        [one.name, concise(one.value, one.sd), "?" if one.sd is None else digits(one.sd), one.unit]
        for one in result.facts.X
    ]
    return Table("", [f"X = {result.frame}" if result.setup else "X", "value", "1 sigma", "unit"], rows)


def _folds(result: Calibration) -> dict[str, list[Block]]:
    """Return what is folded away by title; what `calibrate` warned of is not opened again."""
    count, accuracy = len(result.cautions), accuracy_blocks(result, most=MOST_PARTS)
    return {
        f"Cautions in full ({count})": [Points([str(finding) for finding in result.cautions])] if count else [],
        "Parts of the accuracy": [*accuracy, Paragraph(included_words(result))] if accuracy else [],
        "Directions": [Paragraph(text) for text in [*result.facts.directions, *arm_sentences(result)]],
        "Shared errors": [*shared_blocks(result)] if result.shared else [],
    }
