"""Warnings about input that looks wrong: each is given where it should be, and only there."""

import os
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from fixtures.rigs import quietly
from scipy.spatial.transform import Rotation
from support import difference, moved

import uq_handeye as uq
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.fit.diagnostics.columns import check_poses
from uq_handeye.fit.diagnostics.residuals import check_fit
from uq_handeye.model.poses.residuals import residuals, rotation_angles, summarise
from uq_handeye.read import pose_text

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
needs_data = pytest.mark.skipif("UQ_HANDEYE_DATA" not in os.environ, reason="UQ_HANDEYE_DATA is not set")


def said(poses, noise=NOISE, **options):
    """All warnings of a calibration, which need not succeed."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = uq.calibrate(poses, noise=noise, **options)
            assert result.warnings == tuple(str(item.message) for item in caught)
        except (uq.DegenerateMotionError, uq.NotConvergedError):
            pass
    assert all(item.category is uq.InputWarning for item in caught)
    return " | ".join(str(item.message) for item in caught)


def changed(poses, robot=None, camera=None, setup=None):
    return uq.PosePairs(
        poses.robot if robot is None else robot, poses.camera if camera is None else camera, setup or poses.setup
    )


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def good(request):
    return uq.simulate(25, noise=NOISE, setup=request.param, seed=2)


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
@pytest.mark.parametrize("noise", [NOISE, uq.PoseNoise.isotropic(camera=("1deg", "5mm"))])
def test_nothing_is_said_about_good_data(setup, noise):
    for seed in range(20):
        assert said(uq.simulate(25, noise=noise, setup=setup, seed=seed), noise) == ""


@pytest.mark.slow
def test_wrong_setup_and_inverted_files(good):
    other = "eye-to-hand" if good.setup == "eye-in-hand" else "eye-in-hand"
    for wrong in (
        changed(good, setup=other),
        changed(good, robot=np.linalg.inv(good.robot)),
        changed(good, camera=np.linalg.inv(good.camera)),
    ):
        text = said(wrong)
        assert "X does not explain the poses" in text
        assert "It would fit if" in text
        assert "or if the" in text
        assert "target_T_camera" in text
    length = np.linalg.norm(good.truth.X[:3, 3])
    text = said(changed(good, setup=other))
    assert f"the setup is {good.setup}, or the robot file holds inverse poses (X would be {length:.2g}"[:-1] in text


@pytest.mark.slow
def test_swapped_files(good):
    if good.setup == "eye-in-hand":
        assert "files are swapped" in said(changed(good, robot=good.camera, camera=good.robot))
    assert "hold inverse poses" in said(
        changed(good, robot=np.linalg.inv(good.robot), camera=np.linalg.inv(good.camera))
    )


@pytest.mark.slow
def test_wrong_pairing(good):
    for shift in (1, 5):
        text = said(changed(good, camera=np.roll(good.camera, shift, axis=0)))
        assert f"robot row i belongs to camera row i + {shift}" in text
        assert "halves" not in text and "contradict" not in text  # which the shift explains
    text = said(changed(good, camera=good.camera[np.random.default_rng(1).permutation(good.n)]))
    assert "disagree on the rotation angles" in text and "No shift of the rows" in text


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_large_noise_is_no_wrong_pairing(setup):
    """Rows belong together whose rotations differ by far less than rotations do by chance."""
    large = uq.PoseNoise.isotropic(robot=("1deg", "5mm"), camera=("3deg", "20mm"))
    found = quietly(uq.simulate(15, noise=large, seed=4, setup=setup)).findings
    angles = [one for one in found if one.code == "input_checks.angles_disagree"]
    assert angles and angles[0].severity == "caution" and "Noise of that size can be the cause" in str(angles[0])


def test_a_row_in_another_unit_leaves_the_lengths():
    poses = uq.simulate(20, noise=NOISE, seed=3, setup="eye-to-hand")
    camera = poses.camera.copy()
    camera[7, :3, 3] *= 1000
    codes = {one.code for one in quietly(changed(poses, camera=camera)).findings}
    assert "input_checks.far" in codes and "input_checks.setup_by_lengths" not in codes


def test_both_files_in_millimetres_are_refused_unless_metres_are_stated(tmp_path):
    """Robot and camera agree as well as in metres, so that only the lengths tell."""
    poses = uq.simulate(12, noise=NOISE, seed=3)
    files = tmp_path / "robot.csv", tmp_path / "camera.csv"
    for file, T in zip(files, (poses.robot, poses.camera), strict=True):
        T = T.copy()
        T[:, :3, 3] *= 1000
        file.write_text(pose_text(T))
    found = quietly(uq.read_poses(*files))
    assert not found.usable and found.headline == "NOT USABLE: robot and camera translations look like mm."
    assert "--units mm;" in next_step(found)
    for units, severity in (("mm", None), ("m", None), (("m", None), "caution")):
        of = [one for one in quietly(uq.read_poses(*files, units=units)).findings if one.code == "input_checks.far"]
        assert {one.severity for one in of} == ({severity} - {None})


@pytest.mark.slow
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_the_noise_given_is_only_blamed_where_it_was_given(setup):
    poses = uq.simulate(20, noise=NOISE, seed=3, setup=setup)
    for index in (sorted(range(20), key=str), np.arange(20)[::-1]):
        try:
            found = quietly(changed(poses, camera=poses.camera[index])).findings
        except (uq.InputError, uq.NotConvergedError) as error:
            found, text = error.findings, str(error)
            assert "noise given" not in text
        assert "noise given" not in " ".join(map(str, found))


def test_one_wrong_detection():
    good = uq.simulate(40, noise=NOISE, seed=2)
    camera = good.camera.copy()
    camera[7, :3, :3] = camera[7, :3, :3] @ Rotation.from_rotvec([0, 0, np.pi]).as_matrix()  # the board's half-turn
    text = said(changed(good, camera=camera))
    assert "rotation angles" not in text  # those of the rows that count agree
    assert "1 of 40 poses was rejected" in text
    assert "pose 7 (" in text
    assert "The board is turned by half a turn in view 7 (counted from 0)" in text


@pytest.mark.slow
def test_millimetres(good):
    robot = good.robot.copy()
    robot[:, :3, 3] *= 1000
    text = said(changed(good, robot=robot))
    assert "robot translations reach" in text
    assert "look like millimetres" in text
    assert "camera translations reach" not in text


@pytest.mark.slow
def test_columns(good):
    robot = good.robot.copy()
    robot[:, 2, 3] = robot[:, 1, 3]
    assert "Columns y and z of the robot poses are identical in all 25 rows" in said(changed(good, robot=robot))
    robot[:, 2, 3] = 0.3
    assert "Column z of the robot poses is constant (0.3)" in said(changed(good, robot=robot))
    camera = good.camera.copy()
    camera[4] = camera[3]
    assert "1 of 25 camera poses repeat the row before" in said(changed(good, camera=camera))


def turning(vectors, noise=NOISE):
    """Poses that turn by the rotation vectors given, camera and target of the simulator."""
    truth = uq.simulate(3, seed=0).truth
    robot = np.tile(np.eye(4), (len(vectors), 1, 1))
    robot[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    robot[:, :3, 3] = np.random.default_rng(0).uniform(-0.3, 0.3, (len(vectors), 3))
    camera = np.linalg.inv(robot @ truth.X) @ truth.W
    return uq.PosePairs(robot, camera)


def test_half_turns():
    rng = np.random.default_rng(1)
    axes = rng.normal(size=(12, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    vectors = np.zeros((24, 3))
    vectors[1::2] = axes * np.radians(rng.uniform(165, 178, (12, 1)))  # disjoint pairs turn by almost 180 degrees
    text = said(turning(vectors), noise=None, method="4dpa", pairs="disjoint")
    assert "100 % of the motions rotate by more than 150 degrees" in text
    assert "sin^2(angle)" in text


def test_small_angles_and_parallel_axes():
    rng = np.random.default_rng(1)
    assert "which amplifies the noise" in said(turning(rng.uniform(-0.02, 0.02, (20, 3))), noise=None)
    vectors = rng.uniform(-1, 1, (20, 3)) * [0.01, 0.01, 1.5]
    assert "nearly parallel" in said(turning(vectors), noise=None)


def test_residuals_that_the_noise_does_not_explain():
    noise = uq.PoseNoise.isotropic(camera=("0.5deg", "1mm"))
    poses = uq.simulate(25, noise=noise, seed=3)
    small = uq.PoseNoise.isotropic(camera=("0.05deg", "0.1mm"))
    assert "times what the noise given explains" in said(poses, small)
    assert "seem too large" in said(poses, uq.PoseNoise.isotropic(camera=("5deg", "10mm")))
    assert "more than the noise given explains" in said(poses, uq.PoseNoise(camera=np.diag([0, 0, 0, 1, 1, 1]) * 1e-6))
    each = uq.PoseNoise(robot=np.tile(small.camera, (25, 1, 1)), camera=np.kron(np.eye(25), small.camera))
    assert "times what the noise given explains" in said(poses, each)


def test_residuals_are_those_of_the_definition(rng):
    poses = uq.simulate(10, noise=NOISE, seed=4)
    motions = uq.relative_motions(poses, "all")
    X = poses.truth.X
    angle, distance = residuals(motions.A, motions.B, X)
    left, right = motions.A @ X, X @ motions.B
    expected = np.linalg.norm(
        Rotation.from_matrix(left[:, :3, :3] @ right[:, :3, :3].transpose(0, 2, 1)).as_rotvec(), axis=1
    )
    np.testing.assert_allclose(angle, expected, rtol=1e-9)
    np.testing.assert_allclose(distance, np.linalg.norm(left[:, :3, 3] - right[:, :3, 3], axis=1), rtol=1e-12)
    summary = summarise(angle, distance)
    assert summary.error == pytest.approx(np.sqrt(((left - right) ** 2).sum()) / 45)  # (62)


@pytest.mark.parametrize("angle", [0.0, *np.logspace(-12, 0, 13), 3.0, *(np.pi - np.logspace(-1, -8, 8)), np.pi])
def test_rotation_angles(angle):
    R = Rotation.from_rotvec(angle * np.array([0.6, 0.0, -0.8])).as_matrix()
    assert rotation_angles(R) == pytest.approx(angle, rel=1e-12, abs=1e-15)


def quaternion_order(T):
    """Return what a reader makes of a file that has w, x, y, z under the header x, y, z, w."""
    wrong = T.copy()
    wrong[:, :3, :3] = Rotation.from_quat(np.roll(Rotation.from_matrix(T[:, :3, :3]).as_quat(), 1, axis=1)).as_matrix()
    return wrong


def rescaled(T, factor):
    wrong = T.copy()
    wrong[:, :3, 3] *= factor
    return wrong


@pytest.mark.slow
def test_quaternion_order(good):
    for files, which in (
        (("robot",), "the robot file"),
        (("camera",), "the camera file"),
        (("robot", "camera"), "both"),
    ):
        text = said(changed(good, **{name: quaternion_order(getattr(good, name)) for name in files}))
        assert f"It would fit if {which}" in text or f"or if {which}" in text
        assert "the scalar of the quaternion first" in text
        assert "inverse poses" not in text  # which would fit in rotation alone


@pytest.mark.slow
@pytest.mark.parametrize("noise", [NOISE, None])
@pytest.mark.parametrize("factor", [0.001, 0.0254, 0.5, 1.25, 10, 1000])
def test_units_of_one_file(good, factor, noise):
    text = said(changed(good, camera=rescaled(good.camera, factor)), noise)
    assert "X does not explain the poses" in text or "do not match" in text
    found = re.search(r"multiplied by ([0-9.e+-]+):", text)
    assert float(found[1]) == pytest.approx(1 / factor, rel=0.02)
    assert "swapped" not in text


def test_size_of_the_target_with_noise(good):
    text = said(changed(good, camera=rescaled(good.camera, 0.9)))
    assert "The translations of robot and camera do not match" in text


@pytest.mark.slow
@pytest.mark.parametrize("millimetres", [10, 30, 300])
@pytest.mark.parametrize("noise", [NOISE, None])
def test_one_translation(millimetres, noise):
    good = uq.simulate(25, noise=NOISE, seed=2)
    camera = good.camera.copy()
    camera[11, 0, 3] += 1e-3 * millimetres
    text = said(changed(good, camera=camera), noise)
    assert "1 of 25 poses" in text and "outlier" in text
    assert "pose 11 (" in text


def test_one_rotation():
    good = uq.simulate(25, noise=NOISE, seed=2)
    camera = good.camera.copy()
    camera[3, :3, :3] = camera[3, :3, :3] @ Rotation.from_rotvec([0, np.radians(2), 0]).as_matrix()
    for noise in (NOISE, None):
        assert "pose 3 (" in said(changed(good, camera=camera), noise)


def test_single_poses_are_named_once():
    """The fit names them where it judged each by its own noise, their residuals where no fit did."""
    good = uq.simulate(25, noise=NOISE, seed=2)
    camera = good.camera.copy()
    camera[11, 0, 3] += 0.03
    wrong = changed(good, camera=camera)
    codes = [[one.code for one in check_fit(wrong, good.truth.X, None, None, judged=judged)] for judged in (0, 1)]
    assert codes == [["input_checks.outliers"], []]
    text = said(wrong, NOISE, robust=False)
    assert text.count("pose 11 (") == 1 and "biases X" in text


@pytest.mark.slow
def test_poses_of_a_small_tag_differ_as_their_covariances_do():
    """Those that see it frontally are worse by a factor of 20, which is no sign of outliers; one that is wrong is."""
    rng = np.random.default_rng(0)
    C = np.tile(np.eye(4), (50, 1, 1))
    tilt = (
        np.where(np.arange(50) % 8, rng.uniform(0.5, 0.9, 50), 0.03)[:, None]
        * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])[rng.integers(0, 2, 50)]
    )
    C[:, :3, :3] = Rotation.from_rotvec(tilt).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    C[:, :3, :3] = C[:, :3, :3] @ Rotation.from_euler("z", rng.uniform(-2, 2, (50, 1))).as_matrix()
    C[:, :3, 3] = rng.uniform([-0.1, -0.1, 0.45], [0.1, 0.1, 0.55], (50, 3))
    tag = (uq.tag_points(0.03), (900.0, 900.0, 640.0, 360.0), "exact")
    X, W = uq.simulate(4, seed=0).truth.X, np.eye(4)
    G = moved(W @ np.linalg.inv(C) @ np.linalg.inv(X), 1e-5 * rng.normal(size=(50, 6)))
    own = uq.camera_noise(C, *tag, pixel_sd=0.1).covariance()
    blocks = np.asarray(getattr(own, "own", own))
    roots = np.linalg.cholesky(blocks)
    assert np.ptp(np.log(np.trace(blocks[:, :3, :3], axis1=1, axis2=2))) > 2 * np.log(8)
    camera = moved(C, (roots @ rng.normal(size=(50, 6, 1)))[..., 0])
    noise = uq.camera_noise(camera, *tag)
    assert "much worse than" not in said(uq.PosePairs(G, camera), noise, robust=False)
    k = int(np.argmin(np.trace(blocks, axis1=1, axis2=2)))
    camera[k, :3, 3] += 0.02
    assert f"pose {k} (" in said(uq.PosePairs(G, camera), noise, robust=False)


@pytest.mark.slow
def test_axes_exchanged_and_drift(good):
    robot = good.robot.copy()
    robot[:, :2, 3] = robot[:, [1, 0], 3]
    assert "X does not explain the poses" in said(changed(good, robot=robot), noise=None)
    robot = good.robot.copy()
    robot[:, 0, 3] += np.linspace(0, 1, 25)
    assert said(changed(good, robot=robot), noise=None) != ""


def test_motions_without_poses():
    motions = uq.relative_motions(uq.simulate(25, noise=NOISE, seed=3))
    noise = uq.PairNoise.isotropic(A=("0.03deg", "0.07mm"), B=("0.14deg", "1.2mm"))
    assert said(uq.Motions(motions.A, motions.B), noise) == ""
    B = motions.B.copy()
    B[3, :3, 3] += 5
    text = said(uq.Motions(motions.A, B), noise)
    assert "translation residuals of the motions" in text
    assert "X does not explain the motions" in text
    assert "seem too large" in said(
        uq.Motions(motions.A, motions.B), uq.PairNoise.isotropic(A=("1deg", "10mm"), B=("1deg", "10mm"))
    )


@pytest.mark.slow
@pytest.mark.parametrize("deviation", ["2deg", "3deg", "5deg"])
def test_large_but_honest_noise(deviation):
    noise = uq.PoseNoise.isotropic(camera=(deviation, "20mm"))
    for seed in range(10):
        text = said(uq.simulate(25, noise=noise, seed=seed), noise)
        assert "No shift of the rows" not in text
        assert "overstated" not in text
        assert "too small" not in text


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, 4, 5])
def test_few_poses_are_no_sign_of_overstated_noise(n):
    texts = [said(uq.simulate(n, noise=NOISE, seed=seed)) for seed in range(200)]
    assert sum("overstated" in text for text in texts) <= 1


def unanswered(poses, noise):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            uq.calibrate(poses, noise=noise)
        except uq.DegenerateMotionError:
            return True
    return False


def assert_open(poses, noise, exact):
    """The answer says that translations of X are open, has no finite deviations there, and is right for the rest."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        result = uq.calibrate(poses, noise=noise)
    truth = uq.simulate(3, seed=0).truth.X
    assert "calibration.open" in [found.code for found in result.findings if found.severity == "caution"]
    assert len(result.open_directions) == (1 if np.ptp(exact.robot[:, :3, :3], axis=0).any() else 3)
    told = np.isfinite(result.std)
    assert told[:3].all() and not told[3:].all()
    assert (np.abs(difference(result.X, truth)) < 5 * result.std)[told].all()


