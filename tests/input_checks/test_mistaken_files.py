"""None of many cells has a word that it needs none of, and every mistake of a class is named."""

import numpy as np
import pytest
from fixtures.cells import MISTAKES, cell

import uq_handeye as uq
from uq_handeye.errors import DegenerateMotionError
from uq_handeye.fit.diagnostics.camera_views import check_views
from uq_handeye.fit.diagnostics.lengths import check_lengths
from uq_handeye.fit.diagnostics.misread_axes import misread_axes
from uq_handeye.methods.all_pairs import solve_all_pairs

CELLS = 60


def _word(setup, G, C):
    poses = uq.PosePairs(G, C, setup)
    try:
        X = solve_all_pairs(poses)
    except DegenerateMotionError:
        return True
    return bool(check_views(poses, X) or check_lengths(poses, X) or misread_axes(poses))


@pytest.mark.statistical
def test_good_cells_have_no_word():
    assert not any(_word(*cell(seed)[:3]) for seed in range(2 * CELLS))


@pytest.mark.statistical
@pytest.mark.parametrize("name", MISTAKES)
def test_every_mistake_is_named(name):
    silent = []
    for seed in range(CELLS):
        setup, G, C, _ = cell(seed)
        if not _word(setup, *MISTAKES[name](G, C, np.random.default_rng(seed))):
            silent.append(seed)
    assert len(silent) <= (3 if name == "scaled" else 0), silent  # small scales within noise do no harm
