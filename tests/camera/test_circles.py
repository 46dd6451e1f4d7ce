"""Grids of circles: where a disc is seen, their detection and order, and X from them."""

import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest
from fixtures.rigs import quietly
from scipy.spatial.transform import Rotation
from support import difference

import uq_handeye as uq
from studies.common.pictures import Camera, picture
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.fit.diagnostics.board_rotation import resolve_board_rotation
from uq_handeye.model.camera.adjustment.bundle import Bundle, BundleUnknowns
from uq_handeye.model.camera.adjustment.disc_centres import offset
from uq_handeye.model.camera.board_shape import polynomial_shape
from uq_handeye.model.camera.calibrate import calibrate_camera
from uq_handeye.model.camera.circles import circles_finder
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.corners_file import read_corners
from uq_handeye.model.camera.description import Board, board_of
from uq_handeye.model.camera.models import MODELS

GRIDS = {
    "circles": Board(7, 5, 0.025, "circles", diameter="15mm"),
    "circles-asymmetric": Board(4, 11, "12.5mm", "circles-asymmetric", diameter=0.010),
}
FOCAL, SIZE = 560.0, (640, 480)
CAMERA = Camera("pinhole", np.array([FOCAL, FOCAL, 319.5, 239.5]), SIZE)


def looking_at(board, rng, tilt, roll, away=0.4):
    """A pose camera_T_board about the middle of the board."""
    axis = rng.uniform(0, 2 * np.pi)
    T = np.eye(4)
    turn = Rotation.from_rotvec([tilt * np.cos(axis), tilt * np.sin(axis), 0]) * Rotation.from_euler("z", roll)
    T[:3, :3] = turn.as_matrix()
    T[:3, 3] = np.array([*rng.uniform(-0.02, 0.02, 2), away]) - T[:3, :3] @ board.points.mean(axis=0)
    return T


def bundle_at(model, parameters, poses, points):
    unknowns = BundleUnknowns.poses_only(MODELS[model], polynomial_shape("flat", points))
    n = len(poses)
    return Bundle(
        unknowns, np.asarray(parameters, dtype=float), poses, np.zeros((0, 2)), np.ones(0, dtype=bool), 1.0,
        np.zeros((len(parameters),) * 2), np.zeros((n, 6, 6)), np.zeros((n, 6, len(parameters))), np.ones(n), True, 0,
    )  # fmt: skip


def seen_discs(model, parameters, T, points, diameter):
    m = len(points)
    corners = Corners(np.zeros(m), points, np.zeros((m, 2)), diameter=np.full(m, diameter))
    bundle = bundle_at(model, parameters, T[None], points)
    at = points @ T[:3, :3].T + T[:3, 3]
    return offset(bundle, corners), MODELS[model].project(bundle.intrinsics, at).pixels


@pytest.mark.parametrize("tilt", [0.0, 0.3, 0.8, 1.2])
def test_without_distortion_the_centroid_is_the_centre_of_the_ellipse(rng, tilt):
    """The third column of ``H C^-1 H^T``."""
    board = GRIDS["circles"]
    T, K = looking_at(board, rng, tilt, 0.4), np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
    d, centre = seen_discs("pinhole", CAMERA.parameters, T, board.points, board.disc)
    H = K @ T[:3, [0, 1, 3]]
    for k, (x, y, _) in enumerate(board.points):
        C = np.array([[1, 0, -x], [0, 1, -y], [-x, -y, x * x + y * y - 0.25 * board.disc**2]])
        c = (H @ np.linalg.inv(C) @ H.T)[:, 2]
        np.testing.assert_allclose(centre[k] + d[k], c[:2] / c[2], atol=2e-5)
    assert (np.linalg.norm(d, axis=1).max() > 0.02) == (tilt > 0)


def test_on_the_axis_it_is_the_formula_of_the_module():
    """15 mm, 45 degrees, f = 1000: 0.1125 pixels at 0.5 m, 0.45 at 0.25 m, towards the near side."""
    for away, expected in ((0.5, 0.1125), (0.25, 0.450)):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("x", 45, degrees=True).as_matrix()
        T[:3, 3] = 0, 0, away
        points = 0.1 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
        d, _ = seen_discs("pinhole", [1000.0, 1000.0, 0.0, 0.0], T, points, 0.015)
        assert d[0] == pytest.approx([0.0, -expected], abs=0.01 * expected)


