"""Rig files: what is read, matching by timestamps, one line for what is wrong, the command."""

import json
import re
import tomllib
from dataclasses import replace
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from uq_handeye.calibration.calibrate_rig import calibrate_rig
from uq_handeye.cli.app import main
from uq_handeye.report.page import report_html
from uq_handeye.trials.simulation.several_cameras import simulate_rig, with_noise

RIG = """
[arms.arm]
poses = "robot.csv"
noise = ["0.5mrad", "0.3mm"]
[cameras.left]
on = "arm"
noise = ["0.5mrad", "0.3mm"]
[cameras.front]
on = "world"
noise = ["0.5mrad", "0.3mm"]
[targets.board]
on = "world"
[[views]]
camera = "left"
target = "board"
file = "left.csv"
[[views]]
camera = "front"
target = "board"
file = "front.csv"
"""


def write(path, names, poses):
    rows = np.column_stack([names, poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat()])
    np.savetxt(path, rows, delimiter=",", header="timestamp,x,y,z,qx,qy,qz,qw", comments="", fmt="%.15g")


@pytest.fixture
def folder(tmp_path):
    noise = dict.fromkeys(("arm", "left", "front"), ("0.5mrad", "0.3mm"))
    rig, truth = simulate_rig({"left": "arm", "front": "world"}, {"board": "world"}, n_poses=20, noise=noise, seed=1)
    order = np.random.default_rng(0).permutation(20)
    write(tmp_path / "robot.csv", np.arange(20.0)[order], rig.arms["arm"].poses[order])  # rows in another order
    for view in rig.views:
        write(tmp_path / f"{view.camera}.csv", np.array(view.at, dtype=float)[:15], view.poses[:15])
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path, truth


@pytest.mark.slow
def test_rows_match_by_time_whatever_their_order(folder, capsys):
    path, truth = folder
    rig, noise = uq.read_rig(path / "rig.toml")
    result = calibrate_rig(rig, noise)
    np.testing.assert_allclose(result.cameras["left"].X, truth["left"], atol=5e-3)
    assert result.dof == 6 * 30 - 18
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path / "rig.toml"), "-o", str(path / "out")])
    assert ended.value.code == 0
    assert "world_T_front" in capsys.readouterr().out
    stored = json.loads((path / "out" / "result.json").read_text())
    np.testing.assert_allclose(stored["cameras"]["left"]["pose"], result.cameras["left"].X, atol=1e-12)


