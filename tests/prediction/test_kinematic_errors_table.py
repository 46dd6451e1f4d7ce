"""Estimates of each error of an arm from the data."""

import numpy as np
import pytest
from fixtures.arm_sessions import calibrated, declared, session

from uq_handeye.model.kinematics.kinematic_errors import effects_of_errors


@pytest.fixture(scope="module")
def found():
    case = session(1)
    return case, calibrated(case)


@pytest.mark.slow
def test_each_error_that_counts_has_a_row(found):
    case, result = found
    rows = result.kinematics.table()
    of = case.chain, result.kinematics.joints, np.zeros(len(case.chain.errors)), "workspace"
    moves = np.abs(effects_of_errors(*of)).max(axis=(0, 1))  # some only turn or move base or flange
    names = [
        error.name for error, size in zip(case.chain.errors, moves, strict=True) if not error.gauge and size > 1e-9
    ]
    assert [row.name for row in rows] == names
    shared = {error.name: error for error in result.shared_at_sizes}  # the arm is that of the mean sizes
    for row in rows:
        of = shared[row.name]
        assert (row.key.kind, row.unit) == (of.key.kind, of.unit)
        assert row.size == pytest.approx(of.size) and of.size == pytest.approx(
            declared().standard_deviations[row.key.kind]
        )
        assert row.estimate == pytest.approx(of.estimate, abs=1e-12) and row.sd == pytest.approx(of.sd, rel=1e-6)
        assert row.resolved == pytest.approx(1 - (of.sd / of.size) ** 2, abs=1e-6) and 0 <= row.resolved <= 1


@pytest.mark.slow
def test_the_share_told_of_groups_is_the_mean_of_theirs(found):
    _, result = found
    rows, told = result.kinematics.table(), result.kinematics.told()
    assert list(told) == ["joint offsets", "joint tilts", "link lengths", "transmission", "sag"]
    for group, share in told.items():
        assert share == pytest.approx(np.mean([row.resolved for row in rows if row.key.kind == group]))
    assert told["joint offsets"] > told["link lengths"]  # 0.2 mm of a link are hardly seen


def test_it_is_a_table_of_pandas(found):
    _, result = found
    frame = result.kinematics.to_dataframe()
    assert frame.loc["joint offsets: axis_4", "unit"] == "rad" and len(frame) == len(result.kinematics.kept)
