"""``uq-handeye camera`` and ``calibrate`` on its folder and on pictures: from pictures to X as a user meets it."""

import json
import shutil
from hashlib import sha256

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.pictures import SIZE, simulated_rig, write_pictures
from scipy import stats
from support import CONFIDENCE, SEED, difference

import uq_handeye as uq
from uq_handeye.cli.pictures import COEFFICIENT_NAMES, MODEL_NAMES
from uq_handeye.model.camera.corners_file import corners_text
from uq_handeye.model.camera.description import Board
from uq_handeye.model.camera.models import MODELS
from uq_handeye.read import write_pose_file

pytestmark = pytest.mark.slow

cv2 = pytest.importorskip("cv2")
BOARD = ("--board", "9x6", "--square", "20mm")
FAR = stats.chi2.ppf(CONFIDENCE, 6)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """Pictures img0.png ... of which 4 is blank, robot.csv, and the truth."""
    folder = tmp_path_factory.mktemp("rig")
    poses = write_pictures(folder, Board(9, 6, 0.02), np.random.default_rng([SEED, 8]), n=9, blank=(4,))
    return folder, poses.truth.X


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """corners.csv of a camera without distortion, robot.csv, and the truth."""
    folder = tmp_path_factory.mktemp("table")
    poses, corners = simulated_rig(Board(9, 6, 0.02), np.random.default_rng([SEED, 9]), n=16)
    (folder / "corners.csv").write_text(corners_text(corners, np.ones(corners.m, dtype=bool)))
    write_pose_file(folder / "robot.csv", poses.robot)
    assert (
        run(
            "camera", "corners.csv", "--image-size", "640x480", "--model", "pinhole", "-o", "camera", cwd=folder
        ).returncode
        == 0
    )
    return folder, poses.truth.X


def squared_distance(out, truth):
    """d^2 of the truth by what calibrate --json prints."""
    found = json.loads(out)
    xi = difference(np.array(truth), np.array(found["X"]))
    return float(xi @ np.linalg.solve(np.array(found["covariance"]), xi)), found


