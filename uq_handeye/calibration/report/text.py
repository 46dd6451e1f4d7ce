"""The long text of a calibration, with a unit on every number, and its form in notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from ...core.geometry.pose_numbers import quaternion_deviations
from ...core.geometry.se3 import Array, difference
from ...core.limits import MAX_LISTED
from ...core.presentation.document import (
    COLUMNS,
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
from ...core.presentation.numbers import digits, pose_rows, row
from ...core.presentation.sections import Part, selected
from ...findings import Finding
from ..result import Calibration
from ..tolerance import NO_VERDICTS, Verdict
from .analysis import beside_blocks, covariance_table, diagnosis_blocks
from .arm import arm_blocks, arm_sentences
from .budget import budget_table
from .facts import Fact
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
# Sections of the long text, and of a notebook: unfolded and folded.
LONG = (
    "answer", "accuracy", "checks", "cautions", "notes", "split", "matrix", "numbers", "arm", "4dpa", "noise", "pairs",
    "shared", "flagged", "covariances", "budget", "diagnosis", "ellipsoid", "scope", "quaternion", "inverse", "target",
)  # fmt: skip
NOTEBOOK = ("answer", "all-checks", "x")
NOTEBOOK_FOLDED = ("cautions-in-full", "accuracy-in-full", "directions", "shared-errors")


def calibration_parts(
    result: Calibration, threshold: float = 0.5, verdicts: Mapping[str, Verdict] = NO_VERDICTS
) -> tuple[Part, ...]:
    """Return the sections of a calibration in their order, without those that only a page has.

    Correlations at or above ``threshold`` are listed.
    """
    count = len(result.cautions)
    return (
        Part("answer", "Result", lambda: answer_blocks(result, verdicts, why=False)),
        Part("accuracy", "Parts of the accuracy", lambda: accuracy_blocks(result)),
        Part("checks", "Checks", lambda: [checks_block(result)]),
        Part("all-checks", "Checks", lambda: [Checks.of(result.checks)]),
        *(Part("cautions", "Caution", partial(_caution, one)) for one in result.cautions),
        *(Part("notes", "Note", partial(_note, one)) for one in result.findings if one.code in SHOWN_NOTES),
        Part("split", "Before and after the move", lambda: split_blocks(result)),
        Part("x", "X", lambda: split_blocks(result) or [_six(result)]),
        Part("matrix", "Matrix X (translation in m)", lambda: [matrix_block(result.X)]),
        Part("numbers", "X and its standard deviations", lambda: _numbers(result, threshold)),
        Part("cautions-in-full", f"Cautions in full ({count})", lambda: _cautions_in_full(result)),
        Part("accuracy-in-full", "Parts of the accuracy", lambda: _accuracy_in_full(result)),
        Part(
            "directions", "Directions",
            lambda: [Paragraph(text) for text in [*result.facts.directions, *arm_sentences(result)]],
        ),
        Part("arm", "The arm", lambda: arm_blocks(result)),
        Part("4dpa", "4DPA", lambda: beside_blocks(result)),
        Part("noise", "The noise", lambda: noise_blocks(result)),
        Part("pairs", "Residuals of the pairs", lambda: [pair_table(result)]),
        Part("shared", "Errors that all poses share", lambda: shared_blocks(result)),
        Part("shared-errors", "Shared errors", lambda: shared_blocks(result) if result.shared else []),
        Part("flagged", "Poses that stand out", lambda: flagged_blocks(result)),
        Part("covariances", "Other covariances", lambda: _if_any(covariance_table(result))),
        Part("budget", "Uncertainty budget", lambda: _if_any(budget_table(result))),
        Part("diagnosis", "Diagnostics", lambda: diagnosis_blocks(result)),
        Part("ellipsoid", "Ellipsoid", lambda: _ellipsoid(result)),
        Part("scope", "What the numbers cover", lambda: _scope(result)),
        Part("quaternion", "Quaternion", lambda: _quaternion(result)),
        Part("inverse", "Inverse of X", lambda: _inverse(result)),
        Part("target", "The target", lambda: _target(result)),
    )  # fmt: skip


def _caution(finding: Finding) -> list[Block]:
    return [Caution(str(finding))]


def _cautions_in_full(result: Calibration) -> list[Block]:
    return [Points([str(one) for one in result.cautions])] if result.cautions else []


def _note(finding: Finding) -> list[Block]:
    return [Paragraph(str(finding))]


def _if_any(table: Table | None) -> list[Block]:
    return [] if table is None else [table]


def _accuracy_in_full(result: Calibration) -> list[Block]:
    accuracy = accuracy_blocks(result, most=MAX_LISTED)
    return [*accuracy, Paragraph(included_words(result))] if accuracy else []


def blocks_of(result: Calibration, anchor: str) -> list[Block]:
    """Return the content of one section, for a page that adds to it."""
    return [block for section in selected(calibration_parts(result), (anchor,)) for block in section.blocks]


@document_of.register(Calibration)
def calibration_document(
    result: Calibration,
    verbose: bool = False,
    threshold: float = 0.5,
    verdicts: Mapping[str, Verdict] = NO_VERDICTS,
    last: Sequence[str] = (),
    width: int = COLUMNS,
) -> Document:
    """Return the first screen, or with ``verbose`` all: statement, cautions, X, noise, fit, poses, diagnostics.

    ``threshold``: correlations at or above it are listed. ``last``: paragraphs below the text.
    """
    if not verbose:
        return first_screen(result, verdicts=verdicts, last=last, width=width)
    first, *others = (section.blocks for section in selected(calibration_parts(result, threshold, verdicts), LONG))
    below: list[Block] = [Paragraph(text, hang="  ") for text in last]
    return [[Heading(title_of(result, 118)), *first], *others, *([below] if below else [])]


def _numbers(result: Calibration, threshold: float) -> list[Block]:
    """X and its standard deviations, correlations and directions."""
    numbers: list[Block] = [_pose(result.facts.X)]
    if result.std is not None:
        about = np.array([fact.value for fact in result.facts.select("axis")[3:]])
        turn = row("rotation about axes (deg)", "xyz", None, about, 5)
        numbers += [_lines([turn]), *map(Paragraph, result.facts.directions), _lines(_correlations(result, threshold))]
    return numbers


def _ellipsoid(result: Calibration) -> list[Block]:
    """Return what holds 95 % of the errors."""
    if result.std is None:
        return []
    more = "" if result.analysis is None else " Shifts of X above are given as d, in standard deviations."
    return [Paragraph(result.facts.ellipsoid + more)]


def _scope(result: Calibration) -> list[Block]:
    """Return what the standard deviations mean."""
    if result.std is None:
        return []
    shared = " and of the shared errors in the table" if result.shared else ""
    scope = f"The standard deviations are 1 sigma, to first order, of {result.facts.source}{shared}."
    return [Paragraph(f"{scope} {included_words(result)}")]


def _quaternion(result: Calibration) -> list[Block]:
    S = result.covariance
    of_quaternion = None if S is None else quaternion_deviations(result.quaternion, S)
    quaternion = row("quaternion", "xyzw", result.quaternion, of_quaternion, 7, width=10)
    return [Heading(f"{result.frame} as quaternion"), _lines([quaternion])]


def _inverse(result: Calibration) -> list[Block]:
    frame = result.frame
    name = "_T_".join(reversed(frame.split("_T_"))) if "_T_" in frame else f"inv({frame})"
    return [Heading(f"{name} (inverse of X)"), matrix_block(result.inverse)]


def _target(result: Calibration) -> list[Block]:
    if result.W is None:
        return []
    return [Heading(f"{result.frame_W} (the target, from all poses)"), matrix_block(result.W), _pose(result.facts.W)]


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


def _pose(numbers: Sequence[Fact]) -> Code:
    """Return the six numbers of a pose as two lines."""
    sd = [one.sd for one in numbers if one.sd is not None]
    return _lines(pose_rows(np.array([one.value for one in numbers]), np.array(sd) if sd else None))


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
    parts = calibration_parts(result)
    document: Document = [section.blocks for section in selected(parts, NOTEBOOK)]
    folded = [(section.title, blocks_html(section.blocks)) for section in selected(parts, NOTEBOOK_FOLDED)]
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
