"""Uncertainty by the poses alone, and what assumed errors add to it."""

import numpy as np
import pytest
from fixtures.rigs import NOISE, quietly

import uq_handeye as uq
from uq_handeye.calibration.accuracy import limit_of


@pytest.fixture(scope="module")
def result():
    """Eye-to-hand: the frame of the base of an unknown arm is known by what arms are like alone."""
    poses = uq.simulate(30, noise=NOISE, seed=3, setup="eye-to-hand")
    return quietly(uq.PosePairs(poses.robot, poses.camera, "eye-to-hand"))


@pytest.mark.slow
def test_the_poses_alone_give_the_covariance_for_known_errors(result):
    """Check by the block of the information matrix, in place of the Schur complement."""
    own, posterior = result.accuracy.from_poses, result.posterior
    first = len(posterior.covariance) - len(posterior.names)
    known = {
        error.name for error in result.shared if error.default and error.resolved < 0.5
    }  # fmt: skip
    kept = [k for k in range(len(posterior.covariance)) if k < first or posterior.names[k - first] not in known]
    S = np.linalg.inv(np.linalg.inv(posterior.covariance)[np.ix_(kept, kept)])[:6, :6]
    worst = [np.sqrt(np.linalg.eigvalsh(part)[-1]) for part in (S[3:, 3:], S[:3, :3])]
    np.testing.assert_allclose([own.translation, own.rotation], worst, rtol=1e-6)
    assert own.translation < result.accuracy.translation / 1.25


@pytest.mark.slow
def test_words_name_what_to_declare(result):
    text = limit_of(result)
    assert text.startswith("These poses alone give ") and "--robot-accuracy" in text
    assert " ".join(text.split()) in " ".join(result.summary().split())
    assert result.to_dict()["accuracy"]["from_poses"]["assumed"][0] == {"owner": "robot", "kind": "accuracy"}


def test_one_number_where_all_noise_is_given():
    poses = uq.simulate(20, noise=NOISE, seed=3)
    found = quietly(poses, noise=NOISE)
    assert found.accuracy.from_poses is None and limit_of(found).startswith("Most of it is noise of the camera poses: ")
