"""A target or camera that moves in the middle of a session is named with one camera, and no arm is taken for a move."""

import os
import warnings
from html import escape

import numpy as np
import pytest
from scipy.stats import binom

import uq_handeye as uq
from studies.one_model.chains import ARMS
from studies.one_model.moves import NOISE, drifting, stepped
from studies.one_model.rigs import SETUPS, SPREADS, arm_set
from uq_handeye.cli.app import main
from uq_handeye.read import write_pose_file
from uq_handeye.report.page import report_html

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))


def moves(poses):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(poses)
    return result, [one for one in result.findings if one.code in ("rig.moved", "rig.drifts")]


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


@pytest.mark.slow
@pytest.mark.parametrize("what", ["target", "camera"])
@pytest.mark.parametrize("setup", SETUPS)
def test_an_even_drift_is_no_step_and_has_its_size(what, setup):
    result, (finding,) = moves(drifting([SEED, 5], what, 10e-3, 0.0, setup=setup))
    values = finding.values
    assert (finding.code, values["name"]) == ("rig.drifts", what)
    assert values["shift"] == pytest.approx(10e-3, abs=5 * values["shift_sd"]) and values["shift_sd"] < 2e-3
    assert not result.usable and not result.split
    assert f"the {what} drifts by " in result.headline and "from the first pose to the last" in result.headline


@pytest.mark.slow
def test_report_and_texts_have_both_poses_of_what_moved():
    result, (finding,) = moves(stepped([SEED, 6], "target", 20e-3, 0.0))
    texts = (result.summary(), result.summary(verbose=True), result._repr_html_(), report_html(result))
    assert all("base_T_target@12" in text and "before and after the move" in text for text in texts)
    assert all(f"{1e3 * result.split[-1].pose[0, 3]:.2f}" in text for text in texts)
    assert escape(str(finding)) in report_html(result, folded=False)


@pytest.mark.slow
@pytest.mark.parametrize("since", [15, 18])
def test_update_names_the_pose_from_which_the_target_moved(since, tmp_path, capsys):
    poses = stepped([SEED, 4], "target", 10e-3, 0.0, since=since)
    uq.calibrate(poses.rows(np.arange(15))).to_json(tmp_path / "result.json")
    files = [str(tmp_path / f"{name}.csv") for name in ("robot", "camera")]
    for file, side in zip(files, (poses.robot, poses.camera), strict=True):
        write_pose_file(file, side[15:])
    with pytest.raises(SystemExit, match="3"):
        main(["update", str(tmp_path / "result.json"), *files])
    assert f"NOT USABLE: the target moved from pose {since} on" in capsys.readouterr().out


@pytest.mark.statistical
@pytest.mark.parametrize("what", ["target", "camera"])
@pytest.mark.parametrize(("shift", "angle"), [(3e-3, 0.0), (0.0, np.radians(0.3))])
def test_a_move_of_3_mm_or_a_third_of_a_degree_is_named(what, shift, angle):
    right, trials = 0, 50
    for k in range(trials):
        _, found = moves(stepped([SEED, k], what, shift, angle, setup=SETUPS[k % 2]))
        right += bool(found) and abs(found[0].values.get("since", -9) - 12) <= 2
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
