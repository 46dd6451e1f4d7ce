"""A file that is read wrongly: the warning names the argument and the option, and what it names mends it."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.calibration.findings import check_input
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.core.files.source import Source
from uq_handeye.findings import step_after
from uq_handeye.fit.diagnostics.misread_files import other_readings
from uq_handeye.fit.diagnostics.residuals import check_fit
from uq_handeye.model.poses.residuals import pose_residuals
from uq_handeye.read import write_pose_file

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def good(request):
    return uq.simulate(25, noise=NOISE, setup=request.param, seed=2)


def inverse(T):
    return np.linalg.inv(T)


def millimetres(T):
    T = T.copy()
    T[:, :3, 3] *= 1000
    return T


def centimetres(T):
    T = T.copy()
    T[:, :3, 3] *= 100
    return T


def scalar_first(T):
    """The pose that stands in a file whose columns x, y, z, w hold w, x, y, z."""
    T = T.copy()
    q = np.roll(Rotation.from_matrix(T[:, :3, :3]).as_quat(), 1, axis=1)
    T[:, :3, :3] = Rotation.from_quat(q).as_matrix()
    return T


def said(files, **options):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        uq.calibrate(uq.read_poses(*files, **options), noise=NOISE)
    return " | ".join(str(item.message) for item in caught)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "camera", "option", "argument"),
    [
        (inverse, None, "--robot-frame gripper_T_base", {"robot_frame": "gripper_T_base"}),
        (None, inverse, "--camera-frame target_T_camera", {"camera_frame": "target_T_camera"}),
        (scalar_first, None, "--quaternion robot=wxyz", {"quaternion": ("wxyz", None)}),
        (None, scalar_first, "--quaternion camera=wxyz", {"quaternion": (None, "wxyz")}),
        (scalar_first, scalar_first, "--quaternion wxyz", {"quaternion": "wxyz"}),
        (millimetres, None, "--units robot=mm", {"units": ("mm", "m")}),
        (None, millimetres, "--units camera=mm", {"units": ("m", "mm")}),
        (None, centimetres, "--units camera=cm", {"units": ("m", "cm")}),
        (centimetres, None, "--units robot=cm", {"units": ("cm", "m")}),
    ],
)
def test_the_option_that_is_named_mends_it(good, tmp_path, robot, camera, option, argument):
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T, change in zip(files, (good.robot, good.camera), (robot, camera), strict=True):
        write_pose_file(file, T if change is None else change(T))
    text = said(files, setup=good.setup)
    assert option in text
    ((name, value),) = argument.items()
    shown = "(" + ", ".join("None" if v is None else f'"{v}"' for v in value) + ")"
    assert f"{name}={shown if isinstance(value, tuple) else chr(34) + value + chr(34)}" in text
    assert said(files, setup=good.setup, **argument) == ""


@pytest.mark.slow
def test_wrong_setup(good, tmp_path):
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T in zip(files, (good.robot, good.camera), strict=True):
        write_pose_file(file, T)
    other = "eye-to-hand" if good.setup == "eye-in-hand" else "eye-in-hand"
    text = said(files, setup=other)
    assert f'setup="{good.setup}" (--setup {good.setup})' in text
    assert said(files, setup=good.setup) == ""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize(
    ("setup", "given", "headline", "step"),
    [
        (
            "eye-to-hand",
            {},
            "the setup seems to be eye-to-hand, or the camera file inverse",
            "run again with --setup eye-to-hand; or, if the camera is on the gripper, with --camera-frame "
            "target_T_camera",
        ),
        (
            "eye-in-hand",
            {"setup": "eye-to-hand"},
            "the setup seems to be eye-in-hand, or the camera file inverse",
            "run again with --setup eye-in-hand; or, if the camera is fixed, with --camera-frame target_T_camera",
        ),
        (
            "eye-in-hand",
            {"camera_frame": "target_T_camera"},
            "the camera file seems inverse, or the setup eye-to-hand",
            "run again without --camera-frame; or, if the camera is fixed, with --setup eye-to-hand",
        ),
        (
            "eye-in-hand",
            {"robot_frame": "gripper_T_base"},
            "the robot file seems inverse, or the setup eye-to-hand",
            "run again without --robot-frame; or, if the camera is fixed, with --setup eye-to-hand",
        ),
    ],
)
def test_the_forgotten_setup_stands_in_the_headline_and_the_next_step(tmp_path, setup, given, headline, step):
    """The poses fit by the other setup and by an inverse file alike, with another X."""
    poses = uq.simulate(20, noise=NOISE, setup=setup, distance=("0.5m", "0.7m"), seed=3)
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T in zip(files, (poses.robot, poses.camera), strict=True):
        write_pose_file(file, T)
    found = uq.calibrate(uq.read_poses(*files, **given), noise=NOISE)
    assert found.headline == f"NOT USABLE: {headline}." and next_step(found) == step


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_the_setup_is_asked_for_where_the_wrong_reading_fits(tmp_path):
    """Fixed camera: inverse camera poses fit, with the target's pose on the gripper as X; the view shows it."""
    X, W = np.eye(4), np.eye(4)
    X[:3, :3], X[:3, 3], W[:3, 3] = Rotation.from_euler("XYZ", [-100, 10, 95], degrees=True).as_matrix(), 1.2, 0.04
    poses = uq.simulate(20, noise=NOISE, setup="eye-to-hand", X=X, W=W, seed=3)
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T in zip(files, (poses.robot, poses.camera), strict=True):
        write_pose_file(file, T)

    def run(**given):
        read = uq.read_poses(*files, **given)
        found = uq.calibrate(read, noise=NOISE)
        codes = {finding.code for finding in found.findings} & {
            "input_checks.setup_not_said",
            "input_checks.setup_by_lengths",
        }
        return found, codes, " ".join(note for source in read.sources for note in source.notes)

    inverse_camera = {"camera_frame": "target_T_camera"}
    found, codes, notes = run(**inverse_camera)
    assert found.usable and codes == {"input_checks.setup_not_said"} and "give --setup eye-to-hand" in notes
    assert next_step(found) == "if the camera is fixed, run again with --setup eye-to-hand and without --camera-frame"
    assert np.allclose(found.X, W, atol=5e-3)
    assert run(setup="eye-in-hand", **inverse_camera)[1:] == (set(), "")  # said
    found, codes, _ = run(robot_frame="gripper_T_base")
    assert codes == {"input_checks.setup_by_lengths"} and next_step(found).endswith("without --robot-frame")
    assert run(setup="eye-to-hand")[1:] == (set(), "")
    as_for_opencv = uq.calibrate(uq.PosePairs(inverse(poses.robot), poses.camera), noise=NOISE)
    step = "if the camera is fixed, run again with --setup eye-to-hand and --robot-frame gripper_T_base"
    assert next_step(as_for_opencv) == step and np.allclose(as_for_opencv.X, X, atol=5e-3)


