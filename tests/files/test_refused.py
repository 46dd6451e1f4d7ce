"""Errors of libraries in one line, by a table of kinds of exceptions and words."""

import json

import pytest

from uq_handeye.core.files.one_line import OF_DATA, refused
from uq_handeye.core.files.records import damaged
from uq_handeye.core.files.trees import parse_tree
from uq_handeye.errors import InputError


@pytest.mark.parametrize(
    ("error", "words"),
    [(ValueError("two\nlines."), "a.bin: two lines."), (KeyError(), "a.bin: KeyError.")],
)
def test_any_exception_in_one_line(error, words):
    with pytest.raises(InputError) as caught, refused("a.bin"):
        raise error
    assert str(caught.value) == words
    assert caught.value.__cause__ is error


def test_an_input_error_passes_as_it_is():
    mine = InputError("mine")
    with pytest.raises(InputError) as caught, refused("a.bin"):
        raise mine
    assert caught.value is mine


def test_kinds_that_the_table_does_not_name_pass():
    with pytest.raises(ZeroDivisionError), refused("a.bin", OF_DATA):
        raise ZeroDivisionError
    with pytest.raises(KeyboardInterrupt), refused("a.bin"):
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KeyError("fit"), "The result is damaged: 'fit' is missing."),
        (InputError("Expected n to be a whole number."), "The result is damaged: Expected n to be a whole number."),
        (ZeroDivisionError("division by zero"), "The result is damaged: division by zero."),
    ],
)
def test_a_damaged_result_says_which_part(error, words):
    with pytest.raises(InputError) as caught, damaged("The result"):
        raise error
    assert str(caught.value) == words


def test_json_that_is_no_yaml_either_is_told_as_json():
    with pytest.raises(InputError) as caught:
        parse_tree(b'{"robot": [1, 2,, 3]}', "robot.json")
    assert str(caught.value).startswith("robot.json, line 1: not JSON")
    assert isinstance(caught.value.__cause__, json.JSONDecodeError)
