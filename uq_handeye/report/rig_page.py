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
from ..calibration.report.rig_sections import rig_parts
from ..calibration.rig_poses import RigPoses
from ..core.files.about import ABOUT, OF_CERTIFICATE, as_about
from ..core.limits import MAX_LISTED
from ..core.presentation.document import Badge, Drawing, Section
from ..core.presentation.html import macros
from ..core.presentation.numbers import digits
from ..core.presentation.page import PAPERS, Page, page_path, write_page
from ..core.presentation.sections import selected
from ..model.poses.estimated_pose import EstimatedPose
from ..model.rig.description import WORLD

# Sections that follow the two pages.
FOLDED = ("sizes", "paths", "certificate", "largest", "numbers", "conventions")


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
    parts = rig_parts(result, verdicts)
    first = selected(parts, ("answer", "poses"), wide=True)
    first.insert(1, Section("rig", "The rig", [rig_sketch(result)], wide=True))
    second = selected(parts, ("pairs", "checks", "views", "noise"), wide=True)
    sections = selected(parts, FOLDED, folded=True)
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
