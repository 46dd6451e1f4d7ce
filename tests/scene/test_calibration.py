"""X from camera poses of a scene: scale, order, files, and what is refused; tracks are simulated."""

from dataclasses import replace

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.scene_tracks import SIZE, X_TRUE, simulated

import uq_handeye as uq
from uq_handeye.calibration import by_scene
from uq_handeye.core.geometry.se3 import difference, inverse, perturb
from uq_handeye.findings import Finding
from uq_handeye.fit.diagnostics.row_order import angle_disagreement, find_order
from uq_handeye.fit.graph.screws import scale_by_screws
from uq_handeye.model.errors.joint_covariance import JointCovariance
from uq_handeye.model.poses.scene_facts import SceneFacts, SceneView
from uq_handeye.scene import colmap
from uq_handeye.scene.colmap import Model
from uq_handeye.scene.estimate import adjusted, lens_findings, lens_sd, measured_poses, pull_of_robot
from uq_handeye.scene.lens import NAMES
from uq_handeye.scene.result import ScenePoses, read_scene


@pytest.fixture(scope="module")
def placed():
    sim = simulated(2, n=14, m=500, per_picture=110)
    model = Model(np.arange(14), sim.start, np.full((sim.start.tracks.m, 3), 9, np.uint8))
    return sim, adjusted(model)


@pytest.fixture(scope="module")
def scene(placed):
    sim, found = placed
    poses, covariance = measured_poses(found)
    lens, sd = found.scene.lens, lens_sd(found)
    values = dict(zip(NAMES, lens.values.tolist(), strict=False))
    facts = SceneFacts(14, found.scene.tracks.m, 110.0, found.noise, values["fx"], float(sd[0]))
    view = SceneView("img00.png", 320, 240, "QUJD", (10.0, 20.0, 30.5, 40.5))
    values_of_lens = tuple(lens.values[:8].tolist())
    facts = replace(facts, lens=values_of_lens, lens_sd=tuple(sd.tolist()), views=(view,))
    return ScenePoses(
        poses,
        found.rows.astype(np.int64),
        covariance,
        {name: values[name] for name in NAMES},
        dict(zip(lens.names, sd.tolist(), strict=True)),
        found.scene.points,
        (Finding("scene.models", "note", {"count": 2, "sizes": [10, 4], "joined": True}),),
        facts,
        SIZE,
        found.scene.tracks.names,
        found.scene.tracks.per_picture,
        found.colours,
        sim.robot,
    )


def d2(found, X=X_TRUE):
    off = difference(X, found.X)
    return float(off @ np.linalg.solve(found.covariance, off))


@pytest.mark.slow
def test_scale_is_that_of_the_screws_and_then_an_unknown(placed, scene):
    eyes = [inverse(C)[:, :3, 3] for C in (placed[0].truth.poses, scene.poses)]
    unit = np.median(np.divide(*(np.linalg.norm(np.diff(one, axis=0), axis=1) for one in eyes)))
    scale, spread = scale_by_screws(scene.robot, scene.poses)
    assert scale == pytest.approx(unit, rel=3e-3) and spread < 3e-3
    found = uq.calibrate(scene.pairs)
    assert found.camera_scale.factor == pytest.approx(unit, rel=1e-3)
    assert found.camera_scale.std < 1e-3 * unit and found.usable
    assert d2(found) < 16.8
    assert any("1 unit of the scene is" in str(one) for one in found.findings)
    # errors beyond the features keep their prior when the model is linearised again
    sizes = {part.name: part for part in found.noise_estimate.of_model}
    assert {"features of the scene", "camera beyond its features"} < sizes.keys()
    assert "camera beyond its corners" not in sizes and "intrinsics" not in sizes
    assert 0.2 < found.noise_estimate["camera beyond its features"].size < 3.0


