"""The study against GTSAM: its findings follow the tables, and without GTSAM it ends with 2."""

import importlib.util

import pandas as pd
import pytest

from studies.against_gtsam import STUDY, figures, findings, interleaved

pytestmark = pytest.mark.slow


def tables(covariance, shift, ratio):
    row = {"data": "simulated", "poses": 20, "sets": 1, "covariance": covariance, "X_and_W_sd": shift}
    times = [{"poses": n, "efficient_ms": 1.0, "gtsam_ms": ratio} for n in (10, 30)]
    same = {"covariance_our_errors": 1e-11, "X_and_W_sd_our_errors": 1e-8}
    return {"agreement": pd.DataFrame([{**row, **same}]), "times": pd.DataFrame(times)}


def test_findings_turn_with_the_tables():
    near, far = findings(tables(1e-4, 1e-3, 5.0)), findings(tables(0.3, 2.0, 0.5))
    assert "agree to 1 % in 1 of 1 rows, X and W to a tenth of a standard deviation in 1" in near
    assert "agree to 1 % in 0 of 1 rows, X and W to a tenth of a standard deviation in 0" in far
    assert "faster one in 2 of 2 sizes" in near and "faster one in 0 of 2 sizes" in far
    assert "30.00 %" in far and "1e-08" in near
    assert set(figures(tables(1e-4, 1e-3, 5.0))) == {"agreement"}


def test_runs_take_turns():
    order = []
    found = interleaved([lambda: order.append("a"), lambda: order.append("b")], 0.0)
    assert "".join(order) == "ab" * (len(order) // 2) and len(found) == 2 and min(found) >= 0


def test_without_gtsam_it_says_so(monkeypatch, capsys):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SystemExit) as end:
        STUDY.measure(False)
    assert end.value.code == 2 and "GTSAM is not installed" in capsys.readouterr().err