def test_an_order_that_was_asked_for_wrongly(good, tmp_path):
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T in zip(files, (good.robot, good.camera), strict=True):
        write_pose_file(file, T)
    text = said(files, setup=good.setup, quaternion="wxyz")
    assert 'quaternion="xyzw" (--quaternion xyzw)' in text
    assert "both files have the scalar of the quaternion last" in text


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_camera_file_with_the_scalar_first_where_the_translations_fit_all_the_same(seed):
    """The translation of W does not contain the rotation of the camera poses."""
    poses = uq.simulate(20, noise=NOISE, seed=seed)
    G, C = poses.robot, scalar_first(poses.camera)
    turn, shift = np.sqrt(np.mean(np.square(pose_residuals(G, C, poses.truth.X)), axis=1))
    assert shift < 2e-3 < 0.1 < turn
    (reading, *_) = other_readings(uq.PosePairs(G, C), float(turn), float(shift))
    assert (reading["kind"], reading["file"], reading["order"]) == ("quaternion", "camera", "wxyz")


def lengths_warned_of(poses):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        uq.calibrate(poses, noise=NOISE)
    return " | ".join(str(item.message) for item in caught if "would sit" in str(item.message))


@pytest.mark.slow
@pytest.mark.parametrize("distance", [("0.4m", "0.8m"), ("1m", "2m")])
def test_both_files_inverse_and_swapped_files(good, distance):
    poses = uq.simulate(20, noise=NOISE, setup=good.setup, distance=distance, seed=3)
    inverses = "--robot-frame gripper_T_base --camera-frame target_T_camera"
    text = lengths_warned_of(uq.PosePairs(inverse(poses.robot), inverse(poses.camera), poses.setup))
    assert "hold inverse poses" in text and inverses in text
    swapped = lengths_warned_of(uq.PosePairs(poses.camera, poses.robot, poses.setup))
    if poses.setup == "eye-in-hand":
        assert "Give the robot's file first" in swapped and inverses in swapped
    else:  # X comes out inverse, of the same length
        assert "swapped" not in text + swapped


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("distance", [("0.4m", "0.8m"), ("1m", "2m"), ("2m", "4m")])
def test_files_of_a_rig_with_a_long_bracket_are_left_alone(setup, distance):
    """A sensor on the gripper may sit far from it, the rest near the base, as long as the camera looks at the
    target; of a camera more than 0.5 m away, the measured place is asked for.
    """
    on_gripper, fixed = np.eye(4), np.eye(4)
    on_gripper[:3, 3], fixed[:3, 3] = (0.0, 0.0, 0.6), (0.2, 0.05, 0.1)
    X, W = (on_gripper, fixed) if setup == "eye-in-hand" else (fixed, on_gripper)
    poses = uq.simulate(15, noise=NOISE, setup=setup, X=X, W=W, distance=distance, seed=1)
    text = lengths_warned_of(poses)
    if setup == "eye-in-hand":
        assert re.fullmatch(
            r"The camera would sit (0\.6|0\.599) m from the gripper\. Check.* measured place: [^|]*", text
        )
    else:
        assert text == ""
    other = "eye-to-hand" if setup == "eye-in-hand" else "eye-in-hand"  # the same numbers where they are wrong
    wrong = uq.simulate(15, noise=NOISE, setup=other, X=X, W=W, distance=distance, seed=1)
    assert "would sit" in lengths_warned_of(uq.PosePairs(inverse(wrong.robot), inverse(wrong.camera), other))


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize(("far", "usable"), [(0.6, True), (2.5, False)])
def test_a_camera_that_no_gripper_carries_is_not_usable(far, usable):
    """Swapped files fit as well, with X and W exchanged."""
    X, W = np.eye(4), np.eye(4)
    X[:3, 3], W[:3, 3] = (0.1, 0.05, 0.1), (far, 0.0, 0.1)
    poses = uq.simulate(15, noise=NOISE, X=X, W=W, distance=("0.5m", "1m"), seed=1)
    assert uq.calibrate(poses, noise=NOISE).usable
    found = uq.calibrate(uq.PosePairs(poses.camera, poses.robot, poses.setup), noise=NOISE)
    assert found.usable is usable and "input_checks.long_bracket" in {finding.code for finding in found.findings}


