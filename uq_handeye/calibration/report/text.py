"""The long text of a calibration, with a unit on every number, and its form in notebooks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...core.formatting.numbers import digits, pose_rows, row
from ...core.geometry.pose_numbers import pose_numbers, quaternion_deviations
from ...core.geometry.se3 import Array, difference
from ...core.numbers.limits import MAX_LISTED
from ...core.presentation.document import (
    Block,
    Caution,
    Checks,
    Code,
    Document,
    Heading,
    Paragraph,
    Points,
    Table,
    document_of,
)
from ...core.presentation.html import blocks_html, heat_html, html_of, matrix_html, to_html
from ..result import Calibration
from ..statement.tolerance import Verdict
from .analysis import beside_blocks, covariance_table, diagnosis_blocks
from .arm import arm_blocks, arm_sentences
from .budget import budget_table
from .first_screen import (
    accuracy_blocks,
    answer_blocks,
    checks_block,
    data_words,
    first_screen,
    matrix_block,
    split_blocks,
    title_of,
)
from .noise import noise_blocks
from .residuals import flagged_blocks, pair_table
from .shared_errors import included_words, shared_blocks

# The long text shows these notes with the cautions.
SHOWN_NOTES = ("calibration.excluded", "kinematics.against_controller")


@document_of.register(Calibration)
def calibration_document(result: Calibration, verbose: bool = False, threshold: float = 0.5) -> Document:
    """Return the first screen, or with ``verbose`` the long text (`long_document`)."""
    return long_document(result, threshold) if verbose else first_screen(result)


def long_document(result: Calibration, threshold: float = 0.5, verdict: Verdict | None = None) -> Document:
    """Return the long text: the statement, cautions, X, noise, fit, poses, diagnostics, other forms of X.

    Correlations at or above ``threshold`` are listed.
    """
    tables = [table for table in (covariance_table(result), budget_table(result)) if table is not None]
    return [
        [Heading(title_of(result, 118)), *answer_blocks(result, verdict, why=False)],
        accuracy_blocks(result),
        checks_block(result),
        *(Caution(str(found)) for found in result.cautions),
        *(Paragraph(str(found)) for found in result.findings if found.code in SHOWN_NOTES),
        *_numbers(result, threshold),
        *([arm] if (arm := arm_blocks(result)) else []),
        *([beside] if (beside := beside_blocks(result)) else []),
        noise_blocks(result),
        pair_table(result),
        shared_blocks(result),
        flagged_blocks(result),
        *tables,
        diagnosis_blocks(result),
        *_scope(result),
        *_other_forms(result),
    ]


def _numbers(result: Calibration, threshold: float) -> list[list[Block]]:
    """X and its standard deviations, correlations and directions."""
    numbers: list[Block] = [_lines(pose_rows(*pose_numbers(result.X, result.covariance, opened=result.open_of_X)))]
    if result.std is not None:
        turn = row("rotation about axes (deg)", "xyz", None, np.degrees(result.std[:3]), 5)
        numbers += [_lines([turn]), *map(Paragraph, result.facts.directions), _lines(_correlations(result, threshold))]
    return [*([split] if (split := split_blocks(result)) else []), [matrix_block(result.X)], numbers]


def _scope(result: Calibration) -> list[Block]:
    """Return what the standard deviations mean."""
    if result.std is None:
        return []
    facts = result.facts
    within = facts.ellipsoid
    if result.analysis is not None:
        within += " Shifts of X above are given as d, in standard deviations."
    shared = " and of the shared errors in the table" if result.shared else ""
    scope = f"The standard deviations are 1 sigma, to first order, of {facts.source}{shared}."
    return [Paragraph(within), Paragraph(f"{scope} {included_words(result)}")]


def _other_forms(result: Calibration) -> list[Block | list[Block]]:
    """The inverse of X, its quaternion, and W."""
    frame, S = result.frame, result.covariance
    inverse_name = "_T_".join(reversed(frame.split("_T_"))) if "_T_" in frame else f"inv({frame})"
    of_quaternion = None if S is None else quaternion_deviations(result.quaternion, S)
    quaternion = row("quaternion", "xyzw", result.quaternion, of_quaternion, 7, width=10)
    blocks: list[Block | list[Block]] = [
        [Heading(f"{frame} as quaternion"), _lines([quaternion])],
        Heading(f"{inverse_name} (inverse of X)"),
        matrix_block(result.inverse),
    ]
    if result.W is not None:
        blocks += [
            Heading(f"{result.frame_W} (the target, from all poses)"),
            matrix_block(result.W),
            _lines(
                pose_rows(*pose_numbers(result.W, result.covariance_W, opened=result.open_of_W)),
            ),
        ]
    return blocks


def against_truth(result: Calibration, truth: Array) -> str:
    """Return the error of X against a known one (4, 4) in a sentence, and whether it lies inside the ellipsoid."""
    xi = difference(result.X, truth)
    text = (
        f"Truth: X is off by {digits(1e3 * float(np.linalg.norm(xi[3:])))} mm and "
        f"{digits(np.degrees(float(np.linalg.norm(xi[:3]))))} deg"
    )
    if result.covariance is None:
        return f"{text}."
    inside = float(xi @ np.linalg.solve(result.covariance, xi)) <= result.quantile(0.95)
    return f"{text}, {'inside' if inside else 'outside'} its 95 % ellipsoid."


def _lines(lines: Sequence[str]) -> Code:
    return Code("", "\n".join(lines), "")


def _correlations(result: Calibration, threshold: float) -> list[str]:
    strong = [f"  {i} with {j}: {x:+.2f}" for x, i, j in result.facts.correlations if abs(x) >= threshold]
    if not strong:
        return [f"No correlation is {threshold:g} or larger."]
    return [f"Correlations of {threshold:g} and larger:", *strong]


@html_of.register(Calibration)
def calibration_html(result: Calibration) -> str:
    """Return the headline, the checks and the six numbers; full sentences, parts and matrices folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else data_words(result)
    setup = "" if result.setup is None else f", {result.setup}"
    checks = Checks.of(result.checks)
    document: Document = [answer_blocks(result, why=False), [checks], split_blocks(result) or [_six(result)]]
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


def _six(result: Calibration) -> Table:
    """Return the six numbers of X."""
    rows = [[one.name, one.bare, one.parts[1], one.unit] for one in result.facts.X]
    return Table("", [f"X = {result.frame}" if result.setup else "X", "value", "1 sigma", "unit"], rows)


def _folds(result: Calibration) -> dict[str, list[Block]]:
    """Return what is folded away by title; what `calibrate` warned of is not opened again."""
    count, accuracy = len(result.cautions), accuracy_blocks(result, most=MAX_LISTED)
    return {
        f"Cautions in full ({count})": [Points([str(finding) for finding in result.cautions])] if count else [],
        "Parts of the accuracy": [*accuracy, Paragraph(included_words(result))] if accuracy else [],
        "Directions": [Paragraph(text) for text in [*result.facts.directions, *arm_sentences(result)]],
        "Shared errors": [*shared_blocks(result)] if result.shared else [],
    }


# -------------------------------------------------------------------------------------------- what the total includes