def test_nearest_times_need_a_tolerance(folder):
    path, _ = folder
    text = (path / "left.csv").read_text().splitlines()
    text[1] = text[1].replace("0,", "0.01,", 1)
    (path / "left.csv").write_text("\n".join(text))
    with pytest.raises(uq.InputError, match=r"left\.csv names robot pose 0\.01, which the files of the arm 'arm'"):
        uq.read_rig(path / "rig.toml")
    (path / "rig.toml").write_text("tolerance = 0.02\n" + RIG)
    assert uq.read_rig(path / "rig.toml")[0].views[0].at[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('camera = "front"', 'camera = "back"', r"rig\.toml: front\.csv names the camera 'back'"),
        ('on = "world"\n[[views]]', 'on = ["arm", "world"]\n[[views]]', "'board' is on two things"),
        ("[cameras.front]", "[cameras.left]", r"rig\.toml: \[cameras\.left\] is there twice"),
        ("noise", "nose", r"Unknown name 'nose' in \[arms\.arm\]\. Near it: noise"),
        ("[targets.board]", "[target.board]", "Unknown name 'target' at the top of the file. Near it: targets"),
        ('file = "left.csv"', 'file = "left.csv"\nunit = "mm"', r"Unknown name 'unit' in view 1\. Near it: units"),
        ('file = "left.csv"', "", r"Expected one of file, corners, bag in view 1, got none of them"),
        ('file = "left.csv"', 'file = "lft.csv"', r"rig\.toml: Cannot read .*lft\.csv"),
        ('target = "board"', 'target = "bord"', r"left\.csv names the target 'bord', .* Near it: board"),
        ('target = "board"', "target = 3", "Expected `target` in view 1 to be text, got 3"),
        ('on = "arm"\n', "", r"Expected `on` in \[cameras\.left\]: arm or world"),
        ('on = "arm"', 'on = "front"', "'left' is on 'front', which is none of world, arm"),
        ('on = "arm"', 'on = "left"', "'left' is on 'left', which is none of world, arm"),
        ("[cameras.front]", "[cameras.arm]", "names .* that differ, got 'arm' twice"),
        ('poses = "robot.csv"', 'poses = ["robot.csv", "moved.csv"]', "disagree on robot pose 3: .* 10 mm"),
        ('camera = "front"', 'camera = "left"', "both have the view of board by left at robot pose"),
        ('["0.5mrad", "0.3mm"]', "3", r"rig\.toml: Expected the noise of 'arm'"),
        ('["0.5mrad", "0.3mm"]', '["0.3mm", "0.5mrad"]', r"rig\.toml: Unknown unit 'mm' .* of arm"),
        ('["0.5mrad", "0.3mm"]', '"good"', "noise of 'arm' to be"),
        ("[arms.arm]", 'tolerance = "1"\n[arms.arm]', "`tolerance` at the top of the file to be a number"),
        ('on = "world"\n[[views]]', 'on = "world"\nknown = "x.yaml"\n[[views]]', r"Cannot read .*x\.yaml"),
        ('file = "left.csv"', 'file = "empty.csv"', r"empty\.csv: no rows after the header"),
        ('on = "arm"', 'on = "robot"', "is on 'robot', which is none of world, arm"),
    ],
)
def test_what_is_wrong_is_one_line_with_the_name_in_the_file(folder, old, new, message):
    path, _ = folder
    poses = np.array(uq.read_rig(path / "rig.toml")[0].arms["arm"].poses)[:5]
    names = uq.read_rig(path / "rig.toml")[0].arms["arm"].names[:5]
    poses[names.index(3) if 3 in names else 0, 0, 3] += 0.01
    message = message.replace("pose 3", f"pose {3 if 3 in names else names[0]}")
    write(path / "moved.csv", names, poses)
    (path / "empty.csv").write_text("timestamp,x,y,z,qx,qy,qz,qw\n")
    assert old in RIG
    (path / "rig.toml").write_text(RIG.replace(old, new, 1))
    with pytest.raises(uq.InputError, match=message) as caught:
        uq.read_rig(path / "rig.toml")
    assert "\n" not in str(caught.value)
    assert run("calibrate", path / "rig.toml") == 2


@pytest.mark.slow
def test_parts_that_nothing_ties_and_wrong_places_are_told(folder, capsys):
    path, _ = folder
    for old, new, status, said in (
        ("[targets.board]", '[targets.spare]\non = "arm"\n[targets.board]', 2, "target 'spare' has no view"),
        ('on = "arm"', 'on = "world"', 2, "Nothing ties left, front and board to the rest of the rig"),
        ("[cameras.left]", '[arms.b]\nposes = "robot.csv"\nnoise = "exact"\n[cameras.left]', 2, "base of the arm 'b'"),
        ('[targets.board]\non = "world"', '[targets.board]\non = "arm"', 3, "NOT USABLE: residuals "),
    ):
        assert old in RIG
        (path / "rig.toml").write_text(RIG.replace(old, new, 1))
        assert run("calibrate", path / "rig.toml") == status
        printed = capsys.readouterr()
        assert said in (printed.err if status == 2 else printed.out)


@pytest.mark.slow
def test_one_axis_only_is_an_answer_in_part(tmp_path, capsys):
    noise = dict.fromkeys(("arm", "left"), ("0.5mrad", "0.3mm"))
    rig, _ = simulate_rig({"left": "arm"}, {"board": "world"}, n_poses=15, noise=noise, axes=[[0, 0, 1]], seed=1)
    write(tmp_path / "robot.csv", np.arange(15.0), rig.arms["arm"].poses)
    write(tmp_path / "left.csv", np.arange(15.0), rig.views[0].poses)
    given = [tmp_path / "robot.csv", f"--camera=left={tmp_path / 'left.csv'}", "--robot-noise=0.5mrad,0.3mm"]
    assert run("calibrate", *given, "--camera-noise=0.5mrad,0.3mm") == 6
    assert "rotate about another axis" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize(
    "option",
    [
        "--prior-x x", "--pair time", "--setup eye-to-hand", "--exclude 300", "--images x*.png", "--urdf arm.urdf",
    ],
)  # fmt: skip
def test_options_beside_a_rig_file_are_refused(folder, option, capsys):
    path, _ = folder
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(path / "rig.toml"), *option.split(" ", 1)])
    assert ended.value.code == 2 and capsys.readouterr().err


