"""The study of checks of unknown arms: what a draw says, and that pieces add up to the whole."""

import numpy as np
import pytest

from studies.maintenance import unknown_arms

pytestmark = pytest.mark.slow


def test_a_draw_has_a_p_value_powers_and_now_and_then_a_shift_that_is_found():
    first = unknown_arms.drawn(0)
    assert first[0] == 0.0 and 0 <= first[3] <= 1 and set(first[4:7]) <= {0.0, 1.0}
    assert first[8] == first[9] == 1.0 and 0 < first[7] < 1.0  # 2 mm, and what would have shown in mm
    assert np.isnan(unknown_arms.drawn(6)[7:]).all()


def test_pieces_add_up(tmp_path, capsys):
    one, two, whole = (tmp_path / f"{name}.npz" for name in ("one", "two", "whole"))
    for arguments in (
        ("--draws", "1", "--keep", str(one)),
        ("--draws", "1", "--keep", str(one)),
        ("--draws", "1", "--first", "2", "--keep", str(two)),
        ("--draws", "3", "--keep", str(whole)),
        ("--draws", "0", "--keep", str(one), str(two)),
    ):
        unknown_arms.main(arguments)
    apart, together = [np.load(path)["draws"] for path in (one, two)], np.load(whole)["draws"]
    np.testing.assert_array_equal(np.concatenate(apart), together)
    tables = capsys.readouterr().out.split("| arm mm")
    assert tables[-1] == tables[-2] and "| all | | 3 |" in tables[-1]
