"""Numbers with their deviations, as people write them."""

import re
from decimal import Decimal

import numpy as np
import pytest
from support import SEED

from uq_handeye import InputError
from uq_handeye.core.presentation.numbers import column, concise, fixed

TABLE = [
    (12.3452, 0.0668, "12.345(67)"),
    (-70.1414, 0.336, "-70.14(34)"),
    (1.0, 0.0996, "1.00(10)"),  # rounded to the next power of ten
    (1.0, 0.1, "1.00(10)"),
    (5.0, 0.996, "5.0(1.0)"),
    (12.34, 2.3, "12.3(2.3)"),
    (345.4, 12.0, "345(12)"),
    (12345.0, 123.0, "12340(120)"),
    (12345.0, 99.6, "12340(100)"),
    (12345.0, 996.0, "12300(1000)"),
    (0.0, 0.5, "0.00(50)"),
    (-0.001, 0.1, "0.00(10)"),  # no minus before a zero
    (-0.4, 1.04, "-0.4(1.0)"),
    (0.001, 12.0, "0(12)"),  # a deviation above the value
    (-3.0, 1000.0, "0(1000)"),
    (1.234e-9, 2.1e-11, "1.234(21)e-9"),
    (1e9, 123456.0, "1.00000(12)e9"),
    (12.3, 1e7, "0.0(1.0)e7"),
    (1e-3, 1e-12, "0.0010000000000(10)"),
    (999999.9, 50.0, "1000000(50)"),
    (1e300, 1e290, "1.00000000000(10)e300"),
    (5.0, 0.0, "5(0)"),
    (0.0, 0.0, "0(0)"),
    (5.123456789, None, "5.12346(?)"),
    (-0.0, None, "0(?)"),
]


@pytest.mark.parametrize(("value", "std", "expected"), TABLE)
def test_known_forms(value, std, expected):
    assert concise(value, std) == expected
    assert concise(value, std, "mm") == f"{expected} mm"


def read(text):
    """Value and deviation of a text, by the rule of the docstring and no code of the package."""
    value, inside, exponent = re.fullmatch(r"(-?[\d.]+)\(([\d.]+)\)(?:e(-?\d+))?", text).groups()
    decimals = len(value.partition(".")[2])
    std = Decimal(inside) if "." in inside or not decimals else Decimal(inside).scaleb(-decimals)
    return Decimal(value).scaleb(int(exponent or 0)), std.scaleb(int(exponent or 0))


def test_what_is_written_is_what_it_is():
    """Over 24 decades: the deviation to half a unit of its second digit, the value to half of the same place."""
    rng = np.random.default_rng(SEED)
    for _ in range(3000):
        value = float(rng.choice([-1, 1]) * 10 ** rng.uniform(-12, 12))
        std = abs(value) * float(10 ** rng.uniform(-8, 4))
        found, deviation = read(concise(value, std))
        digits = deviation.normalize().as_tuple().digits
        assert len(digits) <= 2
        place = Decimal(10) ** (deviation.adjusted() - 1)  # of the second digit
        assert abs(deviation - Decimal(std)) <= place / 2
        assert abs(found - Decimal(value)) <= place / 2


@pytest.mark.parametrize(
    ("value", "std"),
    [(np.nan, 1.0), (np.inf, 1.0), (1.0, np.nan), (np.nan, np.inf), (np.inf, np.inf), (1.0, -np.inf), (1.0, -1e-9)],
)
def test_numbers_that_are_none_are_refused(value, std):
    with pytest.raises(InputError, match="finite value and a standard deviation of 0 or more"):
        concise(value, std)


def test_a_number_that_stays_open_has_an_infinite_deviation():
    assert concise(1.25, np.inf, "mm") == "1.25(open) mm"


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.8, "0.800"), (10, "10.0"), (99.96, "100"), (0.048, "0.0480"), (1234.5, "1234"), (0, "0"), (1e-9, "1.00e-09"),
     (-2, "-2.00"), (123456, "123456"), (0.9996, "1.00")],
)  # fmt: skip
def test_zeros_at_the_end_are_kept_in_tables(value, text):
    assert fixed(value) == text


def test_a_column_has_its_decimal_points_below_each_other():
    assert column([0.158, 0.0586, 1.2, 0.84]) == ["0.158", "0.059", "1.200", "0.840"]
    assert column([2.52, 10, 0.454, 5.4, 16.9]) == ["2.52", "10.00", "0.45", "5.40", "16.90"]
    assert column([2.1, 3, 5.04], 2) == ["2.1", "3.0", "5.0"]
    assert column([840, 300, 1290]) == ["840", "300", "1290"]
    assert column([0.0, 0.5, 2.0]) == ["0", "0.500", "2.000"]
    assert column([0.01, 250.0, 90000.0]) == ["0.0100", "250", "90000"]  # too far apart for that
    assert column([1e-9, 1.0, 2.0])[0] == "1.00e-09"
    assert column([]) == [] and column([0.0]) == ["0"]


def test_a_column_shows_a_digit_of_every_number():
    rng = np.random.default_rng(SEED)
    for spread in (0.1, 1, 3, 8):
        values = 10 ** (spread * rng.normal(size=30))
        for value, text in zip(values, column(values), strict=True):
            assert abs(float(text) - value) <= 0.5 * value, (value, text)
