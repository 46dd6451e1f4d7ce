"""``uq.verify`` and ``uq-handeye verify``: answers, texts, exit status, bad input."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.touches import NOISE, POINT_SD, TOUCH_SD, TRUTH, calibration, touches
from scipy.spatial.transform import Rotation
from support import SEED

import uq_handeye as uq
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.read import write_pose_file
from uq_handeye.use.verification.verify_poses import verify_poses

DEVIATIONS = ("--tcp-sd", "0.2mm", "--point-sd", "0.3mm")


def write_touches(path, case, scale=1.0):
    """Write touches of points, with the robot poses at which they were seen."""
    names = [*(f"seen_{a}" for a in "xyz"), *(f"touched_{a}" for a in "xyz")]
    table = [scale * case.seen, scale * case.touched]
    if case.robot is not None:
        names += [f"seen_at_{a}" for a in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        table += [scale * case.robot[:, :3, 3], Rotation.from_matrix(case.robot[:, :3, :3]).as_quat()]
    rows = [",".join(map(repr, row)) for row in np.hstack(table).tolist()]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """result.json, and touches of a cell in which nothing has changed, and with a bias of 5 mm."""
    folder, rng = tmp_path_factory.mktemp("verify"), np.random.default_rng([SEED, 7])
    result = calibration("eye-in-hand", rng)
    result.to_json(folder / "result.json")
    case = touches("eye-in-hand", rng)
    write_touches(folder / "same.csv", case)
    write_touches(folder / "mm.csv", case, 1e3)
    write_touches(folder / "moved.csv", replace(case, touched=case.touched + np.array([0, 0, 5e-3])))
    return folder, result, case


@pytest.mark.slow
def test_the_command_agrees_with_the_function(cell):
    folder, result, case = cell
    done = run("verify", folder / "result.json", folder / "same.csv", *DEVIATIONS, "--json", "-o", folder / "out")
    found = json.loads(done.stdout)
    expected = uq.verify(result, case)
    assert done.returncode == 0 and found["p_value"] == pytest.approx(expected.p_value)
    np.testing.assert_allclose(found["bias"], expected.bias, atol=1e-12)
    np.testing.assert_allclose(found["covariance"], expected.covariance, rtol=1e-6)
    assert json.loads((folder / "out" / "verification.json").read_text()) == found
    rows = (folder / "out" / "points.csv").read_text().splitlines()
    assert len(rows) == 9 and rows[0].startswith("point,difference_x")


@pytest.mark.slow
def test_a_bias_is_an_exit_status_and_an_answer(cell):
    folder, *_ = cell
    done = run("verify", folder / "result.json", folder / "moved.csv", *DEVIATIONS, "--show", "20mm")
    assert done.returncode == 4
    assert done.stdout.startswith("CONTRADICTED by a bias: 8 touches contradict the calibration")
    assert "A bias of 20 mm would show with 1 such touch." in " ".join(done.stdout.split())
    assert max(map(len, done.stdout.splitlines())) <= 80
    assert "All touches miss by the same vector: " in done.stdout and "calibrate again." in " ".join(
        done.stdout.split()
    )
    assert re.search(r"z \+[45]\.\d mm \(touch minus point", " ".join(done.stdout.split()))
    same = run("verify", folder / "result.json", folder / "same.csv", *DEVIATIONS)
    assert same.returncode == 0 and same.stdout.startswith("AGREES: 8 touches agree")
    assert "same vector" not in same.stdout
    short = run("verify", folder / "result.json", folder / "moved.csv", *DEVIATIONS, "--quiet")
    assert short.returncode == 4 and short.stdout.startswith("CONTRADICTED by a bias")
    assert short.stdout.count("\n") <= 2


@pytest.mark.slow
def test_millimetres_are_recognised(cell):
    folder, *_ = cell
    done = run("verify", folder / "result.json", folder / "mm.csv", *DEVIATIONS)
    assert done.returncode == 2 and "seem to be in mm. Give --units mm" in done.stderr
    assert run("verify", folder / "result.json", folder / "mm.csv", *DEVIATIONS, "--units", "mm").returncode == 0
    small = run("verify", folder / "result.json", folder / "same.csv", *DEVIATIONS, "--units", "mm")
    assert small.returncode == 2 and "Give --units m." in small.stderr


@pytest.mark.slow
def test_inverted_robot_poses_are_named(cell):
    _, result, case = cell
    found = uq.verify(result, replace(case, robot=inverse(case.robot)))
    assert found.contradicted and found.findings[0].code == "verification.inverted_robot"


def test_one_touch_and_one_wrong_point(cell):
    _, result, case = cell
    one = uq.verify(result, case.rows([0]))
    assert one.scatter_p_value is None and one.p_value == one.bias_p_value and one.dof == 3
    assert "offset only" in one.summary()
    wrong = case.touched.copy()
    wrong[2] += [0, 0.01, 0]
    found = uq.verify(result, replace(case, touched=wrong, names=tuple("abcdefgh")))
    assert found.contradicted and found.points.flagged.tolist() == [k == 2 for k in range(8)]
    assert found.scatter_p_value < 1e-6 and "1 of 8 points differs" in found.summary()
    assert "such as" not in found.summary()


@pytest.mark.slow
def test_the_next_touch_tells_what_it_promises(cell):
    """The detectable bias after the proposed touches, by touches made there."""
    _, result, case = cell
    found = uq.verify(result, case)
    assert found.detectable > found.next[0].detectable > found.next[-1].detectable
    best = found.next[0]
    more = {"seen": best.seen, "touched": best.base, "robot": case.robot[best.view], "touch_sd": TOUCH_SD}
    parts = {name: np.concatenate([getattr(case, name), np.array(value)[None]]) for name, value in more.items()}
    both = replace(case, **parts, seen_covariance=POINT_SD**2 * np.eye(3), names=())
    assert uq.verify(result, both).detectable == pytest.approx(best.detectable, rel=1e-3)
    given = uq.verify(result, case, candidates=[[0.3, 0.3, 0.9]])
    np.testing.assert_allclose(given.next[0].seen, [0.3, 0.3, 0.9])


def test_points_of_a_board_share_the_noise_of_its_pose(cell):
    """Many points of one view tell no more than the pose."""
    _, result, _ = cell
    truth = TRUTH["eye-in-hand"]
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]] * 5)
    m = len(corners)
    board = np.broadcast_to(truth.camera[0], (m, 4, 4))
    base = truth.robot[0] @ truth.truth.X @ truth.camera[0]
    touched = corners @ base[:3, :3].T + base[:3, 3]
    found = uq.verify(result, corners, touched, robot=np.broadcast_to(truth.robot[0], (m, 4, 4)), board=board,
                      touch_sd=TOUCH_SD)  # fmt: skip
    assert not found.contradicted and found.detectable > 4 * 0.5e-3


def test_new_poses_in_place_of_touches(cell, tmp_path):
    folder, result, _ = cell
    rng = np.random.default_rng(SEED)
    new = uq.simulate(8, noise=NOISE, seed=rng)
    for name, T in (("robot", new.robot), ("camera", new.camera)):
        write_pose_file(tmp_path / f"{name}.csv", T)
    done = run("verify", folder / "result.json", "--poses", tmp_path / "robot.csv", tmp_path / "camera.csv")
    assert done.returncode == 0 and "8 independent poses agree" in done.stdout
    wrong = uq.PosePairs(new.robot, new.camera @ [[1, 0, 0, 0.02], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    assert verify_poses(result, wrong).contradicted


def test_what_is_refused(cell, tmp_path):
    folder, result, case = cell
    for arguments, message in (
        ((), "Give one of TOUCHES.csv"),
        ((folder / "same.csv",), "expected the noise of a touch: --tcp-sd"),
        ((folder / "same.csv", *DEVIATIONS, "--tool-sd", "-1mm"), "--tool-sd"),
        ((folder / "same.csv", *DEVIATIONS, "--show", "0mm"), "--show"),
        ((folder / "same.csv", *DEVIATIONS, "--tool", "1,2"), "--tool"),
    ):
        done = run("verify", folder / "result.json", *arguments)
        assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1, done.stderr
    with pytest.raises(uq.InputError, match="robot pose at which each point was seen"):
        uq.verify(result, replace(case, robot=None))
    with pytest.raises(uq.InputError, match="touch_sd"):
        uq.verify(result, case.seen, case.touched, robot=case.robot)
    with pytest.raises(uq.InputError, match="noise of the touches"):
        uq.verify(result, replace(case, touch_sd=0.0, seen_covariance=np.zeros((3, 3))))
    published = uq.calibrate(result.data, method="park", noise=NOISE)
    with pytest.raises(uq.InputError, match="joint covariance"):
        uq.verify(published, case)
