"""Report of a camera calibration as a user sees it: figures, text and page say what the calibration found."""

import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
import yaml
from fixtures.pictures import CAMERA, SIZE, seen_corners
from fixtures.reports import Page, overlapping
from support import SEED, jacobian, rotations, transforms

import uq_handeye as uq
from uq_handeye.core.presentation.document import Paragraph
from uq_handeye.core.presentation.figure_parts import FIGURE_WIDTH_IN
from uq_handeye.core.presentation.numbers import concise, fixed
from uq_handeye.errors import InputError
from uq_handeye.model.camera.adjustment.bundle import BundleUnknowns
from uq_handeye.model.camera.adjustment.criterion import Candidate
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.calibrated import (
    cells_that_matter,
    certainty,
    covered,
    distances,
    picture_rms,
    radial_means,
    tilts,
)
from uq_handeye.model.camera.intrinsics_file import camera_snippets
from uq_handeye.model.camera.models import MODELS
from uq_handeye.model.camera.rays import pixel_deviation, rays
from uq_handeye.model.camera.report.figures import camera_pictures
from uq_handeye.model.camera.report.page import camera_report_html, report_files
from uq_handeye.model.camera.residual_pattern import CELLS
from uq_handeye.report.sections import camera_sections, shares_words

pytestmark = pytest.mark.slow

S = 0.1
DISTORTION = (-0.3, 0.1, 0.0, 0.0)
MOVED, SHIFT = 333, 10.0
STEMS = ["pattern", "residuals", "pictures", "certainty", "boards", "board_residuals"]
ANCHORS = [
    "answer", "warnings", "residuals", "board", "outliers", "covered", "models", "poses", "forms", "repeat", "scope",
]  # fmt: skip
BOARD = 0.02 * np.stack([*np.meshgrid(np.arange(9.0), np.arange(7.0)), np.zeros((7, 9))], axis=-1).reshape(-1, 3)


def seen(shift=0.0, n=16):
    """Corners that a Brown camera sees all over the picture, one of them moved by ``shift`` pixels."""
    rng = np.random.default_rng(SEED)
    z = rng.uniform(0.3, 0.6, n)
    at = rng.uniform([60, 60], [580, 420], (n, 2))  # pixels, of the middle of the board
    middle = np.column_stack([(at - CAMERA[:2, 2]) / CAMERA[[0, 1], [0, 1]] * z[:, None], z])
    R = rotations(rng.uniform(-0.5, 0.5, (n, 3)))
    poses = transforms(R, middle - (R @ BOARD.mean(axis=0)[:, None])[..., 0])
    row, points, pixels = seen_corners(BOARD, poses, rng, noise=S, distortion=DISTORTION)
    inside = ((pixels > 0) & (pixels < np.array(SIZE) - 1)).all(axis=1)
    row, points, pixels = row[inside], points[inside], pixels[inside]
    pixels[MOVED] += shift * np.array([0.6, 0.8])
    return uq.Corners(row, points, pixels, [f"img-{k}.png" for k in range(n)])


@pytest.fixture(scope="module")
def right():
    """The right model, one corner 10 pixels off."""
    return calibrate_camera(seen(SHIFT), SIZE, "brown", coefficients=["k1", "k2"], shape="flat")


@pytest.fixture(scope="module")
def wrong():
    with pytest.warns(uq.InputWarning, match="pattern"):
        return calibrate_camera(seen(), SIZE, "pinhole", shape="flat")


@pytest.fixture(scope="module")
def upright(right):
    """The same seen by a camera that stands upright."""
    corners = uq.Corners(right.corners.row, right.corners.points, right.corners.pixels[:, ::-1])
    return calibrate_camera(corners, SIZE[::-1], "brown", coefficients=["k1", "k2"])


@pytest.fixture(scope="module")
def drawn(right, wrong, upright):
    return {"right": camera_pictures(right), "wrong": camera_pictures(wrong), "upright": camera_pictures(upright)}


@pytest.fixture(scope="module")
def pages(right, wrong):
    return {"right": camera_report_html(right, date="a day"), "wrong": camera_report_html(wrong, date="a day")}


# ------------------------------------------------------------------------------------------------------------- figures


