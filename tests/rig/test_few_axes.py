"""Rigs whose robot rotates about one axis, in a plane, or not at all: what stays open is said, noise given or not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

NOISE = {"arm": ("0.01deg", "0.05mm"), "left": ("0.07deg", "0.4mm"), "right": ("0.07deg", "0.4mm")}
OPEN = {"one axis": 2, "plane": 1, "no rotation": 3}


def with_motion(motion, n, seed):
    """The cell of two cameras with these motions of its arm, exact."""
    rig, truth = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=n, seed=seed)
    rng, G = np.random.default_rng(seed), np.tile(np.asarray(rig.arms["arm"].poses)[0], (n, 1, 1))
    if motion == "no rotation":
        G[:, :3, 3] += rng.uniform(-0.15, 0.15, (n, 3))
    else:
        turn = np.tile(np.eye(4), (n, 1, 1))
        turn[:, :3, :3] = Rotation.from_rotvec(np.outer(rng.uniform(-1, 1, n), [0, 0, 1])).as_matrix()
        if motion == "plane":
            turn[:, :2, 3] = rng.uniform(-0.1, 0.1, (n, 2))
        G = turn @ G
    views = [
        uq.View(name, "board", np.linalg.inv(G @ truth[name]) @ truth["board"], at=list(range(n)))
        for name in ("left", "right")
    ]
    return uq.Rig({"arm": uq.ArmPoses(G, list(range(n)))}, rig.cameras, rig.targets, tuple(views))


@pytest.mark.parametrize("motion", OPEN)
@pytest.mark.parametrize("n", [12, 25])
def test_directions_that_stay_open_are_said(motion, n):
    for seed in range(2):
        rig = with_noise(with_motion(motion, n, seed), NOISE, [seed, n])
        for noise in (NOISE, None):
            found = calibrate_rig(rig, noise)
            assert len(found.open) == OPEN[motion]
            assert found.answered == "in part"


def test_a_plan_closes_what_stays_open():
    rig = with_noise(with_motion("one axis", 12, 0), NOISE, [0, 12])
    found = uq.plan(calibrate_rig(rig, NOISE), k=3, sample=60)
    first, last = found.of_cameras[0], found.of_cameras[-1]
    assert np.sqrt(np.trace(first[0][3:, 3:])) > 0.1  # m, by the weak prior
    assert np.sqrt(np.trace(last[0][3:, 3:])) < 0.01