def test_from_pictures_to_x_in_two_commands(rig):
    folder, truth = rig
    done = run("camera", "img/*.png", *BOARD, "-o", "camera", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "from 8 pictures, 432 corners" in done.stdout and "fx  " in done.stdout
    assert done.stdout.endswith("Wrote camera. Next: uq-handeye calibrate robot.csv camera\n")
    assert "not found in 1 of 9 pictures, which are left out: img4.png" in done.stderr
    assert {
        "camera.csv",
        "camera_covariance.npz",
        "intrinsics.json",
        "intrinsics.yaml",
        "corners.csv",
        "report.html",
    } <= {path.name for path in (folder / "camera").iterdir()}
    cam = uq.read_camera(folder / "camera")
    assert cam.image_size == SIZE and cam.pixel_noise < 0.1
    assert abs(cam.intrinsics["fx"] - 750) < 4 * cam.std["fx"] + 0.5
    brief = run("camera", "camera/corners.csv", "--image-size", "640x480", "-q", cwd=folder).stdout
    assert brief.startswith("Camera, model") and "Intrinsics" not in brief and brief.count("\n") < 7
    done = run("calibrate", "robot.csv", "camera", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "rows without a picture of the board are left out: 4" in done.stderr
    d2, found = squared_distance(done.stdout, truth)
    assert d2 < FAR and np.abs(np.array(found["X"])[:3, 3] - truth[:3, 3]).max() < 3e-4
    assert found["n_poses"] == 8
    assert isinstance(uq.read_poses(folder / "robot.csv", folder / "camera").camera_calibration, uq.CameraCalibration)


def test_from_pictures_to_x_in_one_command(rig):
    folder, truth = rig
    command = ("calibrate", "robot.csv", "--images", "img/*.png", *BOARD, "--model", "pinhole", "--json")
    done = run(*command, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "note: the camera: pinhole, pixel noise 0.0" in done.stderr
    d2, found = squared_distance(done.stdout, truth)
    assert d2 < FAR
    data = b"".join((folder / "img" / f"img{k}.png").read_bytes() for k in range(9))
    (_, pictures) = found["provenance"]["sources"]
    assert pictures["name"] == "img0.png to img8.png (9)" and pictures["size"] == len(data)
    assert pictures["sha256"] == sha256(data).hexdigest()


def test_a_picture_too_few_is_said(rig, tmp_path):
    """All later ones would be taken for those of other robot poses."""
    folder, _ = rig
    shutil.copytree(folder / "img", tmp_path / "img")
    (tmp_path / "img" / "img0.png").unlink()
    (tmp_path / "img" / "img4.png").unlink()  # the blank one: every picture left shows a board
    done = run("calibrate", folder / "robot.csv", "--images", "img", *BOARD, "--model", "pinhole", cwd=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert "has 9 poses and the pictures 7 pictures, none of them without a board" in done.stderr


def test_half_turns_of_a_board_that_does_not_tell_are_resolved(rng, tmp_path):
    poses = write_pictures(tmp_path, Board(8, 6, 0.02), rng, n=8)
    files = sorted((tmp_path / "img").iterdir())
    for path in files[1:3]:  # the camera upside down: the board is taken for the other way up, and so is the robot
        cv2.imwrite(str(path), np.rot90(cv2.imread(str(path), 0), 2))
    turn = np.diag([-1.0, -1, 1, 1])
    X = poses.truth.X
    robot = poses.robot.copy()
    robot[1:3] = robot[1:3] @ X @ turn @ np.linalg.inv(X)
    write_pose_file(tmp_path / "robot.csv", robot)
    done = run(
        *(
            "calibrate",
            "robot.csv",
            "--images",
            "img",
            "--board",
            "8x6",
            "--square",
            "0.02",
            "--model",
            "pinhole",
            "--json",
        ),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "the other way up in 2 of 8 pictures: img1.png, img2.png" in done.stderr
    assert "looks the same" not in done.stderr  # for it was resolved
    # Robot noise from the 36 residuals that X and W leave of 8 poses has wider tails than chi-square.
    assert squared_distance(done.stdout, X)[0] < 6 * stats.f.ppf(CONFIDENCE, 6, 36)


def test_corners_of_another_program(table):
    folder, truth = table
    done = run("calibrate", "robot.csv", "camera", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert squared_distance(done.stdout, truth)[0] < FAR


def test_the_board_as_measured_is_that_of_the_next_pictures(rig, table):
    """The board.csv from pictures says which board it is; from a table it does not, and serves tables."""
    folder, _ = rig
    assert run("camera", "img/*.png", *BOARD, "-o", "first", cwd=folder).returncode == 0
    done = run("camera", "img/*.png", "--board", "first/board.csv", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)["board"]
    assert found["shape"] == "measured" and found["printed"] == Board(9, 6, 0.02).text
    folder, _ = table
    again = ("camera", "corners.csv", "--image-size", "640x480", "--board", "camera/board.csv")
    assert json.loads(run(*again, "--json", cwd=folder).stdout)["board"]["shape"] == "measured"
    for more, message in (
        (("--square", "20mm"), "--square: not used with --board camera/board.csv"),
        (("--board-shape", "bow2"), "--board-shape: the file of --board holds the shape"),
    ):
        done = run(*again, *more, cwd=folder)
        assert done.returncode == 2 and message in done.stderr and done.stderr.count("\n") == 1
    done = run("camera", "*.png", "--board", "camera/board.csv", cwd=folder)
    assert done.returncode == 2 and "does not name the kind of board" in done.stderr


def test_json_is_that_of_the_folder(table):
    folder, _ = table
    done = run("camera", "corners.csv", "--image-size", "640X480", "--model", "pinhole", "--json", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == json.loads((folder / "camera" / "intrinsics.json").read_text())
    text = run("camera", "corners.csv", "--image-size", "640x480", "--model", "fisheye", cwd=folder).stdout
    assert "Nothing was written: give -o camera/" in text


def test_known_intrinsics_of_a_file(table):
    folder, _ = table
    (folder / "factory.json").write_text('{"fx": [750.0, 0.1], "fy": [746.0, 0.1], "image_size": [640, 480]}')
    done = run("camera", "corners.csv", "--intrinsics", "factory.json", "--model", "pinhole", "-o", "known", cwd=folder)
    assert done.returncode == 0, done.stderr
    cam = uq.read_camera(folder / "known")
    assert 0 < cam.std["fx"] <= 0.1 and abs(cam.intrinsics["fx"] - 750) < 0.5
    done = run("camera", "corners.csv", "--intrinsics", "camera/intrinsics.yaml,exact", "-o", "exact", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert uq.read_camera(folder / "exact").std["fx"] == 0.0
    done = run("camera", "corners.csv", "--intrinsics", "camera/intrinsics.yaml", "-o", "given", cwd=folder)
    assert done.returncode == 0 and 0.0 < uq.read_camera(folder / "given").std["fx"] < 0.75
    (folder / "off.json").write_text('{"fx": 750.0, "fy": 746.0, "cx": 360.0, "cy": 240.0, "image_size": [640, 480]}')
    done = run("camera", "corners.csv", "--intrinsics", "off.json", cwd=folder)
    assert done.returncode == 3 and "cx 360 given" in " ".join(done.stdout.split())
    (folder / "large.json").write_text('{"fx": 1500.0, "image_size": [1280, 960]}')
    done = run("camera", "corners.csv", "--image-size", "640x480", "--intrinsics", "large.json", cwd=folder)
    assert done.returncode == 0 and "scaled by 0.5 from 1280 x 960" in " ".join(done.stdout.split())
    (folder / "wide.json").write_text('{"fx": 750.0, "image_size": [1280, 720]}')
    done = run("camera", "corners.csv", "--image-size", "640x480", "--intrinsics", "wide.json", cwd=folder)
    assert done.returncode == 2 and "another aspect: a part of them. Add --roi" in done.stderr


@pytest.mark.parametrize(
    "command",
    [
        ("compare", "--methods", "park,tsai"),
        ("validate", "--trials", "200", "--workers", "1"),
        ("cross-check", "--trials", "200", "--no-posterior", "--workers", "1"),
        ("posterior", "--samples", "100", "--walkers", "32"),
        ("plan", "-k", "1"),
    ],
    ids=lambda command: command[0],
)
def test_other_commands_take_the_folder(table, command):
    folder, _ = table
    name, *options = command
    done = run(name, "robot.csv", "camera", *options, cwd=folder)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("camera corners.csv", "The table of corners has no image size. Add --image-size"),
        ("camera corners.csv --image-size 640", "--image-size to be two numbers such as 1920x1080, got '640'"),
        ("camera corners.csv --image-size 480x640", "Are width and height swapped?"),
        (
            "camera corners.csv --image-size 640x480 --board 9x6",
            "--board: for pictures, but corners.csv is a table",
        ),
        ("camera nothing.csv --image-size 640x480", "nothing.csv: there is no such file"),
        ("camera *.png --board 9x6 --square 0.02", "No pictures found for *.png"),
        ("camera *.png --board 9x6", "Pictures need --board and --square"),
        ("camera *.png --board 9 --square 0.02", "--board to be two numbers such as 9x6, got '9'"),
        ("camera *.png --board 9x6 --square 20", "--square 20 is 20 m, larger than any board"),
        ("camera *.png --board 9x6 --square x", "Expected --square to be a length"),
        ("camera *.png --board 9x6 --square 0.02 --dictionary 4X4_50", "Add --marker LENGTH"),
        ("camera *.png --board 9x6 --square 0.02 --image-size 640x480", "applies to a table of corners"),
        ("camera corners.csv --image-size 640x480 --model zoom", "Expected --model to be one of auto, pinhole"),
        ("camera corners.csv --image-size 640x480 --coefficients k1", "name the `model`"),
        ("camera corners.csv --image-size 640x480 --model brown --coefficients k9", "has no parameter 'k9'"),
        ("camera corners.csv --image-size 640x480 --intrinsics no.json", "no.json: there is no such file"),
        ("calibrate robot.csv camera --pair time", "--pair: for files of camera poses, not for the folder camera"),
        ("calibrate robot.csv camera --units camera=mm", "--units: for files of camera poses"),
        (
            "calibrate robot.csv camera.csv --images *.png --board 9x6 --square 0.02",
            "Both a file of camera poses, camera.csv, and --images are given",
        ),
        ("calibrate robot.csv camera --board 9x6", "--board: needs pictures or a camera matrix. Add --images"),
        ("calibrate robot.csv .", ". lacks intrinsics.json, camera_covariance.npz"),
    ],
)
def test_bad_usage_is_one_line(table, arguments, message):
    folder, _ = table
    done = run(*arguments.split(), cwd=folder)
    assert done.returncode == 2 and message in done.stderr, done.stderr
    assert done.stderr.count("\n") == 1 and done.stdout == ""


def test_too_few_robot_poses_for_the_pictures(rig, tmp_path):
    folder, _ = rig
    write_pose_file(tmp_path / "robot.csv", uq.read_poses(folder / "robot.csv", folder / "robot.csv").robot[:8])
    done = run("calibrate", tmp_path / "robot.csv", "--images", "img/*.png", *BOARD, "--model", "pinhole", cwd=folder)
    assert done.returncode == 2
    assert "robot.csv has 8 poses, and there are 9 pictures: expected a robot pose for each" in done.stderr


def test_names_that_are_written_down_once_more():
    assert list(MODEL_NAMES) == ["auto", *MODELS]
    assert set(COEFFICIENT_NAMES) == {name for model in MODELS.values() for name in model.coefficients}


def test_a_board_in_millimetres_is_said_and_how_to_mend_it(table, tmp_path):
    folder, _ = table
    corners = uq.read_corners(folder / "corners.csv")
    (tmp_path / "mm.csv").write_text(
        corners_text(uq.Corners(corners.row, 1e3 * corners.points, corners.pixels), np.ones(corners.m, dtype=bool))
    )
    options = ("mm.csv", "--image-size", "640x480", "--model", "pinhole")
    done = run("camera", *options, "-o", "camera", cwd=tmp_path)
    assert done.returncode == 0 and "look like millimetres" in done.stderr and "--units mm" in done.stderr
    done = run("calibrate", folder / "robot.csv", "camera", "--json", cwd=tmp_path)
    assert "Calibrate the camera again with the board in its unit (--units mm" in done.stderr
    assert "look like millimetres" not in run("camera", *options, "--units", "mm", cwd=tmp_path).stderr
