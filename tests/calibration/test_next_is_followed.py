"""Each "Next" of the command line is followed once: it changes what it speaks of."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from fixtures.commands import MODEL, NOISE, run
from fixtures.rigs import quietly
from support import moved

import uq_handeye as uq
from uq_handeye.calibration.accuracy import DECLARE, _about_largest
from uq_handeye.calibration.contribution import Contribution
from uq_handeye.model.errors.keys import CLOCK_OFFSET, FOCAL_LENGTH, PRINCIPAL_POINT, ROBOT_SCALE, TARGET_SCALE
from uq_handeye.model.shared_errors.shared_error import DEFAULT_SD
from uq_handeye.read import write_pose_file

POSES = uq.simulate(30, noise=MODEL, seed=3)
WIDE = ("--robot-noise", "0.4deg,1mm", "--camera-noise", "2deg,10mm")


def scaled(T, factor, rows=slice(None)):
    T = T.copy()
    T[rows, :3, 3] *= factor
    return T


def shifted(T):
    T = T.copy()
    T[7, :3, 3] += 0.05
    return T


def asked(folder, *options):
    """Status, the step after "Next:", and the plain numbers of the result, NOT USABLE or not."""
    files = folder / "robot.csv", folder / "camera.csv"
    done = run("calibrate", *files, *options, "-o", folder / "out")
    text = " ".join((done.stdout + done.stderr).split())
    step = re.search(r"Next: (.*?)(?:\. |\.$|$)(?=uq-handeye|\S*$|)", text)
    file = folder / "out" / "result.json"
    plain = json.loads(file.read_text(encoding="utf-8")) if file.exists() else None
    return done.returncode, text if step is None else text[step.start() :], plain, text


def options_of(step):
    """The options that a step names, with their values; of alternatives the first."""
    found = re.findall(r"(--[a-z][a-z-]*)(?: ('[^']*'|[\w.,%-]*[\w%]))?", step.split("; or")[0])
    return [part.strip("'") for pair in found[:1] for part in pair if part]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "camera", "options", "named"),
    [
        (POSES.robot, scaled(POSES.camera, 1000.0), (), "--units camera=mm"),
        (scaled(POSES.robot, 1000.0), POSES.camera, (), "--units robot=mm"),
        (POSES.robot, np.linalg.inv(POSES.camera), (), "--camera-frame target_T_camera"),
        (np.linalg.inv(POSES.robot), POSES.camera, (), "--robot-frame gripper_T_base"),
        (POSES.robot, scaled(POSES.camera, 1000.0, [7]), (), "--exclude 7"),
    ],
)
def test_what_is_misread_is_read(tmp_path, robot, camera, options, named):
    """The option gives the X of the right files."""
    write_pose_file(tmp_path / "robot.csv", robot)
    write_pose_file(tmp_path / "camera.csv", camera)
    _, step, _, _ = asked(tmp_path, *options)
    assert named in step
    status, _, plain, text = asked(tmp_path, *options, *named.split())
    truth = quietly(POSES)
    assert status == 0 and plain["usable"], text
    assert np.linalg.norm(np.array(plain["X"])[:3, 3] - truth.X[:3, 3]) < truth.accuracy.translation


@pytest.mark.slow
def test_a_noise_that_is_wrong_is_left_out(tmp_path):
    write_pose_file(tmp_path / "robot.csv", POSES.robot)
    write_pose_file(tmp_path / "camera.csv", POSES.camera)
    _, step, before, _ = asked(tmp_path, *WIDE)
    assert step.startswith("Next: leave the noise out")
    status, after_step, after, _ = asked(tmp_path)
    assert status == 0 and "noise" not in after_step.split(".")[0]
    assert max(after["std"][3:]) < 0.2 * max(before["std"][3:])


@pytest.mark.slow
def test_more_poses_reduce_the_noise(tmp_path):
    """The poses that `plan` chooses are measured, and X is better known."""
    poses = uq.simulate(8, noise=MODEL, seed=3)
    write_pose_file(tmp_path / "robot.csv", poses.robot)
    write_pose_file(tmp_path / "camera.csv", poses.camera)
    _, step, before, _ = asked(tmp_path, *NOISE)
    assert step.startswith("Next: take more poses") and "uq-handeye plan" in step
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    assert run("plan", *files, *NOISE, "-k", "6", "-o", tmp_path / "plan").returncode == 0
    new = uq.read_pose_file(tmp_path / "plan" / "next.csv")[1]
    rng = np.random.default_rng(1)
    camera = np.linalg.inv(new @ poses.truth.X) @ poses.truth.W
    sd = np.repeat([np.radians(0.1), 5e-4], 3)
    write_pose_file(tmp_path / "robot.csv", np.concatenate([poses.robot, new]))
    write_pose_file(
        tmp_path / "camera.csv", np.concatenate([poses.camera, moved(camera, sd * rng.normal(size=(6, 6)))])
    )
    _, _, after, _ = asked(tmp_path, *NOISE)
    assert max(after["std"][3:]) < 0.8 * max(before["std"][3:])


@pytest.mark.parametrize("key", [key for key in DECLARE if key in DEFAULT_SD])
def test_what_is_to_be_declared_is_better_than_what_is_assumed(key):
    """Declared as assumed, an error would leave X as it is; the option takes the value as it stands."""
    option, value = DECLARE[key]
    result = SimpleNamespace(n_poses=100, shared=[SimpleNamespace(key=key, default=True)])
    step = _about_largest(result, SimpleNamespace(parts=[Contribution((key,), 1.0, 1.0)]))
    assert option.format(value) in step and "measure" in step
    make = {
        FOCAL_LENGTH: uq.SharedError.focal_length,
        PRINCIPAL_POINT: uq.SharedError.principal_point,
        TARGET_SCALE: uq.SharedError.target_scale,
        ROBOT_SCALE: uq.SharedError.robot_scale,
        CLOCK_OFFSET: uq.SharedError.clock_offset,
    }[key]
    assert make(value).sd[0] <= 0.5 * DEFAULT_SD[key]


@pytest.mark.slow
def test_a_size_that_was_not_declared_is(tmp_path):
    """The step names a value that holds what was found: X comes nearer to the truth by far."""
    write_pose_file(tmp_path / "robot.csv", POSES.robot)
    write_pose_file(tmp_path / "camera.csv", scaled(POSES.camera, 1.02))
    _, step, before, _ = asked(tmp_path, "--shared", "none")
    option = options_of(step)
    assert option and option[0] == "--shared"
    _, _, after, _ = asked(tmp_path, "--shared", "none", *option)
    error = [np.linalg.norm(np.array(one["X"])[:3, 3] - POSES.truth.X[:3, 3]) for one in (before, after)]
    assert error[1] < 0.6 * error[0] and after["std"] != before["std"]


@pytest.mark.slow
def test_an_outlier_is_named_by_what_shows_it(tmp_path):
    """The report that the step asks for names the pose, and without it the step is another."""
    write_pose_file(tmp_path / "robot.csv", POSES.robot)
    write_pose_file(tmp_path / "camera.csv", shifted(POSES.camera))
    _, step, _, _ = asked(tmp_path)
    assert "--report report.html" in step and "flagged" in step
    report = tmp_path / "report.html"
    asked(tmp_path, "--report", report, "--no-compare")
    assert re.search(r"pose 7\b|row 7\b|>7<", report.read_text(encoding="utf-8"))
    _, again, _, _ = asked(tmp_path, "--exclude", "7")
    assert "flagged" not in again


@pytest.mark.slow
def test_rows_that_are_shifted_are_paired_by_time(tmp_path):
    """Files with timestamps that begin at different rows."""
    write_pose_file(tmp_path / "robot.csv", POSES.robot[1:], np.arange(1.0, 30.0))
    write_pose_file(tmp_path / "camera.csv", POSES.camera[:-1], np.arange(29.0))
    _, step, _, text = asked(tmp_path, "--pair", "rows")
    assert "--pair time" in step, text
    status, _, plain, text = asked(tmp_path, "--pair", "time")
    assert status == 0 and plain["n_poses"] == 28, text


@pytest.mark.slow
def test_one_axis_gets_another(tmp_path):
    """Poses that rotate about one axis, and those that `plan` chooses beside them."""
    rng = np.random.default_rng(1)
    angle, G = rng.uniform(-1.5, 1.5, 15), np.tile(np.eye(4), (15, 1, 1))
    G[:, 0, 0], G[:, 1, 1], G[:, 0, 1], G[:, 1, 0] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
    G[:, :3, 3] = rng.uniform(-0.3, 0.3, (15, 3)) + np.array([0.5, 0, 0.5])
    X, W = POSES.truth[:2]
    sd = np.repeat([np.radians(0.1), 5e-4], 3)

    def seen(robot):
        return moved(np.linalg.inv(robot @ X) @ W, sd * rng.normal(size=(len(robot), 6)))

    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    camera = seen(G)
    write_pose_file(files[0], G)
    write_pose_file(files[1], camera)
    status, step, _, _ = asked(tmp_path)
    assert status == 6 and "uq-handeye plan" in step
    done = run("plan", *files, "-k", "4", "-o", tmp_path / "plan")
    assert done.returncode == 0, done.stderr
    new = uq.read_pose_file(tmp_path / "plan" / "next.csv")[1]
    write_pose_file(files[0], np.concatenate([G, new]))
    write_pose_file(files[1], np.concatenate([camera, seen(new)]))
    status, _, plain, text = asked(tmp_path)
    assert status == 0 and plain["usable"] and plain["answered"] == "whole", text
