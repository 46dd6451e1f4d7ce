"""The study of first order: its problems are exact, and its findings follow the table."""

import numpy as np
import pandas as pd
import pytest

from studies.first_order_limits import cell, figures, findings, problems
from uq_handeye.trials.validation.sweep.level import KINDS


def limits(first, second):
    """One row of the table from pairs (holds, fails) in mrad, NaN where there is none."""
    about = {"data": "cell", "noise": "1 mrad", "trials": 1000, "most_mrad": 300, "method": "4dpa"}
    rows = [
        {**about, "covariance": kind, "holds_mrad": holds, "fails_mrad": fails, "heavy_tails": False, "reason": "why."}
        for kind, (holds, fails) in zip(KINDS, (first, second), strict=True)
    ]
    return {"limits": pd.DataFrame(rows)}


def test_data_are_exact():
    for _, _, data, noise in problems():
        assert noise is not None
        if hasattr(data, "robot"):
            np.testing.assert_allclose(data.camera, data.truth.camera)
            W = data.robot @ data.truth.X @ data.camera
            np.testing.assert_allclose(W, np.broadcast_to(W[0], W.shape), atol=1e-12)
        else:
            angles = [np.arccos((np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1) / 2) for T in (data.A, data.B)]
            np.testing.assert_allclose(*angles, atol=1e-7)


@pytest.mark.parametrize(
    ("first", "second", "said"),
    [
        ((90, 100), (np.nan, np.nan), "farther than first order in 1 of 1 rows, less far in 0"),
        ((np.nan, np.nan), (90, 100), "farther than first order in 0 of 1 rows, less far in 1"),
        ((np.nan, np.nan), (np.nan, np.nan), "first order: holds at all levels in 1 of 1 rows."),
        ((1, 4), (90, 100), "usual noise of a cell, in 1."),
        ((90, 100), (90, 100), "usual noise of a cell, in 0."),
    ],
)
def test_findings_follow_the_table(first, second, said):
    assert said in findings(limits(first, second))


def test_ends_are_said_as_they_are():
    text = [cell(row) for row in limits((90, 100), (np.nan, 1))["limits"].itertuples()]
    assert text == ["95", "< 1"]
    assert cell(next(limits((np.nan, np.nan), (1, 2))["limits"].itertuples())) == "> 300"
    assert set(figures(limits((90, 100), (np.nan, np.nan)))) == {"limits"}
