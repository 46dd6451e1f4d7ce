"""The study of first order: its problems are exact, and its findings follow the table."""

import numpy as np
import pandas as pd
import pytest

from studies.first_order_limits import cell, end, figures, findings, problems, reason

pytestmark = pytest.mark.slow


def limits(holds, fails):
    """One row of the table from two levels in mrad, NaN where there is none."""
    about = {"data": "cell", "noise": "1 mrad", "trials": 1000, "most_mrad": 300, "method": "4dpa"}
    return {"limits": pd.DataFrame([{**about, "holds_mrad": holds, "fails_mrad": fails, "reason": "why."}])}


def test_data_are_exact():
    for _, _, data, kind, covariances in problems():
        assert len(kind(*covariances).sides) == 2
        if hasattr(data, "robot"):
            np.testing.assert_allclose(data.camera, data.truth.camera)
            W = data.robot @ data.truth.X @ data.camera
            np.testing.assert_allclose(W, np.broadcast_to(W[0], W.shape), atol=1e-12)
        else:
            angles = [np.arccos((np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1) / 2) for T in (data.A, data.B)]
            np.testing.assert_allclose(*angles, atol=1e-7)


@pytest.mark.parametrize(
    ("holds", "fails", "words"),
    [
        (300, np.nan, "Holds at all levels in 1 of 1 rows."),
        (1, 4, "usual noise of a cell, in 1."),
        (90, 100, "fails first on cell with `4dpa`, at 95 mrad; below 5 mrad, the usual noise of a cell, in 0."),
    ],
)
def test_findings_follow_the_table(holds, fails, words):
    assert words in findings(limits(holds, fails))


def test_ends_are_those_of_the_levels():
    text = [cell(next(limits(*ends)["limits"].itertuples())) for ends in ((90, 100), (np.nan, 1), (300, np.nan))]
    assert text == ["95", "< 1", "> 300"]
    assert set(figures(limits(90, 100))) == {"limits"}
    rows = {1.0: {"reason": ""}, 3.0: {"reason": "too large"}, 10.0: {"reason": ""}}
    assert end(rows) == (1.0, 3.0)
    assert np.isnan(end({1.0: {"reason": "too large"}})[0]) and np.isnan(end({1.0: {"reason": ""}})[1])


@pytest.mark.parametrize(
    ("nees", "failed", "words"),
    [
        ({"joint": (6.1, 5.7, 6.3), "rotation": (3.0, 2.8, 3.2)}, 0.0, ""),
        ({"joint": (6.6, 5.7, 6.3), "rotation": (3.0, 2.8, 3.2)}, 0.0, ""),  # beyond chance, and of no weight
        ({"joint": (6.6, 5.7, 6.3), "rotation": (4.32, 2.8, 3.2)}, 0.0, "rotation errors are 1.2 times"),
        ({"joint": (13.5, 0.1, 20.0)}, 0.0, ""),  # by chance
        ({"joint": (6.0, 5.7, 6.3)}, 0.5, "50 % of the trials give no X."),
    ],
)
def test_reasons_follow_the_numbers(nees, failed, words):
    found = reason(nees, failed)
    assert words in found and bool(words) == bool(found)
