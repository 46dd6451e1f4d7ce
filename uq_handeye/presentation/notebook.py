"""Results in notebooks: HTML that needs nothing but itself, on light and on dark pages; and X as a pandas table."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..calibration.report.text import NAMES, answer, directions
from ..formatting.numbers import concise, digits, rotvec_jacobian, std_of

if TYPE_CHECKING:
    import pandas as pd

    from ..calibration.result import Calibration
    from ..geometry.se3 import Array

# Neither text nor page colours are set, so that those of the notebook hold; tints are half transparent over any page.
_FRAME = "font-family:system-ui,sans-serif;line-height:1.45;max-width:60em"
_TABLE = "border-collapse:collapse;font-variant-numeric:tabular-nums;margin:0.4em 0"
_CELL = "border:1px solid rgba(128,128,128,0.4);padding:0.15em 0.7em;text-align:right"
_WARNING = "border-left:4px solid #d55e00;background:rgba(213,94,0,0.12);padding:0.3em 0.7em;margin:0.4em 0"
_PRE = "font-family:ui-monospace,monospace;font-size:0.9em;line-height:1.3;overflow-x:auto;margin:0.4em 0"
# Red and blue of equal lightness that colour-blind readers can tell apart; the sign is printed, too.
_POSITIVE, _NEGATIVE = "213,94,0", "0,114,178"


class Number(NamedTuple):
    """One of the six numbers of X."""

    name: str
    value: float
    std: float | None
    unit: str


def six_numbers(result: Calibration) -> list[Number]:
    """Translation in mm and rotation vector in degrees of X, with standard deviations to first order."""
    rotvec = Rotation.from_matrix(result.X[:3, :3]).as_rotvec()
    numbers = []
    for name, unit, values, part, J in (
        ("translation", "mm", 1e3 * result.X[:3, 3], slice(3, 6), 1e3 * np.eye(3)),
        ("rotation vector", "deg", np.degrees(rotvec), slice(0, 3), rotvec_jacobian(rotvec)),
    ):
        std = std_of(None if result.covariance is None else result.covariance[part, part], J)
        for k, axis in enumerate("xyz"):
            deviation = None if std is None else float(std[k])
            numbers.append(Number(f"{name} {axis}", float(values[k]), deviation, unit))
    return numbers


def calibration_table(result: Calibration) -> pd.DataFrame:
    """Six rows, translation and rotation vector of X; columns value, std (missing: not determined), unit, concise."""
    import pandas as pd

    numbers = six_numbers(result)
    table = pd.DataFrame(
        {
            "value": [number.value for number in numbers],
            "std": pd.array([number.std for number in numbers], dtype="Float64"),
            "unit": [number.unit for number in numbers],
            "concise": [concise(number.value, number.std, number.unit) for number in numbers],
        },
        index=pd.Index([number.name for number in numbers], name=result.frame),
    )
    return table


def calibration_html(result: Calibration) -> str:
    """The answer, what is wrong, the six numbers; matrix, covariance and correlation folded away."""
    origin = f"{result.n_pairs} pairs" if result.n_poses is None else f"{result.n_poses} poses"
    setup = "" if result.setup is None else f", {result.setup}"
    rows = [
        [number.name, concise(number.value, number.std), "?" if number.std is None else digits(number.std), number.unit]
        for number in six_numbers(result)
    ]
    parts = [
        _heading(f"{result.frame} by {result.method}", f"{origin}{setup}"),
        _paragraph(answer(result)),
        *(f'<p style="{_WARNING}"><b>Caution:</b> {escape(text)}</p>' for text in result.warnings),
        _table(["", "value(deviation)", "1 sigma", "unit"], rows),
        *(_paragraph(text) for text in directions(result)),
        _folded("Matrix X (translation in m)", _matrix(result.X)),
    ]
    if result.covariance is not None and result.correlation is not None:
        parts += [
            _folded("Covariance of (theta, tau), rad and m", _heat(result.covariance, result.correlation, "{:.3e}")),
            _folded("Correlation", _heat(result.correlation.round(2) + 0.0, result.correlation, "{:+.2f}")),
        ]
    return _whole(parts)


def text_html(title: str, verdict: str, text: str, warnings: tuple[str, ...] = ()) -> str:
    """A result that is best read as text: its name and its verdict, and the text folded away."""
    cautions = [f'<p style="{_WARNING}"><b>Caution:</b> {escape(caution)}</p>' for caution in warnings]
    details = f'<pre style="{_PRE}">{escape(text)}</pre>'
    return _whole([_heading(title, ""), _paragraph(verdict), *cautions, _folded("All of it", details)])


def _whole(parts: list[str]) -> str:
    return f'<div style="{_FRAME}">{"".join(parts)}</div>'


def _heading(title: str, beside: str) -> str:
    return f'<p style="margin:0.2em 0"><b style="font-size:1.15em">{escape(title)}</b> {escape(beside)}</p>'


def _paragraph(text: str) -> str:
    return f'<p style="margin:0.3em 0">{escape(text)}</p>'


def _folded(title: str, content: str) -> str:
    return f'<details><summary style="cursor:pointer">{escape(title)}</summary>{content}</details>'


def _table(head: list[str], rows: list[list[str]]) -> str:
    top = "".join(f'<th scope="col" style="{_CELL}">{escape(cell)}</th>' for cell in head)
    body = "".join(
        f'<tr><th scope="row" style="{_CELL};text-align:left;font-weight:normal">{escape(first)}</th>'
        + "".join(f'<td style="{_CELL}">{escape(cell)}</td>' for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )
    return f'<table style="{_TABLE}"><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>'


def _matrix(T: Array) -> str:
    rows = "".join(
        "<tr>" + "".join(f'<td style="{_CELL}">{x + 0.0:.9f}</td>' for x in row) + "</tr>" for row in T.round(9)
    )
    return f'<table style="{_TABLE}">{rows}</table>'


def _heat(values: Array, correlation: Array, form: str) -> str:
    """A table of ``values`` tinted by the correlation: the darker the stronger, of one hue for each sign."""
    head = "".join(f'<th scope="col" style="{_CELL}">{name}</th>' for name in ("", *NAMES))
    rows = []
    for i, name in enumerate(NAMES):
        cells = []
        for value, strength in zip(values[i], correlation[i], strict=True):
            hue = _POSITIVE if strength >= 0 else _NEGATIVE
            tint = f"background:rgba({hue},{0.6 * min(abs(float(strength)), 1.0):.2f})"
            cells.append(f'<td style="{_CELL};{tint}">{form.format(value)}</td>')
        rows.append(f'<tr><th scope="row" style="{_CELL};text-align:left">{name}</th>{"".join(cells)}</tr>')
    return f'<table style="{_TABLE}"><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table>'
