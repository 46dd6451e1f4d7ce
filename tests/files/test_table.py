"""The one reader of tables: separators, comments, decimal commas, missing numbers, and errors that name their place."""

import io

import numpy as np
import pytest

from uq_handeye.core.files import table
from uq_handeye.core.files.table import Places, Schema, name_and_unit, read_table
from uq_handeye.errors import InputError


def places(names, line, where):
    if missing := [axis for axis in "xy" if axis not in names]:
        raise InputError(f"{where}: missing {', '.join(missing)}")
    return Places([names.index(axis) for axis in "xy"], [names.index("who")] if "who" in names else [])


SCHEMA = Schema("the header x,y", "point", places)
OTHER = Schema("the header x,y", "point", places, named=lambda names: "x" in names, missing=("", "na"), quotes=True)
BLANKS = Schema("the header x y", "point", places, marks=",;\t ")


def read(text, schema=SCHEMA):
    return read_table(io.BytesIO(text if isinstance(text, bytes) else text.encode()), "a.csv", schema)


@pytest.mark.parametrize(
    ("text", "schema"),
    [
        ("x,y\n1,2.5\n-3,4\n", SCHEMA),
        ("\ufeffx,y\r\n1,2.5\r\n\r\n# a comment\r\n-3,4", SCHEMA),
        ("y;other;x\n2,5;7;1\n4;8;-3\n", SCHEMA),
        ('x\ty\n"1"\t2.5\n-3\t4\n', SCHEMA),
        ("x,y,\n1,2.5,\n-3,4,\n", SCHEMA),
        ("# when: today\n# x,y\n1,2.5\n-3,4\n", OTHER),
        ("x  y\n 1 2.5\n-3   4\n", BLANKS),
    ],
)
def test_one_table_in_many_styles(text, schema):
    np.testing.assert_array_equal(read(text, schema).values, [[1, 2.5], [-3, 4]])


def test_what_a_table_says():
    table = read('# made by hand\nwho;y;x\n"A; B";1,5;2\nC;na;3\n', OTHER)
    np.testing.assert_array_equal(table.values, [[2, 1.5], [3, np.nan]])
    assert table.texts == [("A; B",), ("C",)]
    assert (table.mark, table.decimal_commas, table.comments) == (";", True, ["made by hand"])
    assert (table.at(1), table.column(1)) == ("a.csv, line 4", "y")
    with pytest.raises(InputError, match="line 4, column y: expected a finite number, got nan; measure it again"):
        table.require_finite("; measure it again")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "a.csv: the file is empty; expected the header x,y and one line per point."),
        ("x,y\n", "a.csv: no rows after the header; expected one line per point."),
        ("x,z\n1,2\n", "a.csv, line 1: missing y"),
        ("x,y\n1,2,3\n", "a.csv, line 2: expected 2 fields separated by commas, got 3, '1,2,3'."),
        ("x,y\n\n1,two\n", "a.csv, line 3, column y: expected a number, got 'two'."),
        ("x,y\n1,\n", "a.csv, line 2, column y: expected a number, got an empty field."),
        ("x,y\n1,2_0\n", "a.csv, line 2, column y: expected a number, got '2_0'."),
        (b"x,y\n1,\xff\n", "a.csv, line 2, column y: expected a number, got bytes that are not UTF-8 text"),
        (b"x\0,y\n", "a.csv, line 1: expected the header x,y, got NUL bytes"),
    ],
)
def test_errors_name_line_and_column(text, words):
    with pytest.raises(InputError) as error:
        read(text)
    assert str(error.value).startswith(words) and "\n" not in str(error.value)


def test_bounds(monkeypatch):
    monkeypatch.setattr(table, "MAX_ROWS", 2)
    assert len(read("x,y\n1,2\n3,4\n").lines) == 2
    with pytest.raises(InputError, match="line 4: expected at most 2 rows"):
        read("x,y\n1,2\n3,4\n5,6\n")
    with pytest.raises(InputError, match="at most 10000 characters"):
        read("x,y\n" + "1" * 10_001)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("x", ("x", None)),
        ("x (mm)", ("x", "mm")),
        ("x[furlong]", ("x", "furlong")),
        ("x_furlong", ("x_furlong", None)),
        ("theta_1_deg", ("theta_1", "deg")),
        ("x []", ("x", "")),
        ("_" * 500, ("_" * 500, None)),
    ],
)
def test_names_with_units(name, expected):
    assert name_and_unit(name, ("mm", "deg")) == expected
