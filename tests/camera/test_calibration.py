"""calibrate_camera: models and their derivatives, the fit, wrong corners and pictures, the choice of the model."""

import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded, transforms
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.camera.adjustment.criterion import Candidate, best
from uq_handeye.model.camera.adjustment.initial_guess import unlike_a_board
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.models import MODELS
from uq_handeye.model.camera.rays import rays
from uq_handeye.read import write_pose_file

PARAMETERS = {
    "pinhole": [900, 910, 640, 480],
    "brown": [900, 910, 640, 480, -0.2, 0.05, 1e-3, -5e-4, 0.01, 0.02, -0.01, 0.003],
    "fisheye": [400, 405, 640, 480, 0.05, -0.02, 0.005, -0.001],
    "brown_full": [
        *(900, 910, 640, 480, -0.2, 0.05, 1e-3, -5e-4, 0.01, 0.02, -0.01, 0.003),
        *(1e-3, -2e-3, 3e-3, 5e-4, 0.02, -0.03),
    ],
    "inverse_brown": [900, 910, 640, 480, 0.12, -0.08, 1e-3, -5e-4, 0.03],
    "fisheye624": [400, 400, 640, 480, 0.05, -0.02, 0.005, -0.001, 2e-4, -1e-5, 1e-3, -5e-4, 1e-3, -2e-4, 8e-4, 1e-4],
}


