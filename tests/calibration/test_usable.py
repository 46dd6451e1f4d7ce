"""A refuted result is not usable, what the data cannot test is not run, and commands refuse what is not usable."""

import dataclasses

import numpy as np
import pytest

import uq_handeye as uq
from studies.one_model.moves import stepped
from studies.one_model.usable import NOISE, drawn, drawn_rig
from uq_handeye.cli.app import main
from uq_handeye.trials.simulation.several_cameras import simulate_rig

pytestmark = pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
VIEW = ("1mrad", "0.5mm")


def with_target_of_other_size(n, factor):
    drawn = uq.simulate(n, noise=NOISE, seed=3)
    camera = drawn.camera.copy()
    camera[:, :3, 3] *= factor
    return uq.PosePairs(drawn.robot, camera)


@pytest.mark.slow
def test_a_declared_size_that_the_residuals_refute_is_not_usable():
    declared = [uq.SharedError.target_scale(1e-4)]
    wrong = uq.calibrate(with_target_of_other_size(25, 1.01), noise=NOISE, shared=declared)
    assert not wrong.usable and any("target scale" in reason for reason in wrong.reasons)
    assert uq.calibrate(with_target_of_other_size(25, 1.0), noise=NOISE, shared=declared).usable


def test_three_poses_do_not_test_the_files():
    status = {n: uq.calibrate(with_target_of_other_size(n, 1.0), noise=NOISE).checks[0].status for n in (3, 8)}
    assert status == {3: "not run", 8: "ok"}


@pytest.mark.slow
def test_three_poses_do_not_test_the_errors_that_are_assumed():
    """Their noise is estimated, and takes whatever these errors leave."""
    for n, expected in ((3, "not run"), (8, "ok")):
        checks = {one.name: one.status for one in uq.calibrate(with_target_of_other_size(n, 1.0)).checks}
        assert checks["shared errors"] == expected


@pytest.mark.parametrize(("kept", "severity"), [(8, "caution"), (5, "failure")])
def test_few_poses_against_most_of_the_others_prove_nothing(kept, severity):
    table = uq.calibrate(uq.simulate(20, noise=NOISE, seed=3), noise=NOISE).table
    flags = ("kept",) * kept + ("rejected",) * (20 - kept)
    (found,) = dataclasses.replace(table, flag=flags).findings
    assert found.code == "diagnostics.flagged" and found.severity == severity


@pytest.mark.slow
def test_a_camera_of_which_few_views_are_left_is_named():
    rig, _ = simulate_rig({"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=12, noise=None, seed=1)
    result = uq.calibrate(rig, noise=dict.fromkeys(("arm", "left", "right"), VIEW))
    assert result.usable
    weights = np.ones(24)
    weights[12:19] = 0.0  # of the right camera 5 of 12 are left
    few = dataclasses.replace(result, weights=weights)
    assert not few.usable and few.reasons == ("7 of 12 views of board by right contradict the others",)


@pytest.mark.slow
def test_commands_refuse_a_result_that_is_not_usable(tmp_path, capsys):
    declared = [uq.SharedError.target_scale(1e-4)]
    wrong = uq.calibrate(with_target_of_other_size(25, 1.01), noise=NOISE, shared=declared)
    file, robot = str(wrong.save(tmp_path / "result.json")), str(tmp_path / "robot.csv")
    camera = str(tmp_path / "camera.csv")
    new = uq.simulate(6, noise=NOISE, seed=4)
    uq.write_pose_file(robot, new.robot)
    uq.write_pose_file(camera, new.camera)
    for command in (
        ["check", file, robot, camera],
        ["diff", file, file],
        ["predict", file, "--robot", robot, "--camera"],
        ["export", file, str(tmp_path / "x.urdf")],
        ["plan", file, "-k", "1"],
    ):
        with pytest.raises(SystemExit) as ended:
            main(command)
        assert ended.value.code == 3 and wrong.reasons[0] in capsys.readouterr().err, command


@pytest.mark.slow
def test_nothing_is_planned_from_poses_that_contradict_each_other(tmp_path, capsys):
    poses = stepped([7, 3], "target", 3e-3, 0.0)
    files = [str(tmp_path / f"{name}.csv") for name in ("robot", "camera")]
    for file, T in zip(files, (poses.robot, poses.camera), strict=True):
        uq.write_pose_file(file, T)
    with pytest.raises(SystemExit) as ended:
        main(["plan", *files, "-k", "1"])
    said = capsys.readouterr()
    assert ended.value.code == 3 and "nothing was planned: the target moved from pose 1" in said.err and not said.out
    found = uq.plan(poses, k=1, sample=20)
    assert found.to_text().startswith("NOT USABLE: the target moved from pose 1") and found.contradictions
    right = uq.plan(with_target_of_other_size(12, 1.0), k=1, sample=20)
    assert not right.contradictions and right.to_text().startswith("1 more pose would bring")


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["noise too small", "wrong target size"])
def test_a_rig_whose_residuals_refute_the_noise_is_not_usable(kind):
    for k in range(2):
        rig, options, _ = drawn_rig(kind, 40 + k)
        result = uq.calibrate(rig, **options)
        assert not result.usable
        if kind == "noise too small":
            assert "times larger than this noise" in result.reasons[0] and uq.calibrate(rig).usable


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("kind", ["noise too small", "wrong target size"])
def test_data_that_contradict_what_was_given_are_not_usable(kind):
    """Noise a third of the true one, and a target that is 1 % off and declared exact."""
    for k in range(3):
        poses, options, _ = drawn(kind, 40 + k)
        result = uq.calibrate(poses, **options)
        assert not result.usable and result.headline.startswith("NOT USABLE")
        right = {"noise": NOISE, "shared": []} if kind == "noise too small" else {}
        assert uq.calibrate(poses, **right).usable
