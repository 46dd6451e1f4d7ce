"""Calibration, Monte Carlo, posterior and cross-check speak of one X: the same poses, weights and noise.

The accuracy assumed of a robot is beside the noise: the covariance of the result has it, that of the fit has not.
"""

from dataclasses import replace

import numpy as np
import pytest
from support import difference, moved

import uq_handeye as uq
from uq_handeye.errors import InputError

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


def measured(wrong=()):
    """Poses as from files, without truth; some rows of the camera are off by ``sigmas`` of its noise."""
    poses = uq.simulate(25, noise=NOISE, seed=11)
    camera = poses.camera.copy()
    for row, sigmas in wrong:
        camera[row] = moved(camera[row], sigmas * np.array([1.7e-3, -1.7e-3, 1.7e-3, 5e-4, -5e-4, 5e-4]))
    return uq.PosePairs(poses.robot, camera)


CASES = {
    "good poses": (),
    "an outlier": ((4, 100.0),),
    "an outlier and poses of partial weight": ((4, 100.0), (9, 2.1), (17, 2.1)),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("wrong", CASES.values(), ids=CASES)
@pytest.mark.parametrize("noise", [None, NOISE], ids=["noise estimated", "noise given"])
def test_one_x(wrong, noise):
    poses = measured(wrong)
    result = uq.calibrate(poses, noise=noise, robust=True)
    weight = result.table.weight
    assert (weight[4] == 0) == bool(wrong)
    if len(wrong) == 3:
        assert ((weight > 0) & (weight < 1)).any()
    data, used = result.used
    assert data.n == (weight > 0).sum()

    trials = uq.monte_carlo(result, method="efficient", trials=100)
    check = uq.cross_check(result, trials=100, posterior=False)
    std = np.sqrt(np.diag(result.bound))
    assert (std <= result.std).all()
    density = uq.maximum_likelihood(data, used)  # where the posterior has its mode, and its covariance there
    formula = next(row for row in check.rows if row.key == "efficient")
    for X, covariance in (
        (trials.experiment.X, trials.consistency.predicted),
        (density.X, density.covariance_X),
        (result.X, formula.covariance),
    ):
        # `efficient` and maximum likelihood, about which noise is drawn, differ to second order
        assert (np.abs(difference(X, result.X)) < 0.03 * std).all()
        np.testing.assert_allclose(np.sqrt(np.diag(covariance)), std, rtol=1e-2)
    assert trials.noise_estimated == check.noise_estimated == (noise is None)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_posterior_of_a_calibration():
    result = uq.calibrate(measured(CASES["an outlier"]))
    posterior = uq.sample_posterior(result, samples=400, scales=False)
    assert posterior.noise_estimated
    std = np.sqrt(np.diag(result.bound))
    assert (np.abs(difference(posterior.X, result.X)) < 0.03 * std).all()
    np.testing.assert_allclose(np.sqrt(np.diag(posterior.bound)), std, rtol=1e-2)
    np.testing.assert_allclose(posterior.std, std, rtol=0.2)


@pytest.mark.filterwarnings("ignore")
def test_pairs_of_a_calibration_with_noise_on_motions():
    poses = measured()
    noise = uq.PairNoise.isotropic(A=("0.03deg", "0.1mm"), B=("0.15deg", "0.7mm"))
    result = uq.calibrate(poses, noise=noise, pairs="consecutive")
    data, _ = result.used
    assert isinstance(data, uq.Motions) and data.N == (result.table.weight > 0).sum() >= 22
    trials = uq.monte_carlo(result, method="efficient", trials=100)
    np.testing.assert_allclose(np.sqrt(np.diag(trials.consistency.predicted)), result.std, rtol=1e-2)


def test_what_a_calibration_cannot_give():
    result = uq.calibrate(measured(), noise=NOISE)
    with pytest.raises(InputError, match="no `noise` beside a calibration"):
        uq.monte_carlo(result, noise=NOISE)
    with pytest.raises(InputError, match="no poses: its file holds none"):
        uq.monte_carlo(replace(result, data=None))
    exact = uq.calibrate(uq.simulate(10, seed=1))
    with pytest.raises(InputError, match="no noise"):
        exact.used  # noqa: B018
