"""One camera of a rig as the result of one camera: marginal posterior, predictions, commands."""

import os

import numpy as np
import pytest
from fixtures.commands import run

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.calibration.prediction.noise_of_views import new_noise
from uq_handeye.calibration.prediction.predict import shared_effects
from uq_handeye.core.geometry.se3 import difference
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.trials.simulation.several_cameras import simulate_rig

SEED = int(os.environ.get("UQ_HANDEYE_SEED", "0"))
SIZE = ("0.5mrad", "0.3mm")


def one_rig(cameras, targets, arms=("arm",), given=True, n=20):
    names = (*arms, *cameras)
    noise = dict.fromkeys(names, SIZE)
    rig, truth = simulate_rig(cameras, targets, arms=arms, n_poses=n, noise=noise, seed=SEED)
    return rig, truth, calibrate_rig(rig, noise if given else None)


@pytest.mark.slow
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("place", ["arm", "world"])
def test_points_are_predicted_as_by_the_rig(place, given):
    other = "world" if place == "arm" else "arm"
    rig, _, result = one_rig({"left": place, "right": place}, {"board": other}, given=given)
    points, robot = np.array([[0.05, 0.02, 0.6]]), rig.arms["arm"].poses[:3]
    for name in rig.cameras:
        one = uq.of_camera(result, name)
        mine, theirs = one.predict(points, robot=robot[:, None]), result.predict(name, points, {"arm": robot})
        np.testing.assert_allclose(mine.points[: len(theirs.points)], theirs.points, atol=1e-12)
        np.testing.assert_allclose(mine.std[: len(theirs.points)], theirs.std, rtol=5e-3)


def test_covariance_is_that_of_the_rig():
    _, truth, result = one_rig({"left": "arm", "right": "arm"}, {"board": "world"})
    one = uq.of_camera(result, "left", "board")
    assert (one.setup, one.n_poses, one.names) == ("eye-in-hand", 20, ("arm", "left", "board"))
    np.testing.assert_allclose(one.covariance, result.cameras["left"].covariance, rtol=1e-9, atol=1e-18)
    np.testing.assert_allclose(one.covariance_W, result.targets["board"].covariance, rtol=1e-9, atol=1e-18)
    assert np.abs(difference(one.X, truth["left"]) / one.std).max() < 5


@pytest.mark.slow
def test_frames_of_an_arm_whose_base_is_estimated():
    """A target in the world is stated in the base of the arm that carries the camera."""
    rig, truth, result = one_rig({"a": "world", "b": "two"}, {"t": "one", "u": "world"}, ("one", "two"), n=10)
    one = uq.of_camera(result, "b", "u")
    W = np.linalg.inv(truth["two"]) @ truth["u"]
    assert one.setup == "eye-in-hand" and np.abs(difference(one.W, W) / one.std_W).max() < 5
    np.testing.assert_allclose(one.covariance_W, result.relative("two", "u").covariance, atol=1e-18)
    assert rig.cameras["a"] == "world"
    with pytest.raises(uq.InputError, match="two robot poses"):
        uq.of_camera(result, "b", "t")
    with pytest.raises(uq.InputError, match="no arm moves them"):
        uq.of_camera(result, "a", "u")
    with pytest.raises(uq.InputError, match="Expected a camera out of a, b"):
        uq.of_camera(result, "c")


@pytest.mark.slow
def test_shared_errors_have_the_effects_of_the_rig():
    rig, _, result = one_rig({"left": "arm"}, {"board": "world"}, given=False)
    one = uq.of_camera(result, "left")
    noise = new_noise(result, rig, Graph.of(rig))
    for side, K in (("robot", noise.K_robot), ("camera", noise.K_camera)):
        F = shared_effects(one, side, one.data.robot, one.data.camera)
        for k, error in enumerate(one.shared_at_sizes):
            if error.side == side and error.key.kind not in ("lens distortion",):  # shares of one size
                place = [key.of("") for key in result.posterior.keys].index(error.key)
                np.testing.assert_allclose(F[..., k] * error.size, K[..., place], atol=1e-9)


@pytest.mark.slow
def test_commands_take_one_camera_of_a_rig(tmp_path):
    noise = dict.fromkeys(("arm", "left", "right"), SIZE)
    files = []
    for k in range(2):
        rig, _ = simulate_rig(
            {"left": "arm", "right": "arm"}, {"board": "world"}, n_poses=15, noise=noise, seed=SEED + k
        )
        files.append(tmp_path / f"{k}.json")
        calibrate_rig(rig, noise).save(files[-1])
    file, other = map(str, files)
    uq.write_pose_file(tmp_path / "robot.csv", rig.arms["arm"].poses)
    robot = str(tmp_path / "robot.csv")
    left = ["--camera", "left"]
    for args in (
        ["predict", file, "--of", "left", "--camera", "--robot", robot],
        ["predict", file, "--of", "left", "--into", "right", "--point", "0,0,0.3"],
        ["diff", file, other, *left],
        ["plan", file, *left, "-k", "1"],
        ["compare", file, *left, "--methods", "park,4dpa"],
        ["validate", file, *left, "--trials", "50", "--workers", "1"],
        ["posterior", file, *left, "--samples", "100", "--walkers", "16", "--max-steps", "2000"],
    ):
        assert run(*args).returncode == 0, args
    refused = run("verify", file, robot)
    assert refused.returncode == 2 and "Choose one: --camera left" in refused.stderr
    refused = run("validate", file, *left, "--robot-noise", "1mrad,1mm")
    assert "--robot-noise: a stored result has its poses and noise" in refused.stderr
