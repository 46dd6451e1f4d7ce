"""Pictures of a scene without a board, from rendered pictures to X; simulated tracks against the stated covariance."""

import numpy as np
import pytest
from scipy import stats

import uq_handeye as uq
from studies.common.pictures import Camera
from studies.common.scores import true_means
from studies.scene.measure import DEFAULTS, EXACT, JOINT, TRACKS, of_tracks, scored
from studies.scene.pictures import Body, Face, Renderer
from studies.scene.sessions import rendered, robot_csv, session, with_kind
from uq_handeye.core.geometry.se3 import difference, inverse, perturb, pose
from uq_handeye.read.poses import read_robot

SIZE = (640, 480)
FAR = stats.chi2.ppf(0.9999, 6)


def test_a_rectangle_is_drawn_where_the_camera_sees_it():
    """The grey weighted centroid of a white square is its centre seen by the lens."""
    camera = Camera("brown", np.array([300.0, 301.0, 151.0, 118.0, -0.1, 0.02, 1e-3, -1e-3, 0, 0, 0, 0]), (320, 240))
    side = 0.02
    T = pose(np.eye(3), [0.0, 0.0, 0.5])
    renderer = Renderer(camera)
    for x, y in ((0.0, 0.0), (0.18, 0.11), (-0.15, 0.12)):
        square = Face(
            np.array([x - side / 2, y + side / 2, 0.0]), np.array([side, 0, 0]), np.array([0, -side, 0]),
            np.full((32, 32), 250, np.uint8),
        )  # fmt: skip
        grey = renderer.picture([Body([square], T[None])], 0)
        white = np.clip(grey - 90.5, 0, None)
        v, u = np.indices(white.shape)
        seen = np.array([(white * u).sum(), (white * v).sum()]) / white.sum()
        np.testing.assert_allclose(seen, camera.seen(np.array([[x, y, 0.0]]), T)[0], atol=0.15)


@pytest.mark.slow
def test_x_from_rendered_pictures(tmp_path):
    made = session("twelve", 1, size=SIZE)
    found = uq.scene_poses(rendered(made, tmp_path), made.robot)
    score = scored(uq.calibrate(found.pairs), made.X)
    assert found.n == made.kind.n and score["usable"]
    assert score["d2"] < FAR and score["mm"] < 0.6, score
    f, sd = found.intrinsics["fx"], found.sd["fx"]
    assert abs(f - made.camera.parameters[0]) < 5 * sd + 0.2 and sd < 1.0


@pytest.mark.slow
def test_later_pictures_show_whether_x_still_holds(tmp_path):
    made = session(with_kind("twelve", n=13), 1, size=SIZE)
    paths = rendered(made, tmp_path)
    result = uq.calibrate(uq.scene_poses(paths[:10], made.robot[:10]).pairs)
    result.to_json(tmp_path / "result.json")
    result = uq.load(tmp_path / "result.json")
    found = uq.scene_poses(paths[10:], made.robot[10:], result=result)
    assert found.n == 3 and found.pairs.scene == result.data.scene
    held = uq.check(result, found.pairs)
    assert held.p_value > 1e-4, held
    slid = perturb(made.X, np.array([0.02, 0.0, 0.0, 0.0, 0.004, 0.0]))
    moved = made.robot[10:] @ made.X @ inverse(slid)  # where the robot is if the camera slid and sees the same
    gone = uq.check(result, uq.scene_poses(paths[10:], moved, result=result).pairs)
    assert gone.changed and gone.cause == "X"
    off = gone.shift - difference(slid, made.X)
    assert off @ np.linalg.solve(gone.covariance, off) < FAR
    with pytest.raises(uq.InputError, match="used by the calibration itself"):
        uq.check(result, uq.scene_poses(paths[:2], made.robot[:2], result=result).pairs)


@pytest.mark.statistical
def test_tracks_are_consistent_with_what_is_stated():
    draws = [of_tracks(TRACKS["table"], 100 + seed) for seed in range(15)]
    low, high = true_means(len(draws))
    assert low < np.mean([one[EXACT]["d2"] for one in draws]) < high
    assert 0.9 < np.mean([one["consistency"] for one in draws]) < 1.1
    for way in (EXACT, JOINT):
        rms = np.sqrt(np.mean([one[way]["mm"] ** 2 for one in draws]))
        stated = np.sqrt(np.mean([one[way]["stated_mm"] ** 2 for one in draws]))
        assert 0.7 < rms / stated < 1.4
    assert np.mean([one[DEFAULTS]["d2"] < stats.chi2.ppf(0.95, 6) for one in draws]) >= 0.8


def test_robot_poses_need_no_timestamps_and_metres(tmp_path):
    made = session("table", bodies=False)
    path = tmp_path / "robot.csv"
    path.write_text(robot_csv(made.robot), encoding="utf-8")
    np.testing.assert_allclose(read_robot(path), made.robot, atol=1e-8)
    far = made.robot.copy()
    far[:, :3, 3] *= 1e3
    path.write_text(robot_csv(far), encoding="utf-8")
    with pytest.raises(uq.InputError, match=r"In millimetres\? Give --units robot=mm"):
        read_robot(path)
    np.testing.assert_allclose(read_robot(path, units="mm"), made.robot, atol=1e-8)
