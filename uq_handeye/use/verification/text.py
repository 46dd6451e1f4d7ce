"""A verification in words."""

from __future__ import annotations

import numpy as np

from ...core.formatting.numbers import digits, plus_minus, probability
from ...core.presentation.document import Answer, Document, Paragraph, Points, Table, document_of
from .power import LEVEL, POWER
from .result import NextTouch, Verification

# Points that the table of a terminal shows.
MOST_ROWS = 30


@document_of.register(Verification)
def verification_document(found: Verification) -> Document:
    """The answer, the bias, its power, the points, what to do next."""
    status = "failed" if found.contradicted else "caution" if found.p_value is None or found.warnings else "ok"
    lines = [Paragraph(text, hang="  ") for text in (_bias(found), _scatter(found), _power(found), _needed(found))]
    tool = _tool(found)
    more = [Paragraph(text, hang="  ") for text in (tool, _next(found)) if text]
    findings = [] if not found.findings else [Points.of_findings(found.findings)]
    return [[Answer(headline(found), status)], [*lines, *more], _table(found), findings]


def headline(found: Verification) -> str:
    """State whether the touches contradict the calibration."""
    n = f"{found.m} {'touch' if found.m == 1 else 'touches'}"
    if found.p_value is None:
        return f"CANNOT TELL: {n} with a tool of unknown offset test nothing."
    p = probability(found.p_value, 2)
    if not found.contradicted:
        verb = "agrees" if found.m == 1 else "agree"
        return f"AGREES: {n} {verb} with the calibration ({p})."
    parts = {"a bias": found.bias_p_value, "the scatter of the points": found.scatter_p_value}
    why = min((p for p in parts.items() if p[1] is not None), key=lambda part: part[1] or 0.0)[0]
    verb = "contradicts" if found.m == 1 else "contradict"
    return f"CONTRADICTED by {why}: {n} {verb} the calibration ({p})."


def _bias(found: Verification) -> str:
    if found.bias_p_value is None:
        return "Bias: not known, the tool's offset hides it."
    half = found.interval[:, 1] - found.bias
    words = [
        f"{axis} hidden" if np.isnan(b) else f"{axis} {plus_minus(1e3 * b, 1e3 * h)}"
        for axis, b, h in zip("xyz", found.bias, half, strict=True)
    ]
    return (
        f"Bias (touch minus point, base frame, 95 %): {', '.join(words)} mm; {probability(found.bias_p_value, 2)}. It "
        "includes the uncertainty of X."
    )


def _scatter(found: Verification) -> str:
    text = f"Differences: {digits(1e3 * found.rms, 2)} mm RMS"
    if found.scatter_p_value is None:
        return f"{text}."
    law = "chi-square" if found.noise_dof is None else "a mixture over the sizes of the errors"
    return (
        f"{text}; d^2 {digits(found.chi2)} of {found.dof} numbers ({law}); scatter about the bias: "
        f"{probability(found.scatter_p_value, 2)}."
    )


def _power(found: Verification) -> str:
    if not np.isfinite(found.detectable):
        return "Power: no bias would have shown in every direction."
    direction = ", ".join(f"{x + 0.0:.2f}" for x in found.worst)
    return (
        f"Power: a bias of {digits(1e3 * found.detectable, 2)} mm would have shown with {100 * POWER:.0f} % "
        f"probability, in "
        f"the worst direction ({direction}); tests at {100 * LEVEL:.0f} %."
    )


def _needed(found: Verification) -> str:
    parts = []
    for one in found.needed:
        size = digits(1e3 * one.size, 3)
        if one.touches is not None:
            many = "1 such touch" if one.touches == 1 else f"{one.touches} such touches in all"
            parts.append(f"A bias of {size} mm would show with {many}.")
        elif np.isfinite(one.limit):
            parts.append(
                f"No number of such touches would show a bias of {size} mm: the uncertainty that they share (X, "
                f"robot, tool) "
                f"hides up to {digits(1e3 * one.limit, 2)} mm."
            )
        else:
            parts.append(f"No number of such touches would show a bias of {size} mm.")
    return " ".join(parts)


def _tool(found: Verification) -> str:
    if found.tool is None or found.tool_std is None:
        return ""
    if not found.dof:
        return ""
    words = [
        f"{axis} {plus_minus(1e3 * v, 1e3 * s)}" for axis, v, s in zip("xyz", found.tool, found.tool_std, strict=True)
    ]
    listed = ", ".join(words)
    return f"Tool offset, found minus given (flange frame, standard deviations, if there is no bias): {listed} mm."


def _next(found: Verification) -> str:
    if not found.next:
        return ""
    first: NextTouch = found.next[0]
    seen = ", ".join(f"{1e3 * x + 0.0:.0f}" for x in first.seen)
    base = ", ".join(f"{1e3 * x + 0.0:.0f}" for x in first.base)
    many = len(found.next)
    return (
        f"Touch next: the point ({seen}) mm of the camera, at ({base}) mm in the base, seen from the pose of point "
        f"{found.points.names[first.view]}. With {many} chosen touches {digits(1e3 * found.next[-1].detectable, 2)} mm "
        "would show."
    )


def _table(found: Verification) -> Table:
    points = found.points
    rows, marked = [], set()
    order = np.argsort(np.nan_to_num(points.p_value, nan=1.0), kind="stable")[:MOST_ROWS]
    order = np.sort(order)
    for row, k in enumerate(order.tolist()):
        p = points.p_value[k]
        if points.flagged[k]:
            marked.add(row)
        rows.append(
            [
                points.names[k],
                *(f"{1e3 * x:.3f}" for x in points.difference[k]),
                f"{1e3 * points.distance[k]:.3f}",
                f"{1e3 * np.sqrt(np.trace(points.covariance[k]) / 3.0):.3f}"
                if np.isfinite(points.std[k]).all()
                else "",
                probability(p, 2).removeprefix("p = ").removeprefix("p ") if np.isfinite(p) else "",
                "differs" if points.flagged[k] else "",
            ]
        )
    left = found.m - len(rows)
    caption = "Touch minus point, base frame" + (f" ({left} more points: --json, -o)" if left > 0 else "")
    head = ["point", "x", "y", "z", "distance", "sd", "p", ""]
    units = ["", "mm", "mm", "mm", "mm", "mm", "", ""]
    return Table(caption, head, rows, units=units, marked=frozenset(marked), text_columns=frozenset({7}))
