"""Options of `calibrate` for rigs: for all cameras, targets and arms, or for one by its name."""

import os

import numpy as np
import pytest
from fixtures.commands import run

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.cli.values import by_names
from uq_handeye.core.geometry.se3 import difference, perturb
from uq_handeye.model.rig.selection import selected
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise
from uq_handeye.use.maintenance.update_views import update_rig

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")
NOISE = dict.fromkeys(("arm", "left", "right"), SIZE)
HAND = ({"left": "arm", "right": "arm"}, {"board": "world"})


def one_rig(n=15, seed=SEED):
    return simulate_rig(*HAND, n_poses=n, noise=NOISE, seed=seed)


def moments(rig, camera):
    return [moment for view in rig.views if view.camera == camera for moment in view.at]


def test_poses_are_left_out_of_all_views_or_of_one_camera():
    rig, _ = one_rig()
    some, found = selected(rig, exclude="3,5-6,left:9")
    assert moments(some, "right") == [0, 1, 2, 4, *range(7, 15)]
    assert moments(some, "left") == [0, 1, 2, 4, 7, 8, *range(10, 15)]
    assert found[0].values["excluded"] == [3, 5, 6]
    some, _ = selected(rig, only="right:0-5")
    assert moments(some, "right") == list(range(6)) and moments(some, "left") == list(range(15))
    with pytest.raises(uq.InputError, match="no robot pose 99"):
        selected(rig, exclude=[99])
    with pytest.raises(uq.InputError, match="leaves 0 of 15"):
        selected(rig, exclude="0-14")


def test_names_and_times_name_poses():
    rig, _ = one_rig(6)
    named = uq.Rig(
        {"arm": uq.ArmPoses(rig.arms["arm"].poses, tuple("abcdef"))},
        rig.cameras, rig.targets,
        [uq.View(view.camera, view.target, view.poses, tuple("abcdef")) for view in rig.views],
    )  # fmt: skip
    assert moments(selected(named, exclude="b,d")[0], "left") == list("acef")
    times = (10.0, 20.5, 30.0, 40.0, 50.0, 60.0)
    timed = uq.Rig(
        {"arm": uq.ArmPoses(rig.arms["arm"].poses, times, timed=True)}, rig.cameras, rig.targets,
        [uq.View(view.camera, view.target, view.poses, times) for view in rig.views],
    )  # fmt: skip
    assert moments(selected(timed, exclude="0,2")[0], "left") == [20.5, 40.0, 50.0, 60.0]


def test_values_by_names():
    assert by_names("left:1;2", ["left", "right"], "--x") == {"left": "1", "": "2"}
    assert by_names(None, [], "--x") == {}
    for text in ("lef:1", "1;2", "left:"):
        with pytest.raises(uq.InputError):
            by_names(text, ["left", "right"], "--x")


@pytest.mark.slow
def test_excluded_poses_do_not_count():
    rig, _ = one_rig()
    found = uq.calibrate(rig, noise=NOISE, exclude="0-2")
    kept = calibrate_rig(selected(rig, exclude="0-2")[0], NOISE)
    np.testing.assert_array_equal(found.poses, kept.poses)
    assert any(one.code == "calibration.excluded" for one in found.findings)


@pytest.mark.slow
def test_a_declared_error_of_one_camera_is_its_own():
    rig, _ = one_rig()
    sizes = {}
    for name, errors in (
        ("all", [uq.SharedError.focal_length(1e-5)]),
        ("left", [uq.SharedError.focal_length(1e-5).of("left")]),
        ("off", [uq.SharedError.target_scale("exact")]),
    ):
        found = calibrate_rig(rig, shared=errors)
        sizes[name] = {line["name"]: line["size"] for line in found.components}
    assert sizes["all"]["left focal length"] == sizes["all"]["right focal length"] == 1e-5
    assert sizes["left"]["left focal length"] == 1e-5 < sizes["left"]["right focal length"]
    assert "target scale" not in sizes["off"] and "board scale" not in sizes["off"]
    found = calibrate_rig(rig, sizes={"left:camera rotation": "0.7mrad", "robot translation": ("0.2mm", 1.0)})
    of = {line["name"]: line["size"] for line in found.components}
    assert of["left rotation"] == 7e-4 != of["right rotation"] and of["arm translation"] == 2e-4
    with pytest.raises(uq.InputError, match="got 'no such error'"):
        calibrate_rig(rig, sizes={"no such error": 0.1})


@pytest.mark.slow
def test_declared_errors_count_beside_given_noise_and_in_an_update(tmp_path):
    exact, _ = simulate_rig(*HAND, n_poses=15, seed=SEED)
    rig = with_noise(exact, NOISE, 4)
    first = calibrate_rig(rig, NOISE)
    found = calibrate_rig(rig, NOISE, shared=[uq.SharedError.robot_scale("1%")])
    assert (np.diag(found.covariance) >= np.diag(first.covariance) * (1 - 1e-9)).all()
    assert np.diag(found.covariance)[3:6].sum() > 1.01 * np.diag(first.covariance)[3:6].sum()
    found.save(tmp_path / "result.json")
    again = uq.load(tmp_path / "result.json")
    new = with_noise(exact, NOISE, 5)
    later = {name: uq.ArmPoses(arm.poses, tuple(range(100, 115))) for name, arm in new.arms.items()}
    views = [uq.View(view.camera, view.target, view.poses, tuple(range(100, 115))) for view in new.views]
    new = uq.Rig(later, rig.cameras, rig.targets, views)
    assert not uq.check(again, new).changed
    both = update_rig(again, new, although_changed=True)
    assert [str(key) for key in both.posterior.keys] == [str(key) for key in found.posterior.keys]


