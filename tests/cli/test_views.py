"""Finished camera poses with board and camera matrix on the command line: numbers, forms of files, what is refused."""

import json

import numpy as np
import pytest
from fixtures.commands import run
from scipy import stats
from support import CONFIDENCE, SEED, difference

import uq_handeye as uq
from studies.camera_covariance import board, poses_of, recorded
from uq_handeye.cli.views import INTRINSICS
from uq_handeye.errors import InputError
from uq_handeye.model.camera.board_file import read_board_points
from uq_handeye.model.shared_errors import camera_noise
from uq_handeye.read import write_pose_file

BOARD = ("--board", "9x6", "--square", "30mm")
FAR = stats.chi2.ppf(CONFIDENCE, 6)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """robot.csv and camera.csv of finished poses, the camera matrix and what is true."""
    folder = tmp_path_factory.mktemp("views")
    corners, robot, X = recorded(np.random.default_rng([SEED, 21]), 16, model="brown")
    poses = poses_of(corners, robot, "brown")
    write_pose_file(folder / "robot.csv", poses.robot)
    write_pose_file(folder / "camera.csv", poses.camera)
    seen = poses.camera_calibration
    K = [round(seen.intrinsics[name], -1) for name in ("fx", "fy", "cx", "cy")]
    matrix = [K[0], 0, K[2], 0, K[1], K[3], 0, 0, 1]
    size = {"image_width": 1280, "image_height": 960}
    (folder / "info.yaml").write_text(json.dumps({**size, "camera_matrix": {"rows": 3, "cols": 3, "data": matrix}}))
    (folder / "topic.yaml").write_text(f"height: 960\nwidth: 1280\nd: [0, 0, 0, 0, 0]\nk: {matrix}\n")
    named = dict(zip(("fx", "fy", "cx", "cy"), K, strict=True))
    (folder / "known.json").write_text(json.dumps(named))
    (folder / "prior.json").write_text(json.dumps({name: [value, 2.0] for name, value in named.items()}))
    lines = [",".join(map(str, 1e3 * point)) for point in board()]
    (folder / "points.csv").write_text("\n".join(["x_mm,y_mm,z_mm", *lines, ""]))
    return folder, X, ",".join(map(str, K)), poses


def calibrate(folder, *arguments, returncode=0):
    done = run("calibrate", "robot.csv", "camera.csv", *arguments, "--json", cwd=folder)
    assert done.returncode == returncode, done.stderr
    return json.loads(done.stdout)


def components(found):
    return {part["name"]: part for part in found["noise_estimate"]["components"]}


@pytest.mark.slow
def test_board_and_camera_matrix_give_the_noise(rig):
    folder, X, K, _ = rig
    found = calibrate(folder, *BOARD, "--camera-matrix", K)
    xi = difference(X, np.array(found["X"]))
    assert xi @ np.linalg.solve(np.array(found["covariance"]), xi) < FAR
    assert components(found)["pixel noise"]["low"] < 0.2 < components(found)["pixel noise"]["high"]
    finished = uq.read_poses(folder / "robot.csv", folder / "camera.csv")  # with their timestamps, thus with drift
    noise = uq.camera_noise(finished, board(), [float(value) for value in K.split(",")])
    np.testing.assert_allclose(uq.calibrate(finished, noise=noise).covariance, found["covariance"], rtol=1e-3)
    text = run("calibrate", "robot.csv", "camera.csv", *BOARD, "--camera-matrix", K, "-v", cwd=folder).stdout
    assert "geometry of the views" in text and " px " in text


@pytest.mark.slow
@pytest.mark.parametrize("matrix", ["info.yaml", "topic.yaml", "known.json"])
def test_the_camera_in_files_and_the_board_as_points(rig, matrix):
    folder, _, K, _ = rig
    given = calibrate(folder, *BOARD, "--camera-matrix", K)
    found = calibrate(folder, "--board", "points.csv", "--camera-matrix", matrix)
    np.testing.assert_allclose(found["X"], given["X"], atol=1e-9)


