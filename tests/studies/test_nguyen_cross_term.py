"""The study of Nguyen and Pham's cross-covariance: units, counts, and verdicts that can fail."""

import numpy as np
import pandas as pd
import pytest
from fixtures.study_tables import quick_tables

from studies.nguyen_cross_term import findings, in_unit, of_own, of_stopping, units
from uq_handeye.core.geometry.se3 import perturb

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tables():
    return quick_tables("nguyen_cross_term")


def test_another_unit_changes_lengths_alone(rng):
    T = perturb(np.eye(4), rng.normal(size=(3, 6)))
    changed = in_unit(T, 1e3)
    np.testing.assert_array_equal(changed[:, :3, :3], T[:, :3, :3])
    np.testing.assert_array_equal(changed[:, :3, 3], 1e3 * T[:, :3, 3])


def test_the_derived_form_is_true_and_the_published_one_is_not(tables):
    text = findings(tables)
    assert "derived: NEES of t" in text and "in 9 of 9 rows; data sets that do not converge in 0 rows" in text
    own = tables["own_geometries"].set_index(["pairs", "noise", "cross_term"])
    bad = own.loc[(5, "0.1 mrad, 0.01 mm", "published")]
    assert bad["converged"] < 0.6 * bad["data_sets"] and bad["mean_nees_t"] > 4


def test_the_findings_turn_with_the_table(tables):
    own = tables["own_geometries"].copy()
    swapped = own.assign(cross_term=own["cross_term"].map({"derived": "published", "published": "derived"}))
    swapped["mean_nees_X"] = 60.0
    text = "\n".join(of_own(swapped))
    derived = next(line for line in text.splitlines() if line.startswith("- derived"))
    assert "9 of 9 rows;" not in derived and "in 0 rows" not in derived
    assert "NEES of X that of a consistent covariance in 0 of 9 rows" in text


def test_nothing_that_converged_is_said_to_have_no_answer(tables):
    one = tables["one_geometry"]
    empty = one[one["converged"] == 0]
    assert len(empty) and empty["mean_nees_t"].isna().all()
    assert one[one["converged"] > 0]["mean_nees_t"].notna().all()


def test_rules_of_stopping():
    table = units(3)
    text = "\n".join(of_stopping(table))
    assert "With the scaled rule convergence and iterations are the same in all units in 2 of 2 cases" in text
    other = table.assign(mean_iterations_t=np.arange(len(table)))
    assert "in 0 of 2 cases" in "\n".join(of_stopping(other))
    assert isinstance(table, pd.DataFrame) and set(table["unit"]) == {"m", "mm", "nm"}
