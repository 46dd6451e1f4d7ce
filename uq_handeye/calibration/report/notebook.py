"""A calibration in a notebook."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...formatting.numbers import concise, digits, rotvec_jacobian, std_of
from .text import answer, directions

if TYPE_CHECKING:
    import pandas as pd

    from ..result import Calibration
from ...presentation.notebook import _WARNING, _folded, _heading, _heat, _matrix, _paragraph, _table, _whole


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