@pytest.mark.slow
def test_lengths_of_the_robot_are_told_as_such(scene):
    pairs = scene.pairs.scaled(0.1)
    assert np.allclose(pairs.camera_covariance.own[:, 3:, 3:], 0.01 * scene.covariance.own[:, 3:, 3:])
    found = uq.calibrate(pairs)
    assert any("robot's metre" in str(one) for one in found.findings)
    assert np.allclose(found.X, uq.calibrate(scene.pairs).X, atol=1e-6)


@pytest.mark.slow
def test_noise_of_the_robot_may_be_declared(scene):
    S = np.diag(np.repeat([3.5e-4, 5e-5], 3) ** 2)
    found = uq.calibrate(scene.pairs, noise=uq.PoseNoise(S))
    assert found.usable and d2(found) < 16.8 and found.camera_scale.std > 0
    assert not found.noise_estimate
    with pytest.raises(uq.InputError, match="comes from its pictures"):
        uq.calibrate(scene.pairs, noise=uq.PoseNoise(S, S))


@pytest.mark.slow
def test_results_of_two_runs_are_compared_and_not_checked(scene, tmp_path):
    found = uq.calibrate(scene.pairs)
    again = replace(
        scene.pairs,
        camera=scene.poses @ inverse(perturb(np.eye(4), np.full(6, 0.1))),
        robot=perturb(scene.robot, np.full(6, 1e-7)),  # of another day
    )
    with pytest.raises(uq.InputError, match="Place new pictures in the scene of the result"):
        uq.check(found, again)
    with pytest.raises(uq.InputError, match="Calibrate with all pictures"):
        uq.update(found, again)
    (tmp_path / "a.png").write_bytes(b"none")
    with pytest.raises(uq.InputError, match="holds no scene in which pictures could be placed"):
        uq.scene_poses([tmp_path / "a.png"], result=found)
    fixed = replace(scene.facts, known="AAAA"), inverse(scene.robot)
    to_hand = uq.calibrate(replace(scene.pairs, scene=fixed[0], robot=fixed[1], setup="eye-to-hand"))
    with pytest.raises(uq.InputError, match="an object in the hand are not placed precisely enough"):
        uq.scene_poses([tmp_path / "a.png"], result=to_hand)
    off = uq.difference(found, uq.calibrate(again))
    assert off.xi.shape == (6,) and off.p_value_W is None and off.p_value_X > 0.5


def test_scale_by_screws_needs_rotations_and_takes_one_axis():
    sim = simulated(4)
    assert scale_by_screws(sim.robot[:1], sim.truth.poses[:1]) is None
    shifted = np.array(sim.robot)
    shifted[:, :3, :3] = np.eye(3)
    assert scale_by_screws(shifted, inverse(shifted)) is None
    axis = np.array([0.0, 0.6, 0.8])
    angles = np.linspace(-1, 1, 12)
    G = perturb(
        np.eye(4), np.column_stack([angles[:, None] * axis, np.outer(angles, axis) + np.cos(9 * angles)[:, None]])
    )
    C = inverse(G @ X_TRUE)
    C[:, :3, 3] *= 7.0
    assert scale_by_screws(G, C)[0] == pytest.approx(1 / 7.0, rel=1e-6)


@pytest.mark.slow
def test_order_is_found_by_angles_alone():
    sim = simulated(6)
    rng = np.random.default_rng(1)
    order = rng.permutation(20)
    C = sim.truth.scaled(3.0).poses[order]
    assert angle_disagreement(sim.robot, C) > np.radians(10)
    assert find_order(sim.robot, C).rows == tuple(order)
    robot = np.array(sim.robot)
    robot[3] = perturb(robot[3], np.array([0.04, 0.0, 0.03, 0.02, 0.0, 0.0]))
    found = np.array(find_order(robot, C).rows)
    assert found[order == 3] == -1 and (found[order != 3] == order[order != 3]).all()
    assert find_order(simulated(7).robot, C) is None


