"""Drawing of a rig: cameras on the left, targets on the right, views between them, what each is on, its uncertainty.

Each node has an ellipse: half its width is the error of the rotation, half its height that of the position, on one
scale for all nodes of the drawing. Where lines of many pairs would cover each other, targets are rows and cameras are
columns. Written as SVG; classes give it the colours of the page.

The report of a rig: one self-contained HTML file, or its two pages as PDF; the skeleton is that of one camera.

Page one has the answer, the drawing of the rig and all poses; page two the relative poses, residuals by camera and
target, and the noise; the rest follows in sections that are folded on the screen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from .._version import __version__
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.formatting.numbers import digits, probability
from ..core.geometry.conventions import CONVENTION
from ..core.geometry.se3 import Array
from ..core.presentation.document import Answer, Badge, Block, Drawing, Paragraph, Points, Section, Table
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from .description import WORLD
from .graph import Graph

WIDTH, ROW, TOP, RADIUS = 440.0, 60.0, 32.0, 18.0
LEFT, RIGHT = 158.0, 282.0
# Pairs of camera and target that are drawn as lines.
MOST_LINES = 12
_INK = 'fill="#515a64"'
_LINE = 'fill="none" stroke="#515a64"'
_RING = 'fill="none" stroke="#0b5394" stroke-width="1.4"'


def rig_sketch(result: Any) -> Drawing:
    """Return the drawing of a `RigCalibration`."""
    rig = result.rig
    nodes = {**result.cameras, **result.targets, **dict(list(result.arms.items())[1:])}
    turns, shifts = (np.array([one.sizes[k] for one in nodes.values()]) for k in (0, 1))
    most = [float(values[np.isfinite(values)].max(initial=0.0)) or 1.0 for values in (turns, shifts)]
    counts: dict[tuple[str, str], int] = {}
    for view in rig.views:
        pair = (view.camera, view.target)
        counts[pair] = counts.get(pair, 0) + len(view.poses)
    many = len(counts) > MOST_LINES
    parts, width, height = (_rows_and_columns if many else _lines)(result, nodes, counts, most)
    svg = (
        f'<svg viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg" class="sketch" font-size="11" '
        'font-family="system-ui, Segoe UI, Roboto, DejaVu Sans, Arial, sans-serif" aria-hidden="true" '
        f'focusable="false">{"".join(parts)}</svg>'
    )
    listed = "; ".join(f"{camera} sees {target} {count} times" for (camera, target), count in counts.items())
    lines = "Numbers are those of views of each target by each camera" if many else "Lines are views, with their number"
    return Drawing(
        "rig", Markup(svg), f"Cameras and targets of the rig with their views: {listed}.",
        f"{lines}. Half the width of an ellipse is the error of the rotation "
        f"(largest: {digits(np.degrees(most[0]), 2)} deg), half its height that of the position (largest: "
        f"{digits(1e3 * most[1], 2)} mm), root mean square, on one scale. A dashed circle: not determined in all "
        "directions.", small=True,
    )  # fmt: skip


Counts = dict[tuple[str, str], int]


def _lines(result: Any, nodes: dict[str, Any], counts: Counts, most: list[float]) -> tuple[list[str], float, float]:
    """Cameras on the left, targets on the right, bases of arms below; width and height."""
    rig, columns = result.rig, (list(result.cameras), list(result.targets))
    others = [name for name in nodes if name not in (*columns[0], *columns[1])]
    rows = max(map(len, columns))
    at = {}
    for x, column in zip((LEFT, RIGHT), columns, strict=True):
        for k, name in enumerate(column):
            at[name] = (x, TOP + ROW * (k + 0.5 + 0.5 * (rows - len(column))))
    for k, name in enumerate(others):
        at[name] = (WIDTH * (k + 1) / (len(others) + 1), TOP + ROW * (rows + 0.5))
    parts = [_text(LEFT, 16, "cameras", "middle"), _text(RIGHT, 16, "targets", "middle")]
    for k, ((camera, target), count) in enumerate(counts.items()):
        (x1, y1), (x2, y2) = at[camera], at[target]
        parts.append(f'<path class="axis" {_LINE} d="M{x1 + 20:.1f} {y1:.1f}L{x2 - 20:.1f} {y2:.1f}"/>')
        share = 0.3 + 0.4 * (k % 3) / 2 if len(counts) > 1 else 0.5
        x, y = x1 + 20 + share * (x2 - x1 - 40), y1 + share * (y2 - y1)
        parts.append(_text(x, y - 4, str(count), "middle"))
    for name, one in nodes.items():
        anchor, dx = ("start", 26.0) if name in others or at[name][0] == RIGHT else ("end", -26.0)
        place = "base of an arm" if name in others else _place(rig.place(name))
        parts += _node(name, one, at[name], most, place, anchor, dx)
    return parts, WIDTH, TOP + ROW * rows + (ROW if others else 0.0)


def _rows_and_columns(
    result: Any, nodes: dict[str, Any], counts: Counts, most: list[float]
) -> tuple[list[str], float, float]:
    """A row for each target and base, a column for each camera, numbers of views where they meet."""
    rig, cameras = result.rig, list(result.cameras)
    names = [name for name in nodes if name not in cameras]
    heads = [_short(f"{name}, {_place(rig.place(name))}") for name in cameras]
    beside = [_short(text) for name in names for text in (name, _place(rig.place(name)))]
    wide, high = 6.6 * max(map(len, beside)), 6.8 * max(map(len, heads))  # of the longest texts
    left, top, step = wide + 52.0, 0.77 * high + 52.0, 36.0
    parts: list[str] = []
    for k, name in enumerate(cameras):
        x = left + step * (k + 0.5)
        parts.append(_shape(nodes[name], (x, top - 22), most, 0.8)[0])
        turned = f'transform="rotate(-50 {x:.1f} {top - 42:.1f})"'
        parts.append(_text(x, top - 42, heads[k], "start", bold=True).replace("<text ", f"<text {turned} ", 1))
    for row, name in enumerate(names):
        y = top + 30.0 * (row + 0.5)
        place = _place(rig.place(name)) if name in rig.targets else "base of an arm"
        parts.append(
            f'<path class="axis" {_LINE} stroke-opacity="0.3" d="M8 {y + 15:.1f}H{left + step * len(cameras):.1f}"/>'
        )
        parts += [_text(left - 28, y - 2, name, "end", bold=True), _text(left - 28, y + 10, place, "end")]
        parts.append(_shape(nodes[name], (left - 8, y), most, 0.7)[0])
        for k, camera in enumerate(cameras):
            if count := counts.get((camera, name)):
                parts.append(_text(left + step * (k + 0.5), y + 4, str(count), "middle"))
    return parts, left + step * (len(cameras) - 0.5) + 0.65 * high + 6.0, top + 30.0 * len(names) + 6.0


def _shape(one: Any, at: tuple[float, float], most: list[float], factor: float = 1.0) -> tuple[str, str]:
    """Ellipse of a node, or dashed circle, and the sizes in words."""
    (x, y), (turn, shift) = at, one.sizes
    if not (np.isfinite(turn) and np.isfinite(shift)):
        dashed = (
            f'<circle class="ring" {_RING} stroke-dasharray="3 3" cx="{x:.1f}" cy="{y:.1f}" r="{factor * RADIUS:g}"/>'
        )
        return dashed, "not determined"
    rx, ry = (max(1.5, factor * RADIUS * size / largest) for size, largest in zip((turn, shift), most, strict=True))
    said = f"{digits(1e3 * shift, 2)} mm, {digits(float(np.degrees(turn)), 2)} deg"
    return f'<ellipse class="ring" {_RING} cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}"/>', said


def _node(
    name: str, one: Any, at: tuple[float, float], most: list[float], place: str, anchor: str, dx: float
) -> list[str]:
    (x, y), (shape, said) = at, _shape(one, at, most)
    return [
        shape,
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2" {_INK}/>',
        _text(x + dx, y - 12, name, anchor, bold=True),
        _text(x + dx, y + 2, place, anchor),
        _text(x + dx, y + 16, said, anchor),
    ]


def _place(place: str) -> str:
    return "in the world" if place == WORLD else f"on {place}"


def _text(x: float, y: float, text: str, anchor: str = "start", bold: bool = False) -> str:
    weight = ' font-weight="600"' if bold else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" {_INK} text-anchor="{anchor}"{weight}>{escape(_short(text))}</text>'


def _short(text: str) -> str:
    return text if len(text) <= 22 else f"{text[:21]}\N{HORIZONTAL ELLIPSIS}"


# Views that are listed, those with the largest distance first; probability of a chi-square below which it is said;
# share of the views that are rejected above which it is.
MOST_VIEWS, UNLIKELY, MANY = 60, 1e-3, 0.1
_DEG, _MM = 180 / np.pi, 1e3


def write_rig_report(
    result: Any,
    path: str | Path,
    *,
    about: Mapping[str, str] | None = None,
    verdicts: Mapping[str, Any] | None = None,
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
    verdicts : mapping of names of cameras to `Verdict`, or None
        Whether each meets the tolerance.
    details : bool
        Open the folded sections.
    paper : "a4" or "letter"

    Raises
    ------
    InputError
        Another suffix, or a file that cannot be written.
    """
    target = page_path(path, paper)
    return write_page(
        target, rig_html(result, about=as_about(about or {}), verdicts=verdicts or {}, details=details), paper
    )