# ------------------------------------------------------------------------------- --camera NAME=FILE


@pytest.fixture
def two_on_the_hand(tmp_path):
    noise = dict.fromkeys(("arm", "left", "right"), ("0.5mrad", "0.3mm"))
    rig, _ = simulate_rig({"left": "arm", "right": "arm"}, {"target": "world"}, n_poses=20, noise=noise, seed=1)
    write(tmp_path / "robot.csv", np.arange(20.0), rig.arms["arm"].poses)
    for view, some in zip(rig.views, (slice(0, 15), slice(19, 3, -1)), strict=True):
        write(tmp_path / f"{view.camera}.csv", np.array(view.at, dtype=float)[some], view.poses[some])
    text = RIG.replace("front", "right").replace("board", "target").replace('on = "world"\nnoise', 'on = "arm"\nnoise')
    (tmp_path / "rig.toml").write_text(text)
    return tmp_path


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code


def cameras_of(path, left="left.csv"):
    return ["--camera", f"left={path / left}", "--camera", f"right={path / 'right.csv'}"]


@pytest.mark.slow
def test_cameras_by_name_are_the_rig_file_that_says_so(two_on_the_hand, capsys):
    path = two_on_the_hand
    assert run("calibrate", path / "rig.toml", "--json") == 0
    by_file = json.loads(capsys.readouterr().out)
    noise = ["--robot-noise", "0.5mrad,0.3mm", "--camera-noise", "0.5mrad,0.3mm"]
    assert run("calibrate", path / "robot.csv", *cameras_of(path), *noise, "--json") == 0
    by_name = json.loads(capsys.readouterr().out)
    for part in ("names", "covariance", "cameras", "targets", "relative", "chi_square"):
        assert by_file[part] == by_name[part], part


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--camera", "left=right.csv"], "The camera 'left' is given twice"),
        (["--camera", "third=none.csv"], "none.csv"),
        (["--camera", "third"], "NAME=FILE"),
        (["--pair", "async"], "--pair async: not for several cameras"),
        (["--camera-scale", "unknown"], "--camera-scale: not for several cameras"),
        (["--exclude", "300"], "no robot pose 300"),
    ],
)
def test_what_is_wrong_with_cameras_by_name_is_one_line(two_on_the_hand, more, message, capsys):
    path = two_on_the_hand
    assert run("calibrate", path / "robot.csv", *cameras_of(path), *more) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1


def test_rows_are_never_matched_by_order_where_files_differ(two_on_the_hand, capsys):
    path = two_on_the_hand
    lines = (path / "left.csv").read_text().splitlines()
    (path / "bare.csv").write_text("\n".join(line.partition(",")[2] for line in lines))
    assert run("calibrate", path / "robot.csv", *cameras_of(path, "bare.csv")) == 2
    assert "do not say which rows belong together" in capsys.readouterr().err


@pytest.mark.slow
def test_views_match_by_the_names_of_poses(two_on_the_hand, capsys):
    """A column `name`, in any order, in place of times; drifts need times, so the answers by time differ by them."""
    path = two_on_the_hand
    for name in ("robot", "left", "right"):
        head, *lines = (path / f"{name}.csv").read_text().splitlines()
        named = [line.partition(",")[2] + f",pose_{int(float(line.partition(',')[0])):03d}.png" for line in lines]
        for order, step in (("forth", 1), ("back", -1)):
            (path / f"{name}_{order}.csv").write_text("\n".join([head.partition(",")[2] + ",name", *named[::step]]))
    poses = []
    for way in ("", "_forth", "_back"):
        cameras = [part for name in ("left", "right") for part in ("--camera", f"{name}={path / f'{name}{way}.csv'}")]
        assert run("calibrate", path / f"robot{way}.csv", *cameras, "--json") == 0
        poses.append(json.loads(capsys.readouterr().out)["cameras"]["left"]["pose"])
    by_time, *by_name = poses
    np.testing.assert_allclose(by_name[1], by_name[0], atol=1e-6)
    np.testing.assert_allclose(by_name[0], by_time, atol=3e-4)  # a fraction of a standard deviation


