"""Input that is wrong in ways that a result can hide: what counts, what is said, and what a program reads."""

import json
import warnings

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.rigs import NOISE, quietly
from scipy.spatial.transform import Rotation
from support import moved

import uq_handeye as uq
from uq_handeye.calibration.report.answer import next_step
from uq_handeye.cli.exit_status import ExitStatus

POSES = uq.simulate(20, noise=NOISE, seed=3)


def scaled(poses, factor, rows=slice(None), side="camera"):
    T = {"robot": poses.robot.copy(), "camera": poses.camera.copy()}
    T[side][rows, :3, 3] *= factor
    return uq.PosePairs(T["robot"], T["camera"])


def codes(result):
    return {finding.code for finding in result.findings}


@pytest.mark.slow
@pytest.mark.parametrize("rows", [[*range(20), 1], [*range(20), *range(20)], [0, 1, 2, 1, *range(3, 20)]])
@pytest.mark.parametrize("noise", [None, NOISE])
def test_what_is_given_again_counts_once(rows, noise):
    """X, its covariance and the noise are those of the poses without the repeats, wherever these stand."""
    alone = quietly(uq.PosePairs(POSES.robot, POSES.camera), noise=noise)
    found = quietly(uq.PosePairs(POSES.robot[rows], POSES.camera[rows]), noise=noise)
    np.testing.assert_allclose(found.X, alone.X, atol=1e-7)
    np.testing.assert_allclose(found.std, alone.std, rtol=1e-3)
    assert found.n_poses == 20 and len(found.excluded) == len(rows) - 20 and found.data.n == len(rows)
    assert "input_checks.repeated_rows" in codes(found) and "calibration.excluded" not in codes(found)


def test_what_is_excluded_and_what_is_given_again():
    rows = [*range(20), 4, 5]
    found = quietly(uq.PosePairs(POSES.robot[rows], POSES.camera[rows]), noise=NOISE, exclude=[0, 4])
    assert found.excluded == (0, 4, 21)  # 20 is the only one left of its kind
    said = next(one for one in found.findings if one.code == "calibration.excluded")
    assert said.values["excluded"] == [0, 4] and "rows 21 " not in str(said)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["robot", "camera"])
def test_one_pose_in_another_unit_is_named_and_reaches_no_number(side):
    alone = quietly(uq.PosePairs(POSES.robot, POSES.camera))
    found = quietly(scaled(POSES, 1000.0, [7], side))
    assert 7 in found.table.flagged and found.usable
    assert found.accuracy.distance == pytest.approx(alone.accuracy.distance, rel=0.05)
    assert found.accuracy.point == pytest.approx(alone.accuracy.point, rel=0.3)
    far = next(one for one in found.findings if one.code == "input_checks.far")
    assert far.values["rows"] == [7] and f"Row 7 of the {side} poses" in str(far)
    assert "--exclude 7" in next_step(found) and "-units" not in next_step(found)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.94, 0.98, 1.02, 1.06])
def test_a_target_of_another_size_is_measured_alike_larger_or_smaller(factor):
    """No unit and no refusal: the size is found, and X is as good as with the right one."""
    found, right = quietly(scaled(POSES, factor)), quietly(uq.PosePairs(POSES.robot, POSES.camera))
    assert found.usable and "calibration.target_size" in codes(found)
    assert not codes(found) & {"input_checks.wrong_scale", "input_checks.poses_unexplained"}
    size = next(one for one in found.findings if one.code == "calibration.target_size")
    assert 1 + size.values["estimate"] == pytest.approx(factor, abs=0.004)
    assert "printer" in str(size)
    assert np.linalg.norm(found.X[:3, 3] - right.X[:3, 3]) < 2 * right.accuracy.translation


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "words"),
    [(1000.0, "in mm"), (0.001, "in m"), (1 / 0.0254, "in in"), (10.0, "different units"), (2.0, "times as large")],
)
def test_factors_are_named_by_what_they_are(factor, words):
    try:
        said = quietly(scaled(POSES, factor)).headline
    except uq.NotConvergedError as error:
        said = " ".join(map(str, error.findings))
        words = {"different units": "one file is in another unit"}.get(words, words)
    assert words in said


@pytest.mark.slow
def test_rigs_without_size_are_named():
    found = quietly(scaled(scaled(POSES, 1e-6), 1e-6, side="robot"))
    assert found.headline.startswith("NOT USABLE: both files seem to be in a larger unit")


@pytest.mark.parametrize("factor", [0.05, 20.0])
def test_a_noise_that_residuals_contradict_is_never_ok(factor):
    noise = uq.PoseNoise(factor**2 * NOISE.robot, factor**2 * NOISE.camera)
    found = quietly(uq.PosePairs(POSES.robot, POSES.camera), noise=noise)
    level = next(check for check in found.checks if check.name == "noise level")
    assert found.fit.p_value < 1e-6 and level.status != "ok" and "times" in level.text


