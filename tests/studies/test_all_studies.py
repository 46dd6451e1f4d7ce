"""Every study runs, draws a figure that is whole, and its page says what its tables say."""

import importlib
import io
import json
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from fixtures.pages import DOCS, ROOT
from fixtures.study_tables import quick_tables
from PIL import Image

from studies.__main__ import described
from studies.common.study import FINDINGS, RUN, read_tables

pytestmark = pytest.mark.slow

PAGES = DOCS / "studies"
OF_THE_PAPER = (
    "table_1",
    "tables_2_3",
    "figures_3_4",
    "figure_5",
    "scaling_factor",
    "laser_camera",
    "registration",
    "shared_poses",
    "efficiency",
    "peers",
)
NAMES = [name.removeprefix("studies.") for name in described() if name.count(".") == 1]


def study_of(name):
    return importlib.import_module(f"studies.{name}").STUDY


def same_columns(a, b):
    return {name: list(table.columns) for name, table in a.items()} == {
        name: list(table.columns) for name, table in b.items()
    }


@pytest.mark.parametrize("name", NAMES)
def test_the_quick_size_runs(name, tmp_path, capsys):
    study = study_of(name)
    assert study.name == name
    study = replace(study, measure=lambda *_: quick_tables(name))
    study.run(importlib.import_module(f"studies.{name}").__doc__, ["-o", str(tmp_path)])
    folder = tmp_path / name
    text = (folder / FINDINGS).read_text(encoding="utf-8")
    assert text in capsys.readouterr().out
    assert not re.search(r"\b(nan|inf)\b", text), text
    tables, pictures = read_tables(folder), sorted(folder.glob("*.png"))
    assert tables and pictures and all(len(table) for table in tables.values())
    for path in pictures:
        grey = np.asarray(Image.open(io.BytesIO(path.read_bytes())).convert("L"))
        rim = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
        assert rim.min() > 200, f"{path.name} is cut at its rim"
        assert (grey < 128).mean() > 0.003, f"{path.name} is empty"
    shown = PAGES / name
    assert {path.name for path in pictures} <= {path.name for path in shown.iterdir()}
    assert same_columns({key: read_tables(shown)[key] for key in tables}, tables)


@pytest.mark.parametrize("name", NAMES)
def test_the_page_says_what_the_tables_say(name):
    folder = PAGES / name
    assert json.loads((folder / RUN).read_text(encoding="utf-8"))["full"], "the documentation quotes the full size"
    assert study_of(name).text(folder) == (folder / FINDINGS).read_text(encoding="utf-8")
    page = (PAGES / f"{name}.md").read_text(encoding="utf-8")
    assert f"{name}/{FINDINGS}" in page
    pictures = [path.name for path in folder.glob("*.png")]
    assert pictures and not [picture for picture in pictures if f"{name}/{picture}" not in page], "on no page"


@pytest.mark.parametrize("name", OF_THE_PAPER)
def test_the_page_names_every_column(name):
    said = (PAGES / f"{name}.md").read_text(encoding="utf-8").partition("## Columns of the tables")[2]
    tables = list((PAGES / name).glob("*.csv"))
    assert tables
    for path in tables:
        assert f"`{path.name}`" in said
        header = pd.read_csv(path, nrows=0).columns
        assert not [column for column in header if f"`{column}`" not in said], path.name


def test_every_study_is_listed_and_has_a_page():
    printed = subprocess.run(
        [sys.executable, "-m", "studies"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    index = (PAGES / "index.md").read_text(encoding="utf-8")
    for name in NAMES:
        assert f"studies.{name}\n" in printed
        assert re.search(rf"^{name}$", index, re.MULTILINE), f"{name} is not in docs/studies/index.md"
    assert {path.name for path in PAGES.iterdir() if path.is_dir()} == set(NAMES)
    assert all(described().values()), "a study without a first line"
