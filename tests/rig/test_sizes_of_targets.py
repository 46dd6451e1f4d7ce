"""Lengths of rigs: a target of another size for one camera, or for all, is named with its size; a right one is not."""

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

NOISE = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
CELL = ({"left": "world", "right": "world"}, {"board": "arm"})


def of_size(rig, size, cameras):
    """The rig in which the target is this many times as large as the programs of some cameras were told."""
    views = []
    for view in rig.views:
        C = np.array(view.poses)
        C[:, :3, 3] /= size if view.camera in cameras else 1.0
        views.append(uq.View(view.camera, view.target, C, view.at))
    return uq.Rig(rig.arms, rig.cameras, rig.targets, tuple(views))


def sizes_of(found):
    return [one for one in found.findings if one.code == "rig.wrong_size"]


def test_a_target_of_another_size_for_one_camera_is_named():
    rig, truth = simulate_rig(*CELL, n_poses=15, noise=NOISE, seed=3)
    found = calibrate_rig(of_size(rig, 0.98, ["right"]), NOISE)
    (size,) = sizes_of(found)
    assert (size.severity, size.values["camera"], size.values["target"]) == ("failure", "right", "board")
    assert abs(size.values["size"] - 0.98) < 4 * size.values["sd"]
    off = np.linalg.norm(found.cameras["right"].X[:3, 3] - truth["right"][:3, 3])
    assert off > 5 * found.cameras["right"].sizes[1]  # which the fit itself does not say
    assert found.headline.startswith("NOT USABLE: right: the target board is 0.9")
    assert "size" in found.remedy and "program of right" in found.remedy


def test_a_target_of_another_size_is_named_with_noise_estimated():
    rig, truth = simulate_rig(*CELL, n_poses=15, noise=NOISE, seed=3)
    found = calibrate_rig(of_size(rig, 0.98, ["right"]))
    (size,) = sizes_of(found)
    assert size.values["camera"] == "right"
    assert abs(size.values["size"] - 0.98) < 2 * size.values["sd"]
    off = np.linalg.norm(found.cameras["right"].X[:3, 3] - truth["right"][:3, 3])
    assert size.severity == "caution" and off < 3 * found.cameras["right"].sizes[1]  # its noise in depth covers it


def test_a_target_of_another_size_is_named_by_noise_that_is_too_large():
    rig, _ = simulate_rig(*CELL, n_poses=15, noise=NOISE, seed=4)
    large = dict.fromkeys(NOISE, ("2mrad", "1.2mm"))
    (size,) = sizes_of(calibrate_rig(of_size(rig, 0.99, ["right"]), large))
    assert size.values["camera"] == "right"
    assert sizes_of(calibrate_rig(rig, large)) == []
    assert sizes_of(calibrate_rig(simulate_rig(*CELL, n_poses=15, seed=4)[0], large)) == []  # exact


def test_a_target_of_another_size_for_all_cameras_is_named():
    rig, _ = simulate_rig(*CELL, n_poses=15, noise=NOISE, seed=3)
    (size,) = sizes_of(calibrate_rig(of_size(rig, 0.98, ["left", "right"]), NOISE))
    assert size.values["camera"] is None
    assert abs(size.values["size"] - 0.98) < 4 * size.values["sd"]
    assert "robot-accuracy" in size.remedy


@pytest.mark.statistical
def test_sizes_are_right_beyond_chance_only():
    exact, _ = simulate_rig(*CELL, n_poses=15, seed=3)
    found = [sizes_of(calibrate_rig(with_noise(exact, NOISE, [7, k]), NOISE)) for k in range(200)]
    assert sum(map(len, found)) <= 2  # 0.2 expected
