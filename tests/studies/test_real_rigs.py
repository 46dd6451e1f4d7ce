"""The simulated rigs are wrong by what the study says of them, and the findings follow the tables."""

import numpy as np
import pandas as pd
import pytest

import uq_handeye as uq
from studies.common.scores import errors
from studies.real_rigs import CASES, COEFFICIENT, DEVIATIONS, SEED, STEP, TOO_LARGE, correlated, one_cell, walking
from studies.real_rigs.findings import findings
from uq_handeye.core.geometry.se3 import perturb

pytestmark = pytest.mark.slow

SETUPS = ("eye-in-hand", "eye-to-hand")


def rig(n, setup="eye-in-hand", seed=3):
    truth = uq.simulate(n, setup=setup, seed=seed).truth
    return uq.PosePairs(truth.robot, truth.camera, setup, np.arange(float(n)), truth)


def test_a_large_target_makes_all_poses_longer():
    true = rig(12)
    made = CASES["target 1 % too large"](true, np.random.default_rng(1))
    assert list(made) == ["camera"]
    np.testing.assert_allclose(made["camera"][:, 3:], TOO_LARGE * true.camera[:, :3, 3])
    assert not made["camera"][:, :3].any()


@pytest.mark.parametrize("setup", SETUPS)
def test_a_target_that_walks_takes_steps_of_a_third_of_the_noise(setup):
    n = 1_000
    true = rig(n, setup)
    made = walking("target")(true, np.random.default_rng(5))["camera"]
    np.testing.assert_allclose(made[0], 0.0, atol=1e-9)  # the truth is that of the first pose
    walked = errors(true.effective_robot @ true.truth.X @ perturb(true.camera, made), true.truth.W)
    size = np.sqrt(DEVIATIONS["robot"] ** 2 + DEVIATIONS["camera"] ** 2)
    assert np.std(np.diff(walked[:, 3:], axis=0)) == pytest.approx(STEP * size[3], rel=5 / np.sqrt(6 * n))


@pytest.mark.parametrize("side", ["robot", "camera"])
def test_noise_of_one_side_is_correlated(side):
    n = 2_000
    poses, _ = correlated(side, n, SETUPS[0], 0)
    truth = uq.simulate(n, setup=SETUPS[0], seed=np.random.default_rng([SEED, n, 0, 0, side == "robot"])).truth
    for name in ("robot", "camera"):
        e = errors(getattr(poses, name), getattr(truth, name))
        found = np.sum(e[1:] * e[:-1]) / np.sum(e * e)
        assert found == pytest.approx(COEFFICIENT if name == side else 0.0, abs=0.1)


def test_the_findings_count_what_is_refused():
    poses = pd.DataFrame([one_cell("nothing", 15, setup, 2) for setup in SETUPS])
    ways = {"views": 5.0, "default": 9.0, "alone": 100.0}
    numbers = {f"{what}, {way}": d2 for way, d2 in ways.items() for what in ("median mm", "mean d2", "inside 95 %")}
    views = pd.DataFrame([{"poses": 15, "setup": SETUPS[0], "sets": 7, **numbers}])
    quiet = {f"refused, {way}": 0.0 for way in ways}
    text = findings({"poses": poses, "views": views.assign(**quiet)})
    assert "4 sets of simulated poses" in text and "100.00 mm, 100, " in text and "not converged" not in text
    noisy = views.assign(**quiet | {"refused, default": 2.0})
    assert "in no mean: 2 of 29 calibrations." in findings({"poses": poses, "views": noisy})
