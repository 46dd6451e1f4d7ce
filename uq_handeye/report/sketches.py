"""Small figures of the two pages: residuals by pose, and the ellipses of rotation and of translation.

They are written as SVG. Classes give them the colours of the page (``report.css``), attributes those of print.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from ..core.formatting.numbers import digits
from ..core.geometry.se3 import Array
from ..core.presentation.document import Drawing
from ..core.presentation.figure_parts import round_number

if TYPE_CHECKING:
    from ..calibration.result import Calibration
    from ..fit.diagnostics.pose_table import PoseTable

# Poses up to which each has a dot; of more, the largest residual of so many neighbours has one.
MOST_DOTS = 400
# A residual this many times the median makes the scale logarithmic.
WIDE = 12.0
# Radii of the ellipses, in standard deviations.
LEVELS = (1, 2, 3)
# Attributes of the shapes, in the colours of print.
_STYLES = {
    "axis": 'fill="none" stroke="#515a64"',
    "grid": 'fill="none" stroke="#d4d9de"',
    "ring": 'fill="none" stroke="#0b5394" stroke-width="1.4"',
    "crosses": 'fill="none" stroke="#d55e00" stroke-width="1.8"',
}
_PAIRS = ((0, 1), (0, 2), (1, 2))


def residual_sketch(table: PoseTable) -> Drawing:
    """Return two panels over the number of the pose: residuals in mm and in deg; flagged poses are crosses, excluded
    ones open circles.
    """
    step = -(-len(table) // MOST_DOTS)
    parts = [
        *_panel(1e3 * table.translation, table, step, 8.0, "mm"),
        *_panel(np.degrees(table.rotation), table, step, 108.0, "deg"),
        _text(50, 207, "0", "middle"),
        _text(398, 207, str(len(table) - 1), "middle"),
        _text(224, 207, f"number of the {table.item}", "middle"),
    ]
    count = len(table.flagged)
    counted, total = table.counted, f"{len(table.counted):,}"
    flagged = f"{count} of {total} flagged, as crosses" if count else f"none of the {total} flagged"
    if table.excluded:
        flagged += f"; {len(table.excluded):,} excluded, as open circles"
    move, turn = 1e3 * np.median(table.translation[counted]), np.degrees(np.median(table.rotation[counted]))
    median = f"{digits(move, 2)} mm, {digits(turn, 2)} deg"
    each = "" if step == 1 else f"; each dot is the largest of {step} neighbours"
    return Drawing(
        "residuals-small",
        Markup(_svg(412, 212, "".join(parts))),
        f"Residual of each {table.item} in mm and in deg: median {median}; {flagged}.",
        f"Residual of each {table.item}: median {median}; {flagged}{each}.",
        small=True,
    )


def _panel(values: Array, table: PoseTable, step: int, top: float, unit: str) -> list[str]:
    """Return one panel, 84 units high, with its axis from 44 to 404."""
    n, bottom = len(values), top + 84.0
    marked = np.zeros(n, dtype=bool)
    marked[table.flagged] = True
    open_ = np.zeros(n, dtype=bool)
    open_[table.excluded] = True
    shown = np.arange(n)
    if step > 1:
        shown = np.array([k + int(np.argmax(values[k : k + step])) for k in range(0, n, step)])
    heights, ticks, logarithmic = _scale(values, float(np.median(values[table.counted])))
    x, y = 50.0 + 348.0 * np.arange(n) / max(n - 1, 1), bottom - 78.0 * heights
    parts = [_path("axis", f"M44 {top:g}V{bottom:g}H404")]
    for tick, height in ticks:
        at = bottom - 78.0 * height
        parts += [_path("grid", f"M44 {at:.1f}H404"), _text(40, at + 3.5, f"{tick:g}", "end")]
    parts.append(_text(50, top + 4, unit + (" (logarithmic)" if logarithmic else "")))
    kept, bad, excluded = shown[~(marked | open_)[shown]], shown[marked[shown]], np.flatnonzero(open_)
    dots = "".join(f'<circle cx="{x[k]:.1f}" cy="{y[k]:.1f}" r="2.2"/>' for k in kept)
    parts.append(f'<g class="dots" fill="#0b5394">{dots}</g>')
    if excluded.size:
        rings = "".join(f'<circle cx="{x[k]:.1f}" cy="{y[k]:.1f}" r="2.6"/>' for k in excluded)
        parts.append(f'<g class="axis" {_STYLES["axis"]}>{rings}</g>')
    if bad.size:
        parts.append(_path("crosses", "".join(f"M{x[k] - 3:.1f} {y[k] - 3:.1f}l6 6m0-6l-6 6" for k in bad)))
    return parts


def _scale(values: Array, median: float) -> tuple[Array, list[tuple[float, float]], bool]:
    """Return heights in [0, 1], ticks with theirs, and whether the scale is logarithmic, since few values hide all."""
    largest = max(float(values.max()), 1e-9)
    if largest > WIDE * max(median, 1e-12):
        low = max(float(np.quantile(values, 0.05)), 1e-4 * largest)
        length = np.log(1.3 * largest / low)
        powers = range(int(np.ceil(np.log10(low))), int(np.floor(np.log10(largest))) + 1)
        ticks = [10.0**k for k in powers] or [largest]
        found = [(tick, float(np.log(tick / low) / length)) for tick in ticks[:: max(1, len(ticks) // 3)]]
        return np.log(np.maximum(values, low) / low) / length, found, True
    size = round_number(largest / 2)
    ticks = [size * k for k in range(int(largest / size + 1e-9) + 1)]
    return (
        values / (1.12 * largest),
        [(tick, tick / (1.12 * largest)) for tick in ticks[:: 1 + (len(ticks) > 4)]],
        False,
    )


def ellipse_sketch(result: Calibration) -> Drawing | None:
    """Return six panels, the 1, 2 and 3 sigma ellipses of translation and of rotation; None without a covariance."""
    if result.covariance is None:
        return None
    parts, said = [], []
    for line, (kind, unit, part, factor) in enumerate(
        (("translation", "mm", slice(3, 6), 1e3), ("rotation", "deg", slice(0, 3), 180 / np.pi))
    ):
        S = factor**2 * result.covariance[part, part]
        reach = 3.2 * float(np.sqrt(S.diagonal().max()))
        if reach <= 0:
            continue
        tick = round_number(0.9 * reach)
        known = zip("xyz", np.sqrt(S.diagonal()), strict=True)
        said.append(f"{kind} {', '.join(f'{axis} {digits(sd, 2)}' for axis, sd in known)} {unit}")
        for column, (i, j) in enumerate(_PAIRS):
            block = S[np.ix_((i, j), (i, j))]
            parts.append(_ellipses(block, reach, tick, (72 + 138 * column, 62 + 150 * line), "xyz"[i], "xyz"[j], unit))
    if not parts:
        return None
    known_part = "" if result.opened is None else " Directions that the poses leave open are not drawn."
    return Drawing(
        "ellipses-small",
        Markup(_svg(412, 294, "".join(parts))),
        f"Ellipses of the error of X, 1, 2 and 3 sigma, seen along each axis. Standard deviations: {'; '.join(said)}.",
        "The error of X in pairs of components: translation above, rotation below. The ellipses are 1, 2 and 3 sigma "
        f"and hold 39 %, 86 % and 99 % of the errors.{known_part}",
        small=True,
    )


def _ellipses(S: Array, reach: float, tick: float, centre: tuple[float, float], x: str, y: str, unit: str) -> str:
    """One panel, 108 units wide, centred: ellipses of a covariance (2, 2) in the unit of ``reach``."""
    scale, (u, v) = 54.0 / reach, centre
    variances, axes = np.linalg.eigh(S)
    sizes = scale * np.sqrt(np.maximum(variances, 0.0))
    angle = -np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))  # of the larger axis; SVG counts y downwards
    rings = "".join(
        f'<ellipse class="ring" {_STYLES["ring"]} rx="{k * sizes[1]:.2f}" ry="{k * sizes[0]:.2f}" '
        f'transform="rotate({angle:.2f})"/>'
        for k in LEVELS
    )
    t = scale * tick
    frame = [
        _path("grid", f"M-54 0H54M0-54V54M{-t:.1f}-54V54M{t:.1f}-54V54M-54 {-t:.1f}H54M-54 {t:.1f}H54"),
        _path("axis", "M-54-54H54V54H-54Z"),
        _text(-t, 65, f"\N{MINUS SIGN}{tick:g}", "middle"),
        _text(t, 65, f"{tick:g}", "middle"),
        _text(0, 77, f"{x} ({unit})", "middle"),
        _text(-57, 3.5, y, "end"),
    ]
    return f'<g transform="translate({u} {v})">{"".join(frame)}{rings}</g>'


def _path(kind: str, d: str) -> str:
    return f'<path class="{kind}" {_STYLES[kind]} d="{d}"/>'


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="#515a64" text-anchor="{anchor}">{text}</text>'


def _svg(width: float, height: float, body: str) -> str:
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" xmlns="http://www.w3.org/2000/svg" class="sketch" font-size="11" '
        f'font-family="system-ui, Segoe UI, Roboto, DejaVu Sans, Arial, sans-serif" aria-hidden="true" '
        f'focusable="false">{body}</svg>'
    )
