"""Formatting of numbers for people: few digits, no exponent where that is short, values with standard deviations."""

from __future__ import annotations

from decimal import Decimal
from math import isfinite, isinf
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import InputError
from ...findings import SIGNIFICANT_DIGITS
from ...findings import digits as digits
from ...findings import probability as probability
from ..geometry.se3 import Array


def multiple(ratio: float) -> str:
    """Two digits of a ratio, or so many that one which is not 1 does not read as 1.

    >>> multiple(2.345), multiple(1.0), multiple(1.023), multiple(0.99962)
    ('2.3', '1', '1.02', '0.9996')
    """
    return next((text for k in range(2, 9) if float(text := digits(ratio, k)) != 1.0), "1")


def rough(value: float) -> str:
    """Two digits of a number that chance moves."""
    return digits(float(f"{value:.1e}"), 2)


def fixed(value: float, significant: int = SIGNIFICANT_DIGITS) -> str:
    """Format as `digits`, but keep the zeros at the end: for columns of a table; infinite is "not determined".

    >>> fixed(0.8), fixed(10), fixed(1234.5), fixed(0)
    ('0.800', '10.0', '1234', '0')
    """
    value = float(value)
    if isinf(value):
        return "not determined"
    if value == 0 or not isfinite(value) or not 1e-4 <= abs(value) < 1e6:
        return digits(value, significant)
    return f"{value:.0f}" if abs(value) >= 10**significant else f"{value:#.{significant}g}".rstrip(".")


