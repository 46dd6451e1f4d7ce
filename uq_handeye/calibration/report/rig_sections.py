"""The sections of a rig calibration in one order: answer, poses, tests, residuals, noise, and the numbers in full.

Terminal, ``-v``, notebook, live panel, report and certificate select from this list (`core.presentation.sections`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core.geometry.conventions import CONVENTION
from ...core.geometry.rotations import Rotation
from ...core.geometry.se3 import Array
from ...core.levels import INTERVAL
from ...core.presentation.document import (
    COLUMNS,
    Answer,
    Block,
    Checks,
    Document,
    Heading,
    Paragraph,
    Points,
    Table,
    document_of,
)
from ...core.presentation.html import blocks_html, html_of, to_html
from ...core.presentation.numbers import digits, probability
from ...core.presentation.sections import Part, selected, text_of
from ...core.presentation.units import DEG_PER_RAD, MM_PER_M
from ...fit.graph.drifts import DRIFT_KINDS
from ...fit.graph.graph import Graph
from ...model.poses.estimated_pose import EstimatedPose
from ..moves import MOVED
from ..rig_poses import camera_pairs, frame_of_pair
from ..rig_statement import RigStatement
from ..tolerance import NO_VERDICTS, Verdict, percent
from .answer import verdict_blocks
from .first_screen import checks_in_short, title_line

# Sections of the terminal, and of the text with all numbers.
SCREEN = ("answer", "checks", "poses", "pairs")
NOTEBOOK = ("answer", "next", "poses")
NOTEBOOK_FOLDED = ("all-checks", "pairs", "views", "noise")
LONG = (
    "answer", "all-checks", "cautions", "poses", "pairs", "views", "noise", "sizes", "paths", "largest",
    "numbers", "conventions",
)  # fmt: skip


def rig_parts(result: RigStatement, verdicts: Sequence[Block] = ()) -> tuple[Part, ...]:
    """Return all sections of a `RigCalibration` in their order; ``verdicts``: whether cameras meet a tolerance."""
    return (
        Part("answer", "Result", lambda: _answer(result, verdicts)),
        Part("checks", "Checks", lambda: [checks_in_short(result)]),
        Part("all-checks", "Checks", lambda: [Checks.of(result.checks)]),
        Part("cautions", "Cautions", lambda: [Points.of_findings(result.cautions)] if result.cautions else []),
        Part("next", "Next step", lambda: _next(result)),
        Part("poses", "Poses", lambda: [poses_table(result)]),
        Part("stated", "Poses", lambda: [stated_table(result, certified_poses(result))]),
        Part("pairs", "Relative poses of the cameras", lambda: _pairs(result)),
        Part("stated-pairs", "Relative poses of the cameras", lambda: _stated_pairs(result)),
        Part("views", "Residuals by camera and target", lambda: [_by_pair(result)]),
        Part("noise", "Noise", lambda: noise_table(result)),
        Part("sizes", "Sizes of all errors", lambda: _sizes(result)),
        Part("paths", "Paths that should agree", lambda: _paths(result)),
        Part("certificate", "Certificate of the global minimum", lambda: _optimality(result)),
        Part("largest", "Views with the largest residuals", lambda: [_largest(result)]),
        Part("numbers", "Poses and standard deviations in full", lambda: [_in_full(result)]),
        Part("conventions", "Conventions", lambda: [Paragraph(f"{CONVENTION}. {FRAMES}")]),
    )


@document_of.register(RigStatement)
def rig_document(
    result: RigStatement,
    verbose: bool = False,
    threshold: float = 0.5,
    verdicts: Mapping[str, Verdict] = NO_VERDICTS,
    last: Sequence[str] = (),
    width: int = COLUMNS,
) -> Document:
    """Return the text of a rig: answer, poses and checks; ``verbose``: all sections; options as of one camera."""
    parts = rig_parts(result, verdict_blocks(result, verdicts))
    below: list[Block] = [Paragraph(text, hang="  ") for text in last]
    answer, *others = selected(parts, LONG if verbose else SCREEN)
    first = [Heading(_title(result, width)), *answer.blocks]
    return [first, *text_of(others, untitled=("checks",)), *([below] if below else [])]


@html_of.register(RigStatement)
def rig_notebook(result: RigStatement) -> str:
    """Return the answer and the poses; relative poses, checks, residuals and noise folded away."""
    parts = rig_parts(result)
    document: Document = [section.blocks for section in selected(parts, NOTEBOOK)]
    folded = [(section.title, blocks_html(section.blocks)) for section in selected(parts, NOTEBOOK_FOLDED)]
    beside = f"{result.rig.words}, {result.rig.n_views} views by {result.method}"
    return to_html(", ".join(result.camera_names), document, beside=beside, seen=len(document), folded=folded)


FRAMES = (
    "The world is the base of the first arm. gripper_T_NAME is the pose of a camera or target in the flange that "
    "carries it, world_T_NAME of one that stands still, A_T_B of B in the frame of A."
)


def _title(result: RigStatement, width: int) -> str:
    rig = result.rig
    of_arms = [arm.source for name, arm in rig.arms.items() if arm.source != f"arm {name}"]
    names = [Path(source).name for source in (*of_arms, *(view.source for view in rig.views)) if source]
    return title_line(", ".join(rig.cameras), names, f"{rig.n_views} views, {result.method}", width)


def _answer(result: RigStatement, verdicts: Sequence[Block]) -> list[Block]:
    """Return the headline, the verdicts or the tolerance that is met, and what limits it or why it is not usable."""
    blocks: list[Block] = [Answer(result.headline, result.status), *verdicts]
    failed = [str(one) for one in result.cautions if one.severity == "failure"]
    said = [None if verdicts else result.suits, *failed[:1], result.limit]
    return [*blocks, *(Paragraph(text) for text in said if text)]


def _next(result: RigStatement) -> list[Block]:
    return [] if result.advice is None else [Paragraph(f"Next: {result.advice}.", hang="  ")]


_HEAD = ["pose", "x (mm)", "y (mm)", "z (mm)", "position (mm)", "rotation (deg)"]


def poses_table(result: RigStatement, more: Sequence[EstimatedPose] = ()) -> Table:
    """Return the poses, and ``more``, with the lengths of their errors; what moved before and after the move."""
    shown = [*(result.split or result.singles), *more]  # where a pose moved, that of all views together is neither
    names = {one.name for one in result.split}
    rows = result.facts.rows({one.frame: one.name if one.name in names else one.frame for one in shown})
    rows = [[*row, str(one.count or "")] for row, one in zip(rows, shown, strict=True)]
    caption = "Position of each pose, and its standard deviation in the worst direction."
    if result.split:
        caption += " What moved has a pose before and one after the move, NAME@MOMENT."
    return Table(caption, [*_HEAD, "views"], rows)


def _pairs(result: RigStatement) -> list[Block]:
    moved = {one.values["name"] for one in result.findings if one.code == MOVED}
    frames = [frame_of_pair(one, two) for one, two in camera_pairs(result.rig) if not moved & {one, two}]
    if result.pairs and not frames:
        return [Paragraph("A camera moved, so that no relative pose of cameras is constant.")]
    if not result.pairs:
        return [Paragraph("No two cameras are on one thing, so that no relative pose is constant.", empty=True)]
    caption = "From the joint covariance: errors that both share cancel, which separate calibrations do not know."
    return [Table(caption, _HEAD, result.facts.rows({frame: frame for frame in frames}))]


def _residuals(result: RigStatement) -> tuple[Graph, Array, Array]:
    """Graph, rotations (deg) and positions (mm) (E,) of the residuals of the views."""
    graph = Graph.of(result.rig)
    r = graph.linearise(result.poses).r
    return graph, DEG_PER_RAD * np.linalg.norm(r[:, :3], axis=1), MM_PER_M * np.linalg.norm(r[:, 3:], axis=1)


def _by_pair(result: RigStatement) -> Table:
    graph, turn, shift = _residuals(result)
    rows: list[list[str]] = []
    marked: set[int] = set()
    pairs = np.array([f"{view.camera}, {view.target}" for view in result.rig.views])[graph.view]
    for pair in dict.fromkeys(pairs.tolist()):
        of = pairs == pair
        kept = of & (result.weights > 0) if (result.weights[of] > 0).any() else of
        if (square := float(result.distances[kept].mean()) / 6) > 2:
            marked.add(len(rows))
        sizes = [digits(float(np.sqrt((values[kept] ** 2).mean())), 2) for values in (shift, turn)]
        rows.append([pair, str(of.sum()), str((result.weights[of] == 0).sum()), *sizes, f"{square:.2f}"])
    return Table(
        "Root mean square of the residuals of the views that count; d^2/6 is 1 on average if the noise is as stated.",
        ["camera, target", "views", "rejected", "position (mm)", "rotation (deg)", "d^2/6"], rows,
        marked=frozenset(marked),
    )  # fmt: skip


def noise_table(result: RigStatement) -> list[Block]:
    """Return the standard deviations of arms and cameras."""
    rows = [[name, *(fact.short for fact in result.facts.select("noise", name))] for name in result.noise]
    how = "estimated from the views" if result.components else "as given"
    caption = f"Standard deviations of one pose per axis, {how}."
    return [Table(caption, ["arm or camera", "position (mm)", "rotation (deg)"], rows)]


def _sizes(result: RigStatement) -> list[Block]:
    if not result.components:
        return [Paragraph("Not estimated: the noise was given.", empty=True)]
    parts = [[part["name"], *(_sized(part[key], _unit(part)) for key in ("size", "low", "high"))]
             for part in result.components]  # fmt: skip
    caption = "Noise, and errors that all poses of their owner share, with 95 % intervals."
    return [Table(caption, ["error", "size", "from", "to"], parts)]


def _unit(part: Mapping[str, Any]) -> str:
    """Unit of a size; that of a drift is a step of rotation and of translation alike."""
    return "mrad, mm" if part["key"]["kind"] in DRIFT_KINDS else str(part["unit"])


def _sized(value: float, unit: str) -> str:
    of_unit = {"m": (MM_PER_M, "mm"), "rad": (DEG_PER_RAD, "deg"), "": (100.0, "%"), "mrad, mm": (1e3, unit)}
    factor, shown = of_unit.get(unit, (1.0, unit))
    return f"{digits(factor * value, 2)} {shown}"


def _paths(result: RigStatement) -> list[Block]:
    if not result.paths:
        return [Paragraph("No two ways lead to one pose.", empty=True)]
    ordered = sorted(result.paths, key=lambda path: path.p)
    rows = [[path.words, digits(MM_PER_M * float(np.linalg.norm(path.change[3:])), 2),
             digits(DEG_PER_RAD * float(np.linalg.norm(path.change[:3])), 2), f"{path.chi_square:.1f} of {path.dof}",
             probability(path.p)] for path in ordered]  # fmt: skip
    return [
        Table(
            "Two ways to one pose and how far they differ; a probability far below one over their number says that "
            "something did not stand still.",
            ["pose", "position (mm)", "rotation (deg)", "chi-square", "probability"], rows,
        )
    ]  # fmt: skip


def _optimality(result: RigStatement) -> list[Block]:
    of = result.optimality
    rows = [["proven", "yes" if of.proven else "no"],
            ["relative gap to the lower bound", "no bound" if of.gap is None else f"{of.gap:.1e}"],
            ["estimate from the minimum of the isotropic problem (standard deviations)",
             "not known" if of.distance is None else digits(of.distance, 2)],
            ["local minima that the bound rejected before", str(of.rejected)]]  # fmt: skip
    return [Paragraph(f"Global minimum: {of.words}."), Table("Dual bound of the isotropic problem.", ["", ""], rows)]


def _largest(result: RigStatement) -> Table:
    graph, turn, shift = _residuals(result)
    rows = []
    for e in np.argsort(-result.distances)[:60].tolist():
        view = result.rig.views[graph.view[e]]
        rows.append([f"{view.camera}, {view.target}", str(view.at[graph.row[e]]), digits(float(shift[e]), 2),
                     digits(float(turn[e]), 2), f"{float(result.distances[e]) / 6:.2f}",
                     digits(float(result.weights[e]), 2)])  # fmt: skip
    return Table(
        f"The {len(rows)} views with the largest distance, of {len(turn)}.",
        ["camera, target", "robot pose", "position (mm)", "rotation (deg)", "d^2/6", "weight"], rows,
    )  # fmt: skip


def _in_full(result: RigStatement) -> Table:
    rows = [[one.frame, *(fact.bare for fact in result.facts.select("pose", one.frame))] for one in result.every]
    return Table(
        "Translation and rotation vector, with one standard deviation in brackets. Matrices and the joint covariance "
        "are in the result file.",
        ["pose", "x (mm)", "y (mm)", "z (mm)", "rx (deg)", "ry (deg)", "rz (deg)"],
        rows,
    )


def certified_poses(result: RigStatement) -> list[EstimatedPose]:
    """Return the poses that a certificate states: cameras, targets, and the bases of all arms but the first."""
    return [*result.cameras.values(), *result.targets.values(), *list(result.arms.values())[1:]]


def stated_table(result: RigStatement, poses: Sequence[EstimatedPose]) -> Table:
    """Return poses with their quaternions and what 95 % of their errors are within."""
    rows = []
    for one in poses:
        q = Rotation.from_matrix(one.pose[:3, :3]).as_quat()
        position = (fact.rounded(3) for fact in result.facts.select("pose", one.frame)[:3])
        sizes = (fact.short_95 for fact in result.facts.select("error of pose", one.frame))
        rows.append([one.frame, *position, *(f"{x:.6f}" for x in q), *sizes])
    caption = (
        f"Position, quaternion, and the length and angle U that {percent(INTERVAL.probability)} of the errors are "
        "within, from the joint covariance."
    )
    return Table(caption, ["pose", "x (mm)", "y (mm)", "z (mm)", "qx", "qy", "qz", "qw", "U (mm)", "U (deg)"], rows)


def _stated_pairs(result: RigStatement) -> list[Block]:
    return [stated_table(result, result.pairs)] if result.pairs else [Paragraph("None.")]