@pytest.mark.parametrize("which", ["right", "wrong", "upright"])
def test_texts_do_not_overlap_and_are_large_enough(drawn, which):
    assert list(drawn[which]) == STEMS
    for name, picture in drawn[which].items():
        assert picture.figure.get_size_inches()[0] == pytest.approx(FIGURE_WIDTH_IN)
        assert len(picture.alt) > 60 and len(picture.caption) > 60 and "{" not in picture.caption
        assert overlapping(picture.figure) == [], name
        texts = picture.figure.findobj(lambda artist: hasattr(artist, "get_fontsize") and hasattr(artist, "get_text"))
        assert min(text.get_fontsize() for text in texts if text.get_text()) >= 7.5


@pytest.mark.parametrize("which", ["right", "wrong", "upright"])
def test_nothing_is_cut_at_the_rim(drawn, which):
    for name, picture in drawn[which].items():
        box = picture.figure.get_tightbbox()
        width, height = picture.figure.get_size_inches()
        assert box.x0 > 0 and box.y0 > 0 and box.x1 < width and box.y1 < height, name


def words(figure):
    return [text.get_text() for text in figure.findobj(lambda artist: hasattr(artist, "get_text")) if text.get_text()]


def test_a_wrong_model_says_so_and_the_right_one_does_not(drawn, pages, right, wrong):
    assert wrong.pattern.found and not right.pattern.found
    said = {which: " ".join(words(drawn[which]["pattern"].figure)).replace("\n", " ") for which in ("right", "wrong")}
    assert "The model pinhole is wrong" in said["wrong"]
    assert f"{fixed(wrong.pattern.share, 2)} times the pixel noise" in said["wrong"]
    assert "wrong" not in said["right"]
    assert cells_that_matter(wrong).sum() >= 5 and cells_that_matter(right).sum() == 0
    for cam, far in ((wrong, True), (right, False)):
        _, mean, count = radial_means(cam)
        assert bool((np.abs(mean) > 5 * cam.pixel_noise / np.sqrt(count)).any()) is far
    for text in (wrong.summary(), pages["wrong"]):
        assert "The model pinhole is wrong" in text
    for text in (right.summary(), pages["right"]):
        assert "is wrong" not in text and "no pattern" in text


def test_a_moved_corner_is_seen_and_named(drawn, right):
    corners = right.corners
    name = f"{corners.names[corners.picture[MOVED]]}, corner {corners.place[MOVED]}"
    assert [(f"{picture}, corner {k}", round(d)) for picture, k, d in right.outliers] == [(name, round(SHIFT))]
    for stem in ("residuals", "pictures"):
        figure = drawn["right"][stem].figure
        (cross,) = (line for line in figure.axes[0].lines if line.get_marker() == "X" and len(line.get_xdata()))
        x, y = cross.get_xydata()[0]
        distance = right.outliers[0][2]
        expected = corners.pixels[MOVED] if stem == "residuals" else (corners.row[MOVED], distance)
        np.testing.assert_allclose((x, y), expected)
        assert name in right.summary()


def test_arrows_are_the_residuals_in_true_proportions(drawn, right):
    figure = drawn["right"]["residuals"].figure
    axis = figure.axes[0]
    (arrows,) = (artist for artist in axis.collections if hasattr(artist, "U"))
    used = right.bundle.used
    np.testing.assert_allclose(np.column_stack([arrows.U, arrows.V]), right.bundle.residuals[used])
    np.testing.assert_allclose(arrows.get_offsets(), right.corners.pixels[used])
    factor = 1 / arrows.scale
    assert f"residual, {factor:,g} times enlarged" in words(figure)
    assert axis.get_xlim() == (-0.5, SIZE[0] - 0.5) and axis.get_ylim() == (SIZE[1] - 0.5, -0.5)
    figure.draw_without_rendering()
    box = axis.get_window_extent()
    assert box.width / box.height == pytest.approx(SIZE[0] / SIZE[1], rel=1e-3)


def test_cells_without_corners_are_hatched(drawn, wrong):
    axis = drawn["wrong"]["pattern"].figure.axes[0]
    hatched = sum(patch.get_hatch() == "////" for patch in axis.patches)
    assert hatched == (wrong.pattern.count == 0).sum() > 0
    assert covered(wrong) == pytest.approx(1 - hatched / CELLS**2)


