"""Boards that bow: X with the estimated shape is as good as stated, and far off where the board is taken as flat."""

import numpy as np
import pytest
from fixtures.study_tables import quick_tables
from scipy import stats

from studies import board_shape as study

SETS = 10


@pytest.mark.statistical
@pytest.mark.parametrize("kind", ["flat", "wide"])
def test_x_is_as_good_as_stated_where_the_shape_is_estimated(kind):
    """The sets of the quick size of the study, and some more."""
    measured = quick_tables("board_shape")["sets"]
    sets = measured[measured.kind == kind].to_dict("records")
    sets += [study.one_set(kind, seed) for seed in range(len(sets), SETS)]
    low, high = stats.chi2.ppf([0.0005, 0.9995], 6 * SETS) / SETS
    assert low < np.mean([one["auto_d2"] for one in sets]) < high
    expected = {"flat": "flat", "wide": "bow2+plane1"}[kind]
    assert [one["auto_shape"] for one in sets].count(expected) >= SETS - 1
    if kind != "flat":
        assert np.mean([one["flat_d2"] for one in sets]) > high
