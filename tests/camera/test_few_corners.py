"""Boards of few corners: what is chosen is the best, though the candidates are far from linear about each other."""

import numpy as np
import pytest
from support import SEED

import studies.camera_covariance as study
from studies.camera_covariance.few_pictures import one
from uq_handeye.model.camera.adjustment.criterion import criterion
from uq_handeye.model.camera.calibrate import calibrate_camera

pytestmark = pytest.mark.slow


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
def test_auto_is_no_worse_than_a_pinhole_by_itself(monkeypatch):
    """3 x 2 corners, no distortion; ranked by linear prediction alone half of them got coefficients."""
    small = study.board(3, 2, 0.03)
    monkeypatch.setattr(study, "board", lambda: small)
    chosen = []
    for k in range(12):
        corners, _, _ = study.recorded(np.random.default_rng([SEED, 50, k]))
        found = calibrate_camera(corners, study.SIZE)
        alone = calibrate_camera(corners, study.SIZE, "pinhole", shape="flat").bundle
        squares = float(np.sum(alone.residuals[alone.used] ** 2))
        bic = criterion(squares, 2 * int(alone.used.sum()), len(alone.poses), int(alone.free.sum()))
        if found.bundle.used.all() and alone.used.all():
            assert min(one.bic for one in found.candidates) <= bic + 0.5
        chosen.append(found.model)
    assert chosen.count("pinhole") >= 8


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.errors.InputWarning")
@pytest.mark.parametrize(
    ("lens", "n", "sets", "least"),
    [("none", 2, 16, 14), ("k1", 3, 16, 14), ("k1, k2", 2, 16, 14), ("k1 to k3", 30, 5, 4)],
)
def test_few_pictures_get_the_simplest_lens_and_many_a_rich_one(lens, n, sets, least):
    """Candidates that start from the richest one are right in 55 to 80 % of sets of two and three pictures."""
    assert sum(one(lens, n, k)[0] for k in range(sets)) >= least