@pytest.mark.slow
def test_a_tolerance_is_met_by_each_camera(two_on_the_hand, capsys):
    path = two_on_the_hand
    assert run("calibrate", path / "rig.toml", "--tolerance", "5mm,1deg") == 0
    assert "left: PASS" in capsys.readouterr().out
    assert run("calibrate", path / "rig.toml", "--tolerance", "0.01mm") == 5


# ------------------------------------------------------------------------------- result file


def assert_same(one, two):
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, two)
    elif hasattr(one, "__dataclass_fields__"):
        assert type(one) is type(two)
        for name in one.__dataclass_fields__:
            if name not in ("edges", "number"):  # of a path, which the file does not hold
                assert_same(getattr(one, name), getattr(two, name))
    elif isinstance(one, dict | tuple | list):
        assert len(one) == len(two)
        for a, b in zip(one.items(), two.items(), strict=True) if isinstance(one, dict) else zip(one, two, strict=True):
            assert_same(a, b)
    else:
        assert type(one) is type(two) and one == two


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["given", "estimated"])
def test_a_result_is_read_back_bit_by_bit(tmp_path, noise):
    sizes = dict.fromkeys(("a", "b", "left", "front"), ("0.5mrad", "0.3mm"))
    on = ({"left": "a", "front": "world"}, {"board": "world", "tool": "b"})
    rig, truth = simulate_rig(*on, arms=("a", "b"), n_poses=15, noise=sizes, seed=4)
    known = uq.PosePrior.of((truth["board"], np.diag([1e-4] * 3 + [np.inf] * 3)))
    rig = uq.Rig(rig.arms, rig.cameras, rig.targets, rig.views, {"board": known})
    result = calibrate_rig(rig, sizes if noise == "given" else None)
    result.save(tmp_path / "result.json")
    again = uq.load(tmp_path / "result.json")
    assert_same(result, again)
    again.save(tmp_path / "again.json")
    assert (tmp_path / "result.json").read_bytes() == (tmp_path / "again.json").read_bytes()
    assert isinstance(again, uq.RigCalibration) and again.text() == result.text()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda d: d.pop("covariance"), "covariance"),
        (lambda d: d["weights"].pop(), "distances to be numbers"),
        (lambda d: d["cameras"]["left"]["pose"][0].__setitem__(3, 1.0), "cameras.left.pose"),
        (lambda d: d["rig"]["views"][0]["at"].__setitem__(0, 99), "99"),
        (lambda d: d.update(format="uq-handeye rig 1"), "'uq-handeye rig 1'.*uq-handeye calibrate"),
        (lambda d: d["rig"]["cameras"].update(left="nowhere"), "nowhere"),
        (lambda d: d.update(lever="long"), "lever"),
        (lambda d: d["posterior"]["covariance"]["shape"].pop(), "an array cannot be read"),
    ],
)
def test_a_damaged_result_is_refused_in_one_line(two_on_the_hand, damage, message):
    path = two_on_the_hand
    calibrate_rig(*uq.read_rig(path / "rig.toml")).save(path / "result.json")
    data = json.loads((path / "result.json").read_text())
    damage(data)
    (path / "result.json").write_text(json.dumps(data))
    with pytest.raises(uq.InputError, match=message) as caught:
        uq.load(path / "result.json")
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------- exports


