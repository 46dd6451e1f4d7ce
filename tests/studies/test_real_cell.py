"""The study of a cell without noise model: covariances as `calibrate` gives them, and verdicts that can fail."""

import numpy as np
import pandas as pd
import pytest

from studies.common.scores import errors, nees
from studies.real_cell import CELLS, KINDS, band, calibrated, distance2, judged, of_rendered, outliers, sets, spoilt
from studies.real_cell import true_components as components

pytestmark = pytest.mark.slow

FIRST = next(iter(CELLS))


@pytest.fixture(scope="module")
def poses():
    return next(sets(15, FIRST, "eye-in-hand", 2))


def test_each_covariance_is_that_of_calibrate(poses):
    result = calibrated(poses)
    for kind in KINDS:
        own = calibrated(poses, covariance=kind)
        d2 = nees(errors(own.X, poses.truth.X)[None], own.covariance)[0]
        assert distance2(result, poses.truth.X, kind) == pytest.approx(d2 / own.quantile(0.95), rel=1e-9)


def test_true_components_are_those_of_the_noise():
    found = components(FIRST)
    assert found["robot rotation"] == pytest.approx(np.radians(0.02)) and found["camera translation"] == 5e-4
    assert found["rotation, robot and camera together"] == pytest.approx(np.radians(np.hypot(0.02, 0.1)))


def test_wrong_poses_are_wrong_and_only_they(poses, rng):
    for kind, least in (("half turn of the board", 2.0), ("5 cm", 0.04), ("anything", 1e-3)):
        bad = spoilt(poses, np.array([3]), kind, rng)
        off = np.linalg.norm(errors(bad.camera, poses.camera), axis=1)
        assert off[3] > least and (np.delete(off, 3) == 0).all()


def test_one_wrong_pose_is_found():
    found = outliers(20, 1, "5 cm", 1)
    assert found["all_found"] == 1 and found["within_1.2"] == 1


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (0.95, "1 of 1 shares differ from 95 % by no more than chance."),
        (0.80, "0 of 1 shares differ from 95 % by no more than chance; 1 below: model, 15 poses, eye-in-hand (0.800)."),
        (1.00, "0 of 1 shares differ from 95 % by no more than chance; 1 above: model, 15 poses, eye-in-hand (1.000)."),
    ],
)
def test_verdicts_follow_the_shares(share, said):
    row = {"covariance": "model", "poses": 15, "setup": "eye-in-hand", "sets": 500, "share": share}
    assert judged(pd.DataFrame([row])) == said
    assert band(500)[0] < 0.95 < band(500)[1]


def test_rendered_images_are_judged_by_their_distance():
    row = {"poses": 19, "d2_of_95_percent": 14.0, "X_off_mm": 2.0}
    rows = [{**row, "robust": robust, "d2": d2, "halves_agree": True} for robust, d2 in ((True, 40.0), (False, 20.0))]
    assert "is too small" in of_rendered(pd.DataFrame(rows))
    small = of_rendered(pd.DataFrame(rows).assign(d2=3.0, halves_agree=False))
    assert "holds the truth" in small and "do not agree" in small
