"""Ranks of X under the errors that `calibrate` assumes: uniform with the sizes told, rejected with half of them."""

import numpy as np
import pytest
from scipy import stats
from support import SEED

from studies.one_model.ranks import AXES, LEVEL, Cell, Ranked, figure_of, lines, ranked, verdict

pytestmark = pytest.mark.slow

SETS = 12


def shares_of(told):
    return [ranked(Cell(6, told=told), SEED, number) for number in range(SETS)]


def test_ranks_are_uniform_with_the_sizes_told_and_not_with_half_of_them():
    """The test is the study's; half sizes are rejected by d^2 although there are so few sets."""
    right, half = (
        {key: np.array([one.shares[key] for one in shares_of(told)]) for key in (*AXES, "d²")} for told in (1.0, 0.5)
    )
    assert verdict(right)[1] and not verdict(half)[1]
    assert stats.kstest(half["d²"], "uniform").pvalue < LEVEL / 100


def test_a_set_with_open_sizes_ranks_every_one_of_them():
    """The mixture of X, the sizes and the target's probability are what the result states."""
    one = ranked(Cell(10, "eye-to-hand"), SEED, 1)
    assert {"camera rotation", "robot accuracy", "target scale", "view", "drift of the camera"} < one.shares.keys()
    assert all(0 <= share <= 1 for share in one.shares.values()) and 0 <= one.probability <= 1


def test_the_table_and_the_figure_say_what_was_ranked(rng):
    sets = [Ranked(dict.fromkeys((*AXES, "d²", "view"), u), 0.1, u > 0.9) for u in rng.uniform(size=60)]
    row, *sizes = lines("15 poses", sets)
    assert "| 60 |" in row and "6.0 ± 2.3" in row and sizes[0].startswith("    view: p ")
    figure = figure_of({"15 poses": sets, "15 poses, sizes told half": sets})
    assert [axis.get_title() for axis in figure.axes[:2]] == [
        "15 poses",
        "15 poses, sizes told half (wrong on purpose)",
    ]
    with pytest.raises(KeyError):
        figure_of({"no such cell": sets})