@pytest.mark.slow
def test_exports_hold_every_pose_and_the_relative_ones(two_on_the_hand, capsys):
    path = two_on_the_hand
    assert run("calibrate", path / "rig.toml", "-o", path / "out") == 0
    result = uq.load(path / "out" / "result.json")
    for name in ("x.yaml", "cv.yaml", "rig.launch.py", "rig.urdf", "poses.toml", "poses.npz", "again.json"):
        more = ["--format", "opencv"] if name == "cv.yaml" else []
        assert run("export", path / "out" / "result.json", path / name, *more) == 0
    frames = ["gripper_T_left", "gripper_T_right", "world_T_target", "left_T_right"]
    poses = dict(zip(frames, (*result.cameras.values(), *result.targets.values(), *result.pairs), strict=True))
    ros = yaml.safe_load((path / "x.yaml").read_text())
    toml = tomllib.loads((path / "poses.toml").read_text())
    arrays = np.load(path / "poses.npz")
    storage = cv2.FileStorage(str(path / "cv.yaml"), cv2.FILE_STORAGE_READ)
    for name, one in poses.items():
        assert list(ros[name]["transform_stamped"]["transform"]["translation"].values()) == one.pose[:3, 3].tolist()
        S = np.array(ros[name]["pose_with_covariance_stamped"]["pose"]["covariance"]).reshape(6, 6)
        np.testing.assert_allclose(S[:3, :3], one.covariance[3:, 3:], rtol=1e-12)
        table = toml["relative" if name == "left_T_right" else "poses"][name]
        np.testing.assert_array_equal(table["matrix"], one.pose)
        np.testing.assert_array_equal(table["covariance"], one.covariance)
        np.testing.assert_array_equal(arrays[name], one.pose)
        np.testing.assert_allclose(storage.getNode(name).mat(), one.pose, rtol=1e-15)
    launch = (path / "rig.launch.py").read_text()
    assert len(re.findall(r"            Node\(", launch)) == 3 and "# left_T_right, which follows" in launch
    compile(launch, "rig.launch.py", "exec")
    robot = ElementTree.parse(path / "rig.urdf").getroot()
    joints = {(j.find("parent").get("link"), j.find("child").get("link")): j for j in robot.iter("joint")}
    assert set(joints) == {("gripper", "left"), ("gripper", "right"), ("world", "target")}
    xyz = np.array(joints["gripper", "left"].find("origin").get("xyz").split(), dtype=float)
    np.testing.assert_allclose(xyz, poses["gripper_T_left"].pose[:3, 3], rtol=1e-15)
    assert uq.load(path / "again.json").text() == result.text()
    capsys.readouterr()
    assert run("export", path / "out" / "result.json", path / "x.dat", "--format", "kuka") == 2
    assert "toml" in capsys.readouterr().err


# ------------------------------------------------------------------------------- report


@pytest.mark.slow
def test_the_report_shows_the_rig_its_pairs_noise_and_findings(two_on_the_hand, capsys):
    path = two_on_the_hand
    more = ["--report", path / "r.html", "--tolerance", "5mm,1deg", "--about", "cell=Cell 4"]
    code = run("calibrate", path / "rig.toml", "-o", path / "out", *more)
    assert code == 0 and "Wrote" in capsys.readouterr().out
    exports = {"x_ros.yaml", "x.urdf", "x_opencv.yaml", "x.npz"}
    assert {one.name for one in (path / "out").iterdir()} == {"result.json", "rig.txt", "report.html"} | exports
    page = (path / "r.html").read_text()
    for text in ("Both cameras", "left_T_right", "gripper_T_left", "Cell 4", "left: PASS", "Paths that should agree",
                 '<ellipse class="ring"', "left sees target 15 times", "chi-square"):  # fmt: skip
        assert text in page, text
    ElementTree.fromstring(page[page.index("<svg") : page.index("</svg>") + 6])
    assert run("report", path / "out" / "result.json", path / "again.html") == 0
    assert run("report", path / "out" / "result.json") == 0
    assert "gripper_T_left" in capsys.readouterr().out
    assert 'id="pairs"' in (path / "again.html").read_text()
    assert run("calibrate", path / "rig.toml", "--report", path / "r.txt") == 2


@pytest.mark.slow
def test_the_report_says_that_the_noise_is_too_small_and_what_was_rejected(two_on_the_hand):
    rig, _ = uq.read_rig(two_on_the_hand / "rig.toml")
    small = dict.fromkeys(("arm", "left", "right"), ("0.2mrad", "0.1mm"))
    right = np.array(rig.views[1].poses)
    right[3, :3, 3] += 0.05
    wrong = uq.Rig(
        rig.arms, rig.cameras, rig.targets, (rig.views[0], replace(rig.views[1], poses=right), *rig.views[2:])
    )
    assert "rejected" in report_html(calibrate_rig(wrong, small))
    result = calibrate_rig(rig, small)
    assert result.rejected == ()  # outliers are those among views whose errors are all larger than stated
    page = report_html(result, date="today")
    assert not result.usable and "times larger than this noise" in result.reasons[0]
    assert 'class="answer failed"' in page and "times larger than this noise (chi-square" in page
    assert page == report_html(result, date="today")


