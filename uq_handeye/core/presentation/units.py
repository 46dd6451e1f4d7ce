"""Numbers with units, as people write them: ``0.02deg``, ``1 mrad``, ``0.5mm``."""

from __future__ import annotations

import math
import re

import numpy as np

from ...errors import InputError

ANGLE_UNITS = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180,
               "arcmin": math.pi / 10800, "arcsec": math.pi / 648000}  # fmt: skip
LENGTH_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6, "in": 0.0254}
RATIO_UNITS = {"%": 1e-2, "ppm": 1e-6}
PIXEL_UNITS = {"px": 1.0}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "\u00b5s": 1e-6, "\u03bcs": 1e-6}

# Factors from SI units to those that people read.
DEG_PER_RAD = 180.0 / math.pi
MM_PER_M = 1.0 / LENGTH_UNITS["mm"]
MS_PER_S = 1.0 / TIME_UNITS["ms"]

# Factor and unit in which people read relative numbers, angles and times that are small.
_SMALL = {"m": (1e3, "mm"), "": (1e2, "%"), "rad": (1e3, "mrad"), "s": (1e3, "ms")}

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s.+-]*)\s*")


# Largest ratio that may be written without a unit.
MAX_BARE_RATIO = 0.01


def _parse(value: str | float, units: dict[str, float], kind: str, name: str) -> float:
    match value:
        case str():
            found = _QUANTITY.fullmatch(value)
            if found is None:
                raise InputError(f"Expected {name} to be {kind} such as '0.1{next(iter(units))}', got {value!r}.")
            known, unit = ", ".join(units), found[2]
            if not unit:
                raise InputError(f"Expected {name} to carry a unit (one of {known}), got {value!r}.")
            if unit not in units:
                raise InputError(f"Unknown unit {unit!r} in {name} = {value!r}; expected one of {known}.")
            result = float(found[1]) * units[unit]
        case int() | float() | np.number() if value is not True and value is not False:
            result = float(value)
        case _:
            raise InputError(f"Expected {name} to be a number or text with a unit, got {value!r}.")
    if not math.isfinite(result):
        raise InputError(f"Expected {name} to be finite, got {value!r}.")
    return result


def parse_angle(value: str | float, name: str = "angle") -> float:
    """An angle in radians, from a number (radians) or text with its unit.

    >>> parse_angle("1 mrad")
    0.001
    """
    return _parse(value, ANGLE_UNITS, "an angle", name)


def parse_length(value: str | float, name: str = "length") -> float:
    """A length in metres, from a number (metres) or text with its unit.

    >>> parse_length("0.5mm")
    0.0005
    """
    return _parse(value, LENGTH_UNITS, "a length", name)


def parse_ratio(value: str | float, name: str = "ratio") -> float:
    """A ratio, from a number or text with ``%`` or ``ppm``; without a unit up to 0.01 (no percentage).

    >>> parse_ratio("0.1%"), parse_ratio("0.001")
    (0.001, 0.001)
    """
    if (
        isinstance(value, str)
        and (match := _QUANTITY.fullmatch(value))
        and not match[2]
        and float(match[1]) <= MAX_BARE_RATIO
    ):
        value = float(match[1])
    return _parse(value, RATIO_UNITS, "a ratio", name)


def parse_pixels(value: str | float, name: str = "length") -> float:
    """A length in pixels, from a number or text with ``px``.

    >>> parse_pixels("0.2px")
    0.2
    """
    return _parse(value, PIXEL_UNITS, "a length in pixels", name)


def parse_time(value: str | float, name: str = "time") -> float:
    """A time in seconds, from a number (seconds) or text with its unit.

    >>> parse_time("5ms")
    0.005
    """
    return _parse(value, TIME_UNITS, "a time", name)


def parse_deviations(value: tuple[str | float, str | float], name: str) -> tuple[float, float]:
    """Standard deviations ``(rotation, translation)`` in (rad, m); negative ones are refused.

    >>> parse_deviations(("1mrad", "0.5mm"), "robot")
    (0.001, 0.0005)
    """
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise InputError(f"Expected {name} to be a pair (rotation, translation), got {value!r}.")
    rotation = parse_angle(value[0], f"the rotation standard deviation of {name}")
    translation = parse_length(value[1], f"the translation standard deviation of {name}")
    for number, text in ((rotation, value[0]), (translation, value[1])):
        if number < 0:
            raise InputError(f"Expected the standard deviations of {name} to be >= 0, got {text!r}.")
        if number > 1e9:
            raise InputError(f"Expected the standard deviations of {name} to be below 1e9, got {text!r}.")
    return rotation, translation


def small_unit(unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which a small number is read: %, mm, mrad, ms; another unit is left.

    >>> small_unit("")
    (100.0, '%')
    """
    return _SMALL.get(unit, (1.0, unit))
