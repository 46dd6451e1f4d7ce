"""Several readings of the rotations of a file: robot and camera decide, and say so; otherwise they are refused."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.calibration.checks import failures_in_words
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.findings import step_after
from uq_handeye.formats.contents import Reading, Side
from uq_handeye.read import pose_text
from uq_handeye.read.readings import chosen_readings, reading_of_robot

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
FRAMES = ("base_T_gripper", "camera_T_target")
ALL = (slice(None), slice(None))
READINGS = (
    Reading("ur", "rotvec-rad"),
    Reading("rpy", "xyz-rad"),
    Reading("staubli", "XYZ-deg", "mm"),
    Reading("yaskawa", "xyz-deg", "mm"),
)


def sides(poses, numbers, readings, scale=1.0):
    robot = Side("robot.csv", poses.robot[:, :3, 3] * scale, numbers, readings=readings)
    return [robot, Side("camera.csv", poses.camera[:, :3, 3], poses.camera[:, :3, :3])]


def numbers_of(poses, reading):
    rotation = Rotation.from_matrix(poses.robot[:, :3, :3])
    if reading.rotation.startswith("rotvec"):
        return rotation.as_rotvec()
    sequence, unit = reading.rotation.split("-")
    return rotation.as_euler(sequence, degrees=unit == "deg")


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("meant", READINGS, ids=lambda reading: reading.format)
def test_the_motions_decide(meant, setup):
    poses = uq.simulate(12, noise=NOISE, setup=setup, seed=SEED)
    scale = 1e3 if meant.units == "mm" else 1.0
    chosen = chosen_readings(
        sides(poses, numbers_of(poses, meant), READINGS, scale), (None, None), (None, None), FRAMES, ALL, setup
    )
    assert chosen.sides[0].readings == (meant,)
    assert str(meant) in chosen.notes[0] and chosen.notes[1] == ""


def test_both_sides_may_be_open():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    orders = (Reading("csv", "xyzw"), Reading("csv", "wxyz"))
    robot = Rotation.from_matrix(poses.robot[:, :3, :3]).as_quat(scalar_first=True)
    camera = Rotation.from_matrix(poses.camera[:, :3, :3]).as_quat()
    pair = [
        Side("robot.csv", poses.robot[:, :3, 3], robot, readings=orders),
        Side("camera.csv", poses.camera[:, :3, 3], camera, readings=orders),
    ]
    chosen = chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert [side.readings[0].rotation for side in chosen.sides] == ["wxyz", "xyzw"]


def test_few_poses_or_a_bad_fit_are_refused_with_the_candidates():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    numbers = numbers_of(poses, READINGS[0])
    for pair in (
        [side_of(side, slice(3)) for side in sides(poses, numbers, READINGS)],
        sides(poses, np.random.default_rng(SEED).normal(size=(12, 3)), READINGS),
    ):
        with pytest.raises(uq.InputError, match=r"ur \(rotvec-rad\), rpy .*--format robot=ur") as caught:
            chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
        assert "\n" not in str(caught.value)


def side_of(side, rows):
    return replace(side, translation=side.translation[rows], rotation=side.rotation[rows])


def test_what_was_asked_for_is_not_decided():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    pair = sides(poses, numbers_of(poses, READINGS[0]), READINGS)
    chosen = chosen_readings(pair, (None, None), ("rotvec-rad", None), FRAMES, ALL, "eye-in-hand")
    assert chosen.sides[0].readings == READINGS and chosen.notes == ("", "")


def test_of_many_poses_some_decide():
    """All of them are returned."""
    poses = uq.simulate(1001, noise=NOISE, seed=SEED)
    pair = sides(poses, numbers_of(poses, READINGS[1]), READINGS)
    chosen = chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert chosen.sides[0].readings == (READINGS[1],) and len(chosen.sides[0]) == len(chosen.sides[1]) == 1001
    assert chosen.sides[0].rotation is pair[0].rotation


def test_another_order_of_angles_is_named():
    """KUKA's angles read as FANUC's: a finding with the option, which is warned of; read right: none."""
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    numbers = numbers_of(poses, Reading("kuka", "ZYX-deg"))
    pair = sides(poses, numbers, (Reading("fanuc", "xyz-deg", "m"),))
    with pytest.warns(uq.InputWarning, match=r'--rotation robot=ZYX-deg \(rotation=\("ZYX-deg", None\)\)'):
        (found,) = chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand").findings
    assert (found.code, found.severity) == ("poses.another_rotation", "failure")
    assert (found.values["used"], found.values["form"]) == ("xyz-deg", "ZYX-deg")
    right = sides(poses, numbers, (Reading("kuka", "ZYX-deg", "m"),))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        chosen_readings(right, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")


def test_another_order_is_named_where_the_setup_is_forgotten_too():
    poses = uq.simulate(12, noise=NOISE, setup="eye-to-hand", seed=SEED)
    pair = sides(poses, numbers_of(poses, Reading("kuka", "ZYX-deg")), (Reading("fanuc", "xyz-deg", "m"),))
    with pytest.warns(uq.InputWarning, match=r"--rotation robot=ZYX-deg"):
        chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")


def test_the_motions_decide_where_the_setup_is_forgotten():
    """`calibrate` names the setup."""
    poses = uq.simulate(12, noise=NOISE, setup="eye-to-hand", seed=SEED)
    pair = sides(poses, numbers_of(poses, READINGS[2]), READINGS, 1e3)
    chosen = chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert chosen.sides[0].readings == (READINGS[2],)


@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_a_form_that_is_not_among_the_readings_is_named(setup):
    """Angles ZYZ of Doosan, Kawasaki: none of the readings is recommended."""
    poses = uq.simulate(12, noise=NOISE, setup=setup, seed=SEED)
    pair = sides(poses, numbers_of(poses, Reading("doosan", "ZYZ-deg")), READINGS[2:], 1e3)
    with pytest.raises(
        uq.InputError, match=r"with rotations as ZYZ-deg they agree\. Give --rotation robot=ZYZ-deg \(docs"
    ) as caught:
        chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert "--format" not in str(caught.value)
    both = sides(poses, numbers_of(poses, Reading("doosan", "ZYZ-deg")), (READINGS[0], READINGS[2]), 1e3)
    with pytest.raises(uq.InputError, match=r"--rotation robot=ZYZ-deg --units robot=mm "):  # m or mm is open
        chosen_readings(both, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")


def test_a_reading_that_fits_in_rotation_alone_is_not_taken():
    """ZXZ and ZYZ differ by a quarter of a rotation about z: their rotations fit alike."""
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    readings = (Reading("kawasaki", "ZYZ-deg", "mm"), READINGS[2])
    pair = sides(poses, numbers_of(poses, Reading("other", "ZXZ-deg")), readings, 1e3)
    with pytest.raises(uq.InputError, match=r"Give --rotation robot=ZXZ-deg \(docs"):
        chosen_readings(pair, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    far = [pair[0], replace(pair[1], translation=1e3 * pair[1].translation)]  # `calibrate` names the unit
    right = [replace(far[0], rotation=numbers_of(poses, readings[0])), far[1]]
    chosen = chosen_readings(right, (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
    assert chosen.sides[0].readings == readings[:1]


def test_a_unit_that_no_reading_has_does_not_speak_for_another_order_of_angles(tmp_path):
    """Centimetres where only metres and millimetres are tried: the angles that fit are taken, the unit is named."""
    poses = uq.simulate(12, noise=NOISE, seed=3)
    angles = Rotation.from_matrix(poses.robot[:, :3, :3]).as_euler("xyz", degrees=True)
    np.savetxt(tmp_path / "robot.txt", np.column_stack([100.0 * poses.robot[:, :3, 3], angles]))
    (tmp_path / "camera.csv").write_text(pose_text(poses.camera))
    read = uq.read_poses(tmp_path / "robot.txt", tmp_path / "camera.csv")
    np.testing.assert_allclose(read.robot[:, :3, :3], poses.robot[:, :3, :3], atol=1e-6)
    with pytest.warns(uq.InputWarning, match="multiplied by 0.1"):
        assert not uq.calibrate(read).usable


def test_rows_that_do_not_belong_together_are_not_blamed_on_the_reading():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    pair = sides(poses, numbers_of(poses, READINGS[0]), READINGS)
    with pytest.raises(uq.InputError, match=r"with none of these robot and camera agree .do the rows"):
        chosen_readings(
            [pair[0], side_of(pair[1], np.arange(12)[::-1])], (None, None), (None, None), FRAMES, ALL, "eye-in-hand"
        )
    with pytest.raises(
        uq.InputError, match=r"12 poses in robot.csv and 11 poses in camera.csv do not decide: one row per moment"
    ):
        chosen_readings([pair[0], side_of(pair[1], slice(11))], (None, None), (None, None), FRAMES, ALL, "eye-in-hand")


@pytest.mark.slow
def test_the_result_names_the_rotations_and_not_the_rows(tmp_path):
    """The roll, pitch and yaw of a pendant, read as the rotation vector of its program."""
    poses = uq.simulate(15, noise=NOISE, seed=SEED)
    numbers = numbers_of(poses, READINGS[1])
    table = np.concatenate([poses.robot[:, :3, 3], numbers], axis=1)
    np.savetxt(tmp_path / "robot.csv", table, delimiter=",", header="x,y,z,rx,ry,rz", comments="")
    uq.write_pose_file(tmp_path / "camera.csv", poses.camera)
    files = (tmp_path / "robot.csv", tmp_path / "camera.csv")
    with pytest.warns(uq.InputWarning, match="^robot.csv: with rotations read as rotvec-rad"):
        wrong = uq.read_poses(*files, format=("ur", None))
    step = "run again with --rotation robot=xyz-rad"
    reason = "the robot rotations seem to be xyz-rad, not rotvec-rad"
    for rows, noise in ((15, None), (14, NOISE)):
        with pytest.warns(uq.InputWarning):
            result = uq.calibrate(wrong.rows(np.arange(15 - rows, 15)), noise=noise)
        assert result.headline == f"NOT USABLE: {reason}." and next_step(result) == step
        assert not any("belong together" in text for text in result.warnings)
    right = uq.read_poses(*files, format=("ur", None), rotation=("xyz-rad", None))
    assert right.findings == () and uq.calibrate(right, noise=NOISE).usable


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_motions_that_seem_not_to_determine_x_have_a_cause(tmp_path):
    """Angles of the camera in a wrong order: the reason comes with the error, alone."""
    poses = uq.simulate(17, noise=NOISE, seed=0)
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot)
    angles = Rotation.from_matrix(poses.camera[:, :3, :3]).as_euler("ZYX")
    table = np.concatenate([poses.camera[:, :3, 3], angles], axis=1)
    np.savetxt(tmp_path / "camera.csv", table, delimiter=",", header="x,y,z,roll,pitch,yaw", comments="")
    read = uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv")
    reason = "the camera rotations seem to be ZYX-rad, not xyz-rad"
    with pytest.raises(uq.DegenerateMotionError) as caught:
        uq.calibrate(read, method="tsai")
    assert failures_in_words(caught.value.findings) == (reason,)
    assert step_after(caught.value.findings) == "run again with --rotation camera=ZYX-rad"
    assert uq.calibrate(read).headline == f"NOT USABLE: {reason}."
    assert read.findings[0].values["form"] == "ZYX-rad" and read.findings[0].values["side"] == "camera"


def test_beside_a_calibrated_camera():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    robot = sides(poses, numbers_of(poses, READINGS[1]), READINGS[:2])[0]
    rows = np.arange(2, 11)
    chosen = reading_of_robot(robot, poses.camera[rows], rows, None, None, FRAMES[0], "eye-in-hand")
    assert chosen.sides[0].readings == (READINGS[1],) and "xyz-rad" in chosen.notes[0]


def test_numbers_of_rows_beside_times_of_a_clock(tmp_path):
    """Rows numbered 0, 1, 2, ... go with times; numbers that differ still show a lost row."""
    poses = uq.simulate(5, noise=NOISE, seed=SEED)
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot, 1.7e9 + 0.7 * np.arange(5))
    uq.write_pose_file(tmp_path / "camera.csv", poses.camera)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv").n == 5
    uq.write_pose_file(tmp_path / "robot.csv", poses.robot, [0, 1, 2, 4, 5])
    with pytest.raises(uq.InputError, match="same moments"):
        uq.read_poses(tmp_path / "robot.csv", tmp_path / "camera.csv")


def _disturbed(poses, wrong, size, rng):
    """Camera poses (n, 4, 4) of a target of another ``size``, with ``wrong`` rows of half turns or of other moments."""
    C = poses.camera.copy()
    C[:, :3, 3] *= size
    rows = rng.choice(poses.n, int(wrong * poses.n), replace=False)
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    half[:2, 3] = 0.08, 0.06
    for k in rows:
        C[k] = C[k] @ half if k % 2 else poses.camera[(k + 3) % poses.n]
    return C


@pytest.mark.parametrize("given", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize(("wrong", "size"), [(0.0, 1.4), (0.12, 1.0), (0.25, 0.7)])
def test_outliers_half_turns_and_a_wrong_size_do_not_mislead(setup, given, wrong, size):
    rng = np.random.default_rng(SEED)
    poses = uq.simulate(24, noise=NOISE, setup=setup, seed=SEED)
    C = _disturbed(poses, wrong, size, rng)
    for meant in READINGS:
        scale = 1e3 if meant.units == "mm" else 1.0
        robot, _ = sides(poses, numbers_of(poses, meant), READINGS, scale)
        both = [robot, Side("camera.csv", C[:, :3, 3], C[:, :3, :3])]
        chosen = chosen_readings(both, (None, None), (None, None), FRAMES, ALL, given)
        assert chosen.sides[0].readings == (meant,)
        assert "next best" in chosen.notes[0]


def test_a_robot_that_did_not_move_is_said_before_its_reading_is_asked_for():
    poses = uq.simulate(12, noise=NOISE, seed=SEED)
    numbers = np.repeat(numbers_of(poses, READINGS[0])[:1], 12, axis=0)
    robot, camera = sides(poses, numbers, READINGS)
    robot = replace(robot, translation=np.repeat(robot.translation[:1], 12, axis=0))
    with pytest.raises(uq.InputError, match="all 12 poses are the same"):
        chosen_readings([robot, camera], (None, None), (None, None), FRAMES, ALL, "eye-in-hand")
