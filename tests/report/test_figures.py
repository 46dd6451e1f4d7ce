"""The figures of the report: what they show, in numbers; that nothing overlaps; ids that do not collide."""

import io
import json
import re
from dataclasses import replace
from importlib import resources

import numpy as np
import pytest
from fixtures.pictures import simulated_rig
from fixtures.reports import overlapping
from PIL import Image
from scipy.stats import chi2
from support import SEED, moved

import uq_handeye as uq
from uq_handeye.calibration.analysis import StoredAnalysis
from uq_handeye.calibration.report.figures import budget_figure, shared_figure, task_space_figure
from uq_handeye.calibration.report.points_ahead import ahead
from uq_handeye.calibration.report.residual_figure import residual_figure
from uq_handeye.calibration.report.rig_figure import rig, rig_figure, rig_scene
from uq_handeye.core.presentation.colours import BLUE, GREEN
from uq_handeye.core.presentation.ellipses import render
from uq_handeye.core.presentation.figure_parts import FIGURE_WIDTH_IN, inline_svg
from uq_handeye.errors import InputError
from uq_handeye.fit.diagnostics.pose_table import PoseTable
from uq_handeye.fit.graph.shared_groups import grouped
from uq_handeye.model.errors.error_estimate import ErrorEstimate, resolved_share
from uq_handeye.model.errors.key import ErrorKey, Kind, Owner
from uq_handeye.report.comparison.compare import compare_result
from uq_handeye.report.comparison.figure import comparison_picture
from uq_handeye.report.figures import figures, pictures

pytestmark = pytest.mark.slow

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))
ALL = ["ellipses", "rig", "residuals", "budget", "task_space"]


@pytest.fixture(scope="module", params=["eye-in-hand", "eye-to-hand"])
def both(request):
    """Poses and their result, of either setup."""
    poses = uq.simulate(n_poses=15, noise=NOISE, setup=request.param, seed=SEED)
    return poses, uq.calibrate(poses, noise=NOISE)


@pytest.fixture(scope="module")
def drawn(both):
    return pictures(both[1])


@pytest.fixture(scope="module")
def result():
    return uq.calibrate(uq.simulate(n_poses=15, noise=NOISE, seed=SEED), noise=NOISE)


def table(n=50, flags=None, seed=SEED):
    rng = np.random.default_rng(seed)
    flag = tuple(["kept"] * n if flags is None else flags)
    ones = np.ones(n)
    return PoseTable("pose", *(np.abs(rng.normal(size=(2, n))) * 1e-3), 6 * ones, ones / n, ones, flag)


def test_all_figures_have_the_width_of_a_page_and_words(drawn):
    assert list(drawn) == ALL
    for picture in drawn.values():
        assert picture.figure.get_size_inches()[0] == pytest.approx(FIGURE_WIDTH_IN)
        assert len(picture.alt) > 60 and len(picture.caption) > 60


def test_figures_by_name(both, drawn):
    _, result = both
    assert result.figures == (*ALL, "methods")
    figure = result.plot("budget")
    assert repr(figure) == "<Figure 'budget': Uncertainty budget of X>" and figure.get_label() == "budget"
    picture, more = figure._repr_png_()
    assert picture.startswith(b"\x89PNG") and more == {"alt": drawn["budget"].alt}
    assert figure.title.encode() in picture and more["alt"].encode() in picture
    assert f"<title>{figure.title}</title>" in render(figure, "svg").decode()
    assert "<title>" not in inline_svg(figure, "budget")
    with pytest.raises(InputError, match=r"`name` to be one of ellipses, rig,.* methods, got 'nothing'\.$"):
        result.plot("nothing")
    with pytest.raises(InputError, match="'workspace' needs data or a covariance that this result does not have"):
        result.plot("workspace")


def test_figures_by_name_are_those_that_can_be_drawn(result):
    stored = uq.Calibration.from_dict(result.to_dict())
    bare = replace(stored, covariance=None, data=None)
    assert bare.figures == ("residuals", "budget")
    assert bare.plot().name == "residuals"
    assert replace(bare, table=None, analysis=None).figures == ()
    with pytest.raises(InputError, match="one of no figures"):
        replace(bare, table=None, analysis=None).plot()