@pytest.mark.slow
def test_a_rig_that_is_not_determined_says_so_in_its_report():
    rig, _ = simulate_rig({"left": "arm"}, {"board": "world"}, n_poses=20, axes=np.eye(3)[:1], seed=1)
    rig = with_noise(rig, dict.fromkeys(("arm", "left"), ("0.5mrad", "0.3mm")), 1)
    page = report_html(calibrate_rig(rig, dict.fromkeys(("arm", "left"), ("0.5mrad", "0.3mm"))))
    assert "Not determined: 1 direction, of left" in page and "stroke-dasharray" in page


# ------------------------------------------------------------------------------- in use, on the command line


@pytest.mark.slow
def test_check_predict_plan_and_update_on_the_command_line(two_on_the_hand, capsys):
    """The last five poses are new views, in a rig file of their own."""
    path = two_on_the_hand
    for name in ("robot", "left", "right"):
        head, *lines = (path / f"{name}.csv").read_text().splitlines()
        old = [line for line in lines if float(line.partition(",")[0]) < 12]
        (path / f"{name}_old.csv").write_text("\n".join([head, *old]))
        (path / f"{name}_new.csv").write_text("\n".join([head, *(line for line in lines if line not in old)]))
    text = (path / "rig.toml").read_text()
    for when in ("old", "new"):
        (path / f"{when}.toml").write_text(text.replace('.csv"', f'_{when}.csv"'))
    assert run("calibrate", path / "old.toml", "-o", path / "out") == 0
    stored = path / "out" / "result.json"
    capsys.readouterr()
    assert run("check", stored, path / "new.toml", "-o", path / "check") == 0
    by_file = json.loads((path / "check" / "check.json").read_text())
    assert "UNCHANGED" in capsys.readouterr().out and by_file["format"] == "uq-handeye check 2"
    cameras = [f"--camera={name}={path / f'{name}_new.csv'}" for name in ("left", "right")]
    by_camera = ["check", stored, path / "robot_new.csv", *cameras]
    assert run(*by_camera, "--json", "--log", path / "log.csv") == 0
    logged = json.loads(capsys.readouterr().out)
    assert logged == by_file
    assert run(*by_camera, "--log", path / "log.csv") == 2 and "not logged twice" in capsys.readouterr().err
    assert run(*by_camera, "--tolerance", "1mm") == 3 and "CANNOT TELL" in capsys.readouterr().out
    assert run(*by_camera, "--same", "robot,left") == 0
    assert run(*by_camera[:-1], "--same", "none", "--quiet") == 0 and "UNCHANGED" in capsys.readouterr().out
    more = ["--into", "right", "--robot", path / "robot.csv"]
    assert run("predict", stored, "--of", "left", "--point", "0mm,0mm,300mm", *more) == 0
    by_row = capsys.readouterr().out.splitlines()
    assert "Points of left in the frame right" in by_row[0]
    assert run("predict", stored, "--of", "left", "--point", "0mm,0mm,300mm", "--into", "right") == 0
    assert capsys.readouterr().out.splitlines()[2] == by_row[2]  # wherever the arm stands
    assert run("predict", stored, "--of", "left", "--point", "0mm,0mm,300mm") == 2
    assert "No robot poses to predict at" in capsys.readouterr().err
    assert run("plan", stored, "-k", "3", "--candidates", path / "robot.csv", "-o", path / "plan") == 0
    assert "camera" in capsys.readouterr().out and (path / "plan" / "next.csv").exists()
    assert run("update", stored, path / "new.toml", "-o", path / "new", "--report", path / "new.html") == 0
    rig, noise = uq.read_rig(path / "rig.toml")
    capsys.readouterr()
    np.testing.assert_allclose(uq.load(path / "new" / "result.json").poses, calibrate_rig(rig, noise).poses, atol=1e-9)
    for wrong, said in (
        (("check", stored, path / "robot.csv"), "come as a rig file"),
        (("check", stored, path / "robot.csv", path / "left.csv"), "CAMERA: not for the result of a rig"),
        (("check", stored, path / "robot.csv", "--camera", f"up={path / 'left.csv'}"), "the rig has left, right"),
        (("check", stored, path / "new.toml", "--camera", f"left={path / 'left.csv'}"), "names all files"),
        (("check", stored, path / "new.toml", "--same", "lef"), "Expected `same` (--same) to be names out of"),
        (("update", stored, path / "new.toml", "--same", "left"), "`same` is not an argument for the result of a rig"),
        (("predict", stored, "--point", "0mm,0mm,1mm"), "No robot poses to predict at"),
        (("plan", stored, "--criterion", "logdet"), "not an argument for the result of a rig"),
    ):
        assert run(*wrong) == 2
        assert said in capsys.readouterr().err