def test_every_picture_has_its_residual(drawn, right):
    line = next(line for line in drawn["right"]["pictures"].figure.axes[0].lines if line.get_marker() == "o")
    used = right.bundle.used
    expected = [
        np.sqrt(np.mean(right.bundle.residuals[used & (right.corners.picture == i)] ** 2))
        for i in range(right.corners.n)
    ]
    np.testing.assert_allclose(line.get_xydata(), np.column_stack([right.rows, expected]))
    np.testing.assert_allclose(picture_rms(right), expected)


def test_boards_stand_where_the_corners_were_seen(drawn, right):
    camera_points = right.poses[right.corners.picture, :3, :3] @ right.corners.points[..., None]
    z = camera_points[:, 2, 0] + right.poses[right.corners.picture, 2, 3]
    np.testing.assert_allclose(distances(right), [z[right.corners.picture == i].mean() for i in range(right.corners.n)])
    np.testing.assert_allclose(np.cos(np.radians(tilts(right))), np.abs(right.poses[:, 2, 2]), atol=1e-9)
    (dots,) = drawn["right"]["boards"].figure.axes[0].lines
    np.testing.assert_allclose(dots.get_xydata(), np.column_stack([distances(right), tilts(right)]))


@pytest.mark.parametrize("name", list(MODELS))
def test_rays_are_the_inverse_of_the_projection(rng, name):
    model = MODELS[name]
    parameters = np.zeros(len(model.names))
    parameters[:4] = 750.0, 746.0, 320.0, 240.0
    parameters[4:6] = (-0.2, 0.05)[: len(parameters) - 4]
    angle, turn = rng.uniform(0, 1.6 if name == "fisheye" else 0.7, 200), rng.uniform(0, 2 * np.pi, 200)
    d = np.column_stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
    np.testing.assert_allclose(rays(model, parameters, model.project(parameters, d).pixels), d, atol=1e-8)


def test_a_pixel_that_no_direction_reaches_is_said():
    parameters = np.zeros(12)
    parameters[:5] = 750.0, 746.0, 320.0, 240.0, -0.5  # the largest radius is 0.54 focal lengths
    assert np.isnan(rays(MODELS["brown"], parameters, np.array([320.0 + 750.0, 240.0]))).all()


def test_the_map_is_the_deviation_of_where_a_point_is_seen(right):
    bundle = right.bundle
    at = np.array([[50.0, 60.0], [320.0, 240.0], [600.0, 400.0]])
    d = rays(bundle.model, bundle.parameters, at)
    step = np.sqrt(np.diag(bundle.covariance))  # each parameter moved by its deviation

    def moved_by(x):
        values = [bundle.model.project(bundle.parameters + step * one, d).pixels.ravel() for one in x]
        return np.array(values)

    J = jacobian(moved_by, len(bundle.parameters)).reshape(3, 2, -1)
    correlation = bundle.covariance / np.where(step > 0, step, 1.0)[:, None] / np.where(step > 0, step, 1.0)
    expected = np.sqrt(np.linalg.eigvalsh(J @ correlation @ J.mT)[:, -1])
    np.testing.assert_allclose(
        pixel_deviation(bundle.model, bundle.parameters, bundle.covariance, at), expected, rtol=1e-6
    )
    _, _, deviation = certainty(right)
    assert fixed(np.nanmax(deviation), 2) in camera_pictures(right)["certainty"].caption


def test_exact_intrinsics_have_no_map(right):
    cam = calibrate_camera(right.corners, SIZE, "brown", coefficients=[], intrinsics=right.intrinsics, exact=True)
    assert list(camera_pictures(cam)) == [stem for stem in STEMS if stem != "certainty"]
    assert "given, exact" in cam.summary() and "taken as exact" in cam.summary()
    assert "no uncertainty to draw" in camera_report_html(cam)


def test_figures_are_written(right, tmp_path):
    path = right.figure(tmp_path / "a.svg", "boards")
    assert path.read_bytes().startswith(b"<?xml")
    with pytest.raises(InputError, match=r"\.png or \.svg"):
        right.figure(tmp_path / "a.pdf")
    with pytest.raises(InputError, match=r"`name`.*pattern.*'lens'"):
        right.figure(tmp_path / "a.png", "lens")