def test_every_option_named_exists():
    """Against typing errors in the texts: the arguments of read_poses."""
    import inspect

    from uq_handeye.fit.diagnostics import readings, sentences

    source = inspect.getsource(sentences) + inspect.getsource(readings)
    named = set(re.findall(r"(?<!\})\b(\w+)=\"", source)) - {
        "phrase",
        "remedy",
        "cause",
        "option",
        "text",
    }
    assert {"setup", "robot_frame", "camera_frame"} <= named | {f"{side}_frame" for side, _ in readings.FRAMES.values()}
    assert named <= set(inspect.signature(uq.read_poses).parameters)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize(("file", "unit"), [("robot", "mm"), ("robot", "cm"), ("camera", "mm")])
def test_the_file_that_was_read_in_a_wrong_unit_is_named(file, unit):
    """Metres read as millimetres: the rig of the other file is as large as rigs are."""
    poses = uq.simulate(15, noise=NOISE, seed=2)
    T = getattr(poses, file).copy()
    T[:, :3, 3] *= {"mm": 1e-3, "cm": 1e-2}[unit]
    result = uq.calibrate(replace(poses, **{file: T}), noise=NOISE)
    assert result.headline == f"NOT USABLE: the {file} file seems to be in m."
    assert next_step(result).startswith(f"run again with --units {file}=m; if it was read so, its lengths were divided")


