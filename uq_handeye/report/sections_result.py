"""Sections of the report about X: the answer, the ellipses, points in task space, forms to copy, and what it covers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..calibration.report.arm import arm_sentences
from ..calibration.report.facts import Number, ahead
from ..calibration.report.shared_errors import included_words
from ..calibration.statement.included import not_included
from ..core.formatting.numbers import concise, fixed
from ..core.presentation.document import Block, Code, Drawing, Paragraph, Points, Section, Table
from ..trials.validation.cross_check.run import state, verdict

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..trials.validation.cross_check.run import CrossCheck

NO_COVARIANCE = "Not known: the noise of the poses was not given, and the residuals show none."
_AXES = "xyz"
# Correlations from here up are listed, at most so many.
STRONG, MOST_CORRELATIONS = 0.5, 5


def full_section(result: Calibration) -> Section:
    """X and W with their standard deviations, and the directions in which X is known least."""
    facts = result.facts
    blocks: list[Block] = [Paragraph(text) for text in facts.directions]
    if result.agreement is not None:
        blocks.append(Paragraph(result.agreement.sentence))
    head = ["", result.frame, *([result.frame_W] if facts.W else [])]
    poses = [facts.X, *([facts.W] if facts.W else [])]
    rows = [[numbers[0].name, *map(_cell, numbers)] for numbers in zip(*poses, strict=True)]
    about = f"{result.frame} is the pose of the {_of(result.frame)}"
    if result.W is not None:
        about += f"; {result.frame_W} that of the target, as all poses see it"
    if result.covariance is None:
        caption = f"X; (?) says that its standard deviations are not determined. {about}."
    else:
        caption = (
            "X, with one standard deviation in brackets: 12.345(67) means 12.345 with a standard deviation of 0.067. "
            f"{about}."
        )
    blocks.append(Table(caption, head, rows))
    if result.covariance is not None and result.std is not None:
        lines = []
        for name, factor, std, weakest in (
            ("translation (mm)", 1e3, result.std[3:], result.weakest_translation),
            ("rotation (deg)", 180 / np.pi, result.std[:3], result.weakest_rotation),
        ):
            assert weakest is not None  # it is where there is a covariance
            lines.append([name, *(fixed(factor * x) for x in (*std, weakest[1]))])
        blocks.append(
            Table(
                f"Standard deviations of X, along and about the axes of the {facts.parent}",
                ["1 sigma", "x", "y", "z", "worst direction"],
                lines,
            )
        )
    return Section("full", "X and the target", blocks, folded=True)


def _of(frame: str) -> str:
    """``camera in the gripper frame`` for gripper_T_camera."""
    if "_T_" not in frame:
        return "camera side in the frame of the robot side (AX = XB)"
    parent, child = frame.split("_T_")
    return f"{child} in the {parent} frame"


def _cell(one: Number) -> str:
    """A number with its standard deviation; what is exact ends in rounding errors."""
    return concise(round(one.value, 9) if one.sd is None else one.value, one.sd, one.unit)


def arm_sections(result: Calibration, drawings: Mapping[str, Drawing]) -> list[Section]:
    """The arm, and how far the tool misses over the workspace; none where the calibration knows no joints."""
    sentences = arm_sentences(result)
    if not sentences:
        return []
    drawn = [drawings["workspace"]] if "workspace" in drawings else []
    beside_joints = [
        Paragraph(str(found)) for found in result.findings if found.code == "kinematics.against_controller"
    ]
    return [Section("arm", "The arm", [*map(Paragraph, sentences), *beside_joints, *drawn], folded=True)]


def ellipses_section(result: Calibration, drawings: Mapping[str, Drawing], cross_check: CrossCheck | None) -> Section:
    """Ellipses, correlations, and the relations of a cross-check."""
    if result.covariance is None:
        return Section(
            "ellipses", "All ellipses of the error of X", [Paragraph(NO_COVARIANCE, empty=True)], folded=True
        )
    blocks: list[Block] = [drawings["ellipses"], _correlations(result)]
    if cross_check is None:
        blocks.append(Paragraph("No cross-check was run.", empty=True))
    else:
        blocks.append(Paragraph(f"Cross-check, {cross_check.trials:,} trials: {verdict(cross_check)}"))
        rows = [[r.statement, state(r), r.text + (f" {r.advice}" if r.advice else "")] for r in cross_check.relations]
        caption = "Relations of the cross-check: what must hold between the covariances, and whether it does"
        blocks.append(Table(caption, ["relation", "found", "in numbers"], rows, frozenset({1, 2})))
    return Section("ellipses", "All ellipses of the error of X", blocks, folded=True)


def _correlations(result: Calibration) -> Block:
    named = [f"{i} with {j} {x:+.2f}" for x, i, j in result.facts.correlations if abs(x) >= STRONG]
    if not named:
        return Paragraph(f"No two components are correlated by {STRONG:g} or more.")
    more = f", and {len(named) - MOST_CORRELATIONS} more from {STRONG:g} up" if len(named) > MOST_CORRELATIONS else ""
    return Paragraph(f"Strongest correlations: {'; '.join(named[:MOST_CORRELATIONS])}{more}.")


def task_space_section(result: Calibration, drawings: Mapping[str, Drawing]) -> Section:
    """The uncertainty of points in front of the camera."""
    title = "Points in front of the camera, in full"
    if result.covariance is None:
        return Section("task-space", title, [Paragraph(NO_COVARIANCE, empty=True)], folded=True)
    if result.opened is not None:
        said = f"Points move without limit along what is open: {'; '.join(result.open_words)}."
        return Section("task-space", title, [Paragraph(said)], folded=True)
    points = ahead(result)
    rows = [[f"{z:g}", *(fixed(1e3 * x) for x in numbers)] for z, *numbers in zip(*points, strict=True)]
    table = Table(
        f"Uncertainty of a point on the optical axis, in the {result.facts.parent} (mm, 1 sigma; last column: radius "
        "of a sphere that holds 95 %)",
        ["distance (m)", "worst direction", "across the line of sight", "along it", "95 % radius"],
        rows,
    )
    return Section("task-space", title, [drawings["task_space"], table], folded=True)


def forms_section(result: Calibration) -> Section:
    """X and its inverse for other programs."""
    from ..formats.snippets import texts

    blocks: list[Block] = [Paragraph("X and its inverse, ready to copy. Each states its units and convention.")]
    blocks += [Code(snippet.title, snippet.text, snippet.convention) for snippet in texts(result)]
    return Section("forms", "X for other software", blocks, folded=True)


def scope_section(result: Calibration, convention: str) -> Section:
    """Section of what the numbers mean, and what they do not contain."""
    blocks: list[Block] = []
    if result.std is not None:
        facts = result.facts
        blocks.append(
            Paragraph(
                f"All standard deviations are 1 sigma, {facts.order}, of {facts.source}. {included_words(result)}"
            )
        )
        blocks.append(Paragraph(facts.ellipsoid))
    missing: Sequence[str] = (
        f"Systematic errors: {', '.join(not_included(result))}. All poses share them, they do not average out, and "
        "residuals hardly show them.",
        "Errors that are common to many poses but not to all, such as those of one part of the workspace.",
        "What changed during or after the recording: a camera or target that was moved, temperature, a wrong time.",
        "Residuals are no accuracy: they say how well the data fit together, not how near X is to the truth.",
    )
    blocks += [Paragraph("The numbers do not contain:"), Points(missing)]
    blocks.append(Paragraph(f"Convention of every covariance: {convention}."))
    return Section("scope", "What the numbers cover", blocks, folded=True)
