"""The frame of the studies: what a run writes, that everything is said from the tables, and what a wrong call says."""

import numpy as np
import pandas as pd
import pytest

import uq_handeye as uq
from studies.common.study import Study, markdown, read_table, read_tables
from uq_handeye.core.presentation.figure_parts import canvas, finished

pytestmark = pytest.mark.slow

THIRD = 1.0 / 3.0


def measure(full):
    counts = pd.DataFrame({"name": ["a", ""], "value": [THIRD, np.nan], "holds": [True, False]})
    return {"counts": counts} | ({"more": pd.DataFrame({"n": [1]})} if full else {})


def findings(tables):
    return f"value {float(tables['counts'].value[0]):.9f}, tables {', '.join(tables)}"


def figures(tables):
    figure = canvas(1.0)
    figure.subplots().plot(tables["counts"].value)
    return {"curve": finished(figure)}


@pytest.fixture
def study():
    return Study("example", measure, findings, figures, packages=("no-such-package",))


def test_a_run_writes_tables_figure_findings_and_what_it_was(study, tmp_path, capsys):
    study.run("What is a third?\n\nMore.", ["-o", str(tmp_path), "--full"])
    folder = tmp_path / "example"
    assert {path.name for path in folder.iterdir()} == {
        "counts.csv",
        "more.csv",
        "curve.png",
        "findings.md",
        "run.json",
    }
    printed = capsys.readouterr().out
    assert (folder / "findings.md").read_text() in printed and "curve.png" in printed and str(folder) in printed
    assert "--full`" in printed and "no-such-package not installed" in printed
    # what is said comes from the file, not from memory: six digits
    assert "value 0.333333000, tables counts, more" in printed


def test_a_table_of_an_earlier_run_is_not_read(study, tmp_path):
    study.run("", ["-o", str(tmp_path), "--full"])
    study.run("", ["-o", str(tmp_path)])
    assert (tmp_path / "example" / "more.csv").exists()
    assert list(read_tables(tmp_path / "example")) == ["counts"]


def test_redrawing_measures_nothing(study, tmp_path, capsys):
    study.run("", ["-o", str(tmp_path)])
    table = tmp_path / "example" / "counts.csv"
    table.write_text(table.read_text().replace("0.333333", "0.25"))
    (tmp_path / "example" / "curve.png").unlink()
    study.run("", ["-o", str(tmp_path), "--redraw"])
    assert "value 0.250000000" in capsys.readouterr().out
    assert table.read_text().splitlines()[1] == "a,0.25,True" and (tmp_path / "example" / "curve.png").exists()


def test_nothing_to_redraw(study, tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        study.run("", ["-o", str(tmp_path / "none"), "--redraw"])
    assert stopped.value.code == 2
    assert "run the study without --redraw first" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_a_package_that_is_missing_is_named_without_a_traceback(tmp_path, capsys):
    def needy(full):
        raise uq.MissingExtraError("Method 'heller' needs CVXPY and Clarabel.")

    with pytest.raises(SystemExit) as stopped:
        Study("example", needy, findings, figures).run("", ["-o", str(tmp_path)])
    assert stopped.value.code == 2 and "needs CVXPY" in capsys.readouterr().err
    assert not list((tmp_path / "example").iterdir())


def test_a_folder_that_cannot_be_made_is_refused_before_anything_is_measured(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    measured = []
    with pytest.raises(SystemExit) as stopped:
        Study("example", measured.append, findings, figures).run("", ["-o", str(tmp_path / "file")])
    assert stopped.value.code == 2 and "cannot make the folder" in capsys.readouterr().err and not measured


def test_empty_cells_of_words_stay_words():
    table = read_table("name,value,holds\na,1.5,True\n,,False\n")
    assert list(table.name) == ["a", ""] and np.isnan(table.value[1]) and table.holds.dtype == bool
    assert read_table("name\nNA\n").name[0] == "NA"  # no word is taken for a missing number


def test_a_table_in_markdown():
    assert markdown(["a", "b"], [["1", 2]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"
