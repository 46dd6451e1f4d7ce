"""A target or camera that moves in the middle of a session is named with one camera, and no arm is taken for a move."""

import os
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import binom

import uq_handeye as uq
from studies.one_model.chains import ARMS
from studies.one_model.rigs import SETUPS, SPREADS, arm_set
from uq_handeye.cli.app import main

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
NOISE = uq.PoseNoise.isotropic(robot=("0.01deg", "0.03mm"), camera=("0.05deg", "0.3mm"))


def stepped(seed, what, shift, angle, n=25, setup="eye-in-hand", since=12):
    """Poses of which the target or the camera is elsewhere from one on, in a random direction."""
    drawn = uq.simulate(n_poses=n, noise=NOISE, seed=seed, setup=setup)
    axis, along = Rotation.random(2, random_state=seed[1]).as_matrix()[:, :, 0]
    D, camera = np.eye(4), drawn.camera.copy()
    D[:3, :3], D[:3, 3] = Rotation.from_rotvec(angle * axis).as_matrix(), shift * along
    camera[since:] = camera[since:] @ D if what == "target" else np.linalg.inv(D) @ camera[since:]
    return uq.PosePairs(drawn.robot, camera, setup)


def moves(poses):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(poses)
    return result, [one for one in result.findings if one.code == "rig.moved"]


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_board_moved_by_20_mm_is_not_usable_and_its_pose_is_in_the_numbers_of_the_data():
    poses = stepped([SEED, 1], "target", 20e-3, 0.0)
    result, (finding,) = moves(poses)
    assert not result.usable and "the target moved from pose 12 on, by " in result.headline
    assert finding.values["shift"] == pytest.approx(20e-3, rel=0.1)
    (later,) = (one for one in uq.calibrate(poses, exclude="0-2").findings if one.code == "rig.moved")
    assert later.values["since"] == 12
    order = np.random.default_rng(SEED).permutation(25)  # rows of a file in another order, with times
    shuffled = uq.PosePairs(poses.robot[order], poses.camera[order], poses.setup, order * 2.0 + 1.0)
    _, (finding,) = moves(shuffled)
    assert order[finding.values["since"]] == 12


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("what", ["target", "camera"])
def test_the_poses_before_and_after_a_move_are_fitted_as_two_and_exported(what, tmp_path):
    poses = stepped([SEED, 3], what, 20e-3, 0.0)
    result = uq.calibrate(poses, exclude="0")
    other = {"target": "camera", "camera": "target"}[what]
    split = {one.name: one for one in result.split}
    assert list(split) == [name for name in ("camera", "target") for name in (name, f"{name}@12") if name in split]
    assert set(split) == {other, what, f"{what}@12"}
    (finding,) = (one for one in result.findings if one.code == "rig.moved")
    moved = split[f"{what}@12"].pose[:3, 3] - split[what].pose[:3, 3]
    assert np.linalg.norm(moved) == pytest.approx(20e-3, abs=4 * finding.values["shift_sd"])
    drawn = uq.simulate(
        n_poses=25, noise=NOISE, seed=[SEED, 3]
    )  # the camera before the move, within 5 standard deviations
    assert (np.abs(split["camera"].pose[:3, 3] - drawn.truth.X[:3, 3]) < 5 * split["camera"].std[3:]).all()
    again = uq.load(result.save(tmp_path / "result.json"))
    assert [one.to_dict() for one in again.split] == [one.to_dict() for one in result.split]
    chosen = list(split)[0 if what == "target" else 1]
    command = ["export", str(tmp_path / "result.json"), str(tmp_path / "x.npz"), "--camera", chosen]
    with pytest.raises(SystemExit, match="0"):
        main(command)
    np.testing.assert_allclose(np.load(tmp_path / "x.npz")["X"], split[chosen].pose, atol=1e-12)
    with pytest.raises(SystemExit, match="2"):
        main([*command[:-1], "other"])


@pytest.mark.statistical
@pytest.mark.parametrize("what", ["target", "camera"])
@pytest.mark.parametrize(("shift", "angle"), [(3e-3, 0.0), (0.0, np.radians(0.3))])
def test_a_move_of_3_mm_or_a_third_of_a_degree_is_named(what, shift, angle):
    right, trials = 0, 50
    for k in range(trials):
        _, found = moves(stepped([SEED, k], what, shift, angle, setup=SETUPS[k % 2]))
        right += bool(found) and abs(found[0].values["since"] - 12) <= 2
    assert right >= binom.ppf(1e-3, trials, 0.98)


@pytest.mark.statistical
@pytest.mark.parametrize("accuracy", [0.0, 0.6e-3, 2e-3])
def test_errors_of_an_arm_are_no_move(accuracy):
    """Poses without and with times; at most 1 % of the sets."""
    alarms, trials = 0, 24
    for k in range(trials):
        rng = np.random.default_rng([SEED, k, int(1e5 * accuracy)])
        name, spread = list(ARMS)[k % 4], list(SPREADS)[k % len(SPREADS)]
        drawn = arm_set(name, accuracy, rng, n=(8, 15, 30, 60)[k % 4], setup=SETUPS[k % 2], spread=spread).poses
        times = None if k % 3 else np.arange(drawn.n) * 7.3 + 0.5
        alarms += bool(moves(uq.PosePairs(drawn.robot, drawn.camera, drawn.setup, times))[1])
    assert alarms <= binom.ppf(1 - 1e-3, trials, 0.01)
