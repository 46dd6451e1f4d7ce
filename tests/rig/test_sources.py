"""Sources of rig files: joints of an arm, corners by known intrinsics, ROS bags."""

import json

import numpy as np
import pandas as pd
import pytest
from fixtures.arms import SIX_AXES, mjcf_of, random_transform
from fixtures.bags import START, Writer
from fixtures.rigs_on_arms import ARM, CENTRE, GEOMETRY
from fixtures.streams import motion

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.calibration.prediction.noise_of_views import new_noise
from uq_handeye.core.geometry.se3 import inverse, logarithm, perturb
from uq_handeye.fit.graph.graph import Graph
from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.errors.key import Kind
from uq_handeye.read import write_pose_file
from uq_handeye.read.rig.rig_file import read_rig

NOISE = '["0.3mrad", "0.1mm"]'


def error(found, truth):
    return np.r_[logarithm(found.pose[:3, :3] @ truth[:3, :3].T), found.pose[:3, 3] - truth[:3, 3]]


def square(found, truth):
    e = error(found, truth)
    return float(e @ np.linalg.solve(found.covariance, e))


def table(path, names, rows):
    text = [",".join(names), *(",".join(map(repr, map(float, row))) for row in rows)]
    path.write_text("\n".join(text) + "\n")


def write_views(path, truth, robot, noise, rng):
    """Files of two cameras on the arm that see one board, and their tables."""
    lines = []
    for name in ("left", "right"):
        C = inverse(robot @ truth[name]) @ truth["board"]
        C = perturb(C, rng.normal(size=(len(C), 6)) * np.repeat(noise, 3))
        write_pose_file(path / f"{name}.csv", C, np.arange(len(C)))
        lines.append(f'[cameras.{name}]\non = "arm"\nnoise = {NOISE}')
        lines.append(f'[[views]]\ncamera = "{name}"\ntarget = "board"\nfile = "{name}.csv"')
    return "\n".join([*lines[::2], '[targets.board]\non = "world"', *lines[1::2]])


def of_arm(path, rng, n=25):
    """A rig whose arm has kinematic errors: ``rig.toml`` with its joints, and the truth."""
    e = np.array([rng.normal() * GEOMETRY.get(one.group, 0.0) for one in ARM.errors])
    q = CENTRE + rng.uniform(-0.5, 0.5, (n, 6))
    truth = {name: random_transform(rng) for name in ("left", "right")}
    for T in truth.values():
        T[:3, 3] *= 0.2
    view = np.eye(4)
    view[2, 3] = 0.5
    truth["board"] = ARM.poses(CENTRE, e) @ truth["left"] @ view
    views = write_views(path, truth, ARM.poses(q, e), (3e-4, 1e-4), rng)
    table(path / "joints.csv", ["timestamp", *(joint.name for joint in ARM.joints)], np.c_[np.arange(n), q])
    write_pose_file(path / "robot.csv", ARM.poses(q), np.arange(n))
    (path / "arm.urdf").write_text(SIX_AXES)
    arm = '[arms.arm]\njoints = "joints.csv"\nurdf = "arm.urdf"\nnoise = ["1e-5rad", "0.01mm"]\n'
    (path / "rig.toml").write_text(arm + views)
    return truth, q


@pytest.mark.slow
def test_an_arm_by_its_joints_is_known_with_its_kinematic_errors(tmp_path):
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        truth, _ = of_arm(tmp_path, rng)
        result = calibrate_rig(*read_rig(tmp_path / "rig.toml"))
        assert any(key.kind == Kind.OFFSETS and key.name == "arm" for key in result.posterior.keys)
        squares.append(square(result.relative("left", "right"), np.linalg.inv(truth["left"]) @ truth["right"]) / 6)
    assert 0.5 < np.mean(squares) < 1.6  # chi-square of 48 numbers; X itself is stated in the frames of the workspace
    result.save(tmp_path / "result.json")
    again = uq.load(tmp_path / "result.json")
    np.testing.assert_array_equal(again.rig.arms["arm"].joints, result.rig.arms["arm"].joints)
    assert again.to_dict() == result.to_dict()
    # new poses without joints get those of the arm
    rig = uq.Rig({"arm": again.rig.arms["arm"].poses}, result.rig.cameras, result.rig.targets, result.rig.views)
    of = [new_noise(again, one, Graph.of(one)).K_robot for one in (result.rig, uq.check(again, rig) and result.rig)]
    np.testing.assert_allclose(of[0], of[1])
    assert not uq.check(again, rig).changed
    assert again.predict("left", [0, 0, 0.5], {"arm": rig.arms["arm"].poses[:3]}).points.shape == (3, 1, 3)
    assert len(uq.plan(again, k=2, sample=20).views) == 2


