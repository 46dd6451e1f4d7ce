"""X from discs is consistent and better than that from corners; discs as points are far off."""

import pytest
from fixtures.study_tables import quick_tables
from scipy import stats


@pytest.mark.slow
def test_discs_are_better_than_corners_and_points_are_not():
    sets = quick_tables("circles")["sets"]
    assert (sets.discs_d2 < stats.chi2.ppf(0.9999, 6)).all() and (sets.points_d2 > 30).all()
    assert (sets.discs_mm < 0.7 * sets.sb_mm).all() and (sets.discs_mm < sets.corners_mm).all()
    assert (sets.discs_pictures == 20).all()
