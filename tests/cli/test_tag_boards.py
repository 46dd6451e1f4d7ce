"""Options of boards of tags: ``camera`` and ``calibrate`` on their pictures, and what is refused."""

import json

import numpy as np
import pytest
from fixtures.commands import run
from fixtures.pictures import write_pictures
from support import SEED

import uq_handeye as uq
from uq_handeye.model.camera.kalibr_target import read_target

GRID = ("--pattern", "aprilgrid", "--board", "4x3", "--square", "40mm", "--spacing", "0.3")
CHECKERBOARD = """target_type: checkerboard
targetCols: 9
targetRows: 6
rowSpacingMeters: 0.02
colSpacingMeters: 0.02
"""
TAG = ("--tag", "20mm", "--camera-matrix", "750,746,320,240")


@pytest.fixture(scope="module")
def grid(tmp_path_factory):
    """Pictures of an AprilGrid, robot.csv, target.yaml, and the truth."""
    folder = tmp_path_factory.mktemp("grid")
    board = uq.Board(4, 3, 0.04, "aprilgrid", spacing=0.3)
    poses = write_pictures(folder, board, np.random.default_rng([SEED, 21]), n=5)
    (folder / "target.yaml").write_text(
        "target_type: 'aprilgrid' # gridtype\ntagCols: 4\ntagRows: 3\ntagSize: 0.04\ntagSpacing: 0.3\n"
    )
    return folder, poses.truth.X


@pytest.fixture(scope="module")
def tag(tmp_path_factory):
    """Pictures of a tag of 25 pixels, robot.csv, and the truth."""
    folder = tmp_path_factory.mktemp("tag")
    board = uq.Board(1, 1, 0.02, "apriltag", first_id=5)
    poses = write_pictures(folder, board, np.random.default_rng([SEED, 22]), n=5)
    return folder, poses.truth.X


def error(out, truth):
    return 1e3 * np.linalg.norm(np.array(json.loads(out)["X"])[:3, 3] - truth[:3, 3])


@pytest.mark.slow
def test_an_aprilgrid_by_its_options_and_by_the_file_of_kalibr(grid):
    folder, truth = grid
    done = run("camera", "img/*.png", *GRID, "--model", "pinhole", "--board-shape", "flat", "-o", "camera", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "# board: columns=4 rows=3 square=0.04 kind=aprilgrid" in (folder / "camera" / "board.csv").read_text()
    images = ("--images", "img/*.png", "--board", "target.yaml", "--model", "pinhole", "--board-shape", "flat")
    done = run("calibrate", "robot.csv", *images, "--json", cwd=folder)
    assert done.returncode == 0 and error(done.stdout, truth) < 0.5, done.stderr
    again = run("calibrate", "robot.csv", "camera", "--json", cwd=folder)
    np.testing.assert_allclose(json.loads(again.stdout)["X"], json.loads(done.stdout)["X"], atol=1e-9)


@pytest.mark.slow
def test_pictures_of_a_single_tag(tag):
    folder, truth = tag
    done = run("calibrate", "robot.csv", "--images", "img/*.png", *TAG, "--json", cwd=folder)
    assert done.returncode == 0 and error(done.stdout, truth) < 2.0, done.stderr
    (folder / "k.json").write_text('{"fx": [750.0, 0.5], "fy": 746.0, "cx": 320, "cy": 240}')
    file = ("--pattern", "apriltag", "--square", "20mm", "--first-id", "5", "--camera-matrix", "k.json")
    done = run("calibrate", "robot.csv", "--images", "img/*.png", *file, "--json", cwd=folder)
    assert done.returncode == 0 and error(done.stdout, truth) < 2.0, done.stderr


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--tag", "20mm"), "Add --camera-matrix, e.g. 1080,1080,960,540"),
        ((*TAG, "--board", "6x6"), "either --tag or --board"),
        ((*TAG, "--pixel-noise", "0.2px"), "--pixel-noise: for finished camera poses"),
        ((*TAG, "--model", "brown"), "--model: not used with --camera-matrix"),
        ((*GRID, "--camera-matrix", "1,1,1,1"), "single tags, not for --images of a board"),
        ((*GRID[:-2],), "Add --spacing, e.g. 0.3"),
        ((*GRID[:2], "--square", "40mm"), "Add --board COLSxROWS"),
        ((*GRID[:4],), "needs the side of a tag"),
        ((*GRID, "--marker", "30mm"), "Of aprilgrid give the side of a tag as --square"),
        ((*GRID, "--dictionary", "4X4_50"), "of AprilTags"),
        (("--kind", *GRID[1:]), "Name the kind of the board as --pattern aprilgrid"),
        (("--board", "9x6", "--square", "20mm", "--spacing", "3mm"), "Add --pattern aprilgrid"),
        ((*TAG, "--first-id", "6"), "No tag 6 of APRILTAG_36H11"),
        ((*TAG, "--first-id", "600"), "APRILTAG_36H11 has 587"),
    ],
)
def test_what_is_refused(tag, options, message):
    folder, _ = tag
    done = run("calibrate", "robot.csv", "--images", "img/*.png", *options, cwd=folder)
    assert done.returncode == 2 and message in done.stderr and done.stdout == ""
    assert done.stderr.count("error:") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("tagCols: 4", "expected a target of Kalibr"),
        ("target_type: circlegrid", "got target_type 'circlegrid'"),
        ("target_type: aprilgrid\ntagCols: 4\ntagRows: 3\ntagSize: 0.04", "expected tagSpacing"),
        ("target_type: aprilgrid\ntagCols: 4.5\ntagRows: 3", "a whole number"),
        (CHECKERBOARD.replace("col", "# col") + "colSpacingMeters: 0.03", "squares"),
        ("- 1", "expected a target of Kalibr"),
    ],
)
def test_files_that_are_no_target(tmp_path, text, message):
    (tmp_path / "target.yaml").write_text(text)
    done = run("camera", "img/*.png", "--board", "target.yaml", cwd=tmp_path)
    assert done.returncode == 2 and "target.yaml" in done.stderr and message in done.stderr


def test_a_chessboard_of_kalibr_is_read(tmp_path):
    (tmp_path / "t.yaml").write_text(CHECKERBOARD)
    assert read_target(tmp_path / "t.yaml") == uq.Board(9, 6, 0.02)


def test_a_tag_may_name_its_kind(tag):
    asked = ("calibrate", tag[0] / "robot.csv", "--images", str(tag[0] / "none*.png"), *TAG, "--pattern", "aruco")
    assert "No pictures found" in run(*asked).stderr
    assert "Give either --tag or" in run(*asked, "--board", "4x3").stderr
