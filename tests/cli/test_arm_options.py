"""Joints and a chain on the command line: what the arguments mean, numbers, and what is refused."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from fixtures.arms import SIX_AXES, mjcf_of, motion
from fixtures.commands import run
from scipy import stats
from support import CONFIDENCE, SEED, difference, moved, random_transforms

import uq_handeye as uq
from uq_handeye.cli import arm as arm_options
from uq_handeye.cli import names as cli_names
from uq_handeye.model.errors.sizes import CLASSES
from uq_handeye.model.kinematics import kinematic_errors
from uq_handeye.model.kinematics.chain import Kinematics
from uq_handeye.model.kinematics.workspace_gauge import aligned_poses
from uq_handeye.read import write_pose_file

ARM = Kinematics.from_urdf(SIX_AXES)
TOOL = motion((0.0, 0.0, 0.8), (0.0, 0.0, 0.1))
# Deviations (rad, m) of the arm and of the camera.
SIZES = ("--size", "joint offsets=1mrad", "--size", "joint tilts=0.5mrad", "--size", "link lengths=0.3mm")
DECLARED = ("--kinematics", "declared", *SIZES)
NOISES = (
    "--size",
    "joint noise=0.1mrad",
    "--robot-noise",
    "exact",
    "--camera-noise",
    "0.5mrad,0.3mm",
    "--shared",
    "none",
)
GIVEN = (*DECLARED, *NOISES)
CHAIN = ("--joints", "joints.csv", "--urdf", "arm.urdf")
FAR = stats.chi2.ppf(CONFIDENCE, 6)


def write_joints(file, q, names=ARM.names, times=None):
    head = list(names) if times is None else ["timestamp", *names]
    rows = q.tolist() if times is None else np.column_stack([times, q]).tolist()
    file.write_text("\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows)]) + "\n")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """Files of an arm with errors: joints, camera, the controller's poses at a tool; X in the chain's flange."""
    folder = tmp_path_factory.mktemp("arm")
    rng = np.random.default_rng([SEED, 19])
    q = rng.uniform([-1, -0.7, -1, -1, -0.5, -1], [1, 1.3, 1, 1, 1.5, 1], (16, 6))
    of = {"joint offsets": 1e-3, "joint tilts": 5e-4, "link lengths": 3e-4}
    e = rng.normal(size=len(ARM.errors)) * [0.0 if error.gauge else of.get(error.group, 0.0) for error in ARM.errors]
    X, W = motion((0.2, -0.1, 0.4), (0.05, 0.02, 0.08)), random_transforms(rng)
    true = ARM.poses(q + 1e-4 * rng.normal(size=q.shape), e)
    camera = moved(np.linalg.inv(true @ X) @ W, rng.normal(size=(16, 6)) * np.repeat([5e-4, 3e-4], 3))
    (folder / "arm.urdf").write_text(SIX_AXES)
    write_joints(folder / "joints.csv", q)
    write_joints(folder / "degrees.csv", np.degrees(q))
    write_joints(folder / "timed.csv", q, times=np.arange(16.0))
    write_pose_file(folder / "camera.csv", camera)
    write_pose_file(folder / "robot.csv", ARM.poses(q) @ TOOL)
    write_pose_file(folder / "some.csv", camera[[2, 3, 5, 7, 11, 13, 1]], [2, 3, 5, 7, 11, 13, 1])
    return folder, X, q


def found_in(folder, *arguments, command="calibrate"):
    done = run(command, *arguments, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def refusal(folder, *arguments, command="calibrate"):
    done = run(command, *arguments, cwd=folder)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    return done.stderr


def close(found, X):
    xi = difference(X, np.array(found["X"]))
    return xi @ np.linalg.solve(np.array(found["covariance"]), xi)


def test_names_are_those_of_the_package():
    of_package = (kinematic_errors.HOW, tuple(kinematic_errors.POPULATIONS), kinematic_errors.FLANGES)
    assert of_package == (arm_options.HOW, cli_names.ROBOT_CLASSES, arm_options.FLANGES)
    assert (Kinematics.arm_names(), tuple(CLASSES)) == (arm_options.ROBOT_MODELS, cli_names.ACCURACY_CLASSES)


# ------------------------------------------------------------------------------------------------------------ numbers


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target is ahead")  # it is anywhere
def test_a_single_file_beside_joints_is_that_of_the_camera(cell):
    folder, X, _ = cell
    found = found_in(folder, "camera.csv", *CHAIN, *GIVEN)
    assert close(found, X) < FAR
    camera = uq.read_poses(None, folder / "camera.csv", joints=folder / "joints.csv", kinematics=ARM)
    errors = uq.KinematicErrors("declared", 1e-3, 5e-4, 3e-4, joint_sd=1e-4)
    noise = uq.PoseNoise.isotropic(None, (5e-4, 3e-4))
    same = uq.calibrate(camera, noise=noise, shared=[], kinematics=ARM, kinematic_errors=errors)
    np.testing.assert_allclose(found["covariance"], same.covariance, rtol=1e-9)
    assert [source["name"] for source in found["provenance"]["sources"]] == ["joints.csv", "camera.csv"]
    exact = found_in(folder, "camera.csv", *CHAIN, "--kinematics", "exact", *NOISES[2:])
    assert np.trace(np.array(exact["covariance"])) < 0.5 * np.trace(np.array(found["covariance"]))


@pytest.mark.slow
@pytest.mark.parametrize(
    "files",
    [("robot.csv", "camera.csv"), ("camera.csv", "--robot", "robot.csv")],
    ids=["both files", "--robot"],
)
def test_poses_of_the_controller_and_joints_beside(cell, files):
    """The tool of the controller is found, named in the summary, and X belongs to it."""
    folder, X, _ = cell
    found = found_in(folder, *files, *CHAIN, *GIVEN)
    assert close(found, np.linalg.inv(TOOL) @ X) < FAR
    text = run("calibrate", *files, *CHAIN, *GIVEN, "-v", cwd=folder).stdout
    assert "after a tool frame of 100 mm, 45.8 deg" in " ".join(text.split())
    alone = found_in(folder, "camera.csv", *CHAIN, *GIVEN)
    assert np.trace(np.array(found["covariance"])[:3, :3]) == pytest.approx(
        np.trace(np.array(alone["covariance"])[:3, :3]),
        rel=0.02,  # the frames that fit the workspace are of the tool
    )


@pytest.mark.slow
def test_degrees_by_flag(cell):
    folder, X, _ = cell
    chain = ("--joints", "degrees.csv", "--urdf", "arm.urdf")
    text = refusal(folder, "camera.csv", *chain, *GIVEN)
    assert "degrees.csv" in text and "in degrees? Give --joint-units deg" in text
    assert close(found_in(folder, "camera.csv", *chain, "--joint-units", "deg", *GIVEN), X) < FAR


@pytest.mark.slow
def test_joints_pair_by_time(cell):
    folder, X, _ = cell
    found = found_in(folder, "some.csv", "--joints", "timed.csv", "--urdf", "arm.urdf", "--pair", "time", *GIVEN)
    assert found["n_poses"] == 7 and close(found, X) < FAR


@pytest.mark.slow
@pytest.mark.parametrize("robot", [(), ("--robot", "robot.csv")], ids=["joints alone", "beside poses"])
def test_streams_with_clocks_of_their_own(tmp_path, robot):
    rng = np.random.default_rng([SEED, 23])
    times = np.arange(0.0, 12.0, 0.01)
    turn = rng.uniform(0.4, 0.9, (2, 6))
    q_at = lambda t: 0.8 * np.sin(t[:, None] * turn[0] + [0, 1, 2, 3, 4, 5]) + 0.2 * np.sin(4 * t[:, None] * turn[1])  # noqa: E731
    X, W = motion((0.2, -0.1, 0.4), (0.05, 0.02, 0.08)), random_transforms(rng)
    seen = np.arange(0.5, 11.5, 0.05)
    camera = moved(np.linalg.inv(ARM.poses(q_at(seen)) @ X) @ W, rng.normal(size=(len(seen), 6)) * 1e-3)
    write_joints(tmp_path / "joints.csv", q_at(times) + 1e-5 * rng.normal(size=(len(times), 6)), times=times)
    write_pose_file(tmp_path / "robot.csv", ARM.poses(q_at(times[3::2] + 0.004)), times[3::2] + 0.004)
    write_pose_file(tmp_path / "camera.csv", camera, seen - 0.3)
    (tmp_path / "arm.urdf").write_text(SIX_AXES)
    found = found_in(tmp_path, "camera.csv", *robot, *CHAIN, "--kinematics", "exact", "--pair", "async")
    assert close(found, X) < FAR
    assert found["time_offset"]["offset"] == pytest.approx(0.3, abs=2e-3)


@pytest.mark.slow
def test_errors_of_the_arm_are_estimated_unless_said_otherwise(cell):
    folder, X, _ = cell
    found = found_in(folder, "camera.csv", *CHAIN, "--robot-class", "cobot")
    assert close(found, X) < FAR
    assert found["kinematics"]["how"] == "estimate" and found["kinematics"]["flange"] == "workspace"
    assert found["kinematics"]["sd"]["joint offsets"] > 1e-3
    physical = found_in(folder, "camera.csv", *CHAIN, *GIVEN, "--flange", "physical")
    assert physical["kinematics"]["flange"] == "physical"
    assert np.trace(np.array(physical["covariance"])) > np.trace(np.array(found["covariance"])) * 0.1


@pytest.fixture(scope="module")
def far_apart(tmp_path_factory):
    """Files of a UR5e with offsets of its joints: its poses, joint values and Denavit-Hartenberg table; X."""
    folder = tmp_path_factory.mktemp("named")
    arm, rng = Kinematics.from_name("ur5e"), np.random.default_rng([SEED, 41])
    q = np.array([0.3, -1.4, 1.5, -1.6, -1.5, 0.2]) + rng.uniform(-0.6, 0.6, (20, 6))
    e = rng.normal(size=len(arm.errors)) * [1.5e-3 * (error.group == "joint offsets") for error in arm.errors]
    X, view = motion((0.2, -0.1, 0.4), (0.05, 0.02, 0.08)), motion((0.0, 0.0, 0.0), (0.0, 0.0, 0.6))
    true = aligned_poses(arm, q, e)  # in the frames that X is stated in
    camera = moved(np.linalg.inv(true @ X) @ true[0] @ X @ view, rng.normal(size=(20, 6)) * np.repeat([5e-4, 3e-4], 3))
    write_pose_file(folder / "robot.csv", arm.poses(q))
    write_pose_file(folder / "camera.csv", camera)
    write_joints(folder / "joints.csv", q, arm.names)
    (folder / "dh.csv").write_text(
        "# convention: standard\njoint,theta,d,a,alpha\n"
        + "".join(
            f"joint_{k},0deg,{d}mm,{a}mm,{alpha}deg\n"
            for k, d, a, alpha in (
                *((1, 162.5, 0, 90), (2, 0, -425, 0), (3, 0, -392.2, 0)),
                *((4, 133.3, 0, 90), (5, 99.7, 0, -90), (6, 99.6, 0, 0)),
            )
        )
    )
    return folder, X


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [("--robot-model", "UR5e"), ("--robot-model", "ur5e", "--robot-class", "cobot"), ("--dh", "dh.csv")],
    ids=["name", "class", "table"],
)
def test_an_arm_by_its_model_needs_no_joints(far_apart, model):
    """The joint values follow from the poses; the errors of the arm are found with X, as with joints given."""
    folder, X = far_apart
    found = found_in(folder, "robot.csv", "camera.csv", *model)
    assert found["kinematics"]["how"] == "estimate" and close(found, X) < FAR
    with_joints = found_in(folder, "camera.csv", "--joints", "joints.csv", *model)
    same_branch = "--robot-model" in model  # a table does not say how the arm usually stands
    np.testing.assert_allclose(found["X"], with_joints["X"], atol=2e-5 if same_branch else 1e-3)


@pytest.mark.slow
def test_a_class_sets_the_accuracy_of_an_unknown_arm(far_apart):
    folder = far_apart[0]
    found = {name: found_in(folder, "robot.csv", "camera.csv", "--robot-class", name) for name in CLASSES}
    for name, size in CLASSES.items():
        line = f"robot accuracy: {1e3 * size.median:.2g} mm"
        assert any(text.startswith(line) for text in found[name]["provenance"]["options"]["shared"])
    sd = {name: max(one["std"][3:]) for name, one in found.items()}
    assert sd["calibrated"] < sd["cobot"] and "kinematics" not in found["cobot"]
    given = ("--robot-noise", "0.01deg,0.03mm", "--camera-noise", "0.03deg,0.3mm", "--shared", "none")
    known = [found_in(folder, "robot.csv", "camera.csv", *given, *more) for more in ((), ("--robot-class", "cobot"))]
    assert max(known[1]["std"][3:]) > max(known[0]["std"][3:])  # declared, so it counts beside noise that is given, too


@pytest.mark.slow
@pytest.mark.parametrize("tip", ["tool0", "l6"])
def test_base_and_tip(cell, tip):
    folder, X, q = cell
    found = found_in(folder, "camera.csv", *CHAIN, *GIVEN, "--base", "base", "--tip", tip)
    behind = Kinematics.from_urdf(SIX_AXES, tip=tip).poses(q[0])
    assert close(found, np.linalg.inv(behind) @ ARM.poses(q[0]) @ X) < FAR


@pytest.mark.slow
@pytest.mark.parametrize("command", ["validate", "posterior", "cross-check", "compare"])
def test_other_commands_have_the_errors_of_the_arm_in_their_noise(cell, command):
    folder = cell[0]
    few = {
        "validate": ("--trials", "200", "--workers", "1"),
        "posterior": ("--samples", "100"),
        "cross-check": ("--trials", "200", "--no-posterior", "--workers", "1"),
        "compare": ("--methods", "efficient,park"),
    }[command]
    done = run(command, "camera.csv", *CHAIN, *GIVEN, *few, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    with_errors = json.loads(done.stdout)
    if command == "compare":
        exact = found_in(folder, "camera.csv", *CHAIN, "--kinematics", "exact", *NOISES[2:], *few, command=command)
        sd = [np.linalg.norm(each["methods"][0]["std"]) for each in (with_errors, exact)]
        assert sd[0] > 1.5 * sd[1]


# ----------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--kinematics", "exact", "--tip", "tool0"), "--tip, --kinematics: needs a robot model. Add --urdf"),
        (("--robot-class", "cobot", "--size", "sag=1mrad"), "--robot-class, --size: needs a robot model"),
        (("--joints", "joints.csv"), "Add --urdf robot.urdf (or --dh FILE, --robot-model NAME)"),
        (("--joints", "joints.csv", "--robot-model", "ur5x"), "--robot-model: No arm of the name 'ur5x' is known"),
        (("--robot-model", "ur5x"), "Similar: ur5"),
        (("--robot-model", "ur5e", "--urdf", "arm.urdf"), "--urdf: not used with --robot-model"),
        (("--robot-model", "ur5e", "--dh", "dh.csv"), "--robot-model: not used with --dh"),
        (("--urdf", "arm.urdf", "--joint-units", "deg"), "--joint-units needs --joints"),
        ((*CHAIN, "--dh", "dh.csv"), "--urdf: not used with --dh"),
        (("--joints", "joints.csv", "--dh", "dh.csv", "--tip", "tool0"), "--tip: not used with --dh"),
        ((*CHAIN, "--kinematics", "guess"), "--kinematics to be one of estimate, declared, exact"),
        ((*CHAIN, "--robot-class", "cobots"), "Did you mean cobot?"),
        ((*CHAIN, "--flange", "real"), "--flange to be one of workspace, controller, physical"),
        ((*CHAIN, "--size", "joint tilts=2mm"), "--size 'joint tilts'"),
        ((*CHAIN, "--size", "link lengths=-1mm"), "--size 'link lengths'"),
        ((*CHAIN, "--size", "link lengths=1mm,2"), "errors of the arm take no factor"),
        ((*CHAIN, "--kinematics", "exact", "--size", "sag=1mrad"), "--size 'sag': not used with --kinematics exact"),
        ((*CHAIN, "--units", "robot=mm"), "--units: for a file of robot poses, not for --joints"),
        ((*CHAIN, "--robot-frame", "gripper_T_base"), "--robot-frame: for a file of robot poses"),
        ((*CHAIN, "--joint-units", "parsec"), "--joint-units"),
        ((*CHAIN, "--tip", "tool1"), "tool0"),
        ((*CHAIN, "--base", "basis"), "base"),
        ((*CHAIN, "--method", "tsai"), "tsai"),
    ],
)
def test_refuses_combinations_in_one_line(cell, arguments, words):
    assert words in refusal(cell[0], "camera.csv", *arguments)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--robot-class", "hobby"), "--robot-class to be one of calibrated, industrial, cobot, got 'hobby'"),
        (
            ("--urdf", "arm.urdf", "--robot-class", "hobbyist"),
            "--robot-class to be one of industrial, cobot, hobby, calibrated",
        ),
        (("--robot-class", "cobot", "--robot-accuracy", "1mm,0.1deg"), "--robot-class and --robot-accuracy"),
        (("--robot-model", "ur3e"), "does not reach"),
        (("--urdf", "arm.urdf", "--method", "park"), "Method 'park'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_refuses_beside_poses_in_one_line(cell, arguments, words):
    done = run("calibrate", "robot.csv", "camera.csv", *arguments, "-q", cwd=cell[0])
    assert (done.returncode, done.stdout) == (2, "")
    assert words in done.stderr and done.stderr.count("error:") == 1


@pytest.mark.slow
def test_refuses_files_given_twice_or_not_at_all(cell):
    folder = cell[0]
    text = refusal(folder, "robot.csv", "camera.csv", "--robot", "robot.csv", *CHAIN)
    assert "Robot poses are given twice" in text
    assert "--joints needs camera poses. Add their file" in refusal(folder, *CHAIN)
    assert "Missing argument 'ROBOT', or --joints and --urdf" in refusal(folder)
    assert "uq-handeye compare --help" in refusal(folder, command="compare")
    assert "Missing argument 'ROBOT' (see uq-handeye sync --help)" in refusal(folder, command="sync")


def test_names_the_joint_file_where_rows_are_missing(cell):
    folder, _, q = cell
    write_joints(folder / "short.csv", q[:-1])
    text = refusal(folder, "camera.csv", "--joints", "short.csv", "--urdf", "arm.urdf")
    assert "short.csv has 15" in text and "camera.csv has 16" in text
    text = refusal(folder, "camera.csv", "--robot", "robot.csv", "--joints", "short.csv", "--urdf", "arm.urdf")
    assert "robot.csv has 16 poses and short.csv has 15 rows" in text


@pytest.mark.slow
def test_missing_joints_and_further_ones(cell):
    folder, X, q = cell
    write_joints(folder / "missing.csv", q[:, :5], ARM.names[:5])
    assert "no column of joint axis_6" in refusal(folder, "camera.csv", "--joints", "missing.csv", "--urdf", "arm.urdf")
    write_joints(folder / "more.csv", np.hstack([np.full((16, 1), 0.02), q[:, ::-1]]), ("finger", *ARM.names[::-1]))
    assert close(found_in(folder, "camera.csv", "--joints", "more.csv", "--urdf", "arm.urdf", *GIVEN), X) < FAR


@pytest.mark.slow
def test_a_urdf_of_another_arm_is_named(cell):
    folder = cell[0]
    (folder / "other.urdf").write_text(SIX_AXES.replace("0 0 0.27", "0 0 0.67"))
    done = run(
        "calibrate", "robot.csv", "camera.csv", "--joints", "joints.csv", "--urdf", "other.urdf", *GIVEN, cwd=folder
    )
    said = " ".join((done.stdout + done.stderr).split())
    assert "more than any tolerance of an arm" in said and "of another arm" in said


# ---------------------------------------------------------------------------------------------------------- real data

needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


@pytest.mark.slow
@needs_data
def test_a_real_arm_by_its_joints():
    """FR3: the mount of the camera is known to about a millimetre; the controller's tool is turned by 45 degrees."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "fr3_philnad"
    given = (
        "--kinematics",
        "declared",
        "--robot-class",
        "cobot",
        "--size",
        "joint noise=0.3mrad",
        "--robot-noise",
        "exact",
    )
    chain = ("--joints", "joints.csv", "--urdf", "model.urdf")
    arguments = (*chain, *given, "--camera-noise", "0.11deg,0.43mm", "--shared", "none")
    found = found_in(folder, "camera.csv", *arguments)
    np.testing.assert_allclose(1e3 * np.array(found["X"])[:3, 3], [94.6, -11.4, 39.1], atol=1.5)
    text = run("calibrate", "tcp.csv", "camera.csv", *arguments, "-v", cwd=folder).stdout
    assert "after a tool frame of 45 deg" in " ".join(text.split())


# --------------------------------------------------------------------------------------------------------------- MJCF


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The target is ahead")  # it is anywhere
def test_an_mjcf_model_gives_the_result_of_the_urdf(cell):
    folder, _, _ = cell
    (folder / "arm.xml").write_text(mjcf_of(ARM), encoding="utf-8")
    mjcf = ("--joints", "joints.csv", "--robot-model", "arm.xml", "--tip", "tool")
    found, same = (found_in(folder, "camera.csv", *chain, *GIVEN) for chain in (mjcf, CHAIN))
    np.testing.assert_allclose(found["X"], same["X"], atol=1e-9)
    np.testing.assert_allclose(found["covariance"], same["covariance"], rtol=1e-6)


def test_base_and_tip_are_for_a_model_in_a_file(cell):
    chain = ("--joints", "joints.csv", "--robot-model", "ur5e", "--tip", "tool")
    assert "--tip: not used with --robot-model" in refusal(cell[0], "camera.csv", *chain)
