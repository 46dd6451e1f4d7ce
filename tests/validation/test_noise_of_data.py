"""Limits of a validation in its texts: it cannot judge the noise, and the data can."""

import json

import pytest
from support import SEED

import uq_handeye as uq
from uq_handeye.report.page import report_html
from uq_handeye.trials.validation.cross_check.text import verdict

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
SMALL = uq.PoseNoise.isotropic(robot=("0.01deg", "0.025mm"), camera=("0.05deg", "0.25mm"))
CANNOT = "cannot tell whether the noise is right."


def measured():
    poses = uq.simulate(30, noise=NOISE, seed=SEED)
    return uq.PosePairs(poses.robot, poses.camera)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("calibrated", [False, True])
@pytest.mark.parametrize("noise", [NOISE, SMALL], ids=["right", "too small"])
def test_the_verdict_names_a_noise_that_the_data_contradict(noise, calibrated):
    """Drawn noise always gives the covariance of drawn noise: whether it is that of the data is said beside it."""
    data, given = (uq.calibrate(measured(), noise=noise), None) if calibrated else (measured(), noise)
    run = uq.monte_carlo(data, noise=given, method="efficient", trials=300)
    check = uq.cross_check(data, noise=given, trials=100, posterior=False)
    assert run.consistent and "The covariance of efficient is consistent with this noise" in run.verdict
    assert "true" not in run.verdict
    texts = [run.verdict, run.summary(), str(run), check.to_text(), verdict(check)]
    texts += [run.summary(verbose=True), check.to_text(verbose=True)]
    assert len(run.summary(verbose=True)) > 1.5 * len(run.summary())
    for text in texts:
        words = " ".join(text.split())
        assert CANNOT in words and "On these data" in words
        assert ("than this noise" in words) == (noise is SMALL), words
        if noise is SMALL:
            assert "residuals 2 times larger" in words or "residuals 2.1 times larger" in words, words
    for result in (run, check):
        plain = json.loads(result.to_json())["noise_of_data"]
        assert plain["by"] == ("calibrate" if calibrated else "residuals")
        statuses = {one["name"]: one["status"] for one in plain["checks"]}
        assert (statuses["noise level"] in ("caution", "failed")) == (noise is SMALL)
        assert CANNOT in " ".join(result._repr_html_().split())
    for text in (run.summary(), check.to_text()):
        assert len(text.splitlines()) <= 30 and max(map(len, text.splitlines())) <= 80


def test_noise_that_cannot_be_checked():
    estimated = uq.monte_carlo(measured(), method="efficient", trials=50)
    assert "it was not checked: the noise was estimated from the same residuals" in estimated.verdict
    exact = uq.monte_carlo(uq.simulate(10, seed=SEED), noise=NOISE, trials=50)
    assert "it was not checked: the data are exact, simulated without noise" in exact.verdict


@pytest.mark.slow
def test_the_report_says_it_too(without_rendering):
    result = uq.calibrate(measured(), noise=NOISE)
    check = uq.cross_check(result, trials=100, posterior=False)
    assert CANNOT in report_html(result, cross_check=check, comparison=None)