@pytest.mark.usefixtures("without_rendering")
def test_what_cannot_be_drawn_is_left_out(result):
    poses = uq.simulate(n_poses=8, noise=NOISE, seed=SEED)
    motions = uq.relative_motions(poses, "consecutive")
    of_motions = uq.calibrate(motions, noise=uq.PairNoise(A=1e-6 * np.eye(6), B=1e-6 * np.eye(6)))
    # Without a covariance there are neither ellipses nor a task space, which take long to draw.
    assert "rig" in figures(replace(of_motions, covariance=None))  # the motions know their poses
    bare = uq.Motions(motions.A, motions.B)
    of_bare = uq.calibrate(bare, noise=uq.PairNoise(B=1e-6 * np.eye(6)))
    assert list(figures(replace(of_bare, covariance=None))) == ["residuals", "budget"]
    assert list(figures(uq.calibrate(poses, noise=NOISE, method="park"))) == ["ellipses", "rig", "task_space"]
    assert list(figures(uq.calibrate(uq.simulate(n_poses=8, seed=SEED)))) == ["rig"]
    stored = uq.Calibration.from_dict(result.to_dict())
    assert isinstance(stored.analysis, StoredAnalysis)
    assert list(figures(replace(stored, covariance=None))) == ["rig", "residuals", "budget"]


@pytest.mark.parametrize("name", ["residuals", "budget", "task_space"])
def test_no_text_overlaps(drawn, name):
    assert overlapping(drawn[name].figure) == []


def test_texts_of_a_methods_figure_do_not_overlap():
    poses = uq.simulate(n_poses=12, noise=NOISE, seed=SEED)
    compared = uq.compare(poses, noise=NOISE, methods=["4dpa", "tsai", "park", "li"])
    assert overlapping(comparison_picture(compared).figure) == []


def test_fonts_are_readable_on_paper(drawn):
    for picture in drawn.values():
        texts = picture.figure.findobj(lambda artist: hasattr(artist, "get_fontsize") and hasattr(artist, "get_text"))
        assert min(text.get_fontsize() for text in texts if text.get_text()) >= 7.5


# ----------------------------------------------------------------------------------------------------------- rig


@pytest.mark.usefixtures("without_rendering")
def test_the_rig_stands_where_the_poses_are(both):
    poses, result = both
    scene = rig(poses, result.X, result.W, result.covariance, None)
    in_hand = poses.setup == "eye-in-hand"
    cameras = poses.robot @ result.X if in_hand else result.X[None]
    np.testing.assert_allclose(scene.cameras, cameras, atol=1e-12)
    # Every camera sees its target where it was detected.
    seen = np.linalg.inv(scene.cameras) @ scene.targets
    np.testing.assert_allclose(seen[:, :3, 3], poses.camera[:, :3, 3], atol=0.02)


def test_the_ellipsoid_is_that_of_the_translation_in_the_base_frame(both, drawn):
    poses, result = both
    scene = rig(poses, result.X, result.W, result.covariance, None)
    if poses.setup == "eye-in-hand":
        k = int(np.argmin(np.linalg.norm(scene.cameras[:, :3, 3] - scene.centre, axis=1)))
        R = poses.robot[k, :3, :3]
    else:
        R = np.eye(3)
    np.testing.assert_allclose(
        scene.half_axes @ scene.half_axes.T,
        chi2.ppf(0.95, 3) * R @ result.covariance[3:, 3:] @ R.T,
        rtol=1e-9,
        atol=1e-16,
    )
    largest = np.linalg.norm(scene.half_axes, axis=0).max()
    assert 0.02 * scene.size < scene.factor * largest <= 0.1 * scene.size
    assert f"{scene.factor:,.0f} times enlarged" in drawn["rig"].caption


def test_the_scene_that_can_be_turned_is_the_rig(both, drawn):
    poses, result = both
    scene = json.loads(drawn["rig"].scene)
    assert len(drawn["rig"].scene) < 12_000 and "<" not in drawn["rig"].scene
    G = np.array(scene["poses"]).reshape(-1, 3, 4)
    np.testing.assert_allclose(G, poses.robot[:, :3], atol=1e-5)
    X, W = (np.array(scene[name]).reshape(3, 4) for name in "XW")
    np.testing.assert_allclose(X, result.X[:3], atol=1e-5)
    np.testing.assert_allclose(W, result.W[:3], atol=1e-5)
    assert scene["hand"] is (poses.setup == "eye-in-hand")
    half = np.array(scene["half"]).reshape(3, 3)
    factor = rig(poses, result.X, result.W, result.covariance, None).factor
    wanted = factor**2 * chi2.ppf(0.95, 3) * result.covariance[3:, 3:]
    np.testing.assert_allclose(half @ half.T, wanted, atol=2e-3 * np.trace(wanted))
    assert len(scene["names"]) == poses.n and scene["names"][3].startswith("pose 3: ")