def test_the_same_calibration_gives_the_same_page(right, pages):
    assert camera_report_html(right, date="a day") == pages["right"]


# ------------------------------------------------------------------------------------------------------ text and page


def test_the_summary_has_the_numbers(right):
    text = right.summary()
    for name in right.estimated:
        assert concise(right.intrinsics[name], right.std[name]) in text
    assert "k3" not in text  # neither estimated nor given
    focal, sd = right.intrinsics["fx"], right.std["fx"]
    assert f"{fixed(1e3 * sd / focal, 2)} mm" in text.replace("\n  ", " ")
    assert f"{fixed(right.pixel_noise)} pixels per coordinate" in text
    assert max(map(len, text.splitlines())) <= 120


def test_the_summary_says_why_this_model(right, pages):
    candidates = (
        Candidate("pinhole", (), 100.0, 0.5),
        Candidate("brown", ("k1", "k2"), -12.5, 0.1),
        Candidate("fisheye", ("k1",), np.inf, np.inf),
    )
    text = replace(right, candidates=candidates).summary()
    assert "Model and shape of the board chosen of 3" in text
    assert [line.split() for line in text.splitlines() if line.startswith("pinhole")] == [
        ["pinhole", "flat", "112.5", "0.5000"]
    ]
    (chosen,) = (line for line in text.splitlines() if line.endswith("*"))
    assert chosen.split() == ["brown", "(k1,", "k2)", "flat", "0.0", "0.1000", "*"]
    (failed,) = (line for line in text.splitlines() if "no fit" in line)
    assert failed.split()[0] == "fisheye"
    assert "was given" in "".join(Page(pages["right"]).texts["models"])
    many = replace(right, candidates=candidates + tuple(Candidate("brown", ("k1",), 10.0 * k, 0.2) for k in range(9)))
    assert "The other 6 were further off; -v" in many.summary() and "no fit" not in many.summary()
    assert "further off" not in many.summary(details=True) and "no fit" in many.summary(details=True)


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_little_coverage_is_said():
    corners = seen()
    middle = (np.abs(corners.pixels - CAMERA[:2, 2]) < (150, 110)).all(axis=1)
    enough = np.bincount(corners.row[middle], minlength=16)[corners.row] >= 12
    kept = middle & enough
    cam = calibrate_camera(uq.Corners(corners.row[kept], corners.points[kept], corners.pixels[kept]), SIZE, "pinhole")
    assert covered(cam) < 0.5 and "extrapolated" in cam.summary()


@pytest.mark.parametrize("which", ["right", "wrong"])
def test_the_page_is_whole(which, pages, request):
    cam, text = request.getfixturevalue(which), pages[which]
    page = Page(text)
    assert page.broken == [] and page.stack == []
    assert [found["id"] for tag, found in page.elements if tag == "section"] == ANCHORS
    ids = [found["id"] for _, found in page.elements if "id" in found]
    assert len(ids) == len(set(ids))
    assert not re.search(r'(?:src|href)="https?://', text)
    for name in cam.estimated:
        assert concise(cam.intrinsics[name], cam.std[name]).replace("-", "\N{MINUS SIGN}") in text
    assert ("Nothing looked wrong" in text) is (cam.warnings == ())
    assert all(name in text for name in cam.corners.names)


def test_names_of_pictures_are_escaped(right):
    names = ["<script>alert(1)</script>", *right.corners.names[1:]]
    corners = uq.Corners(right.corners.row, right.corners.points, right.corners.pixels, names)
    assert "<script>alert" not in camera_report_html(replace(right, corners=corners))
    assert "<script>alert" not in replace(right, corners=corners)._repr_html_()


def test_files_of_the_report(right):
    found = report_files(right)
    assert sorted(found) == sorted(["report.html", *(f"{stem}.{kind}" for stem in STEMS for kind in ("png", "svg"))])


