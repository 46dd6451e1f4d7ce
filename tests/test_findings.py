"""A finding is its code, severity and values; the sentence is made from them at the end."""

import json
import pickle

import pytest

from uq_handeye import InputError
from uq_handeye.findings import Finding, sentence


@sentence("tests.too_few")
def _(there: int, wanted: int) -> str:
    return f"there are {there}, {wanted} are needed"


FOUND = Finding("tests.too_few", "caution", {"there": 2, "wanted": 3})


def test_its_text_is_the_sentence_of_its_code():
    assert str(FOUND) == "there are 2, 3 are needed"


def test_it_survives_json_and_pickling():
    assert Finding.from_dict(json.loads(json.dumps(FOUND.to_dict()))) == FOUND
    assert pickle.loads(pickle.dumps(FOUND)) == FOUND


@pytest.mark.parametrize(
    "change", [{"code": "tests.unknown"}, {"code": []}, {"severity": "bad"}, {"values": 3}, {"more": 1}]
)
def test_what_is_no_finding_is_refused(change):
    with pytest.raises(InputError, match="Expected a"):
        Finding.from_dict(FOUND.to_dict() | change)


def test_a_code_is_worded_once():
    with pytest.raises(ValueError, match="worded twice"):
        sentence("tests.too_few")(str)