def rig_html(
    result: Any,
    *,
    about: Mapping[str, str] | None = None,
    verdicts: Mapping[str, Any] | None = None,
    details: bool = False,
    date: str | None = None,
) -> str:
    """Return the report as HTML text; ``date`` None is now (UTC)."""
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC") if date is None else date
    rig, titles = result.rig, about or {}
    first = [
        Section("answer", "Result", _answer(result, verdicts or {}), wide=True),
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
        [counted(rig), f"{sum(len(view.poses) for view in rig.views)} views", f"method {result.method}",
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


def headline(result: Any) -> tuple[str, str]:
    """Return the sentence that a rig is asked for, with its status: ok, caution or failed."""
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
    least = f"{digits(_MM * known[shift][1], 2)} mm and {digits(_DEG * turn, 2)} deg"
    count = "Both" if len(known) == 2 else f"All {len(known)}"
    whose = f"{count} cameras are known" if len(known) > 1 else f"The camera {shift} is known"
    text = f"{whose} to {least} or better (root mean square error, 1 sigma)."
    unlikely = result.p_value < UNLIKELY or len(result.rejected) > MANY * len(result.weights)
    return text, "caution" if caution or unlikely else "ok"


def _answer(result: Any, verdicts: Mapping[str, Any]) -> list[Block]:
    text, status = headline(result)
    blocks: list[Block] = [Answer(text, status)]
    colours = {"PASS": "ok", "NOT SHOWN": "caution", "FAIL": "failed"}
    blocks += [Badge(f"{name}: {v.word}", v.sentence, colours[v.word]) for name, v in verdicts.items()]
    said = f"Chi-square of the residuals {result.chi_square:.0f} of {result.dof:.0f}, {probability(result.p_value)}."
    if result.p_value < UNLIKELY:
        said += " The residuals are larger than the noise says: the errors are larger than stated."
    if len(result.rejected) > MANY * len(result.weights):
        said += f" {len(result.rejected)} of {len(result.weights)} views were rejected."
    blocks.append(Paragraph(said))
    if result.findings:
        blocks.append(Points.of_findings(result.findings))
    if rejected := result.rejected_words:
        blocks.append(Points(rejected))
    return blocks


def counted(rig: Any) -> str:
    """Return the numbers of arms, cameras and targets in words."""
    parts = (("arm", rig.arms), ("camera", rig.cameras), ("target", rig.targets))
    return ", ".join(f"{len(of)} {what}{'' if len(of) == 1 else 's'}" for what, of in parts)


def _rows(poses: Sequence[Any], counted: bool) -> list[list[str]]:
    rows = []
    for one in poses:
        turn, shift = one.sizes
        sizes = [digits(_MM * shift, 2) if np.isfinite(shift) else "open",
                 digits(_DEG * turn, 2) if np.isfinite(turn) else "open"]  # fmt: skip
        count = [str(one.count) if one.count else ""] if counted else []
        rows.append([one.frame, *(f"{_MM * x:.2f}" for x in one.pose[:3, 3]), *sizes, *count])
    return rows


_HEAD = ["pose", "x (mm)", "y (mm)", "z (mm)", "position (mm)", "rotation (deg)"]


def _poses(result: Any) -> Table:
    every = [*result.cameras.values(), *result.targets.values(), *list(result.arms.values())[1:]]
    return Table(
        "Position of each pose, and the root mean square length of its error (1 sigma).", [*_HEAD, "views"],
        _rows(every, True),
    )  # fmt: skip


def _pairs(result: Any) -> list[Block]:
    if not result.pairs:
        return [Paragraph("No two cameras are on one thing, so that no relative pose is constant.", empty=True)]
    return [
        Table(
            "From the joint covariance: errors that both share cancel, which separate calibrations do not know.",
            _HEAD, _rows(result.pairs, False),
        )
    ]  # fmt: skip


def _residuals(result: Any) -> tuple[Graph, Array, Array]:
    """Graph, rotations (deg) and positions (mm) (E,) of the residuals of the views."""
    graph = Graph.of(result.rig)
    r = graph.linearise(result.poses).r
    return graph, _DEG * np.linalg.norm(r[:, :3], axis=1), _MM * np.linalg.norm(r[:, 3:], axis=1)


def _by_pair(result: Any) -> Table:
    graph, turn, shift = _residuals(result)
    rows: list[list[str]] = []
    marked: set[int] = set()
    pairs = dict.fromkeys((view.camera, view.target) for view in result.rig.views)
    for camera, target in pairs:
        views = [k for k, view in enumerate(result.rig.views) if (view.camera, view.target) == (camera, target)]
        of = np.isin(graph.view, views)
        kept = of & (result.weights > 0)
        if not kept.any():
            kept = of
        square = float(result.distances[kept].mean()) / 6
        if square > 2:
            marked.add(len(rows))
        rows.append([f"{camera}, {target}", str(int(of.sum())), str(int((result.weights[of] == 0).sum())),
                     digits(float(np.sqrt((shift[kept] ** 2).mean())), 2),
                     digits(float(np.sqrt((turn[kept] ** 2).mean())), 2), f"{square:.2f}"])  # fmt: skip
    return Table(
        "Root mean square of the residuals of the views that count; d^2/6 is 1 on average if the noise is as stated.",
        ["camera, target", "views", "rejected", "position (mm)", "rotation (deg)", "d^2/6"], rows, frozenset(),
        frozenset(marked),
    )  # fmt: skip


def noise_table(result: Any) -> list[Block]:
    """Return the standard deviations of arms and cameras."""
    rows = [[name, digits(_MM * sizes[1], 2), digits(_DEG * sizes[0], 2)] for name, sizes in result.noise.items()]
    how = "estimated from the views" if result.components else "as given"
    caption = f"Standard deviations of one pose per axis, {how}."
    return [Table(caption, ["arm or camera", "position (mm)", "rotation (deg)"], rows)]


def _sizes(result: Any) -> list[Block]:
    if not result.components:
        return [Paragraph("Not estimated: the noise was given.", empty=True)]
    parts = [[part["name"], *(_sized(part[key], part["unit"]) for key in ("size", "low", "high"))]
             for part in result.components]  # fmt: skip
    caption = "Noise, and errors that all poses of their owner share, with 95 % intervals."
    return [Table(caption, ["error", "size", "from", "to"], parts)]


def _sized(value: float, unit: str) -> str:
    factor, shown = {"m": (_MM, "mm"), "rad": (_DEG, "deg")}.get(unit, (100.0, "%") if not unit else (1.0, unit))
    return f"{digits(factor * value, 2)} {shown}"


def _paths(result: Any) -> list[Block]:
    if not result.paths:
        return [Paragraph("No two ways lead to one pose.", empty=True)]
    ordered = sorted(result.paths, key=lambda path: path.p)
    rows = [[path.words, digits(_MM * float(np.linalg.norm(path.change[3:])), 2),
             digits(_DEG * float(np.linalg.norm(path.change[:3])), 2), f"{path.chi_square:.1f} of {path.dof}",
             probability(path.p)] for path in ordered]  # fmt: skip
    return [
        Table(
            "Two ways to one pose and how far they differ; a probability far below one over their number says that "
            "something did not stand still.",
            ["pose", "position (mm)", "rotation (deg)", "chi-square", "probability"], rows,
        )
    ]  # fmt: skip


def _optimality(result: Any) -> list[Block]:
    of = result.optimality
    rows = [["proven", "yes" if of.proven else "no"],
            ["relative gap to the lower bound", "no bound" if of.gap is None else f"{of.gap:.1e}"],
            ["estimate from the minimum of the isotropic problem (standard deviations)",
             "not known" if of.distance is None else digits(of.distance, 2)],
            ["local minima that the bound rejected before", str(of.rejected)]]  # fmt: skip
    return [Paragraph(of.words), Table("Dual bound of the isotropic problem.", ["", ""], rows)]


def _largest(result: Any) -> Table:
    graph, turn, shift = _residuals(result)
    rows = []
    for e in np.argsort(-result.distances)[:MOST_VIEWS].tolist():
        view = result.rig.views[graph.view[e]]
        rows.append([f"{view.camera}, {view.target}", str(view.at[graph.row[e]]), digits(float(shift[e]), 2),
                     digits(float(turn[e]), 2), f"{float(result.distances[e]) / 6:.2f}",
                     digits(float(result.weights[e]), 2)])  # fmt: skip
    return Table(
        f"The {len(rows)} views with the largest distance, of {len(turn)}.",
        ["camera, target", "robot pose", "position (mm)", "rotation (deg)", "d^2/6", "weight"], rows,
    )  # fmt: skip


def _in_full(result: Any) -> Table:
    every = [*result.cameras.values(), *result.targets.values(), *list(result.arms.values())[1:], *result.pairs]
    rows = []
    for one in every:
        sd = one.std
        rows.append([one.frame, *(f"{_MM * x:.4f}" for x in one.pose[:3, 3]),
                     *(f"{_MM * s:.4f}" if np.isfinite(s) else "open" for s in sd[3:]),
                     *(f"{_DEG * s:.5f}" if np.isfinite(s) else "open" for s in sd[:3])])  # fmt: skip
    return Table(
        "Positions, standard deviations of position and rotation about each axis. Matrices and the joint covariance "
        "are in the result file.",
        ["pose", "x (mm)", "y (mm)", "z (mm)", "sd x (mm)", "sd y", "sd z", "sd about x (deg)", "about y", "about z"],
        rows,
    )  # fmt: skip
