"""A finding is its code, severity and values; the sentence is made from them at the end."""

import json
import pickle
import subprocess
import sys

import numpy as np
import pytest

from uq_handeye import InputError, InputWarning
from uq_handeye.findings import Finding, sentence, texts, warn, without_consequences

SEVERITIES = ("note", "caution", "failure")


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
    "change", [{"code": []}, {"severity": "bad"}, {"values": 3}, {"values": {"x": float("nan")}}, {"more": 1}]
)
def test_what_is_no_finding_is_refused(change):
    with pytest.raises(InputError, match="Expected "):
        Finding.from_dict(FOUND.to_dict() | change)


@pytest.mark.stored
@pytest.mark.parametrize("change", [{"code": "tests.of_tomorrow"}, {"values": {"there": 2}}, {"values": {"new": 1}}])
def test_a_finding_of_another_version_is_read_and_says_what_it_has(change):
    found = Finding.from_dict(FOUND.to_dict() | change)
    assert found.to_dict() == FOUND.to_dict() | change
    assert found.code in str(found) and all(f"{name} = {value}" in str(found) for name, value in found.values.items())


def test_values_are_plain():
    found = Finding("tests.too_few", "note", {"there": np.float64(2), "wanted": (np.arange(2), {"x": None})})
    assert found.values == {"there": 2.0, "wanted": [[0, 1], {"x": None}]}
    assert type(found.values["there"]) is float
    for bad in (object(), b"x", {1, 2}):
        with pytest.raises(TypeError, match="no plain value"):
            Finding("tests.too_few", "note", {"there": bad})
    with pytest.raises(ValueError, match="not finite"):
        Finding("tests.too_few", "note", {"there": np.array([1.0, np.inf])})


def test_warnings_are_given_for_more_than_a_note():
    notes = [Finding("tests.too_few", severity, {"there": k, "wanted": 9}) for k, severity in enumerate(SEVERITIES)]
    assert texts(notes) == ("there are 1, 9 are needed", "there are 2, 9 are needed")
    with pytest.warns(InputWarning) as caught:
        warn(notes, stacklevel=1)
    assert [str(item.message) for item in caught] == list(texts(notes))
    assert {item.filename for item in caught} == {__file__}


def test_a_code_is_worded_once():
    with pytest.raises(ValueError, match="worded twice"):
        sentence("tests.too_few")(str)


@pytest.mark.slow
def test_a_stored_finding_is_worded_in_a_process_that_made_none():
    """Its package was not imported: `uq.load` of a result said its code and values."""
    code = "from uq_handeye.findings import Finding; print(Finding('input_checks.same_file', 'failure', {}).phrase)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "robot and camera file hold the same poses"


def test_a_caution_about_one_camera_explains_no_failure_of_a_rig():
    """A move is said also where the axes of a file look sheared, which hides it as a failure only."""
    moved = Finding("rig.moved", "failure", {})
    for severity, left in (("caution", 2), ("failure", 1)):
        read = Finding("input_checks.misread_axes", severity, {"reading": {"kind": "axes"}})
        values = {"camera": "left", "target": "board", "finding": read.to_dict()}
        assert len(without_consequences([moved, Finding("rig.of_camera", severity, values)])) == left
