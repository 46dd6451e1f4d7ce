"""The report of a rig: one self-contained HTML file, or its two pages as PDF, with the skeleton of one camera's report.

Page one has the answer, the drawing of the rig and all poses; page two the relative poses, residuals by camera and
target, and the noise; the rest follows in sections that are folded on the screen.

The drawing has cameras on the left, targets on the right, and the views between them. Each node names its carrier and
has an ellipse: half its width is the error of the rotation, half its height that of the position, on one scale for all
nodes. Where lines of many pairs would cover each other, targets are rows and cameras are columns. The drawing is
written as SVG (`sketch.svg.j2`); its classes give it the colours of the page.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from .._version import __version__
from ..calibration.estimate.rig_poses import RigPoses
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.formatting.numbers import digits, probability
from ..core.formatting.units import DEG_PER_RAD, MM_PER_M
from ..core.geometry.conventions import CONVENTION
from ..core.geometry.se3 import Array
from ..core.numbers.levels import CONTRADICTED
from ..core.numbers.limits import MAX_LISTED
from ..core.presentation.document import Answer, Badge, Block, Drawing, Paragraph, Points, Section, Table
from ..core.presentation.html import macros
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from ..fit.graph.graph import Graph
from ..model.poses.estimated_pose import EstimatedPose
from ..model.rig.description import WORLD

# The headline is a caution where a larger share of the views is rejected.
MAX_REJECTED_VIEWS = 0.1


def rig_sketch(result: RigPoses) -> Drawing:
    """Return the drawing of a `RigCalibration`, by the macros of `sketch.svg.j2`."""
    turns, shifts = (np.array([one.sizes[k] for one in result.singles]) for k in (0, 1))
    most = [float(values[np.isfinite(values)].max(initial=0.0)) or 1.0 for values in (turns, shifts)]
    counts: Counter[tuple[str, str]] = Counter()
    for view in result.rig.views:
        counts[view.camera, view.target] += len(view.poses)
    nodes = {one.name: _node(result, one, most) for one in result.singles}
    cameras, targets = ({name: nodes.pop(name) for name in of} for of in (result.cameras, result.targets))
    drawn = macros(__package__, "sketch.svg.j2", short=_short, longest=lambda of: max(len(_short(text)) for text in of))
    lines = "Lines are views, with their number"
    if len(counts) > MAX_LISTED:
        lines = "Numbers are those of views of each target by each camera"
        svg = drawn.table(cameras, targets | nodes, counts)
    else:
        svg = drawn.lines(cameras, targets, nodes, counts)
    listed = "; ".join(f"{camera} sees {target} {count} times" for (camera, target), count in counts.items())
    return Drawing(
        "rig", svg, f"Cameras and targets of the rig with their views: {listed}.",
        f"{lines}. Half the width of an ellipse is the error of the rotation "
        f"(largest: {digits(np.degrees(most[0]), 2)} deg), half its height that of the position (largest: "
        f"{digits(1e3 * most[1], 2)} mm), root mean square, on one scale. A dashed circle: not determined in all "
        "directions.", small=True,
    )  # fmt: skip


def _node(result: RigPoses, one: EstimatedPose, most: list[float]) -> dict[str, str | list[float] | None]:
    """Return what is drawn of a pose: its names, its sizes in words and as an ellipse."""
    name, (turn, shift), radii, said = one.name, one.sizes, None, "not determined"
    if np.isfinite([turn, shift]).all():
        radii = [18.0 * size / largest for size, largest in zip((turn, shift), most, strict=True)]
        said = f"{digits(1e3 * shift, 2)} mm, {digits(float(np.degrees(turn)), 2)} deg"
    place = result.rig.place(name)
    where = "base of an arm" if name in result.arms else "in the world" if place == WORLD else f"on {place}"
    return {"name": name, "place": where, "head": f"{name}, {where}", "said": said, "radii": radii}


def _short(text: str) -> str:
    return text if len(text) <= 22 else f"{text[:21]}\N{HORIZONTAL ELLIPSIS}"


def write_rig_report(
    result: RigPoses,
    path: str | Path,
    *,
    about: Mapping[str, str] | None = None,
    verdicts: Sequence[Badge] = (),
    details: bool = False,
    paper: str = PAPERS[0],
) -> Path:
    """Write the report of a rig and return its path.

    Parameters
    ----------
    result : RigCalibration
    path : path that ends in .html or .pdf
    about : mapping of names to text, or None
        Title block, by the names of `uq_handeye.core.files.about.ABOUT`.
    verdicts : sequence of Badge
        Whether each camera meets the tolerance.
    details : bool
        Open the folded sections.
    paper : "a4" or "letter"

    Raises
    ------
    InputError
        Another suffix, or a file that cannot be written.
    """
    target = page_path(path, paper)
    return write_page(target, rig_html(result, about=as_about(about or {}), verdicts=verdicts, details=details), paper)


def rig_html(
    result: RigPoses,
    *,
    about: Mapping[str, str] | None = None,
    verdicts: Sequence[Badge] = (),
    details: bool = False,
    date: str | None = None,
) -> str:
    """Return the report as HTML text; ``date`` None is now (UTC)."""
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    rig, titles = result.rig, about or {}
    first = [
        Section("answer", "Result", _answer(result, verdicts), wide=True),
        Section("rig", "The rig", [rig_sketch(result)], wide=True),
        Section("poses", "Poses", [_poses(result)], wide=True),
    ]
    second = [
        Section("pairs", "Relative poses of the cameras", _pairs(result), wide=True),
        Section("views", "Residuals by camera and target", [_by_pair(result)], wide=True),
        Section("noise", "Noise", noise_table(result), wide=True),
    ]
    sections = [
        Section("sizes", "Sizes of all errors", _sizes(result), folded=True),
        Section("paths", "Paths that should agree", _paths(result), folded=True),
        Section("certificate", "Certificate of the global minimum", _optimality(result), folded=True),
        Section("largest", "Views with the largest residuals", [_largest(result)], folded=True),
        Section("numbers", "Poses and standard deviations in full", [_in_full(result)], folded=True),
        Section("conventions", "Conventions", [Paragraph(f"{CONVENTION}. {FRAMES}")], folded=True),
    ]
    fields = [(ABOUT[key], titles.get(key, "")) for key in ABOUT if key not in OF_CERTIFICATE and
              (key != "note" or key in titles)]  # fmt: skip
    return Page(
        "Calibration of a rig",
        ", ".join(rig.cameras),
        [rig.words, f"{rig.n_views} views", f"method {result.method}",
         f"report of {date}"],
        sections,
        sheets=[first, second],
        fields=fields,
        foot=f"uq-handeye {__version__}. Standard deviations are 1 sigma. Not printed: "
        f"{'; '.join(section.title for section in sections)}.",
        full=details,
    ).html()  # fmt: skip


FRAMES = (
    "The world is the base of the first arm. gripper_T_NAME is the pose of a camera or target in the flange that "
    "carries it, world_T_NAME of one that stands still, A_T_B of B in the frame of A."
)


def headline(result: RigPoses) -> tuple[str, str]:
    """Return the headline of a rig, with its status: ok, caution or failed."""
    if result.reasons:
        return f"Not usable. {result.reasons[0]}", "failed"
    caution = any(finding.severity == "caution" for finding in result.findings)
    known = {name: one.sizes for name, one in result.cameras.items()}
    unknown = [name for name, sizes in known.items() if not np.isfinite(sizes).all()]
    if unknown:
        text = f"Not determined in all directions: {', '.join(unknown)}. The robot poses turn about too few axes."
        return text, "caution"
    shift = max(known, key=lambda name: known[name][1])
    turn = max(sizes[0] for sizes in known.values())
    least = f"{digits(MM_PER_M * known[shift][1], 2)} mm and {digits(DEG_PER_RAD * turn, 2)} deg"
    count = "Both" if len(known) == 2 else f"All {len(known)}"
    whose = f"{count} cameras are known" if len(known) > 1 else f"The camera {shift} is known"
    text = f"{whose} to {least} or better (root mean square error, 1 sigma)."
    unlikely = result.p_value < CONTRADICTED.probability or len(result.rejected) > MAX_REJECTED_VIEWS * len(
        result.weights
    )
    return text, "caution" if caution or unlikely else "ok"


def _answer(result: RigPoses, verdicts: Sequence[Badge]) -> list[Block]:
    text, status = headline(result)
    blocks: list[Block] = [Answer(text, status)]
    blocks += verdicts
    said = f"Chi-square of the residuals {result.chi_square:.0f} of {result.dof:.0f}, {probability(result.p_value)}."
    if result.p_value < CONTRADICTED.probability:
        said += " The residuals are larger than the noise says: the errors are larger than stated."
    if len(result.rejected) > MAX_REJECTED_VIEWS * len(result.weights):
        said += f" {len(result.rejected)} of {len(result.weights)} views were rejected."
    blocks.append(Paragraph(said))
    if result.findings:
        blocks.append(Points.of_findings(result.findings))
    if rejected := result.rejected_words:
        blocks.append(Points(rejected))
    return blocks


_HEAD = ["pose", "x (mm)", "y (mm)", "z (mm)", "position (mm)", "rotation (deg)"]


def _rows(poses: Sequence[EstimatedPose]) -> list[list[str]]:
    return [[one.frame, *(f"{MM_PER_M * x:.2f}" for x in one.pose[:3, 3]), *one.said] for one in poses]


def _poses(result: RigPoses) -> Table:
    shown = result.split or result.singles  # where a pose moved, that of all views together is neither
    rows = [[*row, str(one.count or "")] for row, one in zip(_rows(shown), shown, strict=True)]
    caption = "Position of each pose, and the root mean square length of its error (1 sigma)."
    if result.split:
        caption += " What moved has a pose before and one after the move, NAME@MOMENT."
    return Table(caption, [*_HEAD, "views"], rows)


def _pairs(result: RigPoses) -> list[Block]:
    if not result.pairs:
        return [Paragraph("No two cameras are on one thing, so that no relative pose is constant.", empty=True)]
    caption = "From the joint covariance: errors that both share cancel, which separate calibrations do not know."
    return [Table(caption, _HEAD, _rows(result.pairs))]


def _residuals(result: RigPoses) -> tuple[Graph, Array, Array]:
    """Graph, rotations (deg) and positions (mm) (E,) of the residuals of the views."""
    graph = Graph.of(result.rig)
    r = graph.linearise(result.poses).r
    return graph, DEG_PER_RAD * np.linalg.norm(r[:, :3], axis=1), MM_PER_M * np.linalg.norm(r[:, 3:], axis=1)


def _by_pair(result: RigPoses) -> Table:
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


def noise_table(result: RigPoses) -> list[Block]:
    """Return the standard deviations of arms and cameras."""
    rows = [
        [name, digits(MM_PER_M * sizes[1], 2), digits(DEG_PER_RAD * sizes[0], 2)]
        for name, sizes in result.noise.items()
    ]
    how = "estimated from the views" if result.components else "as given"
    caption = f"Standard deviations of one pose per axis, {how}."
    return [Table(caption, ["arm or camera", "position (mm)", "rotation (deg)"], rows)]


def _sizes(result: RigPoses) -> list[Block]:
    if not result.components:
        return [Paragraph("Not estimated: the noise was given.", empty=True)]
    parts = [[part["name"], *(_sized(part[key], part["unit"]) for key in ("size", "low", "high"))]
             for part in result.components]  # fmt: skip
    caption = "Noise, and errors that all poses of their owner share, with 95 % intervals."
    return [Table(caption, ["error", "size", "from", "to"], parts)]


def _sized(value: float, unit: str) -> str:
    factor, shown = {"m": (MM_PER_M, "mm"), "rad": (DEG_PER_RAD, "deg")}.get(
        unit, (100.0, "%") if not unit else (1.0, unit)
    )
    return f"{digits(factor * value, 2)} {shown}"


def _paths(result: RigPoses) -> list[Block]:
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


def _optimality(result: RigPoses) -> list[Block]:
    of = result.optimality
    rows = [["proven", "yes" if of.proven else "no"],
            ["relative gap to the lower bound", "no bound" if of.gap is None else f"{of.gap:.1e}"],
            ["estimate from the minimum of the isotropic problem (standard deviations)",
             "not known" if of.distance is None else digits(of.distance, 2)],
            ["local minima that the bound rejected before", str(of.rejected)]]  # fmt: skip
    return [Paragraph(of.words), Table("Dual bound of the isotropic problem.", ["", ""], rows)]


def _largest(result: RigPoses) -> Table:
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


def _in_full(result: RigPoses) -> Table:
    rows = []
    for one in result.every:
        sd = [*(f"{MM_PER_M * s:.4f}" for s in one.std[3:]), *(f"{DEG_PER_RAD * s:.5f}" for s in one.std[:3])]
        rows.append(
            [one.frame, *(f"{MM_PER_M * x:.4f}" for x in one.pose[:3, 3]), *(s.replace("inf", "open") for s in sd)]
        )
    return Table(
        "Positions, standard deviations of position and rotation about each axis. Matrices and the joint covariance "
        "are in the result file.",
        ["pose", "x (mm)", "y (mm)", "z (mm)", "sd x (mm)", "sd y", "sd z", "sd about x (deg)", "about y", "about z"],
        rows,
    )  # fmt: skip
