"""Several cameras that see one scene: lenses of their own, and their relative pose with its covariance."""

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.scene_tracks import SIZE, TRUE_LENS, X_TRUE, simulated

import uq_handeye as uq
from studies.scene.sessions import rendered, rendered_right, session, with_kind
from uq_handeye.calibration.rig_by_scene import in_metres, rig_of
from uq_handeye.calibration.rig_result import RigCalibration
from uq_handeye.core.geometry.se3 import difference, inverse, perturb
from uq_handeye.model.camera.models import MODELS
from uq_handeye.scene.adjust import Scene
from uq_handeye.scene.colmap import Model
from uq_handeye.scene.estimate import adjusted
from uq_handeye.scene.lens import Lens, Lenses
from uq_handeye.scene.tracks import Tracks

LEFT_T_RIGHT = perturb(np.eye(4), np.array([0.02, 0.1, -0.03, 0.06, 0.005, 0.01]))
RIGHT_LENS = TRUE_LENS * np.array([0.9, 0.9, 1.01, 0.99, 0.5, 1, 1, 1, 1, 1, 1, 1])


def two_cameras(seed, n, m, per_picture):
    """Simulated tracks of a left and a right camera on a hand, near the truth in another unit, and the robot poses."""
    sim = simulated(seed, n=n, m=m, per_picture=per_picture)
    rng = np.random.default_rng([1, seed])
    points = sim.truth.points
    C = inverse(LEFT_T_RIGHT) @ sim.truth.poses
    seen = np.einsum("nij,mj->nmi", C[:, :3, :3], points) + C[:, None, :3, 3]
    pixels = MODELS["brown"].project(RIGHT_LENS, seen.reshape(-1, 3)).pixels.reshape(n, len(points), 2)
    inside = (pixels > 5).all(-1) & (pixels < np.array(SIZE) - 5).all(-1)
    inside &= rng.random(inside.shape) < np.minimum(per_picture / np.maximum(inside.sum(1), 1), 1.0)[:, None]
    picture, point = np.nonzero(inside)
    noisy = pixels[inside] + 0.25 * rng.normal(size=(len(picture), 2))
    t = sim.truth.tracks
    names = tuple(f"img{k:02d}.png" for k in range(2 * n))
    both = np.concatenate([t.pixels, noisy])
    tracks = Tracks.of(np.append(t.picture, n + picture), np.append(t.point, point), both, names, SIZE)
    lens = Lenses.of_cameras([Lens.of(SIZE), Lens.of(SIZE)], np.repeat([0, 1], n))
    values = np.concatenate([TRUE_LENS, RIGHT_LENS])
    truth = Scene(tracks, np.concatenate([sim.truth.poses, C]), points, lens.at(values))
    near = perturb(truth.poses, 2e-3 * rng.normal(size=(2 * n, 6)))
    start = Scene(tracks, near, points + 2e-3 * rng.normal(size=points.shape), lens.at(1.003 * values)).scaled(12.0)
    return sim.robot, truth, start


def test_one_camera_is_no_rig():
    with pytest.raises(uq.InputError, match="two cameras or more"):
        uq.scene_rig({"left": "left/*.png"}, np.eye(4)[None])


def test_each_camera_has_a_lens_of_its_own():
    _, truth, _ = two_cameras(0, 5, 150, 40)
    of = np.repeat([0, 1], 5)[truth.tracks.picture]
    found = truth.lens.project(truth.in_camera(), truth.tracks.picture, derivatives=True).by_parameters
    assert truth.lens.f == 16
    for k in (0, 4, 9):  # fx and k1 of the left camera, fy of the right one
        d = np.zeros(16)
        d[k] = 1e-4
        ends = [Scene(truth.tracks, truth.poses, truth.points, truth.lens.stepped(s * d)).residuals() for s in (1, -1)]
        assert np.allclose(found[..., k], (ends[0] - ends[1]) / 2e-4, atol=1e-5)
        assert np.array_equal(ends[0][of != k // 8], ends[1][of != k // 8])
    assert truth.lens.of_pictures(np.array([0, 7])).camera.tolist() == [0, 1]
    assert len(truth.lens.prior_rows()[0]) == 2 * len(Lens.of(SIZE).prior_rows()[0])


@pytest.mark.statistical
def test_the_relative_pose_of_two_cameras_is_as_certain_as_stated():
    d2, of_left = [], []
    for seed in range(8):
        robot, _, start = two_cameras(seed, 12, 300, 60)
        n, names = len(robot), ["left", "right"]
        main = adjusted(Model(np.arange(2 * n), start, np.zeros((start.tracks.m, 3), np.uint8)))
        camera = np.repeat([0, 1], n)
        main = in_metres(main, robot, camera, main.rows % n, names)
        found = uq.calibrate(rig_of(main, robot, names, camera, "eye-in-hand"))
        of_both = (found.relative(*names), LEFT_T_RIGHT, d2), (found.cameras["left"], X_TRUE, of_left)
        for one, true, into in of_both:
            off = difference(true, one.pose)
            into.append(off @ np.linalg.solve(one.covariance, off))
    # sizes that are estimated make it wider than chi-square, whose mean of 8 is within 3.0 to 10.2 in all but 1e-3
    assert 2.0 < np.mean(d2) < 10.2 and 2.0 < np.mean(of_left) < 10.2, (d2, of_left)


@pytest.mark.slow
def test_two_cameras_from_the_command_line(tmp_path):
    made = session(with_kind("eight", n=8), 2, size=(480, 360))
    rendered(made, tmp_path)
    truth = rendered_right(made, tmp_path / "right")
    cameras = ("--camera", "left=img/*.png", "--camera", "right=right/*.png")
    done = run("calibrate", "robot.csv", *cameras, "--scene", "-o", "out", cwd=tmp_path)
    assert done.returncode in (0, 1), done.stderr
    found = RigCalibration.from_json(tmp_path / "out" / "result.json").relative("left", "right")
    off = difference(truth, found.pose)
    assert off @ np.linalg.solve(found.covariance, off) < 30 and np.linalg.norm(off[3:]) < 1e-3
    assert (tmp_path / "out" / "right.yaml").read_text(encoding="utf-8").startswith("%YAML:1.0")
    done = run("check", "out/result.json", "robot.csv", *cameras, cwd=tmp_path)
    assert done.returncode == 2 and "by pictures of a scene" in done.stderr
    done = run("calibrate", "robot.csv", *cameras, "--scene", "--mask", "m.png", cwd=tmp_path)
    assert done.returncode == 2 and "not for several cameras" in done.stderr
    (tmp_path / "right" / "img07.png").unlink()
    done = run("calibrate", "robot.csv", *cameras, "--scene", cwd=tmp_path)
    assert done.returncode == 2 and "a picture of each camera at each of 8 robot poses, got 7 of right" in done.stderr
