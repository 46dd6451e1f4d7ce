"""Quantities with units, as people write them."""

import math

import pytest
from hypothesis import strategies as st
from support import holds_for

from uq_handeye.core.presentation.units import ANGLE_UNITS, LENGTH_UNITS, parse_angle, parse_deviations, parse_length
from uq_handeye.errors import InputError

# By hand, from the definitions of the units; not from the tables of the package.
ANGLES = {
    "1rad": 1.0,
    "1 mrad": 1e-3,
    "1urad": 1e-6,
    "180deg": math.pi,
    "90°": math.pi / 2,
    "60arcmin": math.pi / 180,
    "3600 arcsec": math.pi / 180,
    " 0.02deg ": 3.490658503988659e-4,
    ".5rad": 0.5,
    "5.rad": 5.0,
    "-2e-3rad": -2e-3,
    "+1E2mrad": 0.1,
}
LENGTHS = {
    "1m": 1.0,
    "1cm": 0.01,
    "0.5mm": 5e-4,
    "1 um": 1e-6,
    "1\u00b5m": 1e-6,
    "1\u03bcm": 1e-6,
    "1in": 0.0254,
    "1e3mm": 1.0,
}


@pytest.mark.parametrize(("text", "value"), ANGLES.items())
def test_angles(text, value):
    assert parse_angle(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(("text", "value"), LENGTHS.items())
def test_lengths(text, value):
    assert parse_length(text) == pytest.approx(value, rel=1e-15)


def test_every_unit_is_tested():
    def used(texts, units):
        return {unit for unit in units for text in texts if text.strip().lstrip("+-.0123456789eE ") == unit}

    assert used(ANGLES, ANGLE_UNITS) == set(ANGLE_UNITS)
    assert used(LENGTHS, LENGTH_UNITS) == set(LENGTH_UNITS)


@pytest.mark.parametrize("value", [0.25, 3, -1])
def test_numbers_are_radians_and_metres(value):
    assert parse_angle(value) == parse_length(value) == value


@pytest.mark.slow
@holds_for(
    value=st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-9),
    unit=st.sampled_from(sorted(ANGLE_UNITS)),
)
def test_what_is_printed_is_read(value, unit):
    assert parse_angle(f"{value!r}{unit}") == pytest.approx(value * ANGLE_UNITS[unit], rel=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.1", "Expected deviation to carry a unit"),
        ("0.1 furlong", "Unknown unit 'furlong'"),
        ("0.1mm", "Unknown unit 'mm'"),
        ("0.1DEG", "Unknown unit 'DEG'"),
        ("deg", "Expected deviation to be an angle"),
        ("", "Expected deviation to be an angle"),
        ("1 2deg", "Expected deviation to be an angle"),
        ("1,5deg", "deviation"),
        ("1e999deg", "Expected deviation to be finite"),
        (math.nan, "Expected deviation to be finite"),
        (math.inf, "Expected deviation to be finite"),
    ],
)
def test_refused(text, message):
    with pytest.raises(InputError, match=message):
        parse_angle(text, "deviation")


def test_an_angle_is_no_length():
    with pytest.raises(InputError, match="Unknown unit 'deg' in length = '1deg'; expected one of m, cm"):
        parse_length("1deg")


def test_deviations():
    assert parse_deviations(("1mrad", 0.002), "robot") == (1e-3, 2e-3)
    assert parse_deviations(["0rad", "0m"], "robot") == (0.0, 0.0)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (("1mrad",), r"robot to be a pair"),
        (("1mrad", "1mm", "1mm"), r"robot to be a pair"),
        ("ab", r"robot to be a pair"),
        (("-1mrad", "1mm"), r"robot to be >= 0, got '-1mrad'"),
        (("1mrad", "-1mm"), r"robot to be >= 0, got '-1mm'"),
        (("1mm", "1mrad"), r"Unknown unit 'mm' in the rotation standard deviation of robot"),
        (("1mrad", "1mrad"), r"Unknown unit 'mrad' in the translation standard deviation of robot"),
    ],
)
def test_deviations_refused(value, message):
    with pytest.raises(InputError, match=message):
        parse_deviations(value, "robot")
