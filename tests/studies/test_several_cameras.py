"""The study of several cameras: bound, programs in interpreters of their own, and what the page says."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
from fixtures.pages import DOCS
from scipy.stats import chi2

from studies.common.scores import errors, nees
from studies.common.study import FINDINGS, RUN
from studies.peers import rig_programs
from studies.peers import several_cameras as study
from uq_handeye.core.geometry.se3 import inverse, perturb

pytestmark = pytest.mark.slow

FOLDER = DOCS / "studies" / "peers" / "several_cameras"
FREE = np.full(study.FREE_LENS, np.inf)
TRUTH = study.cell()
TARGET = inverse(TRUTH.cameras[-1])


def test_the_bound_is_that_of_its_own_errors():
    rng = np.random.default_rng(1)
    for sd, draws in ((np.zeros(study.FREE_LENS), 6), (FREE, 6)):
        X, _ = study.least_squares(TRUTH, TRUTH.pixels, study.LENSES, sd)
        np.testing.assert_allclose(X, TARGET, atol=1e-8)
        noisy = TRUTH.pixels + rng.normal(0, study.NOISE_PX, (draws, *TRUTH.pixels.shape))
        X, S = map(np.stack, zip(*(study.least_squares(TRUTH, one, study.LENSES, sd) for one in noisy), strict=True))
        total = nees(errors(X, TARGET), S).sum()
        assert chi2.ppf(1e-4, 6 * draws) < total < chi2.ppf(1 - 1e-4, 6 * draws)


def test_this_toolkit_finds_exact_corners():
    robot = TRUTH.world_T_first @ TRUTH.boards @ inverse(TRUTH.gripper_T_board)
    rng = np.random.default_rng(2)
    pixels = TRUTH.pixels + rng.normal(0, 1e-3, TRUTH.pixels.shape)
    found = {setting: X for setting, X, _ in study.ours(TRUTH, robot, pixels, study.LENSES)}
    assert len(found) == 3
    for X in found.values():
        np.testing.assert_allclose(X, TARGET, atol=1e-4)


def test_a_program_finds_exact_corners_in_another_interpreter():
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "calibrateMultiview"):
        pytest.skip("calibrateMultiview comes with OpenCV 5")
    version, found = study.by_program("opencv", sys.executable, TRUTH, TRUTH.pixels[None])
    assert version[0].isdigit()
    np.testing.assert_allclose(found["intrinsics known"][0], TARGET, atol=1e-4)
    np.testing.assert_allclose(found["default"][0], TARGET, atol=1e-3)


def test_a_program_that_raises_has_failed(tmp_path, capsys, monkeypatch):
    def run(draw):
        if draw["pixels"][0, 0, 0, 0] < 0:
            raise ValueError("no")
        return {"default": TRUTH.cameras}

    monkeypatch.setitem(rig_programs.PROGRAMS, "opencv", (run, "numpy"))
    np.savez(tmp_path / "draws.npz", pixels=np.stack([TRUTH.pixels, -TRUTH.pixels]))
    rig_programs.main("opencv", str(tmp_path / "draws.npz"), str(tmp_path / "found.npz"))
    assert "draw 1: ValueError: no" in capsys.readouterr().err
    with np.load(tmp_path / "found.npz") as file:
        X = inverse(file["default"][:, -1])
    row = study._row("opencv", "5", "default", X, TARGET)
    assert (row["failed"], row["draws"]) == (1, 2) and row["mm"] < 1e-9


def test_programs_without_an_interpreter_are_named(capsys, monkeypatch):
    monkeypatch.setattr(study, "QUICK_TRIALS", 1)
    near = perturb(TARGET, np.full(6, 1e-4))
    monkeypatch.setattr(study, "ours", lambda *_: iter([("intrinsics known", near, 1e-8 * np.eye(6))]))
    rows = study.measure({}, full=False)["cameras"]
    assert set(rows.program) == {study.BOUND, study.OURS}
    said = capsys.readouterr().err
    assert all(f"{name} is skipped" in said for name in rig_programs.PROGRAMS)
    assert "not run" in study.findings({"cameras": rows})


def test_the_page_says_what_the_table_says():
    assert json.loads((FOLDER / RUN).read_text(encoding="utf-8"))["full"]
    assert study.study({}).text(FOLDER) == (FOLDER / FINDINGS).read_text(encoding="utf-8")
    page = (DOCS / "studies" / "peers.md").read_text(encoding="utf-8")
    assert f"peers/several_cameras/{FINDINGS}" in page
    header = pd.read_csv(FOLDER / "cameras.csv", nrows=0).columns
    said = page.partition("## Columns of the tables")[2]
    assert not [column for column in header if f"`{column}`" not in said]