def test_a_long_recording_is_a_small_scene_with_its_rejected_poses():
    poses = uq.simulate(n_poses=700, noise=NOISE, seed=SEED)
    weight = np.ones(700)
    weight[0] = 0.0
    found = json.loads(rig_scene(rig(poses, poses.truth.X, poses.truth.W, None, weight), None, "seen"))
    assert len(found["poses"]) <= 61 and 300 < len(found["dots"]) <= 400 and found["half"] is None
    assert found["rejected"] == [0] and found["names"][0] == "pose 0"


def test_the_target_has_the_outline_of_its_corners():
    board = uq.Board(9, 6, "20mm")
    poses, corners = simulated_rig(board, np.random.default_rng(SEED), n=8)
    camera = uq.calibrate_camera(corners, (640, 480))
    seen = uq.PosePairs(poses.robot, camera.poses, camera_calibration=camera)
    outline = rig(seen, poses.truth.X, poses.truth.W, None, None).board
    np.testing.assert_allclose(np.ptp(outline, axis=0), np.ptp(board.points, axis=0))


@pytest.mark.usefixtures("without_rendering")
def test_a_large_ellipsoid_is_not_enlarged(both):
    poses, result = both
    scene = rig(poses, result.X, result.W, np.eye(6), None)
    assert scene.factor == 1.0 and scene.enlarged == "in true size"


@pytest.mark.usefixtures("without_rendering")
def test_rejected_poses_do_not_set_the_scale(both):
    poses, result = both
    robot = np.array(poses.robot)
    robot[3, :3, 3] += 100.0
    weight = np.ones(poses.n)
    weight[3] = 0.0
    far = uq.PosePairs(robot, poses.camera, poses.setup)
    assert rig(far, result.X, result.W, result.covariance, weight).size < 3.0
    labels = [text.get_text() for text in rig_figure(rig(far, result.X, result.W, None, weight)).legends[0].get_texts()]
    assert "rejected" in labels
    assert not any("sigma" in label for label in labels)


# ------------------------------------------------------------------------------------- residuals, budget, task space


@pytest.mark.usefixtures("without_rendering")
def test_residuals_show_every_pose_and_name_the_worst():
    flags = ["kept"] * 2000
    flags[7], flags[1500] = "rejected", "downweighted"
    many = table(2000, flags)
    distance2 = many.distance2.copy()
    distance2[7], distance2[1500] = 900.0, 40.0
    many = replace(many, distance2=distance2)
    figure = residual_figure(many)
    for axis in figure.get_axes():
        drawn = [line for line in axis.lines if line.get_linestyle() == "None"]
        assert sum(len(line.get_xdata()) for line in drawn) == 2000
    assert [text.get_text() for text in figure.get_axes()[2].texts] == ["7", "1500"]
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend[:3] == ["kept (1,998)", "downweighted (1)", "rejected (1)"]


@pytest.mark.parametrize("largest", [2.6, 15.0, 400.0, 37_982.0, 4e9])
def test_d2_has_few_plain_ticks_and_shows_every_pose_and_the_limit(largest):
    some = table(30)
    distance2 = np.geomspace(0.8, largest, 30)
    some = replace(some, distance2=distance2, translation=1e-4 * distance2)
    figure = residual_figure(some)
    axis = figure.get_axes()[2]
    low, high = axis.get_ylim()
    assert low < max(distance2.min(), 1e-6 * largest) and high > max(some.limit, distance2.max())
    figure.draw_without_rendering()
    for part in figure.get_axes():
        if part.get_yscale() != "log":
            continue
        low, high = part.get_ylim()
        both = zip(part.get_yticks(), part.get_yticklabels(), strict=True)
        texts = [text.get_text() for tick, text in both if low <= tick <= high]
        assert 2 <= len(texts) <= 9
        assert not any(text.get_text() for text in part.get_yticklabels(minor=True))
        if high < 1e6:
            assert all(re.fullmatch(r"[0-9.,]+", text) for text in texts), texts
    assert overlapping(figure) == []