def test_with_distortion_it_is_the_mean_over_many_points(rng):
    board = GRIDS["circles"]
    T, parameters = looking_at(board, rng, 0.6, 1.0, 0.25), np.zeros(len(MODELS["brown"].names))
    parameters[:8] = FOCAL, 570.0, 310.0, 245.0, -0.3, 0.1, 1e-3, -2e-3
    d, centre = seen_discs("brown", parameters, T, board.points, board.disc)
    side = (np.arange(801) + 0.5) / 801 - 0.5
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    grid = board.disc * grid[np.linalg.norm(grid, axis=1) < 0.5]
    for k in (0, 17, 34):
        at = (board.points[k] + np.pad(grid, [(0, 0), (0, 1)])) @ T[:3, :3].T + T[:3, 3]
        seen = MODELS["brown"].project(parameters, at)
        area = np.abs(np.linalg.det(seen.by_point @ T[:3, :2]))
        np.testing.assert_allclose(centre[k] + d[k], area @ seen.pixels / area.sum(), atol=2e-4)


def test_boards_are_read_back_and_nonsense_is_refused():
    for board in GRIDS.values():
        assert board_of(board.text) == board and len(board.points) == board.columns * board.rows
    assert GRIDS["circles"].symmetry_order == 2 and Board(5, 5, 0.02, "circles", diameter=0.01).symmetry_order == 4
    assert GRIDS["circles-asymmetric"].symmetry_order == 1
    x, y, _ = GRIDS["circles-asymmetric"].points[4]
    assert (x, y) == (0.0125, 0.0125)
    for wrong, text in (
        ({"kind": "circles"}, "`diameter`"),
        ({"kind": "chessboard", "diameter": 0.01}, "no `diameter`"),
        ({"kind": "circles", "diameter": 0.03}, "smaller than the distance"),
        ({"kind": "circles", "diameter": 0.01, "marker": 0.01}, "no markers"),
        ({"kind": "apriltag", "diameter": 0.01}, "diameter"),
    ):
        with pytest.raises(uq.InputError, match=text):
            Board(7, 5, 0.025, **wrong)


def test_a_table_of_centres_has_the_diameter(tmp_path):
    lines = ["row,x_mm,y_mm,z_mm,u,v,diameter_mm"]
    lines += [f"0,{25 * i},{25 * j},0,{100 + 30 * i},{90 + 31 * j},15" for i in range(3) for j in range(2)]
    (tmp_path / "centres.csv").write_text("\n".join(lines) + "\n")
    np.testing.assert_allclose(read_corners(tmp_path / "centres.csv").diameter, 0.015)


@pytest.mark.slow
@pytest.mark.parametrize("kind", GRIDS)
def test_discs_are_found_in_an_order_that_is_not_mirrored_at_any_roll(rng, kind):
    """Within 0.03 pixels of the centroids, with noise of 2 grey levels, black on white and white on black."""
    board = GRIDS[kind]
    for k, roll in enumerate(np.linspace(-3.0, 3.0, 8)):
        T = looking_at(board, rng, 0.4, roll)
        image = picture(CAMERA, board, T, rng, noise=2.0, blur=0.7)
        found = circles_finder(board)(image if k % 2 else 255 - image)
        assert found is not None, roll
        d, centre = seen_discs("pinhole", CAMERA.parameters, T, board.points, board.disc)
        orders = [centre + d, (centre + d)[::-1]][: board.symmetry_order]  # half a turn cannot be seen
        off = min(np.abs(found[1] - seen).max() for seen in orders)
        assert off < 0.03, (roll, off)


@pytest.mark.statistical
def test_x_from_discs_is_right_and_from_points_it_is_not(tmp_path):
    """Two sessions of 12 pictures of a symmetric grid at any roll, exact robot: d^2, which points miss by far."""
    board, squares = GRIDS["circles"], {"discs": [], "points": []}
    for seed in range(2):
        rng = np.random.default_rng(seed)
        X, W = (np.eye(4) for _ in range(2))
        X[:3, :3], W[:3, :3] = Rotation.random(2, rng=rng).as_matrix()
        X[:3, 3], W[:3, 3] = 0.05 * rng.normal(size=3), 0.5 * rng.normal(size=3)
        C = np.array(
            [
                looking_at(board, rng, t, r, rng.uniform(0.35, 0.5))
                for t, r in rng.uniform((0.1, -3), (0.75, 3), (12, 2))
            ]
        )
        robot = W @ inverse(C) @ inverse(X)
        for k, T in enumerate(C):
            cv2.imwrite(str(tmp_path / f"{k:02d}.png"), picture(CAMERA, board, T, rng, noise=2.0, blur=0.7))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            corners = uq.detect_board(str(tmp_path / "*.png"), board)
            for name, of in (("discs", corners), ("points", replace(corners, diameter=None))):
                camera = calibrate_camera(of)
                poses = uq.PosePairs(robot[camera.rows], camera.poses, camera_calibration=camera)
                noise = uq.PoseNoise.isotropic(robot=("1e-7rad", "1e-7m"))
                result = quietly(resolve_board_rotation(poses, board), noise=noise)
                xi = difference(result.X, X)
                squares[name].append(xi @ np.linalg.solve(result.covariance, xi))
        assert corners.n == 12
    assert max(squares["discs"]) < 25.0 and min(squares["points"]) > 100.0, squares