@pytest.mark.slow
def test_what_is_known_of_the_intrinsics_and_of_the_noise(rig):
    folder, _, K, poses = rig
    sizes = {}
    for name, more in {
        "estimated": (),
        "exact": ("--intrinsics", "exact"),
        "pinhole": ("--intrinsics", "pinhole"),
        "prior": (),
    }.items():
        matrix = "prior.json" if name == "prior" else K
        alone = ("--pixel-noise", "0.2px", "--no-robust", "--robot-noise", "exact", "--correlation", "none")
        given = ("--camera-matrix", matrix, *more, *alone)
        # K is rounded to 10 px, the poses are of pictures with distortion: taken as exact, the residuals contradict it
        found = calibrate(folder, *BOARD, *given, returncode=3 if name == "exact" else 0)
        sizes[name] = np.sqrt(np.diag(np.array(found["covariance"])))
        assert components(found)["pixel noise"]["status"] == "given"
        assert "robot rotation" not in components(found)  # an exact robot has none
    assert (sizes["exact"] < sizes["pinhole"]).all() and (sizes["pinhole"] < sizes["estimated"]).all()
    assert (sizes["exact"] < sizes["prior"]).all()
    known = calibrate(folder, *BOARD, "--camera-matrix", K, "--robot-noise", "0.003deg,0.02mm")
    assert components(known)["robot rotation"]["status"] == "fixed"
    (folder / "robot.toml").write_text('[robot]\nrotation = "0.003deg"\ntranslation = "0.02mm"\n')
    in_file = calibrate(folder, *BOARD, "--camera-matrix", K, "--noise", "robot.toml")
    np.testing.assert_allclose(in_file["covariance"], known["covariance"], rtol=0.02)
    write = poses.camera_calibration
    write.write(folder / "camera")
    assert components(calibrate(folder, *BOARD, "--camera-matrix", "camera"))["pixel noise"]["size"] > 0


@pytest.mark.slow
def test_other_commands_take_the_same(rig):
    folder, _, K, _ = rig
    given = ("robot.csv", "camera.csv", *BOARD, "--camera-matrix", K)
    found = json.loads(run("compare", *given, "--methods", "park,efficient", "--json", cwd=folder).stdout)
    assert len(found["methods"]) == 2
    done = run("validate", *given, "--trials", "100", "--json", cwd=folder)
    assert done.returncode == 0 and json.loads(done.stdout)["trials"] == 100


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (BOARD, "or --camera-matrix."),
        (("--tag", "40mm"), "--tag: these options need --camera-matrix"),
        (("--camera-matrix", "K"), "needs the target: add --board"),
        ((*BOARD, "--camera-matrix", "none.yaml"), "a file or a folder"),
        ((*BOARD, "--camera-matrix", "1,2,3"), "a file or a folder"),
        ((*BOARD, "--camera-matrix", "points.csv"), "points.csv"),
        ((*BOARD, "--camera-matrix", "1,1,0.5,0.5"), "in pixels"),
        ((*BOARD, "--camera-matrix", "1200,1200,60,50"), "does not fit"),
        (("--board", "9x6", "--square", "30", "--camera-matrix", "K"), "larger than any board"),
        (("--board", "points.csv", "--square", "30mm", "--camera-matrix", "K"), "Remove the option"),
        (("--board", "robot.csv", "--camera-matrix", "K"), "expected the header x,y,z"),
        ((*BOARD, "--tag", "40mm", "--camera-matrix", "K"), "either --tag or --board"),
        ((*BOARD, "--camera-matrix", "K", "--intrinsics", "known.json"), "one of estimated, pinhole, exact"),
        (
            (*BOARD, "--camera-matrix", "K", "--camera-noise", "0.1deg,1mm"),
            "The camera noise follows from the views (--camera-matrix",
        ),
        ((*BOARD, "--camera-matrix", "K", "--pixel-noise", "2mm"), "--pixel-noise"),
        ((*BOARD, "--camera-matrix", "K", "--model", "brown"), "for pictures, not for --camera-matrix"),
        ((*BOARD, "--camera-matrix", "K", "--images", "img/*.png"), "for finished camera poses and single tags"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(rig, arguments, words):
    folder, _, K, _ = rig
    arguments = [K if argument == "K" else argument for argument in arguments]
    done = run("calibrate", "robot.csv", "camera.csv", *arguments, cwd=folder)
    assert done.returncode == 2 and words in done.stderr and len(done.stderr.strip().splitlines()) == 1, done.stderr


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "the file is empty; expected the header x,y,z"),
        ("x,y,z\n", "no rows after the header"),
        ("1,2,3\n", "header x,y,z"),
        ("x,y,z\n1,2\n", "line 2: expected 3 fields separated by commas, got 2"),
        ("x,y,z\n1,two,3\n", "line 2, column y: expected a number, got 'two'"),
        ("x,y,z\n1,2,inf\n", "line 2, column z: expected a finite number, got inf"),
        ("x_deg,y,z\n1,2,3\n", "header x,y,z"),
    ],
)
def test_tables_of_points_that_are_none(tmp_path, text, words):
    (tmp_path / "points.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_board_points(tmp_path / "points.csv")


def test_names_are_those_of_the_function():
    assert INTRINSICS == (camera_noise.ESTIMATED, camera_noise.PINHOLE, camera_noise.EXACT)
