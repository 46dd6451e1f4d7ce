"""Given intrinsics: right ones are believed, wrong ones named, files of other programs read as they mean."""

import pytest
from fixtures.study_tables import quick_tables
from scipy import stats

from studies import given_intrinsics as study


@pytest.mark.slow
def test_each_row_of_the_quick_size_says_what_it_should():
    sets = quick_tables("given_intrinsics")["sets"]
    limit = stats.chi2.ppf(0.9999, 6)
    for kind in ("right", "half", "realsense", "roi", "binning", "resolution", "tilt"):
        part = sets[sets.kind == kind]
        assert not part.found.any() and part.usable.all() and (part.d2 < limit).all(), kind
    for kind in ("sign", "crop", "inverse", "tilt_cut"):
        part = sets[sets.kind == kind]
        assert part.right_name.all() and not part.usable.any(), kind
    assert set(sets.kind) == set(study.KINDS)