def test_another_order_is_refused_with_the_order(placed, monkeypatch):
    sim, found = placed
    order = np.roll(np.arange(14), 3)
    seen = type("Seen", (), {"names": found.scene.tracks.names})
    with pytest.raises(uq.InputError, match=r"another order: img00\.png belongs to row 3"):
        by_scene._Run([], sim.robot[order], "eye-in-hand", None, print)._require_order(found, seen)
    with pytest.raises(uq.InputError, match="do not belong together"):
        by_scene._Run([], simulated(9, n=14).robot, "eye-in-hand", None, print)._require_order(found, seen)


@pytest.mark.parametrize("eye_to_hand", [False, True])
def test_the_pull_of_the_robot_is_least_where_the_robot_is(placed, eye_to_hand):
    sim, _ = placed
    robot = inverse(sim.robot) if eye_to_hand else sim.robot
    S = np.tile(np.diag([1e-7] * 3 + [1e-8] * 3), (14, 1, 1))
    own = JointCovariance.of_each(S)
    pull = pull_of_robot(robot, X_TRUE, own, np.ones(14), eye_to_hand)
    # another X costs nothing; an error of a robot pose what its covariance says, once X is at its best
    other = inverse(sim.robot @ perturb(X_TRUE, np.array([1e-5, 0, 2e-5, 1e-5, 0, 0])))
    assert pull.at(other)[0] < 1e-4
    moved = np.array(robot)
    moved[4] = perturb(moved[4], np.array([0, 0, 0, 1e-4, 0, 0]))
    cost = pull.at(inverse((inverse(moved) if eye_to_hand else moved) @ X_TRUE))[0]
    assert 0.7 < cost < 1.0 + 1e-6
    assert np.allclose(pull.of_pictures(np.arange(14)).information, pull.information)
    # an error that all robot poses share costs about its size once, however many poses show it
    F = 1e-3 * np.random.default_rng(0).normal(size=(14, 6, 1))
    shared = perturb(robot, F[..., 0])
    C = inverse((inverse(shared) if eye_to_hand else shared) @ X_TRUE)
    joint = pull_of_robot(robot, X_TRUE, JointCovariance(own.own, F), np.ones(14), eye_to_hand)
    assert joint.at(C)[0] < 1.1 and pull.at(C)[0] > 100


@pytest.mark.slow
def test_a_scene_is_read_as_it_was_written(scene, tmp_path):
    scene.write(tmp_path / "scene")
    again = read_scene(tmp_path / "scene")
    assert np.array_equal(again.poses, scene.poses) and again.facts == scene.facts
    assert np.array_equal(again.covariance.shared, scene.covariance.shared)
    assert again.findings == scene.findings and again.intrinsics == scene.intrinsics
    head = (tmp_path / "scene" / "points.ply").read_bytes()[:400].decode("latin1")
    assert f"element vertex {len(scene.points)}" in head
    K = uq.read_intrinsics(str(tmp_path / "scene" / "intrinsics.yaml"))
    assert K.values["fx"] == pytest.approx(scene.intrinsics["fx"])
    uq.write_pose_file(tmp_path / "robot.csv", scene.robot)
    done = run("calibrate", "robot.csv", "--camera", "left=scene", "--camera", "right=scene", cwd=tmp_path)
    assert done.returncode == 2 and "Calibrate each camera alone" in done.stderr
    pairs = uq.read_poses(tmp_path / "robot.csv", tmp_path / "scene")
    assert pairs.scene == scene.facts
    assert d2(uq.calibrate(pairs)) < 16.8
    (tmp_path / "scene" / "scene.json").unlink()
    with pytest.raises(uq.InputError, match=r"lacks scene\.json"):
        read_scene(tmp_path / "scene")


@pytest.mark.slow
def test_the_result_keeps_that_it_is_of_a_scene(scene, tmp_path):
    found = uq.calibrate(scene.pairs)
    found.to_json(tmp_path / "x.json")
    again = uq.load(tmp_path / "x.json")
    assert again.data.scene == scene.facts and again.camera_scale == found.camera_scale
    assert again.noise_estimate.from_scene and again.noise_estimate.camera_known
    page = again.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert "The scene" in page and "data:image/jpeg;base64,QUJD" in page and "<circle" in page
    assert "Intrinsics of the model brown that belong to X" in page