@pytest.mark.slow
@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("kind", ["half turns", "planar", "translations"])
def test_rotations_lost_in_the_noise_are_no_answer(kind, given):
    noise = uq.PoseNoise.isotropic(robot=("0.1deg", "0.1mm"), camera=("0.1deg", "0.5mm"))
    vectors = {
        "half turns": np.pi * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float),
        "planar": np.random.default_rng(0).uniform(-2, 2, (20, 1)) * [0.0, 0.6, 0.8],
        "translations": np.zeros((20, 3)),
    }[kind]
    exact = turning(vectors)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        poses = changed(
            exact,
            robot=moved(exact.robot, rng.normal(size=(len(vectors), 6)) * np.sqrt(np.diag(noise.robot))),
            camera=moved(exact.camera, rng.normal(size=(len(vectors), 6)) * np.sqrt(np.diag(noise.camera))),
        )
        if kind == "half turns":
            assert unanswered(poses, noise if given else None)
        else:
            assert_open(poses, noise if given else None, exact)


QUIET = {
    "camera turns": (uq.PoseNoise.isotropic(camera=("0.3deg", "0.05mm")), {}),
    "rotation only": (uq.PoseNoise(camera=np.diag([1e-6] * 3 + [0] * 3)), {}),
    "robot turns": (
        uq.PoseNoise.isotropic(robot=("0.1deg", "0.02mm")),
        {"setup": "eye-to-hand", "distance": (1.7, 2.6)},
    ),
    "narrow": (uq.PoseNoise.isotropic(camera=("0.5deg", "1mm")), {"n_poses": 200, "tilt": "3deg", "roll": "3deg"}),
    "many": (uq.PoseNoise.isotropic(camera=("2deg", "1mm")), {"n_poses": 1000, "tilt": "5deg", "roll": "5deg"}),
    "three": (uq.PoseNoise.isotropic(camera=("0.1deg", "0.5mm")), {"n_poses": 3}),
    "common": (uq.PoseNoise(camera=np.kron(25 * np.ones((20, 20)) + np.eye(20), np.diag([1e-6] * 3 + [1e-7] * 3))), {}),
    "unequal": (uq.PoseNoise(camera=np.eye(6) * np.logspace(-8, -5, 20)[:, None, None]), {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", QUIET)
def test_nothing_is_said_about_noise_that_was_declared(case):
    noise, options = QUIET[case]
    for seed in range(15):
        text = said(uq.simulate(**({"n_poses": 20} | options), noise=noise, seed=seed), noise)
        assert "residuals" not in text
        assert "much worse" not in text
        assert "does not explain" not in text


def test_a_head_that_only_turns():
    """No travel of the gripper at all: turning about the tool centre point, a pan-tilt head."""
    noise = uq.PoseNoise.isotropic(camera=("0.1deg", "1mm"))
    rng = np.random.default_rng(0)
    poses = turning(rng.uniform(-0.6, 0.6, (20, 3)))
    robot = rescaled(poses.robot, 0.0)
    truth = uq.simulate(3, seed=0).truth
    camera = moved(np.linalg.inv(robot @ truth.X) @ truth.W, rng.normal(size=(20, 6)) * np.sqrt(np.diag(noise.camera)))
    for given in (noise, None):
        text = said(uq.PosePairs(robot, camera), given)
        assert "does not explain" not in text
        assert "residuals" not in text


def test_same_file_twice(good):
    assert "the same file was given twice" in said(changed(good, camera=good.robot))


@pytest.mark.slow
@needs_data
@pytest.mark.parametrize("name", ["kuka_1", "synthetic_camera_2"])
def test_good_real_data(name):
    """Nothing is said about files, frames and units; single poses and the residuals are another matter."""
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / name
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    assert said(poses, noise=None, method="4dpa") == ""
    text = said(poses, noise=None)
    assert "does not explain" not in text
    assert "rows of the two files" not in text


@pytest.mark.slow
@needs_data
@pytest.mark.parametrize("noise", [NOISE, None])
def test_the_data_set_of_the_paper_does_not_pass_silently(noise):
    folder = Path(os.environ["UQ_HANDEYE_DATA"]) / "wu_2019_as_published"
    poses = uq.read_poses(folder / "robot.csv", folder / "camera.csv")
    text = said(poses, noise)
    assert "Columns y and z of the robot poses are identical in all 224 rows" in text
    assert "No shift of the rows" in text
    assert unanswered(poses, noise)


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "mm"), (100.0, "cm")])
def test_the_unit_that_is_named_is_the_right_one(good, factor, unit):
    robot, camera = good.robot.copy(), good.camera.copy()
    robot[:, :3, 3] *= factor / np.abs(robot[:, :3, 3]).max()  # reaching one metre
    camera[:, :3, 3] *= 0.6 * factor / np.abs(camera[:, :3, 3]).max()
    texts = [str(found) for found in check_poses(uq.PosePairs(robot, camera))]
    for side in ("robot=", "camera=") if unit != "mm" else ("",):  # both in millimetres agree with each other
        assert any(f"--units {side}{unit}" in text for text in texts)


def test_noise_in_a_wrong_unit_is_named(good):
    with pytest.raises(uq.DegenerateMotionError, match=r"The noise given hides the motions: .* Check its units"):
        quietly(good, noise=uq.PoseNoise.isotropic(robot=(20.0, 0.05), camera=(100.0, 0.5)))


@pytest.mark.slow
@pytest.mark.parametrize("side", ["robot", "camera"])
def test_a_side_that_did_not_move_is_the_cause_that_is_named(good, side):
    poses = changed(good, **{side: np.repeat(getattr(good, side)[:1], good.n, axis=0)})
    try:
        found = quietly(poses).findings
    except (uq.InputError, uq.NotConvergedError) as error:
        found = error.findings
    assert f"All 25 {side} poses are the same" in " ".join(map(str, found))
    assert {one.code for one in found if one.severity == "failure"} == {"input_checks.still"}
