"""The title block of a report: what it takes, what it refuses, and that the result file keeps it."""

from dataclasses import replace

import pytest
from support import SEED

import uq_handeye as uq
from uq_handeye.core.files.about import ABOUT, as_about, read_about
from uq_handeye.errors import InputError


def test_files_and_texts_are_merged_in_the_order_of_the_report(tmp_path):
    file = tmp_path / "cell=3.toml"
    file.write_text('operator = "J. Doe"\ncamera_serial = 40123\ndate = 2026-11-20\ncell = "A"\n', encoding="utf-8")
    found = read_about([str(file), "cell = B 7 ", "note=a = b", "operator="])
    assert list(found.items()) == [
        ("cell", "B 7"), ("camera_serial", "40123"), ("date", "2026-11-20"), ("note", "a = b"),
    ]  # fmt: skip
    assert set(found) < set(ABOUT)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('colour = "red"', r"Unknown name 'colour' in .*cell\.toml: use cell, robot, "),
        ("[cell]\nname = 1", "Expected cell in .* to be text, got dict"),
        ("cell = true", "to be text, got bool"),
        ("cell = ", "expected a TOML file"),
        (f'cell = "{81 * "x"}"', "at most 80 characters, got 81"),
        ('cell = "a\\u0007b"', "printable text"),
    ],
)
def test_anything_else_is_refused_in_one_line(tmp_path, content, message):
    file = tmp_path / "cell.toml"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message) as error:
        read_about([str(file)])
    assert "\n" not in str(error.value)


def test_texts_of_unknown_names_and_missing_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="Unknown name 'colour' in --about"):
        read_about(["colour=red"])
    with pytest.raises(InputError, match="no such file"):
        read_about([str(tmp_path / "none.toml")])
    with pytest.raises(InputError, match="a mapping of names to text, got list"):
        as_about(["cell"])


def test_the_result_file_keeps_it():
    result = replace(uq.calibrate(uq.simulate(n_poses=6, seed=SEED)), about=as_about({"cell": "<b>", "date": "today"}))
    data = result.to_dict()
    assert uq.Calibration.from_dict(data).about == {"cell": "<b>", "date": "today"}
    for wrong in ({"colour": "red"}, {"cell": 3.5}, ["cell"]):
        with pytest.raises(InputError, match="damaged"):
            uq.Calibration.from_dict(data | {"about": wrong})
    del data["about"]
    assert uq.Calibration.from_dict(data).about == {}
