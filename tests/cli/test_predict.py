"""``uq-handeye predict``: numbers are those of the result, in text, JSON and CSV; what is refused."""

import csv
import json

import numpy as np
import pytest
from fixtures.arms import SIX_AXES
from fixtures.commands import MODEL, run
from support import SEED, moved, random_transforms

import uq_handeye as uq
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.read import write_pose_file

ARM = Kinematics.from_urdf(SIX_AXES)


def write_joints(file, q, names=ARM.names):
    file.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in q.tolist())]) + "\n")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """arm.json of a calibration with joints, plain.json of one without, next.csv and robot.csv to predict at."""
    folder = tmp_path_factory.mktemp("predict")
    rng = np.random.default_rng([SEED, 20])
    q = rng.uniform(-1.0, 1.0, (12, 6))
    X, W = random_transforms(rng), random_transforms(rng)
    camera = moved(np.linalg.inv(ARM.poses(q) @ X) @ W, rng.normal(size=(12, 6)) * np.repeat([5e-4, 3e-4], 3))
    poses = uq.PosePairs(ARM.poses(q), camera, joints=q)
    errors = uq.KinematicErrors("declared", 1e-3, 5e-4, 3e-4, joint_sd=1e-4)
    noise = uq.PoseNoise.isotropic(None, (5e-4, 3e-4))
    result = uq.calibrate(poses, noise=noise, shared=[], kinematics=ARM, kinematic_errors=errors)
    result.to_json(folder / "arm.json")
    plain = uq.simulate(12, noise=MODEL, seed=3)
    without = uq.calibrate(plain, noise=MODEL)
    without.to_json(folder / "plain.json")
    ahead = rng.uniform(-1.0, 1.0, (3, 6))
    write_joints(folder / "next.csv", ahead)
    write_joints(folder / "degrees.csv", np.degrees(ahead))
    write_pose_file(folder / "robot.csv", plain.robot[:2], [10.0, 20.0])
    return folder, result, without, ahead, plain.robot[:2]