@pytest.mark.parametrize("seed", range(4))
def test_no_factor_is_named_where_the_rotations_do_not_fit(seed):
    poses = uq.simulate(20, noise=NOISE, seed=seed)
    shuffled = poses.camera[np.random.default_rng(seed).permutation(20)]
    assert other_readings(uq.PosePairs(poses.robot, shuffled), 0.5, 1e3) == []
    kinds = [reading["kind"] for reading in other_readings(uq.PosePairs(poses.robot, inverse(poses.camera)), 0.5, 1e3)]
    assert kinds == ["inverse camera", "inverse robot"]


@pytest.mark.slow
def test_the_same_file_twice_is_what_the_headline_says():
    poses = uq.simulate(15, noise=NOISE, seed=2)
    with pytest.warns(uq.InputWarning):
        result = uq.calibrate(uq.PosePairs(poses.robot, poses.robot))
    assert result.headline == "NOT USABLE: robot and camera file hold the same poses."
    assert result.findings[0].code == "input_checks.same_file"


@pytest.mark.parametrize(("file", "option"), [("robot", "--rotation robot"), ("camera", "--rotation camera")])
def test_transposed_rotations_are_named(file, option):
    poses = uq.simulate(15, noise=NOISE, seed=2)
    T = getattr(poses, file).copy()
    T[:, :3, :3] = np.swapaxes(T[:, :3, :3], 1, 2)
    wrong = replace(poses, **{file: T})
    with pytest.warns(uq.InputWarning):
        result = uq.calibrate(wrong, noise=NOISE)
    assert f"{option}=transposed" in " ".join(map(str, result.findings))


@pytest.mark.parametrize("axis", [0, 1])
def test_a_left_handed_camera_is_named(good, axis):
    """Poses as a flat target gives them, which stay rotations when the points are mirrored."""
    mirror, flat = np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0])
    mirror[axis, axis] = -1.0
    poses = uq.PosePairs(good.robot, mirror @ good.camera @ flat, setup=good.setup)
    found = check_fit(poses, good.truth.X, None, None)
    (finding,) = [one for one in found if one.code == "input_checks.poses_unexplained"]
    assert finding.values["readings"][0]["kind"] == "mirrored"
    assert "is left-handed" in str(finding) and "left-handed" in finding.phrase
    assert "right-handed frame" in step_after(found)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_tag_of_another_size_in_a_bag_names_its_option(factor):
    """Also beside an outlier, and with noise that would make the factor of short motions too small."""
    noise = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.3deg", "2mm"))
    good = uq.simulate(60, noise=noise, seed=4)
    camera = good.camera.copy()
    camera[:, :3, 3] *= factor
    camera[7, :3, :3] = camera[7, :3, :3] @ Rotation.from_rotvec([0.0, np.radians(8), 0.0]).as_matrix()
    source = Source("cell.mcap", "rosbag", 1, "0", ())
    poses = uq.PosePairs(good.robot, camera, sources=(source, source))
    found = check_fit(poses, good.truth.X, None, None)
    (reading,) = [one for one in found if one.code in ("input_checks.wrong_scale", "input_checks.poses_unexplained")]
    assert reading.severity == "failure"
    values = reading.values.get("reading") or reading.values["readings"][0]
    assert values["factor"] == pytest.approx(1 / factor, rel=0.01)
    assert "the size of the tag is wrong, that of --tag" in str(reading) and "units" not in str(reading)
    assert "correct --tag" in step_after(found) and "the tag seems to be" in reading.phrase


@pytest.mark.parametrize("side", ["robot", "camera"])
@pytest.mark.parametrize("inverted", ["robot", "camera"])
def test_inverse_poses_in_millimetres_are_named_at_once(side, inverted):
    """Neither fault alone restores the fit; both options together do."""
    poses = uq.simulate(15, noise=NOISE, seed=2)
    files = {"robot": np.array(poses.robot), "camera": np.array(poses.camera)}
    files[inverted] = inverse(files[inverted])
    files[side] = millimetres(files[side])
    wrong = uq.PosePairs(files["robot"], files["camera"])
    (found,) = [one for one in check_input(wrong) if one.code == "input_checks.poses_unexplained"]
    options = {"robot": "--robot-frame gripper_T_base", "camera": "--camera-frame target_T_camera"}
    assert options[inverted] in str(found)
    for text in (str(found), found.remedy):
        assert f"--units {side}=mm" in text and ("--setup" in text or "-frame" in text)
