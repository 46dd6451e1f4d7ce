"""Tables of texts that come from elsewhere: no spreadsheet runs them, and they are read back as they were."""

import csv
import re

import numpy as np
import pandas as pd
import pytest
from fixtures.pages import ROOT

from uq_handeye.core.files.csv_text import csv_text, frame_text, plain_text, safe_text
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.corners_file import corners_text, read_corners
from uq_handeye.model.points.point_file import read_points, read_target
from uq_handeye.model.points.result import _rows as _table

NAMES = (
    "=cmd|' /C calc'!A0",
    "@SUM(1)",
    "+1+1",
    "-2+3",
    "\t=1",
    " =1",
    "\uff1d1",
    "-1.5",
    "+2",
    "a=b",
    "A,1",
    'B"2',
    "é",
)


@pytest.mark.parametrize("text", [*NAMES, "'=1", "''@x", "'quoted'", "", "'"])
def test_no_text_is_a_formula_and_every_one_comes_back(text):
    safe = safe_text(text)
    assert plain_text(safe) == text
    assert safe.lstrip()[:1] not in tuple("=+-@\uff1d") or float(text) in (-1.5, 2.0)
    (row,) = csv.reader([csv_text([[text, -1.5, None]]).removesuffix("\n")])
    assert row == [safe, "-1.5", ""]


def test_a_frame_keeps_its_numbers():
    frame = pd.DataFrame({"name": ["=1+1", None], "x": [-0.1, np.nan], "n": [1, 2], "ok": [True, False]})
    assert frame_text(frame) == "name,x,n,ok\n'=1+1,-0.1,1,True\n,,2,False\n"
    assert frame["name"][0] == "=1+1"


def test_names_of_points_and_pictures(tmp_path):
    names = list(dict.fromkeys(name.strip() for name in NAMES))
    xyz = np.arange(3.0 * len(names)).reshape(-1, 3) / 100
    path = tmp_path / "points.csv"
    path.write_text(_table(["pose", "point", "x", "y", "z"], [0] * len(names), names, *xyz.T.tolist()), "utf-8")
    assert sorted(read_points(path).point.tolist()) == sorted(names)
    path.write_text(_table(["point", "x", "y", "z"], names, *xyz.T.tolist()), encoding="utf-8")
    assert sorted(read_target(path).names) == sorted(names)
    row, board = np.repeat(np.arange(len(names)), 4), np.tile(np.eye(4, 3), (len(names), 1))
    corners = Corners(row, board, board[:, :2] + row[:, None], tuple(names))
    path.write_text(corners_text(corners, np.ones(len(row), bool)), encoding="utf-8")
    assert read_corners(path).names == tuple(names)


def test_every_table_with_texts_is_written_in_one_place():
    """Other writers hold numbers and names of our own; `Plan.to_csv` takes the name of an arm."""
    writes = re.compile(r"csv\.writer|\.to_csv\((?!\)|arm=)|DictWriter")
    found = {
        str(path.relative_to(ROOT / "uq_handeye"))
        for path in (ROOT / "uq_handeye").rglob("*.py")
        if writes.search(path.read_text(encoding="utf-8"))
    }
    assert found == {"core/files/csv_text.py"}