@pytest.fixture(scope="module")
def parallel(tmp_path_factory):
    """Files of poses that rotate about one axis."""
    rng = np.random.default_rng(1)
    folder = tmp_path_factory.mktemp("parallel")
    G = np.tile(np.eye(4), (15, 1, 1))
    angle = rng.uniform(-1.5, 1.5, 15)
    G[:, 0, 0], G[:, 1, 1], G[:, 0, 1], G[:, 1, 0] = np.cos(angle), np.cos(angle), -np.sin(angle), np.sin(angle)
    G[:, :3, 3] = rng.uniform(-0.3, 0.3, (15, 3)) + np.array([0.5, 0, 0.5])
    X, W = uq.simulate(3, seed=1).truth[:2]
    C = np.linalg.inv(G @ X) @ W
    C = moved(C, rng.normal(0, 3e-4, (15, 6)))
    for name, T in (("robot", G), ("camera", C)):
        np.savetxt(folder / f"{name}.txt", T.reshape(15, 16))
    return folder


@pytest.mark.slow
def test_what_is_answered_in_part_is_not_usable_and_has_a_status(parallel, tmp_path):
    """Programs read `usable` or the exit status; X along the axis is one of all that fit."""
    done = run("calibrate", parallel / "robot.txt", parallel / "camera.txt", "--json", "-o", tmp_path / "out")
    found = json.loads(done.stdout)
    assert done.returncode == ExitStatus.IN_PART == 6
    assert found["usable"] is False and found["answered"] == "in part" and found["open"]
    result = uq.Calibration.from_json(tmp_path / "out" / "result.json")
    assert not result.usable and result.answered == "in part" and result.reasons == ()
    assert "Not determined: " in result.headline and np.linalg.norm(result.X[:3, 3]) < 1.0
    written = run("export", tmp_path / "out" / "result.json", tmp_path / "x.urdf")
    assert (
        written.returncode == ExitStatus.IN_PART
        and "Not determined: " in written.stderr
        and (tmp_path / "x.urdf").exists()
    )
    asked = run("report", tmp_path / "out" / "result.json", "--tolerance", "1mm")
    assert asked.returncode == 5


def test_exact_rotations_beside_noise_are_no_internal_error(parallel):
    """One axis, and rotation residuals of zero: an answer or one line, never an error of linear algebra."""
    G, C = (np.loadtxt(parallel / f"{name}.txt").reshape(-1, 4, 4) for name in ("robot", "camera"))
    G = G.copy()
    X, W = uq.simulate(3, seed=1).truth[:2]
    exact = np.linalg.inv(G @ X) @ W
    exact[:, :3, 3] = C[:, :3, 3]
    try:
        found = quietly(uq.PosePairs(G, exact))
    except (uq.InputError, uq.NotConvergedError):
        return
    assert not found.usable


@pytest.mark.slow
def test_a_result_that_is_open_in_part_is_read_again(tmp_path):
    """Rotations of 0.3 deg about other axes: a direction of X is open, and the bound of its numbers is 0."""
    rng = np.random.default_rng(2)
    truth = uq.simulate(15, seed=3).truth
    robot = np.tile(np.eye(4), (12, 1, 1))
    turns = np.outer(np.linspace(0, 2, 12), [0, 0, 1]) + 0.005 * rng.normal(size=(12, 3))
    robot[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    robot[:, :3, 3] = rng.uniform(-0.3, 0.3, (12, 3))
    camera = np.linalg.inv(robot @ truth.X) @ truth.W
    camera[:, :3, :3] = camera[:, :3, :3] @ Rotation.from_rotvec(1.7e-3 * rng.normal(size=(12, 3))).as_matrix()
    camera[:, :3, 3] += 5e-4 * rng.normal(size=(12, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", uq.InputWarning)
        result = uq.calibrate(uq.PosePairs(robot, camera))
        again = uq.load(result.save(tmp_path / "result.json"))
    assert result.opened is not None and not result.usable and not again.usable
    np.testing.assert_array_equal(again.X, result.X)
    result.report(tmp_path / "report.html", comparison=False)


def half_wrong(kind, seed=5, n=30):
    """Poses of which 15 of 30 are wrong, the first five among them."""
    rng = np.random.default_rng(seed)
    poses = uq.simulate(n, noise=NOISE, seed=seed)
    camera = poses.camera.copy()
    wrong = np.r_[:5, 5 + rng.permutation(n - 5)[:10]]
    for k in wrong:
        if kind == "anywhere":
            camera[k, :3, :3] = Rotation.random(random_state=rng).as_matrix()
            camera[k, :3, 3] += rng.normal(scale=0.3, size=3)
        else:  # the other solution of a planar target
            about = rng.uniform(0.0, 2.0 * np.pi)
            turn = rng.uniform(0.5, 1.2) * np.array([np.cos(about), np.sin(about), 0.0])
            camera[k, :3, :3] = camera[k, :3, :3] @ Rotation.from_rotvec(turn).as_matrix()
    return uq.PosePairs(poses.robot, camera), wrong, poses.truth.X


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["anywhere", "flipped"])
def test_half_of_the_poses_may_be_wrong_also_in_a_row(kind):
    """They are no move of the board, no other reading of the files, and no noise of 20 deg."""
    poses, wrong, X = half_wrong(kind)
    found = quietly(poses)
    assert found.usable, found.reasons
    assert set(wrong) <= set(found.table.flagged) and len(found.table.flagged) <= len(wrong) + 2
    assert np.linalg.norm(found.X[:3, 3] - X[:3, 3]) < 5.0 * np.linalg.norm(found.std[3:])
