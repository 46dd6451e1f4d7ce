"""The board as measured: its bow with its deviation, board.csv as a prior, and residuals that follow its points."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from fixtures.reports import Page, overlapping
from support import SEED

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded
from uq_handeye.core.files.atomic import write_files
from uq_handeye.errors import InputError
from uq_handeye.model.camera.board_file import board_text, read_board_points
from uq_handeye.model.camera.board_shape import polynomial_shape
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.calibration_files import camera_files
from uq_handeye.model.camera.description import board_of
from uq_handeye.model.camera.report.figures import camera_pictures
from uq_handeye.model.camera.report.page import camera_report_html

POINTS = board(9, 7, 0.05)
LENS = {"model": "brown", "coefficients": ("k1", "k2")}


def bowed(height=4e-4, stretch=0.0):
    """Displacements of a board that bows by ``height`` from middle to corners, and is wider than high by a share."""
    local = POINTS - POINTS.mean(axis=0)
    x, y = (local / np.ptp(local, axis=0).clip(1e-9))[:, :2].T
    z = x**2 + 0.4 * x * y + 0.3 * y**2
    z *= height / np.ptp(z)
    return np.column_stack([0.5 * stretch * local[:, :2] * [1.0, -1.0], z])


def calibrated(key, bent, **options):
    rng = np.random.default_rng([SEED, key])
    corners, _, _ = recorded(rng, n=15, model="brown", pixel=0.05, points=POINTS, bent=bent)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", uq.InputWarning)
        return calibrate_camera(corners, SIZE, **{**LENS, **options})


@pytest.fixture(scope="module")
def bent():
    return calibrated(1, bowed(stretch=2e-3), shape="bow2+plane1")


@pytest.fixture(scope="module")
def flat():
    return calibrated(2, 0.0 * POINTS, shape="auto")


def codes(cam):
    return {finding.code for finding in cam.findings}


@pytest.mark.slow
def test_bow_and_stretch_are_those_of_the_board(bent, flat):
    board = bent.board
    assert bent.shape == "bow2+plane1" and np.array_equal(bent.board_points, board.points)
    for (value, sd), truth in ((board.bow, 4e-4), (board.stretch, 2e-3)):
        assert 0 < sd < 0.1 * truth and abs(value - truth) < 4 * sd
    assert board.size == pytest.approx(np.hypot(8 * 0.05, 6 * 0.05))
    assert "The board bows by 0." in bent.summary() and "% wider than high" in bent.summary()
    assert "camera.squares_stretched" in codes(bent)
    assert flat.shape == "flat" and flat.board.flat and flat.board.bow == (0.0, 0.0)
    assert "The board is flat as far as the pictures show: a bow of more than 0." in flat.summary()
    assert "camera.squares_stretched" not in codes(flat)
    assert "A board that is not flat" not in bent.summary() + flat.summary()
    given = calibrated(2, 0.0 * POINTS, shape="flat").summary()
    assert "The board was taken as flat." in given and "A board that is not flat" in given


@pytest.mark.slow
def test_the_deviation_of_the_bow_is_that_of_repeated_calibrations():
    found = np.array([calibrated([3, k], bowed(), shape="bow2").board.bow for k in range(40)])
    z = (found[:, 0] - 4e-4) / found[:, 1]
    # 4 standard deviations of a mean and of a variance of 40; the extremes of noise add a little to a height
    assert abs(z.mean()) < 4 / np.sqrt(40) and 0.4 < z.std() < 1.6


@pytest.mark.slow
def test_a_bow_that_would_show_is_found_and_a_third_of_it_is_not(flat):
    visible = flat.board_pattern.visible
    assert 1e-5 < visible < 2e-4
    assert calibrated(2, bowed(3 * visible), shape="auto").shape.startswith("bow")
    assert calibrated(2, bowed(visible / 3), shape="auto").shape == "flat"


def test_a_measured_board_is_the_prior_of_the_next_calibration(bent, tmp_path):
    write_files(tmp_path, camera_files(bent))
    shape = uq.read_board(tmp_path / "board.csv")
    assert shape.name == "measured" and np.array_equal(shape.points + shape.offset, bent.board.points)
    np.testing.assert_allclose(shape.fields, bent.board.factor, rtol=1e-8)
    again = calibrated(4, bowed(stretch=2e-3), shape=shape)
    alone = calibrated(4, bowed(stretch=2e-3), shape="bow2+plane1")
    assert again.std["fx"] < alone.std["fx"] and again.board.bow[1] < bent.board.bow[1]
    # Another factor of the same covariance has another board: the change is one of the prior, the data add to it.
    fields = polynomial_shape("bow2+plane1", POINTS).fields.reshape(-1, 5)
    change = np.linalg.lstsq(fields, (again.board.points - bent.board.points).ravel(), rcond=None)[0]
    F = np.linalg.lstsq(fields, bent.board.factor.reshape(-1, 5), rcond=None)[0]
    assert change @ np.linalg.solve(F @ F.T, change) < 20.5  # chi-square of 5, once in 1,000
    write_files(tmp_path / "again", camera_files(again))
    assert uq.read_camera(tmp_path / "again").shape == "measured"
    assert np.array_equal(uq.read_board(tmp_path / "again" / "board.csv").points, shape.points)


def test_a_flat_board_has_no_columns_and_points_are_read_for_views(flat, tmp_path):
    (tmp_path / "board.csv").write_text(board_text(flat.board, ""))
    shape = uq.read_board(tmp_path / "board.csv")
    assert shape.q == 0 and not shape.offset.any()
    assert np.array_equal(read_board_points(tmp_path / "board.csv"), flat.board.points)


@pytest.mark.parametrize(
    "one", [uq.Board(9, 6, "20mm"), uq.Board(7, 5, 0.03, "charuco", "22mm", "5X5_100")], ids=["chessboard", "charuco"]
)
def test_the_file_says_which_board_it_is(one, bent, tmp_path):
    assert board_of(one.text) == one
    seen = replace(bent, corners=replace(bent.corners, board=one.text))
    write_files(tmp_path, camera_files(seen))
    assert f"# board: {one.text}\n" in (tmp_path / "board.csv").read_text()
    assert uq.read_camera(tmp_path).corners.board == one.text


def lines(change):
    """A change of the table, line by line."""
    return lambda text: "\n".join(change(text.split("\n")))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lines(lambda all: [*all[:2], "x,y,z,nominal_x", *all[3:]]), "line 3: expected the header x,y,z, or that"),
        (
            lines(lambda all: [*all[:4], all[4].rsplit(",", 1)[0], *all[5:]]),
            "line 5: expected 21 fields separated by commas, got 20",
        ),
        (lines(lambda all: [*all[:4], all[3], *all[4:]]), "every point of the board once"),
        (
            lines(lambda all: [*all[:4], f"0.9{all[4][all[4].index(',') :]}", *all[5:]]),
            "expected points as measured near to those as meant",
        ),
        (lambda text: "x,y,z\n0,0,0\n", "got only points"),
        (lines(lambda all: [*all[:4], f"nan{all[4][all[4].index(',') :]}", *all[5:]]), "expected a finite number"),
    ],
)
def test_tables_that_are_no_measured_board(bent, tmp_path, change, message):
    path = tmp_path / "board.csv"
    path.write_text(change(board_text(bent.board, "")))
    with pytest.raises(InputError, match=message) as caught:
        uq.read_board(path)
    assert "board.csv" in str(caught.value) and "\n" not in str(caught.value)


def test_another_board_is_refused(bent, tmp_path):
    (tmp_path / "board.csv").write_text(board_text(bent.board, ""))
    shape = uq.read_board(tmp_path / "board.csv")
    corners = replace(bent.corners, points=1e3 * bent.corners.points)
    with pytest.raises(InputError, match="is it another board, or in another unit"):
        calibrate_camera(corners, SIZE, shape=shape)


@pytest.mark.slow
def test_residuals_that_follow_the_points_are_found_and_others_are_not(bent, flat):
    rng = np.random.default_rng([SEED, 5])
    printed = calibrated(6, 1e-4 * rng.normal(size=POINTS.shape) * [1.0, 1.0, 0.0], shape="auto")
    assert printed.board_pattern.found and "camera.board_pattern" in codes(printed)
    for cam in (bent, flat):
        assert cam.board_pattern.p_value > 1e-3 and "camera.board_pattern" not in codes(cam)
        assert "do not follow the points" in cam.summary()
        z = cam.board_pattern.mean / cam.board_pattern.deviation  # of 63 points, less what the poses take out
        assert 0.75 < np.sqrt(np.mean(z**2)) < 1.15
    assert calibrated(1, bowed(stretch=2e-3), shape="flat").board_pattern.found


@pytest.mark.slow
def test_the_test_by_points_is_uniform_where_everything_is_right():
    p = [calibrated([7, k], bowed(), shape="bow2").board_pattern.p_value for k in range(60)]
    assert 0.35 < np.mean(p) < 0.65 and np.mean(np.array(p) < 0.05) < 0.15


@pytest.mark.slow
def test_figures_and_page_show_the_board(bent, flat):
    drawn = {"bent": camera_pictures(bent), "flat": camera_pictures(flat)}
    assert "board" in drawn["bent"] and "board" not in drawn["flat"]
    for pictures in drawn.values():
        for name in {"board", "board_residuals"} & set(pictures):
            figure = pictures[name].figure
            assert overlapping(figure) == [], name
            box = figure.get_tightbbox()
            assert box.x0 > 0 and box.y0 > 0 and box.x1 < figure.get_size_inches()[0], name
    assert "as measured (bow2+plane1)" in drawn["bent"]["board_residuals"].figure.axes[0].get_title(loc="left")
    page = Page(camera_report_html(flat))
    assert "flat as far as the pictures show" in "".join(page.texts["board"]) and page.broken == []