@pytest.mark.usefixtures("without_rendering")
def test_what_stands_still_is_seen_whole(both):
    poses, result = both
    scene = rig(poses, result.X, result.W, result.covariance, None)
    axis = rig_figure(scene).get_axes()[1]
    low, high = np.array([axis.get_xlim(), axis.get_ylim()]).T
    colour = GREEN if poses.setup == "eye-in-hand" else BLUE
    drawn = next(np.array(line.get_xydata()) for line in axis.get_lines() if line.get_color() == colour)
    assert len(drawn) > 2  # target or camera, not an axis of the base
    assert (drawn >= low).all() and (drawn <= high).all()


def test_residuals_of_very_many_poses_stay_a_small_drawing():
    text = inline_svg(residual_figure(table(30_000)), "residuals")
    assert len(text) < 700_000 and "data:image/png" in text


@pytest.mark.usefixtures("without_rendering")
def test_residuals_of_one_pose_and_of_none():
    for values in (np.zeros(1), np.ones(1)):
        one = replace(table(1), rotation=values, translation=values, distance2=values)
        assert len(residual_figure(one).get_axes()) == 3


@pytest.mark.usefixtures("without_rendering")
def test_the_budget_is_drawn_as_it_is():
    shares = {"robot rotation": np.array([0.25, 0.0]), "camera rotation": np.array([0.75, 1.0])}
    axis = budget_figure(shares).get_axes()[0]
    assert [bar.get_width() for bar in axis.patches] == [25.0, 75.0, 0.0, 100.0]
    assert [text.get_text() for text in axis.texts] == ["25.0 %", "75.0 %", "0.0 %", "100.0 %"]
    hatches = {bar.get_hatch() for bar in axis.patches}
    assert len(hatches) == 2  # told apart without colour


def shared_error(name, size, estimate, sd, unit="", index=None):
    key, resolved = ErrorKey(Owner.CAMERA, Kind.OWN, index, name), resolved_share(sd, size)
    found = {"estimate": estimate, "sd": sd, "share": 0.5, "resolved": resolved, "effect": np.zeros(6)}
    return ErrorEstimate(key, "camera", unit, size, count=1, **found)


def test_shared_errors_are_drawn_in_what_was_assumed_of_them():
    errors = (
        shared_error("focal length", 1e-3, 5e-4, 2e-4),
        shared_error("principal point x", 1e-3, 0.0, 1e-3, "rad"),
        shared_error("an error of the user's own with a long name", 1e-4, 5e-3, 1e-5),
    )
    figure = shared_figure(grouped(errors, np.eye(6)))
    axis = figure.get_axes()[0]
    bars = [bar for bar in axis.patches if bar.get_width() == 2.0]
    assert len(bars) == 3 and all(bar.get_x() == -1.0 for bar in bars)
    points = next(line for line in axis.lines if line.get_marker() == "o")
    np.testing.assert_allclose(points.get_xdata()[:2], [0.5, 0.0])
    low, high = axis.get_xlim()
    assert low <= points.get_xdata()[2] <= high  # one far away stays at the rim, its number beside it
    assert [text.get_text() for text in axis.texts] == ["0.050(20) %", "0.0(1.0) mrad", "0.5000(10) %"]
    assert overlapping(figure) == []


def test_an_error_of_many_numbers_is_one_row_of_dots():
    many = [shared_error("joint offsets", 1e-3, (k - 2) * 1e-4, 2e-4, "rad", k) for k in range(5)]
    figure = shared_figure(grouped([shared_error("focal length", 1e-3, 5e-4, 2e-4), *many], np.eye(6)))
    axis = figure.get_axes()[0]
    assert [label.get_text() for label in axis.get_yticklabels()] == ["focal length", "joint offsets"]
    dots = next(line for line in axis.lines if len(line.get_xdata()) == 5)
    np.testing.assert_allclose(dots.get_xdata(), [-0.2, -0.1, 0.0, 0.1, 0.2], atol=1e-12)
    assert [text.get_text() for text in axis.texts] == ["0.050(20) %", "RMS 0.14 mrad; told 96 %"]
    assert overlapping(figure) == []


def test_a_result_with_shared_errors_has_their_figure():
    result = uq.calibrate(uq.simulate(n_poses=15, noise=NOISE, seed=SEED))
    found = pictures(result)
    assert list(found) == [*ALL[:4], "shared", ALL[4]]
    assert all(error.name in found["shared"].alt for error in result.shared)
    assert "target scale (B)" in found["budget"].alt and "robot rotation (A)" in found["budget"].alt
    assert overlapping(found["shared"].figure) == [] and overlapping(found["budget"].figure) == []