def predicted(folder, *arguments):
    done = run("predict", *arguments, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def table(file):
    with file.open(newline="") as opened:
        head, *rows = csv.reader(opened)
    return head, np.array(rows, dtype=float)


@pytest.mark.slow
def test_points_at_joints(stored):
    folder, result, _, ahead, _ = stored
    points = ("--point", "0mm,10mm,300mm", "--point", "0,0,0.5")
    found = json.loads(predicted(folder, "arm.json", "--joints", "next.csv", *points, "--json", "-o", "points"))
    same = result.predict([[0, 0.01, 0.3], [0, 0, 0.5]], joints=ahead[:, None])
    np.testing.assert_allclose(found["points"], same.points, rtol=1e-12)
    np.testing.assert_allclose(found["covariance"], same.covariance, rtol=1e-9)
    assert found["frame"] == "base" and found["timestamps"] == [0.0, 1.0, 2.0]
    head, rows = table(folder / "points" / "predictions.csv")
    assert head[:9] == ["timestamp", "point", "x", "y", "z", "sd_x", "sd_y", "sd_z", "radius_95"]
    assert rows[:, :2].tolist() == [[0, 0], [0, 1], [1, 0], [1, 1], [2, 0], [2, 1]]
    np.testing.assert_allclose(rows[:, 2:5], same.points.reshape(6, 3), rtol=1e-12)
    np.testing.assert_allclose(rows[:, head.index("cov_y_z")], same.covariance.reshape(6, 3, 3)[:, 1, 2], rtol=1e-9)
    text = predicted(folder, "arm.json", "--joints", "degrees.csv", "--joint-units", "deg", *points)
    assert "Points in the frame base: 2 at 3 robot poses" in text
    assert f"{1e3 * same.points[0, 0, 0]:.3f}" in text and f"{1e3 * same.radius_95.max():.3g} mm" in text


@pytest.mark.slow
@pytest.mark.parametrize("noise", [(), ("--no-noise",)])
def test_what_the_camera_should_see(stored, noise):
    folder, result, _, ahead, _ = stored
    arguments = ("arm.json", "--joints", "next.csv", "--camera", *noise)
    found = json.loads(predicted(folder, *arguments, "--json", "-o", "seen"))
    same = result.predict_camera(joints=ahead, new_measurement=not noise)
    np.testing.assert_allclose(found["poses"], same.poses, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["covariance"], same.covariance, rtol=1e-9, atol=1e-18)
    assert found["new_measurement"] == (not noise)
    head, rows = table(folder / "seen" / "predictions.csv")
    np.testing.assert_allclose(rows[:, 1:4], same.poses[:, :3, 3], rtol=1e-12)
    np.testing.assert_allclose(rows[:, head.index("sd_tau_z")], same.std[:, 5], rtol=1e-9)
    assert len(head) == rows.shape[1] == 8 + 6 + 21
    assert ("without noise of measurement" in predicted(folder, *arguments)) == bool(noise)


@pytest.mark.slow
def test_at_robot_poses_where_no_joints_are_known(stored):
    folder, _, without, _, robot = stored
    found = json.loads(predicted(folder, "plain.json", "--robot", "robot.csv", "--camera", "--json"))
    np.testing.assert_allclose(found["covariance"], without.predict_camera(robot=robot).covariance, rtol=1e-9)
    assert found["timestamps"] == [10.0, 20.0]
    scaled = robot.copy()
    scaled[:, :3, 3] *= 1e3
    write_pose_file(folder / "mm.csv", scaled)
    arguments = ("plain.json", "--robot", "mm.csv", "--units", "mm", "--point", "0mm,0mm,100mm", "--json")
    again = json.loads(predicted(folder, *arguments))
    expected = without.predict([[0, 0, 0.1]], robot=robot[:, None])
    np.testing.assert_allclose(again["points"], expected.points, rtol=1e-9)


@pytest.mark.slow
def test_beside_poses_of_the_controller(stored):
    folder, result, _, ahead, _ = stored
    robot = ARM.poses(ahead)
    write_pose_file(folder / "own.csv", robot)
    arguments = ("arm.json", "--joints", "next.csv", "--robot", "own.csv", "--point", "0mm,0mm,300mm")
    found = json.loads(predicted(folder, *arguments, "--json"))
    same = result.predict([[0, 0, 0.3]], joints=ahead[:, None], robot=robot[:, None])
    np.testing.assert_allclose(found["points"], same.points, rtol=1e-9)
    np.testing.assert_allclose(found["covariance"], same.covariance, rtol=1e-9)


@pytest.mark.slow
def test_how_far_the_tool_misses(stored):
    folder, result, _, ahead, _ = stored
    write_joints(folder / "there.csv", ahead + 0.1)
    arguments = ("arm.json", "--joints", "next.csv", "--reached-at", "there.csv", "--point", "0mm,0mm,300mm")
    found = json.loads(predicted(folder, *arguments, "--tool", "0,0,150mm", "--json"))
    there = (ahead + 0.1)[:, None]
    same = result.predict([[0, 0, 0.3]], joints=ahead[:, None], reached_at=there, tool=[0, 0, 0.15])
    np.testing.assert_allclose(found["points"], same.points, rtol=1e-9)
    np.testing.assert_allclose(found["covariance"], same.covariance, rtol=1e-9)
    assert "Tip of the tool minus the point, in the frame base: 1 at 3 robot poses" in predicted(folder, *arguments)


@pytest.mark.slow
def test_long_tables_are_cut_in_text_alone(stored):
    folder, _, _, ahead, _ = stored
    write_joints(folder / "many.csv", np.tile(ahead, (20, 1)))
    text = predicted(folder, "arm.json", "--joints", "many.csv", "--camera", "-o", "many_seen")
    assert "20 more rows: -o DIR or --json has all." in text
    assert text.endswith("\n\nWrote predictions.csv and predictions.json to many_seen\n")
    assert len(table(folder / "many_seen" / "predictions.csv")[1]) == 60
    assert len(json.loads((folder / "many_seen" / "predictions.json").read_text())["poses"]) == 60


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("arm.json", "--joints", "next.csv"), "Give either --point X,Y,Z"),
        (("arm.json", "--joints", "next.csv", "--camera", "--point", "0,0,1"), "Give either --point"),
        (("arm.json", "--camera"), "No robot poses to predict at. Give --joints"),
        (("arm.json", "--joints", "next.csv", "--point", "0,0"), "--point to be X,Y,Z"),
        (("arm.json", "--joints", "next.csv", "--point", "0,0,300"), "Write the unit, e.g. 0mm,0mm,300mm"),
        (("arm.json", "--joints", "next.csv", "--point", "0,0,nan"), "--point"),
        (("arm.json", "--joints", "next.csv", "--point", "a,0,0"), "--point"),
        (("arm.json", "--joints", "next.csv", "--point", "0,0,1", "--no-noise"), "--no-noise needs --camera"),
        (("arm.json", "--robot", "robot.csv", "--joint-units", "deg", "--camera"), "--joint-units needs --joints"),
        (("arm.json", "--joints", "next.csv", "--units", "mm", "--camera"), "--units needs --robot"),
        (
            ("arm.json", "--joints", "next.csv", "--robot", "robot.csv", "--camera"),
            "next.csv has 3 and robot.csv has 2 rows",
        ),
        (("arm.json", "--joints", "next.csv", "--point", "0,0,1", "--tool", "0,0,1"), "--tool needs --reached-at"),
        (
            ("arm.json", "--joints", "next.csv", "--camera", "--reached-at", "next.csv"),
            "--reached-at needs --point",
        ),
        (("plain.json", "--joints", "next.csv", "--camera"), "plain.json holds no joints. Give --robot"),
        (("arm.json", "--joints", "degrees.csv", "--camera"), "Give --joint-units deg"),
        (("arm.json", "--joints", "missing.csv", "--camera"), "missing.csv"),
        (("missing.json", "--joints", "next.csv", "--camera"), "missing.json"),
    ],
)
def test_refusals_in_one_line(stored, arguments, words):
    done = run("predict", *arguments, cwd=stored[0])
    assert done.returncode == 2 and done.stdout == ""
    assert words in done.stderr and done.stderr.count("\n") == 1, done.stderr


def test_points_of_a_fixed_camera_need_no_robot_poses(tmp_path):
    poses = uq.simulate(12, noise=MODEL, setup="eye-to-hand", seed=3)
    result = uq.calibrate(poses, noise=MODEL)
    result.to_json(tmp_path / "result.json")
    text = predicted(tmp_path, "result.json", "--point", "0,0,0.5", "--point", "0,0.1,0.4", "-o", "out")
    assert "2 at 1 robot pose" in text
    points = np.array([[0, 0, 0.5], [0, 0.1, 0.4]]) @ result.R.T + result.t
    head, rows = table(tmp_path / "out" / "predictions.csv")
    np.testing.assert_allclose(rows[:, [head.index(axis) for axis in "xyz"]], points, atol=1e-9)
