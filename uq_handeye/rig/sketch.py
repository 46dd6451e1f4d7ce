"""Drawing of a rig: cameras on the left, targets on the right, views between them, what each is on, its uncertainty.

Each node has an ellipse: half its width is the error of the rotation, half its height that of the position, on one
scale for all nodes of the drawing. Where lines of many pairs would cover each other, targets are rows and cameras are
columns. Written as SVG; classes give it the colours of the page.
"""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from markupsafe import Markup

from ..core.formatting.numbers import digits
from ..core.presentation.document import Drawing
from .description import WORLD

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
