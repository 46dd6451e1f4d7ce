"""The study of the bound: what it draws, and that its verdicts can fail."""

import numpy as np
import pandas as pd
import pytest

from studies.common.scores import errors
from studies.likelihood import LIMITS, ROWS, at_bound, draws, findings, honest, score, scores, true_ratios

pytestmark = pytest.mark.slow


def table(least=1.0, largest=1.0, nees=6.0, draws=1000, **about):
    row = {"draws": draws, "least_sd_over_bound": least, "largest_sd_over_bound": largest, "mean_nees": nees}
    return pd.DataFrame([{"data": "60 pairs", "noise": "1 mrad", "estimator": "ml", **row, **about}])


def test_draws_satisfy_the_model_and_have_its_noise():
    for row, (geometry, _, noise) in enumerate(ROWS + LIMITS):
        drawn = draws(row, geometry, noise, 1)
        if hasattr(drawn.exact, "robot"):
            W = drawn.exact.robot @ drawn.X @ drawn.exact.camera
            np.testing.assert_allclose(W, np.broadcast_to(W[0], W.shape), atol=1e-12)
        else:
            np.testing.assert_allclose(drawn.exact.A @ drawn.X, drawn.X @ drawn.exact.B, atol=1e-12)
    geometry, _, noise = ROWS[-1]
    drawn = draws(len(ROWS) - 1, geometry, noise, 1)
    (block,) = drawn.blocks
    xi = errors(block.B, np.broadcast_to(drawn.exact.B, block.B.shape)).reshape(-1, 6)
    L = np.linalg.cholesky(noise.B)
    np.testing.assert_allclose(np.cov(np.linalg.solve(L, xi.T)), np.eye(6), atol=5 / np.sqrt(len(xi)))


def test_a_score_of_errors_from_the_bound(rng):
    limit = np.array([1.0, 2.0, 3.0, 1e-3, 2e-3, 3e-3])
    e = limit * rng.standard_normal((4000, 6))
    found = score(e, np.sum((e / limit) ** 2, axis=1), limit)
    low, high = true_ratios(4000)
    assert low < found.least <= found.largest < high and found.nees == pytest.approx(6, abs=0.3)


@pytest.mark.parametrize(
    ("least", "largest", "nees", "near", "true"),
    [(0.99, 1.01, 6.0, True, True), (0.99, 1.2, 6.0, False, True), (0.8, 1.0, 5.0, False, False)],
)
def test_verdicts_follow_the_table(least, largest, nees, near, true):
    row = table(least, largest, nees)
    assert at_bound(row).item() is near and honest(row).item() is true
    joint = pd.concat([table(told=told) for told in ("joint", "independent")])
    text = findings({"bound": row, "limits": row, "joint": joint})
    assert f"at the bound in {int(near)} of 1 rows" in text
    assert f"NEES of a consistent covariance in {int(true)} of 1" in text
    assert ("60 pairs, 1 mrad: 5.0" in text) is not true


def test_one_step_fails_where_rotation_noise_dominates_and_two_do_not():
    row = next(k for k, (_, label, _) in enumerate(ROWS) if label == "30 mrad, 0.1 mm")
    found = scores(row, *ROWS[row][::2], 200)
    assert found["one step"].nees > 100 and found["efficient"].nees < 8 and found["4dpa"].least > 50
