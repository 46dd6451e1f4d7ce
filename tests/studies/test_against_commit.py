"""The comparison of two programs: what counts as rounding, and what does not."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from studies.performance.against_commit import allowances, disagreements


@pytest.fixture
def result() -> dict[str, Any]:
    half = np.random.default_rng(0).normal(size=(6, 6))
    worst = [{"row": 4, "distance2": 812.0, "rotation": 0.3}, {"row": 7, "distance2": 64.0, "rotation": 0.2}]
    return {
        "status": 0.0,
        "X": np.eye(4).tolist(),
        "covariance": (half @ half.T).tolist(),
        "findings": [
            {"code": "pose.rejected", "values": {"worst": worst}},
            {"code": "noise.tails", "values": {"p_value": 1e-7}},
        ],
    }


@pytest.fixture
def rounded(result: dict[str, Any]) -> dict[str, Any]:
    """The result with other rounding, which distances of rejected poses amplify."""
    found = copy.deepcopy(result)
    found["findings"][0]["values"]["worst"][0]["distance2"] *= 1 + 2e-5
    found["findings"][0]["values"]["worst"][0]["rotation"] *= 1 + 1e-13
    return found


def test_equal_results_agree(result: dict[str, Any], rounded: dict[str, Any]) -> None:
    assert disagreements(result, copy.deepcopy(result), {}) == []
    assert disagreements(result, rounded, allowances(result, rounded)) == []


def test_a_change_of_a_millionth_is_seen_where_rounding_does_not_amplify(
    result: dict[str, Any], rounded: dict[str, Any]
) -> None:
    allowed = allowances(result, rounded)
    changed = copy.deepcopy(result)
    changed["findings"][0]["values"]["worst"][1]["rotation"] *= 1 + 1e-6
    changed["findings"][1]["values"]["p_value"] *= 1 + 1e-6
    changed["X"][0][3] += 1e-6
    places = [place for place, _ in disagreements(result, changed, allowed)]
    assert places == ["X", "findings[0].values.worst[1].rotation", "findings[1].values.p_value"]


def test_rounding_is_allowed_for_the_value_that_amplifies_it(result: dict[str, Any], rounded: dict[str, Any]) -> None:
    allowed = allowances(result, rounded)
    changed = copy.deepcopy(result)
    changed["findings"][0]["values"]["worst"][1]["distance2"] *= 1 + 1e-4
    assert disagreements(result, changed, allowed) == []
    changed["findings"][0]["values"]["worst"][1]["distance2"] *= 1 + 1e-3
    assert [place for place, _ in disagreements(result, changed, allowed)] == ["findings[0].values.worst[1].distance2"]


def test_another_code_a_missing_finding_or_another_kind_of_result_is_never_rounding(
    result: dict[str, Any], rounded: dict[str, Any]
) -> None:
    allowed = allowances(result, rounded)
    other, fewer, none = (copy.deepcopy(result) for _ in range(3))
    other["findings"][0]["code"] = "pose.downweighted"
    del fewer["findings"][1]
    del none["covariance"]
    for changed, place in ((other, "findings[0].code"), (fewer, "findings"), (none, "covariance")):
        assert disagreements(result, changed, allowed) == [(place, np.inf)]
    assert disagreements(result, fewer, allowances(result, fewer)) == [("findings", np.inf)]


def test_a_covariance_counts_in_units_of_its_standard_deviations(result: dict[str, Any]) -> None:
    covariance = np.diag([1.0, 1.0, 1.0, 1e-8, 1e-8, 1e-8])
    result["covariance"] = covariance.tolist()
    covariance[4, 4] *= 1 + 1e-6
    (place, size), *rest = disagreements(result, {**result, "covariance": covariance.tolist()}, {})
    assert (place, rest) == ("covariance", [])
    assert size == pytest.approx(1e-6, rel=1e-3)