def quietly(corners, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return calibrate_camera(corners, *arguments, **options)


def fisheye_pictures(rng, n=15, parameters=PARAMETERS["fisheye"], size=(1280, 1280), widest=1.2):
    """A board close to a lens that sees almost half of the world, up to ``widest`` rad from the axis."""
    points = board()
    around, aside, spin = rng.uniform(0, 2 * np.pi, n), rng.uniform(0, widest, n), rng.uniform(-np.pi, np.pi, (n, 1))
    look = Rotation.from_rotvec(aside[:, None] * np.stack([np.cos(around), np.sin(around), 0 * around], axis=-1))
    turn = look * Rotation.from_rotvec(rng.uniform(-0.5, 0.5, (n, 3))) * Rotation.from_euler("z", spin)
    away = np.stack([np.zeros(n), np.zeros(n), rng.uniform(0.15, 0.4, n)], axis=-1)
    camera = transforms(turn, look.apply(away) - turn.apply(points.mean(axis=0)))
    seen = points @ camera[:, :3, :3].mT + camera[:, None, :3, 3]
    pixels = MODELS["fisheye"].project(np.array(parameters, dtype=float), seen).pixels
    pixels = pixels + 0.2 * rng.normal(size=pixels.shape)
    angle = np.arctan2(np.hypot(seen[..., 0], seen[..., 1]), seen[..., 2])
    inside = ((pixels > 0) & (pixels < np.array(size) - 1)).all(axis=-1) & (angle < np.radians(92))
    inside &= inside.sum(axis=1, keepdims=True) >= 6
    row, which = np.nonzero(inside)
    return Corners(row, points[which], pixels[inside])


def reference(name, parameters, points):
    """Pixels by OpenCV; of the other models by their definition."""
    K, zero = np.array([[parameters[0], 0, parameters[2]], [0, parameters[1], parameters[3]], [0, 0, 1]]), np.zeros(3)
    d = parameters[4:] if name != "pinhole" else np.zeros(5)
    if name in ("pinhole", "brown", "fisheye", "brown_full"):
        project = cv2.fisheye.projectPoints if name == "fisheye" else cv2.projectPoints
        return project(points[:, None], zero[:, None], zero[:, None], K, d)[0][:, 0]
    a = points[:, :2] / points[:, 2:]
    if name == "inverse_brown":  # a fixed point of the other direction
        at = a.copy()
        for _ in range(200):
            ahead = np.append(at, np.ones((len(at), 1)), axis=1)
            at = at - (cv2.projectPoints(ahead[:, None], zero, zero, np.eye(3), d)[0][:, 0] - a)
    else:
        r = np.linalg.norm(a, axis=1)
        angle = np.arctan(r)
        xy = a * ((angle + sum(k * angle ** (2 * i + 3) for i, k in enumerate(d[:6]))) / r)[:, None]
        s, p = np.sum(xy**2, axis=1)[:, None], d[6:8]
        at = xy + 2 * (xy @ p)[:, None] * xy + s * p + s * d[[8, 10]] + s**2 * d[[9, 11]]
    return at * parameters[:2] + parameters[2:4]


@pytest.mark.parametrize("name", MODELS)
def test_models_are_those_of_their_definition_and_their_derivatives_true(rng, name):
    model, parameters = MODELS[name], np.array(PARAMETERS[name], dtype=float)
    points = np.concatenate([rng.uniform(-0.6, 0.6, (50, 2)), np.ones((50, 1))], axis=1) * rng.uniform(0.5, 3, (50, 1))
    seen = model.project(parameters, points)
    np.testing.assert_allclose(seen.pixels, reference(name, parameters, points), atol=1e-8)
    for k in range(len(parameters)):
        h = 1e-6 * max(1.0, abs(parameters[k])) * np.eye(len(parameters))[k]
        slope = (model.project(parameters + h, points).pixels - model.project(parameters - h, points).pixels) / (
            2 * h[k]
        )
        np.testing.assert_allclose(seen.by_parameters[..., k], slope, atol=1e-4)
    for k in range(3):
        h = 1e-6 * np.eye(3)[k]
        slope = (model.project(parameters, points + h).pixels - model.project(parameters, points - h).pixels) / 2e-6
        np.testing.assert_allclose(seen.by_point[..., k], slope, atol=1e-3)
    directions = rays(model, parameters, seen.pixels)
    np.testing.assert_allclose(directions, points / np.linalg.norm(points, axis=1, keepdims=True), atol=1e-6)


@pytest.mark.slow
def test_one_wrong_corner_is_found_and_changes_nothing(rng):
    corners, _, _ = recorded(rng)
    for pixels, model in ((5.0, "pinhole"), (20.0, "auto"), (400.0, "pinhole")):
        wrong = int(rng.integers(corners.m))
        moved = corners.pixels.copy()
        moved[wrong] += np.where(moved[wrong] > 0.5 * np.array(SIZE), -pixels, pixels) * np.array([0.8, 0.6])
        found = quietly(replace(corners, pixels=moved), SIZE, model)
        kept = np.arange(corners.m) != wrong
        without = quietly(
            replace(corners, row=corners.row[kept], points=corners.points[kept], pixels=moved[kept]), SIZE
        )
        assert np.flatnonzero(~found.bundle.used).tolist() == [wrong]
        assert found.model == without.model
        for name, value in without.intrinsics.items():
            assert found.intrinsics[name] == pytest.approx(value, abs=1e-2 * without.std[name] + 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["auto", "pinhole"])
def test_a_picture_whose_corners_fit_nothing_is_left_out_as_a_whole(rng, model):
    """Its pose would keep four of its wrong corners, and with them the pixel noise would be many times too large."""
    corners, _, _ = recorded(rng)
    pixels, part = corners.pixels.copy(), corners.row == 4
    pixels[part] = rng.uniform(100, 900, (int(part.sum()), 2))
    with pytest.warns(InputWarning, match="The image of row 4 was rejected"):
        found = calibrate_camera(replace(corners, pixels=pixels), SIZE, model)
    assert found.corners.missing == ()  # a table does not say how many pictures there were
    good = quietly(
        replace(corners, row=corners.row[~part], points=corners.points[~part], pixels=pixels[~part], names=()), SIZE
    )
    np.testing.assert_array_equal(found.rows, [k for k in range(20) if k != 4])
    assert found.pixel_noise == pytest.approx(good.pixel_noise, rel=1e-6) and found.outliers == []
    assert found.corners.names == good.corners.names
    np.testing.assert_allclose(found.poses, good.poses, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("before", [True, False])
def test_pictures_that_were_taken_are_counted_once(rng, tmp_path, monkeypatch, before):
    """Robot poses are as many as the pictures taken, whether one is left out before the fit or after it."""
    if not before:
        monkeypatch.setattr(
            "uq_handeye.model.camera.calibrate.unlike_a_board", lambda corners: np.zeros(corners.n, dtype=bool)
        )
    corners, robot, _ = recorded(rng)
    pixels = corners.pixels.copy()
    for row in (4, 7):
        part = corners.row == row
        pixels[part] += 15 * rng.normal(size=(int(part.sum()), 2))
    names = tuple(f"img{k:02d}.png" for k in corners.rows)
    found = quietly(replace(corners, pixels=pixels, names=names, image_size=SIZE), model="pinhole")
    assert sorted(found.corners.missing) == ["img04.png", "img07.png"]
    write_pose_file(tmp_path / "robot.csv", robot)
    poses = uq.read_poses(tmp_path / "robot.csv", found)
    np.testing.assert_allclose(poses.robot, robot[found.rows], atol=1e-8)


@pytest.mark.slow
def test_a_lens_that_distorts_is_decentred_too(rng):
    """The criterion alone may leave out p1 and p2, which turn X by several standard deviations."""
    radial, whole = Candidate("brown", ("k1",), 0.0, 0.2), Candidate("brown", ("k1", "k2", "p1", "p2"), 9.0, 0.2)
    flat, failed = Candidate("pinhole", (), 5.0, 0.2), Candidate("fisheye", ("k1",), float("inf"), float("inf"))
    assert best([flat, radial, whole, failed]) == whole
    assert best([flat._replace(bic=-1.0), radial, whole]) == flat._replace(bic=-1.0)
    wide = Candidate("fisheye", ("k1", "k2", "k3", "k4"), 0.0, 0.2)
    assert best([whole, wide]) == whole and best([whole._replace(bic=11.0), wide]) == wide == best([wide])
    assert best([radial, failed]) == radial and best([failed]) is None and best([]) is None
    found = quietly(recorded(rng, model="brown")[0], SIZE)
    assert found.model == "brown" and {"p1", "p2"} <= set(found.estimated)
    assert quietly(recorded(rng)[0], SIZE).model == "pinhole"


@pytest.mark.slow
def test_a_wide_fisheye_starts_and_other_models_say_that_they_do_not_fit():
    """Tried focal lengths leave corners of one line in a picture: no error of OpenCV or of linear algebra comes out."""
    for seed in (1,):
        corners = fisheye_pictures(np.random.default_rng([17, seed]))
        found = quietly(corners, (1280, 1280), "fisheye")
        assert found.pixel_noise == pytest.approx(0.2, rel=0.1)
        off = np.array(list(found.intrinsics.values())) - PARAMETERS["fisheye"]
        assert off @ np.linalg.solve(found.bundle.covariance, off) < 27.9  # 99.9 % of chi-square(8) is 26.1
        other = quietly(corners, (1280, 1280), "brown")
        assert "camera.residual_pattern" in {finding.code for finding in other.findings}
        assert other.pixel_noise > 10 * found.pixel_noise


def test_corners_on_a_line_are_named():
    points = board()[:9]
    corners = Corners(np.repeat(np.arange(3), 9), np.tile(points, (3, 1)), np.tile(4e3 * points[:, :2] + 100, (3, 1)))
    for model in ("auto", "pinhole", "brown", "fisheye"):
        with pytest.raises(InputError, match="points of one line"):
            calibrate_camera(corners, SIZE, model)


def test_a_board_that_is_not_flat_needs_intrinsics(rng):
    corners, _, _ = recorded(rng)
    points = corners.points.copy()
    points[:, 2] += 0.1 * points[:, 0] ** 2
    for model in ("auto", "pinhole"):
        with pytest.raises(InputError, match="lie in a plane, or `intrinsics`"):
            calibrate_camera(replace(corners, points=points), SIZE, model)


@pytest.mark.slow
def test_corners_far_off_any_camera_are_those_of_another_board(rng):
    corners, _, _ = recorded(rng)
    pixels = corners.pixels + 10.0 * rng.normal(size=corners.pixels.shape)
    wrong = replace(corners, pixels=np.clip(pixels, 1, 959), board="kind=chessboard columns=9")
    found = quietly(wrong, SIZE, "pinhole")
    assert found.findings[0].code == "camera.another_board"
    assert "those of a chessboard board. Check its kind, columns and rows (--pattern, --board)." in found.warnings[0]


def test_pictures_that_are_none_of_a_board(rng):
    """Told before any fit, as one of them can keep every model from starting; a strong distortion is none of them."""
    corners, _, _ = recorded(rng)
    pixels, part = corners.pixels.copy(), np.isin(corners.row, [2, 9])
    pixels[part] = rng.uniform(100, 900, (int(part.sum()), 2))
    np.testing.assert_array_equal(np.flatnonzero(unlike_a_board(replace(corners, pixels=pixels))), [2, 9])
    for good in (corners, recorded(rng, model="brown")[0], *(fisheye_pictures(rng) for _ in range(5))):
        assert not unlike_a_board(good).any()
    solid = replace(corners, points=corners.points + np.linspace(0, 1, corners.m)[:, None] ** 2)
    assert not unlike_a_board(solid).any()
