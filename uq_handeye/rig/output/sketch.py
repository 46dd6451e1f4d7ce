"""Drawing of a rig: cameras on the left, targets on the right, views between them, what each is on, its uncertainty.

Each node has an ellipse: half its width is the error of the rotation, half its height that of the position, on one
scale for all nodes of the drawing. Written as SVG; classes give it the colours of the page.
"""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup

from ...core.formatting.numbers import digits
from ...core.presentation.document import Drawing
from ..description import WORLD

WIDTH, ROW, TOP, RADIUS = 440.0, 60.0, 32.0, 18.0
LEFT, RIGHT = 158.0, 282.0
_INK = 'fill="#515a64"'
_LINE = 'fill="none" stroke="#515a64"'
_RING = 'fill="none" stroke="#0b5394" stroke-width="1.4"'


def rig_sketch(result: Any) -> Drawing:
    """Return the drawing of a `RigCalibration`."""
    rig, others = result.rig, list(result.arms.items())[1:]
    columns = [list(result.cameras.items()), [*result.targets.items()]]
    rows = max(map(len, columns))
    height = TOP + ROW * rows + (ROW if others else 0.0)
    at = {}
    for x, column in zip((LEFT, RIGHT), columns, strict=True):
        for k, (name, _) in enumerate(column):
            at[name] = (x, TOP + ROW * (k + 0.5 + 0.5 * (rows - len(column))))
    for k, (name, _) in enumerate(others):
        at[name] = (WIDTH * (k + 1) / (len(others) + 1), TOP + ROW * (rows + 0.5))
    nodes = {name: one for column in (*columns, others) for name, one in column}
    turns, shifts = (np.array([one.sizes[k] for one in nodes.values()]) for k in (0, 1))
    most = [float(values[np.isfinite(values)].max(initial=0.0)) or 1.0 for values in (turns, shifts)]
    parts = [_text(LEFT, 16, "cameras", "middle"), _text(RIGHT, 16, "targets", "middle")]
    counts: dict[tuple[str, str], int] = {}
    for view in rig.views:
        pair = (view.camera, view.target)
        counts[pair] = counts.get(pair, 0) + len(view.poses)
    for k, ((camera, target), count) in enumerate(counts.items()):
        (x1, y1), (x2, y2) = at[camera], at[target]
        parts.append(f'<path class="axis" {_LINE} d="M{x1 + 20:.1f} {y1:.1f}L{x2 - 20:.1f} {y2:.1f}"/>')
        share = 0.3 + 0.4 * (k % 3) / 2 if len(counts) > 1 else 0.5
        x, y = x1 + 20 + share * (x2 - x1 - 40), y1 + share * (y2 - y1)
        parts.append(_text(x, y - 4, str(count), "middle"))
    for name, one in nodes.items():
        anchor, dx = ("start", 26.0) if name in dict(others) or at[name][0] == RIGHT else ("end", -26.0)
        place = "base of an arm" if name in dict(others) else _place(rig.place(name))
        parts += _node(name, one, at[name], most, place, anchor, dx)
    svg = (
        f'<svg viewBox="0 0 {WIDTH:g} {height:g}" xmlns="http://www.w3.org/2000/svg" class="sketch" font-size="11" '
        'font-family="system-ui, Segoe UI, Roboto, DejaVu Sans, Arial, sans-serif" aria-hidden="true" '
        f'focusable="false">{"".join(parts)}</svg>'
    )
    listed = "; ".join(f"{camera} sees {target} {count} times" for (camera, target), count in counts.items())
    return Drawing(
        "rig", Markup(svg), f"Cameras and targets of the rig with their views: {listed}.",
        "Lines are views, with their number. Half the width of an ellipse is the error of the rotation "
        f"(largest: {digits(np.degrees(most[0]), 2)} deg), half its height that of the position (largest: "
        f"{digits(1e3 * most[1], 2)} mm), root mean square, on one scale. A dashed circle: not determined in all "
        "directions.", small=True,
    )  # fmt: skip


def _node(
    name: str, one: Any, at: tuple[float, float], most: list[float], place: str, anchor: str, dx: float
) -> list[str]:
    (x, y), (turn, shift) = at, one.sizes
    if np.isfinite(turn) and np.isfinite(shift):
        rx, ry = (max(1.5, RADIUS * size / largest) for size, largest in zip((turn, shift), most, strict=True))
        shape = f'<ellipse class="ring" {_RING} cx="{x:.1f}" cy="{y:.1f}" rx="{rx:.1f}" ry="{ry:.1f}"/>'
        said = f"{digits(1e3 * shift, 2)} mm, {digits(float(np.degrees(turn)), 2)} deg"
    else:
        shape = f'<circle class="ring" {_RING} stroke-dasharray="3 3" cx="{x:.1f}" cy="{y:.1f}" r="{RADIUS:g}"/>'
        said = "not determined"
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
    short = text if len(text) <= 20 else f"{text[:19]}\N{HORIZONTAL ELLIPSIS}"
    return f'<text x="{x:.1f}" y="{y:.1f}" {_INK} text-anchor="{anchor}"{weight}>{escape(short)}</text>'