def test_summary_says_pictures_points_and_lens(scene):
    text = scene.summary(details=True)
    assert "14 of 14 pictures" in text and "fx" in text and "img03.png" in text
    assert repr(scene).startswith("ScenePoses(14 of 14 pictures")
    with pytest.raises(uq.InputError, match="robot poses"):
        _ = replace(scene, robot=None).pairs


@pytest.mark.slow
def test_lens_as_no_lens_is(placed):
    _, found = placed
    lens = found.scene.lens
    assert lens_findings(lens, lens_sd(found)) == []
    values = lens.values.copy()
    values[6] = 0.01
    (one,) = lens_findings(lens.at(values), lens_sd(found))
    assert one.code == "scene.lens" and one.severity == "failure" and "standstill" in str(one)
    (one,) = lens_findings(lens, np.full(8, 30.0))
    assert one.code == "scene.focal_open" and "+- 30 px" in str(one)


def test_fewer_than_six_pictures_are_no_scene(tmp_path):
    for k in range(5):
        (tmp_path / f"a{k}.png").write_bytes(b"none")
    with pytest.raises(uq.InputError, match="6 pictures or more"):
        uq.scene_poses(f"{tmp_path}/*.png")


@pytest.mark.slow
def test_bad_input(tmp_path):
    for k in range(6):
        (tmp_path / f"a{k}.png").write_bytes(b"none")
    with pytest.raises(uq.InputError, match="robot pose for each of 6 pictures, got 2"):
        uq.scene_poses(f"{tmp_path}/*.png", np.tile(np.eye(4), (2, 1, 1)))
    pytest.importorskip("pycolmap")
    Image = pytest.importorskip("PIL.Image")
    for k in range(6):
        Image.fromarray(np.full((240, 320), 100 + k, np.uint8)).save(tmp_path / f"b{k}.png")
    Image.fromarray(np.full((60, 80), 255, np.uint8)).save(tmp_path / "small.bmp")
    Image.fromarray(np.zeros((240, 320), np.uint8)).save(tmp_path / "black.bmp")
    for mask, said in (
        ("a0.png", "cannot be read"),
        ("small.bmp", "320 x 240, got 80 x 60"),
        ("black.bmp", "is black"),
    ):
        with pytest.raises(uq.InputError, match=said):
            uq.scene_poses(f"{tmp_path}/b*.png", mask=tmp_path / mask)
    for k in range(6):
        (tmp_path / f"b{k}.png").unlink()
    with pytest.raises(uq.InputError, match=r"a0\.png.* as a picture of the scene"):
        uq.scene_poses(f"{tmp_path}/*.png")


def test_pycolmap_is_asked_for(tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "pycolmap", None)
    with pytest.raises(uq.InputError, match=r'pip install "uq-handeye\[scene\]"'):
        colmap.pycolmap()


@pytest.mark.slow
def test_pictures_without_texture_make_no_scene(tmp_path):
    pytest.importorskip("pycolmap")
    Image = pytest.importorskip("PIL.Image")
    for k in range(6):
        Image.fromarray(np.full((240, 320), 100 + k, np.uint8)).save(tmp_path / f"img{k}.png")
    with pytest.raises(uq.InputError, match="do not make one scene: 0 matches"):
        uq.scene_poses(tmp_path)


@pytest.mark.slow
def test_options_of_a_board_are_refused(tmp_path):
    done = run("calibrate", "robot.csv", "--images", "*.png", "--scene", "--board", "9x6", cwd=tmp_path)
    assert done.returncode == 2 and "--board: not used with --scene" in done.stderr
    done = run("calibrate", "robot.csv", "--scene", cwd=tmp_path)
    assert done.returncode == 2 and "--scene needs pictures" in done.stderr
    done = run("calibrate", "robot.csv", "--images", "*.png", "--mask", "m.png", cwd=tmp_path)
    assert done.returncode == 2 and "--mask" in done.stderr