def column(values: ArrayLike, significant: int = SIGNIFICANT_DIGITS) -> list[str]:
    """Numbers of a column with their decimal points below each other.

    So many decimals that the median has ``significant`` digits. Where that would leave less than one digit of the
    smallest, or give the largest more than three too many, each number has its own (`fixed`).

    >>> column([0.158, 0.0586, 1.2])
    ['0.158', '0.059', '1.200']
    >>> column([0.01, 250.0, 90000.0])
    ['0.0100', '250', '90000']
    """
    numbers = np.asarray(values, dtype=float).ravel()
    sizes = np.abs(numbers[np.isfinite(numbers) & (numbers != 0)])
    if sizes.size:
        powers = [int(f"{size:.{significant - 1}e}".partition("e")[2]) for size in sorted(sizes)]
        decimals = significant - 1 - powers[(len(powers) - 1) // 2]
        if (
            decimals >= 0
            and powers[0] >= -decimals
            and powers[-1] + 1 + decimals <= significant + 3
            and powers[0] >= -4
        ):
            return [f"{x:.{decimals}f}" if np.isfinite(x) and x != 0 else digits(x) for x in numbers]
    return [fixed(x, significant) for x in numbers]


def concise(value: float, std: float | None, unit: str = "") -> str:
    """A value with its standard deviation in parentheses: ``12.345(67) mm`` is 12.345 mm with 0.067 mm.

    Always two significant digits of the standard deviation, and the value to the same decimal place. Below 1 the
    standard deviation is written as units of the last digits; from 1 on with its own decimal point or zeros, to be read
    by itself: ``12.3(2.3)``, ``345(12)``, ``12340(120)``. Where value or standard deviation would need an exponent,
    both share it: ``1.234(21)e-9``. A standard deviation of None is not determined, which ``(?)`` says; one of 0 is
    exact; an infinite one is that of a number that stays open.

    Raises `InputError` for numbers that are not finite and standard deviations below 0.

    >>> concise(12.3452, 0.0668, "mm")
    '12.345(67) mm'
    """
    if isfinite(value) and std is not None and isinf(std) and std > 0:
        return f"{value + 0.0:.6g}(open)" + (f" {unit}" if unit else "")
    if not isfinite(value) or (std is not None and not (isfinite(std) and std >= 0)):
        raise InputError(f"Expected a finite value and a standard deviation of 0 or more, got {value} and {std}.")
    top = max(abs(value), std or 0.0)
    exponent = 0 if top == 0 or 1e-4 <= top < 1e6 else int(f"{top:e}".partition("e")[2])
    x = Decimal(float(value)).scaleb(-exponent)
    if std is None or std == 0:
        text = f"{float(x) + 0.0:.{6 if std is None else 10}g}({'?' if std is None else 0})"
    else:
        mantissa, _, power = f"{Decimal(float(std)).scaleb(-exponent):.1e}".partition("e")  # rounded: 0.0996 is 1.0e-1
        decimals = 1 - int(power)
        if decimals <= 0:  # to tens, hundreds, ...
            step = Decimal(1).scaleb(-decimals)
            inside, shown = (
                f"{Decimal(mantissa).scaleb(int(power)):.0f}",
                f"{(x / step).quantize(Decimal(1)) * step:.0f}",
            )
        else:
            inside = mantissa if decimals == 1 else mantissa.replace(".", "")
            shown = f"{x:.{decimals}f}"
        text = f"{'0' + shown[2:] if shown.startswith('-0') and not shown.strip('-0.') else shown}({inside})"
    scale = f"e{exponent}" if exponent else ""
    return f"{text}{scale} {unit}".rstrip()


def plus_minus(value: float, std: float) -> str:
    """Return a value and its standard deviation, of two digits, to the same decimal place.

    >>> plus_minus(12.3452, 0.0668), plus_minus(-0.0001, 0.3), plus_minus(12345, 123)
    ('12.345 +- 0.067', '0.00 +- 0.30', '12340 +- 120')
    """
    return " +- ".join(value_and_sd(value, std))


def value_and_sd(value: float, std: float) -> tuple[str, str]:
    """Return both parts of `plus_minus`."""
    if not (isfinite(value) and isfinite(std)) or std <= 0 or not 1e-6 <= std < 1e6:
        return digits(value, 6), digits(std, 2)
    decimals = 1 - int(f"{std:.1e}".partition("e")[2])
    places = max(decimals, 0)
    return f"{round(value, decimals) + 0.0:.{places}f}", f"{round(std, decimals):.{places}f}"


def signed(number: str) -> str:
    """A number as text, with a plus where it has no minus."""
    return number if number.startswith("-") else f"+{number}"


def row(label: str, names: str, values: Array | None, std: Array | None, decimals: int, width: int = 22) -> str:
    """A line of named values with their standard deviations."""
    parts = []
    for k, name in enumerate(names):
        value = "" if values is None else f" {values[k] + 0.0:.{decimals}f}"
        deviation = "" if std is None else " open" if isinf(std[k]) else f" +- {digits(std[k])}"
        parts.append(f"{name}{value}{deviation}")
    return f"{label:{width}s} " + "   ".join(parts)


def pose_rows(values: Array, std: Array | None) -> list[str]:
    """The six numbers (mm, deg) of `geometry.pose_numbers` as two lines, translation and rotation vector."""
    move, turn = (None, None) if std is None else (std[:3], std[3:])
    return [
        row("translation (mm)", "xyz", values[:3], move, 4),
        row("rotation vector (deg)", "xyz", values[3:], turn, 5),
    ]


def times_of_noise(ratio: float) -> str:
    """Return how residuals compare with the noise given."""
    return f"residuals {digits(max(ratio, 1 / ratio), 2)} times {'larger' if ratio > 1 else 'smaller'} than this noise"


class Snippet(NamedTuple):
    """One text to copy."""

    title: str  # e.g. "ROS 2 static transform: gripper_T_camera"
    convention: str  # one or two sentences: units, order, frames
    text: str
    language: str  # for highlighting: python, bash, yaml or xml


def short(value: float) -> str:
    """Twelve significant digits; never ``-0``.

    >>> short(0.1 + 0.2), short(-0.0)
    ('0.3', '0')
    """
    return f"{value + 0.0:.12g}"
