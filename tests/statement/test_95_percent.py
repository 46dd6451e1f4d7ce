"""Statements for 95 % follow from one rule: the length that 95 % of the errors are within."""

import json
import re

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly
from scipy import stats

import uq_handeye as uq
from uq_handeye.core.quantiles import normal_points, radius_holding

POSES = uq.simulate(20, noise=NOISE, seed=5)
CASES = {
    "noise estimated": lambda: quietly(POSES),
    "noise given": lambda: quietly(POSES, noise=NOISE),
    "sandwich": lambda: quietly(POSES, covariance="sandwich"),
    "published": lambda: quietly(POSES, method="park"),
    "eye-to-hand": lambda: quietly(uq.simulate(12, noise=NOISE, setup="eye-to-hand", seed=2)),
}


def test_normal_points_are_standard_normal():
    z = normal_points(6)
    np.testing.assert_allclose(z.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(z.T @ z / len(z), np.eye(6), atol=1e-9)
    for k in range(6):
        assert stats.kstest(z[:, k], "norm").statistic < 4e-3


@pytest.mark.parametrize("share", [0.5, 0.95, 0.99])
def test_the_radius_is_that_of_chi_distributions(share):
    """Closed forms: three, two and one directions of one size; the sphere of unequal ones by random draws."""
    for k in (1, 2, 3):
        S = 4e-6 * np.diag([1.0] * k + [0.0] * (3 - k))
        assert radius_holding(S, share) == pytest.approx(2e-3 * np.sqrt(stats.chi2.ppf(share, k)), rel=6e-3)
    rng = np.random.default_rng(0)
    L = rng.normal(size=(5, 3, 3))
    drawn = np.linalg.norm(np.einsum("kij,nj->kni", L, rng.normal(size=(200_000, 3))), axis=-1)
    np.testing.assert_allclose(radius_holding(L @ L.mT, share), np.quantile(drawn, share, axis=1), rtol=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_the_tolerance_that_is_stated_is_met_and_a_smaller_one_is_not(name):
    result = CASES[name]()
    found = re.search(r"ahead: good for a tolerance of ([\d.]+) mm \(95 %\)", result.summary())
    assert found is not None
    distance = result.accuracy.distance
    assert result.verdict(f"{found[1]}mm", at=distance).passed
    assert not result.verdict((0.9 * float(found[1]) / 1e3, None), at=distance).passed
    assert result.verdict((1.001 * result.accuracy.point_95, None), at=distance).passed
    assert result.verdict((1.001 * result.accuracy.translation_95, None)).passed
    assert not result.verdict((0.999 * result.accuracy.translation_95, None)).passed
    assert result.verdict((None, 1.001 * result.accuracy.rotation_95)).passed
    assert not result.verdict((None, 0.999 * result.accuracy.rotation_95)).passed


@pytest.mark.slow
def test_text_report_certificate_and_prediction_state_the_same(tmp_path):
    result = CASES["noise estimated"]()
    accuracy = result.accuracy
    shown = f"{1e3 * accuracy.translation_95:.2g}"
    within = re.search(r"95 % of the errors are within +([\d.]+)", result.summary(verbose=True))
    assert within is not None and within[1] == shown
    at = result.uncertainty_at([0.0, 0.0, accuracy.distance])
    assert float(at.radius_95) == pytest.approx(accuracy.point_95, rel=1e-7)
    page = result.report(tmp_path / "report.html", comparison=False).read_text()
    assert f"{1e3 * accuracy.point_95:.2g}" in page and "95 % of the errors are within" in page
    data = json.loads(result.report(tmp_path / "certificate.json", certificate=True).read_text())
    stated = {one["label"]: one["measurementUncertaintyUnivariate"]["expandedMU"] for one in _quantities(data)}
    assert stated["translation"]["valueExpandedMU"] == accuracy.translation_95
    assert stated["point"]["valueExpandedMU"] == accuracy.point_95


def _quantities(data):
    if isinstance(data, dict):
        if "measurementUncertaintyUnivariate" in data:
            yield data
        for value in data.values():
            yield from _quantities(value)
    elif isinstance(data, list):
        for value in data:
            yield from _quantities(value)


@pytest.mark.statistical
def test_the_stated_length_holds_95_percent_of_true_errors():
    """Noise given, 400 rigs: translation, and the point at the distance of the target; 3 standard errors of 95 %."""
    inside = []
    for seed in range(400):
        poses = uq.simulate(12, noise=NOISE, seed=seed)
        result = quietly(poses, noise=NOISE, robust=False)
        p = np.array([0.0, 0.0, result.accuracy.distance])
        off = (result.X - poses.truth.X)[:3]
        inside.append(
            [
                np.linalg.norm(off[:, 3]) < result.accuracy.translation_95,
                np.linalg.norm(off[:, :3] @ p + off[:, 3]) < result.accuracy.point_95,
            ]
        )
    share = np.mean(inside, axis=0)
    assert (np.abs(share - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 400)).all(), share