@pytest.mark.slow
def test_a_prior_that_contradicts_the_views_is_named():
    rig, truth = one_rig()
    for off, code in ((0.0, "calibration.prior_agrees"), (0.02, "calibration.prior_contradicted")):
        T = np.array(truth["board"])
        T[2, 3] += off
        covariance = np.diag([np.inf] * 5 + [1e-8])
        found = calibrate_rig(uq.Rig(rig.arms, rig.cameras, rig.targets, rig.views, {"board": (T, covariance)}), NOISE)
        assert [one.code for one in found.findings if one.code.startswith("calibration.prior")] == [code]


@pytest.mark.statistical
def test_covariances_of_the_residuals_are_those_of_the_estimates():
    exact, truth = simulate_rig(*HAND, n_poses=25, seed=3)
    errors, S = [], {"sandwich": [], "bootstrap": []}
    for k in range(15):
        rig = with_noise(exact, NOISE, [SEED, k])
        found = {kind: calibrate_rig(rig, NOISE, covariance=kind, robust=False) for kind in S}
        for kind, of in S.items():
            of.append(found[kind].covariance)
        result = found["sandwich"]
        errors.append(
            np.concatenate([difference(T, truth[n]) for n, T in zip(result.names, result.poses, strict=True)])
        )
    assert result.reference.dof is not None or result.reference.quantile(0.95) > 12.6
    for of in S.values():
        ratio = np.diag(np.mean(of, axis=0)) / np.mean(np.square(errors), axis=0)
        assert 0.6 < np.exp(np.mean(np.log(ratio))) < 1.7  # 18 numbers of 15 draws


@pytest.mark.slow
def test_options_on_the_command_line(tmp_path):
    rig, _ = one_rig()
    uq.write_pose_file(tmp_path / "robot.csv", rig.arms["arm"].poses)
    for view in rig.views:
        uq.write_pose_file(tmp_path / f"{view.camera}.csv", view.poses)
    cameras = ["calibrate", "robot.csv", "--camera", "left=left.csv", "--camera", "right=right.csv"]
    for args in (
        ["--exclude", "3,left:5-7", "--covariance", "sandwich"],
        ["--camera-noise", "left:0.5mrad,0.3mm;1mrad,0.6mm", "--robot-noise", "0.5mrad,0.3mm"],
        ["--robot-noise", "0.5mrad,0.3mm"],
        ["--target-scale-sd", "exact", "--shared", "focal length=left:0.01%", "--robot-class", "cobot"],
        ["--size", "left:camera rotation=0.5mrad", "--shared", "none"],
        ["--known", "target x = 0mm +- 1m", "--known", "left z = 50mm +- 1m"],
    ):
        found = run(*cameras, *args, cwd=tmp_path)
        assert found.returncode == 0, (args, found.stderr)
    for args, said in (
        (["--images", "*.png"], "a rig file (rig.toml) names corners"),
        (["--camera-scale", "unknown"], "need one unit"),
        (["--method", "park"], "published methods solve one A X = X B"),
        (["--shared", "focal length=lef:1%"], "none of left, right"),
        (["--prior-x", "x.yaml"], "which of left, right"),
        (["--robot-noise", "left:1mrad,1mm"], "which is none of arm"),
    ):
        refused = run(*cameras, *args, cwd=tmp_path)
        assert refused.returncode == 2 and said in refused.stderr, (args, refused.stderr)


@pytest.mark.slow
def test_an_arm_of_a_rig_by_its_joints_on_the_command_line(tmp_path):
    """Two cameras on a UR5e: joints in place of poses, the poses by inverse kinematics, points predicted at joints."""
    chain, rng = uq.Kinematics.from_name("ur5e"), np.random.default_rng(SEED)
    q = np.array([0.3, -1.4, 1.6, -1.2, -1.5, 0.2]) + 0.35 * rng.normal(size=(15, 6))
    X, W = np.eye(4), np.diag([1.0, -1.0, -1.0, 1.0])
    X[:3, 3], W[:3, 3] = (0.05, 0.0, 0.08), (0.6, 0.2, -0.1)
    robot = chain.poses(q)
    seen = np.linalg.inv(robot @ X) @ W
    for name in ("left", "right"):
        uq.write_pose_file(tmp_path / f"{name}.csv", perturb(seen, 3e-4 * rng.normal(size=(15, 6))))
    uq.write_pose_file(tmp_path / "robot.csv", robot)
    head = ",".join(["timestamp", *chain.names])
    rows = [",".join(map(str, [float(k), *row])) for k, row in enumerate(q.tolist())]
    (tmp_path / "joints.csv").write_text("\n".join([head, *rows, ""]))
    cameras = ["--camera", "left=left.csv", "--camera", "right=right.csv", "--robot-model", "ur5e"]
    for args in (["--joints", "joints.csv", "-o", "out"], ["robot.csv", "--kinematics", "declared"]):
        found = run("calibrate", *args, *cameras, cwd=tmp_path)
        assert found.returncode == 0, found.stderr
    result = uq.load(tmp_path / "out" / "result.json")
    assert (np.abs(difference(result.cameras["left"].pose, X)) < 5 * result.cameras["left"].std).all()
    assert result.rig.arms["arm"].kinematics is not None
    found = run(
        "predict", "out/result.json", "--of", "left", "--point", "0,0,0.3", "--joints", "joints.csv", cwd=tmp_path
    )
    assert found.returncode == 0, found.stderr