# ------------------------------------------------------------------------------------------- certificate, drawing


@pytest.mark.slow
def test_a_certificate_states_every_pose_of_a_rig(two_on_the_hand, capsys):
    path = two_on_the_hand
    assert run("calibrate", path / "rig.toml", "-o", path / "out") == 0
    stored = path / "out" / "result.json"
    result = uq.load(stored)
    found = uq.make_certificate(result, tolerance="1mm,0.1deg", about={"cell": "7"}, issued="today")
    data = found.to_dict()
    assert data["certified"] and set(data["poses"]) == {"left", "right", "target"}
    for name, one in data["poses"].items():
        pose = {**result.cameras, **result.targets}[name]
        np.testing.assert_array_equal(one["pose"], pose.pose)
        drawn = np.random.default_rng(0).multivariate_normal(np.zeros(6), pose.covariance, 200_000)
        for part, size in (("translation", drawn[:, 3:]), ("rotation", drawn[:, :3])):
            within = np.mean(np.linalg.norm(size, axis=1) < one["expanded"][part])
            assert within == pytest.approx(0.95, abs=0.005)
    assert data["decision"]["left"]["verdict"] == "PASS" and data["optimality"]["proven"]
    other = uq.make_certificate(result, about={"cell": "8"}, issued="today")
    assert other.identifier != found.identifier == uq.make_certificate(
        result, tolerance="1mm,0.1deg", about={"cell": "7"}, issued="tomorrow").identifier  # fmt: skip
    capsys.readouterr()
    assert run("certificate", stored, path / "rig.html", "--tolerance", "1mm,0.1deg", "--about", "cell=7") == 0
    assert found.identifier in capsys.readouterr().out
    page = (path / "rig.html").read_text()
    assert "left: PASS" in page and found.identifier in page and "gripper_T_right" in page
    assert run("certificate", stored, "--tolerance", "1um,0.0001deg") == 5


@pytest.mark.slow
def test_a_rig_in_which_something_moved_is_not_certified(two_on_the_hand):
    path = two_on_the_hand
    rig, noise = uq.read_rig(path / "rig.toml")
    views = []
    for view in rig.views:
        poses = np.array(view.poses)
        poses[np.array(view.at) > 9, 0, 3] += 0.02 if view.camera == "left" else 0.0
        views.append(uq.View(view.camera, view.target, poses, view.at))
    result = calibrate_rig(uq.Rig(rig.arms, rig.cameras, rig.targets, views), noise)
    found = uq.make_certificate(result)
    assert not found.certified and "poses" not in found.to_dict()
    assert "NOT CERTIFIED" in found.to_html() and "gripper_T_left" not in found.to_html()
    result.save(path / "moved.json")
    assert run("certificate", path / "moved.json") == 3


@pytest.mark.slow
def test_the_report_has_the_certificate_of_the_minimum_and_a_drawing_of_many_cameras():
    cameras = {f"camera <{k}> with a long name": "world" if k else "arm" for k in range(5)}
    targets = {f"tag {k}": "world" if k == 1 else "arm" for k in range(4)}
    noise = dict.fromkeys(("arm", *cameras), ("0.5mrad", "0.3mm"))
    rig, _ = simulate_rig(cameras, targets, n_poses=15, noise=noise, seed=1)
    result = calibrate_rig(rig, noise)
    page = report_html(result, details=True)
    assert "Certificate of the global minimum" in page and "relative gap" in page
    svg = re.search(r"<svg viewBox=.*?</svg>", page, re.S).group()
    tree = ElementTree.fromstring(svg)
    texts = [of.text for of in tree.iter() if of.tag.endswith("text")]
    assert texts.count("15") == 5 * 4 and "tag 3" in texts and any(of.startswith("camera <4>") for of in texts)
    width, height = (float(of) for of in tree.attrib["viewBox"].split()[2:])
    for of in tree.iter():
        if of.tag.endswith("text"):
            assert 0 <= float(of.attrib["x"]) <= width and 0 <= float(of.attrib["y"]) <= height
    assert sum(of.tag.endswith("ellipse") for of in tree.iter()) == 9