@pytest.mark.parametrize("model", list(MODELS))
def test_intrinsics_to_copy_are_those_of_the_camera(right, model):
    kind = MODELS[model]
    values = np.concatenate([right.bundle.parameters[:4], [-0.2, 0.05, 1e-5, 2e-5][: len(kind.coefficients)]])
    values = np.pad(values, (0, len(kind.names) - len(values)))
    k = len(values)
    unknowns = BundleUnknowns(kind, right.bundle.shape, np.ones(k, dtype=bool))
    bundle = replace(right.bundle, unknowns=unknowns, parameters=values, covariance=np.eye(k))
    opencv, ros, python = camera_snippets(replace(right, bundle=bundle))
    K = np.array([[values[0], 0, values[2]], [0, values[1], values[3]], [0, 0, 1]])
    info = yaml.safe_load(ros.text)
    np.testing.assert_allclose(np.reshape(info["camera_matrix"]["data"], (3, 3)), K, rtol=1e-15)
    np.testing.assert_allclose(np.reshape(info["projection_matrix"]["data"], (3, 4))[:, :3], K, rtol=1e-15)
    d = np.array(info["distortion_coefficients"]["data"])
    sizes = {"fisheye": ("equidistant", 4), "fisheye624": ("fisheye624", 12), "inverse_brown": ("inverse_brown", 5)}
    sizes |= dict.fromkeys(("pinhole", "brown", "brown_full"), ("plumb_bob", 5))
    assert (info["distortion_model"], len(d)) == sizes[model]
    np.testing.assert_allclose(d, np.pad(values[4:], (0, 8))[: len(d)])
    assert (info["image_width"], info["image_height"]) == SIZE
    names = {}
    exec(python.text, names)
    np.testing.assert_allclose(names["K"], K, rtol=1e-11)
    np.testing.assert_allclose(names["d"], d, rtol=1e-11)
    assert names["covariance"].shape == (k, k)
    assert "camera_matrix" in opencv.text


# ------------------------------------------------------------------------------------------------------ hand-eye report


@pytest.mark.filterwarnings("ignore:The camera would sit")  # it is anywhere
@pytest.mark.filterwarnings("ignore:The target is ahead")
def test_the_hand_eye_report_says_what_the_intrinsics_make(right):
    rng = np.random.default_rng(SEED)
    X, W = transforms(rotations(rng.normal(size=(2, 3))), rng.normal(size=(2, 3)))
    robot = W @ np.linalg.inv(X @ right.poses)
    poses = uq.PosePairs(robot, right.poses, camera_calibration=right)
    R = np.diag([1e-8] * 3 + [1e-10] * 3)
    result = uq.calibrate(poses, noise=uq.PoseNoise(robot=R, camera=right.covariance))
    budget = result.analysis.budget
    assert {"camera (each pose)", "camera (shared)"} <= set(budget.sources)
    np.testing.assert_allclose(budget.covariance[:6, :6], result.covariance, rtol=1e-6, atol=1e-16)
    # What the intrinsics move has no more directions than they are; what corners do has all twelve.
    shared, each = (budget.covariances[budget.sources.index(f"camera ({name})")] for name in ("shared", "each pose"))
    assert np.linalg.matrix_rank(each / np.sqrt(np.outer(np.diag(each), np.diag(each)))) == 12
    assert np.linalg.matrix_rank(shared, tol=1e-9 * np.abs(shared).max()) <= len(right.estimated)
    assert (budget.shares >= -1e-12).all()
    k = budget.sources.index("camera (shared)")
    said = shares_words(result)
    assert f"make {fixed(100 * budget.group_shares['X rotation'][k], 2)} %" in said
    (section,) = camera_sections(result)
    assert Paragraph(said) in section.blocks
    assert any("model brown (k1, k2)" in getattr(block, "caption", "") for block in section.blocks)
    plain = uq.calibrate(uq.PosePairs(robot, right.poses), noise=uq.PoseNoise(robot=R, camera=1e-8 * np.eye(6)))
    assert shares_words(plain) == "" and camera_sections(plain) == []


def test_colours_of_figures_follow_a_dark_page(pages):
    """But those of coloured maps, and what is drawn on them."""
    rules = (resources.files("uq_handeye.core.presentation") / "figures.css").read_text(encoding="utf-8")
    known = set(re.findall(r'"((?:fill|stroke): #[0-9a-f]{6})"', rules))
    for figure in re.finditer(r'<figure id="figure-(\w+)".*?</figure>', pages["right"], re.DOTALL):
        if figure.group(1) not in ("certainty", "board", "board_residuals"):
            assert set(re.findall(r"(?:fill|stroke): #[0-9a-f]+", figure.group())) <= known, figure.group(1)