@pytest.mark.usefixtures("without_rendering")
def test_points_ahead_against_a_numerical_experiment(result, rng):
    distance = np.array([0.2, 1.0])
    found = ahead(result, distance)
    xi = rng.multivariate_normal(np.zeros(6), result.covariance, size=20_000)
    p = np.array([[0.0, 0.0, z, 1.0] for z in distance])
    q = np.einsum("sij,kj->ski", moved(result.X, xi), p)[..., :3]
    in_camera = q @ result.X[:3, :3]
    for k in range(2):
        S = np.cov(in_camera[:, k].T)
        np.testing.assert_allclose(found.along[k], np.sqrt(S[2, 2]), rtol=0.03)
        np.testing.assert_allclose(found.worst[k], np.sqrt(np.linalg.eigvalsh(S)[-1]), rtol=0.03)
        np.testing.assert_allclose(found.across[k], np.sqrt(np.linalg.eigvalsh(S[:2, :2])[-1]), rtol=0.03)


@pytest.mark.usefixtures("without_rendering")
def test_the_task_space_of_a_pure_translation_error_is_flat(result):
    flat = replace(result, covariance=np.diag([0, 0, 0, 1e-6, 1e-6, 1e-6]))
    assert task_space_figure(flat).get_axes()
    np.testing.assert_allclose(ahead(flat).worst, 1e-3)


# ------------------------------------------------------------------------------------------ cross-check and inline SVG


def test_a_cross_check_is_laid_over_the_ellipses():
    poses = uq.simulate(n_poses=8, noise=NOISE, seed=SEED)
    result = uq.calibrate(poses, noise=NOISE)
    check = uq.cross_check(poses, noise=NOISE, trials=200, posterior=False)
    labels = [text.get_text() for text in figures(result, check)["ellipses"].legends[0].get_texts()]
    assert labels == ["this result (efficient)", "Monte Carlo, efficient", "4DPA, first order", "samples"]
    other = uq.calibrate(uq.simulate(n_poses=9, noise=NOISE, seed=SEED), noise=NOISE)
    with pytest.raises(InputError, match=r"`cross_check`.*9 rows.*of 8"):
        figures(other, check)
    to_hand = uq.calibrate(uq.simulate(n_poses=8, noise=NOISE, setup="eye-to-hand", seed=SEED), noise=NOISE)
    with pytest.raises(InputError, match=r"`cross_check` to be of base_T_camera.*gripper_T_camera"):
        figures(to_hand, check)


def test_inline_svg_is_the_same_again_and_shares_no_id(drawn, both):
    first = {name: inline_svg(picture.figure, name) for name, picture in drawn.items()}
    again = {"residuals": residual_figure(both[1].table), "task_space": task_space_figure(both[1])}
    for name, figure in again.items():
        assert inline_svg(figure, name) == first[name]
    ids = [match for text in first.values() for match in re.findall(r'\sid="([^"]*)"', text)]
    assert len(ids) == len(set(ids)) > 100
    for text in first.values():
        assert set(re.findall(r'(?:href="#|url\(#)([^")]*)', text)) <= set(ids)
        assert text.startswith("<svg ") and "<metadata>" not in text and "<?xml" not in text


def test_every_colour_follows_the_page(drawn):
    """Each has a rule for dark pages, but those of the map of the task space."""
    rules = (resources.files("uq_handeye.core.presentation") / "figures.css").read_text(encoding="utf-8")
    known = set(re.findall(r'"((?:fill|stroke): #[0-9a-f]{6})"', rules))
    for stem, picture in drawn.items():
        used = set(re.findall(r"(?:fill|stroke): #[0-9a-f]+", inline_svg(picture.figure, stem)))
        of_map = {colour for colour in used if stem == "task_space" and "fill" in colour}
        assert len(used) > 2 and used - of_map <= known, stem


def test_nothing_is_cut_at_the_rim():
    """No ink on the outermost pixels of any picture; names of methods are the longest labels."""
    result = uq.calibrate(uq.simulate(n_poses=8, noise=NOISE, seed=SEED), noise=NOISE)
    found = figures(result, None, compare_result(result).comparison)
    assert list(found) == [*ALL, "methods"]
    for stem, figure in found.items():
        grey = np.asarray(Image.open(io.BytesIO(render(figure, "png"))).convert("L"))
        rim = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
        assert rim.min() > 200, stem