def test_an_mjcf_model_with_its_tip(tmp_path):
    of_arm(tmp_path, np.random.default_rng(1))
    text = (tmp_path / "rig.toml").read_text()
    chain = read_rig(tmp_path / "rig.toml")[0].arms["arm"].kinematics
    (tmp_path / "arm.xml").write_text(mjcf_of(chain))
    (tmp_path / "rig.toml").write_text(text.replace('urdf = "arm.urdf"', 'robot_model = "arm.xml"\ntip = "tool"'))
    arm = read_rig(tmp_path / "rig.toml")[0].arms["arm"]
    np.testing.assert_allclose(arm.kinematics.poses(arm.joints), chain.poses(arm.joints), atol=1e-12)


def test_poses_beside_joints_and_a_model_without_joints(tmp_path):
    of_arm(tmp_path, np.random.default_rng(1))
    text = (tmp_path / "rig.toml").read_text()
    for arm in (
        'joints = "joints.csv"\nposes = "robot.csv"\nurdf = "arm.urdf"',
        'poses = "robot.csv"\nurdf = "arm.urdf"',
    ):
        (tmp_path / "rig.toml").write_text(text.replace('joints = "joints.csv"\nurdf = "arm.urdf"', arm))
        rig, _ = read_rig(tmp_path / "rig.toml")
        arm = rig.arms["arm"]
        np.testing.assert_allclose(arm.kinematics.poses(arm.joints), arm.poses, atol=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('urdf = "arm.urdf"', "", r"\[arms\.arm\] has joints and no robot model"),
        ('urdf = "arm.urdf"', 'robot_model = "ur55e"', "ur5e"),
        ('urdf = "arm.urdf"', 'robot_model = "ur5e"\ntip = "tool0"', r"\[arms\.arm\] has tip beside robot_model"),
        ('joints = "joints.csv"\nurdf', "urdf", r"Expected `poses` \(files\), `joints` .* in \[arms\.arm\]"),
        ('joints = "joints.csv"', 'joints = ["joints.csv", 3]', "Expected `joints` in"),
        ('joints = "joints.csv"', 'joint = "joints.csv"', r"Unknown name 'joint' in \[arms\.arm\]. Near it: joints"),
        ('urdf = "arm.urdf"', 'urdf = "arm.urdf"\nrobot_class = "large"', "robot_class"),
    ],
)
def test_what_is_wrong_with_an_arm_is_one_line(tmp_path, old, new, message):
    of_arm(tmp_path, np.random.default_rng(1))
    text = (tmp_path / "rig.toml").read_text()
    assert old in text
    (tmp_path / "rig.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(uq.InputError, match=message) as caught:
        read_rig(tmp_path / "rig.toml")
    assert "\n" not in str(caught.value) and "rig.toml" in str(caught.value)


# ------------------------------------------------------------------------------------------- corners


def seen_corners(truth, robot, points, intrinsics, rng, pixel_noise=0.1):
    fx, fy, cx, cy = intrinsics
    rows, at, pixels = [], [], []
    for k, G in enumerate(robot):
        C = np.linalg.inv(G @ truth["eye"]) @ truth["board"]
        p = points @ C[:3, :3].T + C[:3, 3]
        if (p[:, 2] < 0.05).any():
            continue
        rows.append(np.full(len(p), k))
        at.append(points)
        pixels.append(np.c_[fx * p[:, 0] / p[:, 2] + cx, fy * p[:, 1] / p[:, 2] + cy])
    pixels = np.concatenate(pixels)
    return uq.Corners(np.concatenate(rows), np.concatenate(at), pixels + pixel_noise * rng.normal(size=pixels.shape))


def with_corners(path, seed, intrinsics_sd=1.0):
    """A camera on an arm that sees a board by its corners; its intrinsics are known to a pixel."""
    rng = np.random.default_rng(seed)
    truth = {"eye": random_transform(rng)}
    truth["eye"][:3, 3] *= 0.1
    view = np.eye(4)
    view[2, 3] = 0.5
    truth["board"] = truth["eye"] @ view
    board = uq.Board(6, 5, 0.03)
    robot = perturb(np.eye(4), rng.normal(size=(15, 6)) * np.repeat([0.25, 0.05], 3))
    said = np.array([800.0, 800.0, 640.0, 480.0])
    corners = seen_corners(truth, robot, board.points, said + intrinsics_sd * rng.normal(size=4), rng)
    write_pose_file(path / "robot.csv", perturb(robot, rng.normal(size=(15, 6)) * 1e-5), np.arange(15))
    (path / "board.csv").write_text(corners_text(corners, np.ones(corners.m, dtype=bool)))
    names = zip(("fx", "fy", "cx", "cy"), said.tolist(), strict=True)
    (path / "eye.json").write_text(json.dumps({name: [value, intrinsics_sd] for name, value in names}))
    (path / "rig.toml").write_text(
        '[arms.arm]\nposes = "robot.csv"\nnoise = [1e-5, 1e-5]\n[cameras.eye]\non = "arm"\nintrinsics = "eye.json"\n'
        '[targets.board]\non = "world"\n[[views]]\ncamera = "eye"\ntarget = "board"\ncorners = "board.csv"\n'
    )
    return truth


@pytest.mark.slow
def test_corners_by_known_intrinsics_carry_their_errors(tmp_path):
    squares = []
    for seed in range(20):
        truth = with_corners(tmp_path, seed)
        result = calibrate_rig(*read_rig(tmp_path / "rig.toml"))
        squares.append(square(result.cameras["eye"], truth["eye"]) / 6)
    assert 0.6 < np.mean(squares) < 1.5, np.mean(squares)  # without the intrinsics' errors: 5 and more
    assert result.rig.views[0].intrinsics.shape[2] == 4


@pytest.mark.slow
def test_wrong_corners_and_pictures_are_left_out(tmp_path):
    with_corners(tmp_path, 3)
    before = calibrate_rig(*read_rig(tmp_path / "rig.toml")).cameras["eye"]
    seen = pd.read_csv(tmp_path / "board.csv")
    seen.loc[seen["row"] == 2, ["u", "v"]] = seen.loc[seen["row"] == 2, ["u", "v"]].to_numpy()[::-1] * [1.0, 1.2]
    seen.loc[5, "u"] += 30.0
    seen.to_csv(tmp_path / "board.csv", index=False)
    rig, _ = read_rig(tmp_path / "rig.toml")
    assert 2 not in rig.views[0].at and len(rig.views[0].poses) == 14
    after = calibrate_rig(*read_rig(tmp_path / "rig.toml")).cameras["eye"]
    sd = np.sqrt(np.diag(before.covariance))
    assert (np.sqrt(np.diag(after.covariance)) < 1.3 * sd).all()
    assert square(after, before.pose) < 3.0


def test_corners_need_intrinsics(tmp_path):
    with_corners(tmp_path, 0)
    text = (tmp_path / "rig.toml").read_text()
    for old, new, message in (
        ('intrinsics = "eye.json"\n', "", "has corners and no intrinsics"),
        ('"eye.json"', "[800, 800]", "Expected `intrinsics` to be fx, fy, cx, cy"),
        ('corners = "board.csv"', 'corners = "board.csv"\nfile = "x.csv"', "in view 1, got file and corners"),
    ):
        (tmp_path / "rig.toml").write_text(text.replace(old, new))
        with pytest.raises(uq.InputError, match=message):
            read_rig(tmp_path / "rig.toml")
    shapes = []
    for intrinsics in ("800,800,640,480", "800,800,640,480,exact", "one.json", "one.json,exact"):
        (tmp_path / "one.json").write_text('{"fx": 800, "fy": 800, "cx": 640, "cy": 480}')
        (tmp_path / "rig.toml").write_text(text.replace('"eye.json"', f'"{intrinsics}"'))
        shapes.append(read_rig(tmp_path / "rig.toml")[0].views[0].intrinsics.shape[-1])
    assert shapes == [4, 0, 4, 0]  # a number alone has a deviation, as with --intrinsics


# ------------------------------------------------------------------------------------------- bags


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Return a folder with a bag of an arm and two cameras on it, the second 30 ms late, and the truth."""
    path = tmp_path_factory.mktemp("bag")
    rng = np.random.default_rng(5)
    move, flange = motion(rng, 8.0), np.eye(4)
    truth = {"left": random_transform(rng), "right": random_transform(rng), "board": random_transform(rng)}
    with Writer(path, "mcap") as writer:
        for t in START + np.arange(0, 8.0, 0.01):
            T = move(np.array([t - START]))[0] @ flange
            writer.pose_stamped("/tcp_pose", t, "base", perturb(T, 2e-5 * rng.normal(size=6)))
        for name, late, first in (("left", 0.0, 0.2), ("right", 0.03, 0.213)):
            for t in START + np.arange(first, 7.8, 0.1):
                C = np.linalg.inv(move(np.array([t - START]))[0] @ truth[name]) @ truth["board"]
                writer.pose_stamped(f"/{name}/board", t - late, name, perturb(C, 2e-4 * rng.normal(size=6)))
    mounts = "".join(
        f'[cameras.{name}]\non = "arm"\n[[views]]\ncamera = "{name}"\ntarget = "board"\nbag = "{writer.path.name}"\n'
        f'topic = "/{name}/board"\n' for name in ("left", "right")
    )  # fmt: skip
    (path / "rig.toml").write_text(
        f'[arms.arm]\nbag = "{writer.path.name}"\ntopic = "/tcp_pose"\n[targets.board]\non = "world"\n{mounts}'
    )
    return path, truth


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_a_bag_is_a_source_with_a_clock_for_each_camera(bag):
    path, truth = bag
    rig, noise = read_rig(path / "rig.toml")
    assert noise is None and len(rig.views[0].poses) > 60
    result = calibrate_rig(rig, shared=False)
    relative = np.linalg.inv(truth["left"]) @ truth["right"]
    turn, shift = np.split(error(result.relative("left", "right"), relative), 2)
    assert np.linalg.norm(turn) < 5e-4 and np.linalg.norm(shift) < 1e-3
    text = (path / "rig.toml").read_text()
    (path / "late.toml").write_text(text.replace("[cameras.right]\n", "[cameras.right]\noffset = 0.0\n"))
    late = calibrate_rig(read_rig(path / "late.toml")[0], shared=False, robust=False)
    assert np.linalg.norm(error(late.relative("left", "right"), relative)) > 5 * np.linalg.norm(np.r_[turn, shift])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('topic = "/tcp_pose"\n', "", r"\[arms\.arm\] has a bag and no topic"),
        ('topic = "/tcp_pose"', 'topic = "/tcp"', "no topic of this name"),
        (
            'bag = "cell"\ntopic = "/tcp_pose"',
            'bag = "cell"\nposes = "x.csv"\ntopic = "/tcp_pose"',
            "both bag and poses",
        ),
        (
            "[cameras.left]\n",
            '[cameras.left]\noffset = "late"\n',
            r"Expected `offset` in \[cameras.left\] to be a number",
        ),
    ],
)
def test_what_is_wrong_with_a_bag_is_one_line(bag, old, new, message):
    path, _ = bag
    text = (path / "rig.toml").read_text()
    assert old in text
    (path / "wrong.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(uq.InputError, match=message) as caught:
        read_rig(path / "wrong.toml")
    assert "\n" not in str(caught.value)
