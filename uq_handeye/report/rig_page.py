"""The report of a rig: its selection of sections, and its drawing.

Page one has the answer, the drawing of the rig and all poses; page two the relative poses, residuals by camera and
target, and the noise; the rest follows in sections that are folded on the screen.

The drawing has cameras on the left, targets on the right, and the views between them. Each node names its carrier and
has an ellipse: half its width is the error of the rotation, half its height that of the position, on one scale for all
nodes. Where lines of many pairs would cover each other, targets are rows and cameras are columns. The drawing is
written as SVG (`sketch.svg.j2`); its classes give it the colours of the page.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from ..calibration.report.answer import badges_of
from ..calibration.report.rig_sections import rig_parts
from ..calibration.rig_result import RigCalibration
from ..core.limits import MAX_LISTED
from ..core.presentation.document import Drawing, Section
from ..core.presentation.html import macros
from ..core.presentation.numbers import digits
from ..core.presentation.sections import selected
from ..model.poses.estimated_pose import EstimatedPose
from ..model.rig.description import WORLD
from .content import Content, Wanted, content_of

# Sections that follow the two pages.
FOLDED = ("sizes", "paths", "certificate", "largest", "numbers", "conventions")


def rig_sketch(result: RigCalibration) -> Drawing:
    """Return the drawing of a `RigCalibration`, by the macros of `sketch.svg.j2`."""
    sizes = [result.facts.select("error of pose", one.frame) for one in result.singles]
    shifts, turns = (np.array([of[k].value for of in sizes]) for k in (0, 1))
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
        f"(largest: {digits(most[0], 2)} deg), half its height that of the position (largest: "
        f"{digits(most[1], 2)} mm), 1 sigma in the worst direction, on one scale. A dashed circle: not determined "
        "in all directions.", small=True,
    )  # fmt: skip


def _node(result: RigCalibration, one: EstimatedPose, most: list[float]) -> dict[str, str | list[float] | None]:
    """Return what is drawn of a pose: its names, its sizes in words and as an ellipse."""
    name, radii, said = one.name, None, "not determined"
    shift, turn = result.facts.select("error of pose", one.frame)
    if np.isfinite([turn.value, shift.value]).all():
        radii = [18.0 * fact.value / largest for fact, largest in zip((turn, shift), most, strict=True)]
        said = f"{shift.short} {shift.unit}, {turn.short} {turn.unit}"
    place = result.rig.place(name)
    where = "base of an arm" if name in result.arms else "in the world" if place == WORLD else f"on {place}"
    return {"name": name, "place": where, "head": f"{name}, {where}", "said": said, "radii": radii}


def _short(text: str) -> str:
    return text if len(text) <= 22 else f"{text[:21]}\N{HORIZONTAL ELLIPSIS}"


@content_of.register
def rig_content(result: RigCalibration, wanted: Wanted) -> Content:
    """Return what the report of a rig shows."""
    parts = rig_parts(result, badges_of(result, wanted.verdicts))
    first = selected(parts, ("answer", "next", "poses"), wide=True)
    first.insert(1, Section("rig", "The rig", [rig_sketch(result)], wide=True))
    second = selected(parts, ("pairs", "all-checks", "cautions", "views", "noise"), wide=True)
    sections = selected(parts, FOLDED, folded=True) if wanted.folded else []
    return Content(result.camera_names, [result.rig.words, f"{result.rig.n_views} views"], [first, second], sections)
