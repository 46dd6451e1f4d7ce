"""Boards in pictures: rendered ones, at every angle, with all that pictures of people have."""

import numpy as np
import pytest
from fixtures.pictures import (
    CAMERA,
    SIZE,
    camera_to_board,
    facing,
    picture,
    projected,
    save,
    simulated_rig,
    write_pictures,
)
from support import assert_same_covariance, difference

import uq_handeye as uq
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.camera.adjustment.initial_guess import unlike_a_board
from uq_handeye.model.camera.chessboard import chessboard_finder
from uq_handeye.model.camera.corners import without_pictures
from uq_handeye.model.camera.picture_files import picture_paths

cv2 = pytest.importorskip("cv2")
SQUARE = 0.02


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(9, 6), (5, 8)])
def test_colours_fix_the_order_at_every_angle_of_roll(rng, shape):
    board = uq.Board(*shape, SQUARE)
    assert board.symmetry_order == 1
    find = chessboard_finder(board)
    off = []
    for roll in range(0, 360, 45):
        T = facing(board, roll + 7.0)
        numbers, pixels, _ = find(picture(board, T, rng))
        np.testing.assert_array_equal(numbers, np.arange(np.prod(shape)))
        off.append(pixels - projected(board, T))
    off = np.concatenate(off)
    assert np.abs(off).max() < 0.15  # another order would be 20 pixels off
    assert np.abs(off.mean(axis=0)).max() < 0.01  # and half a pixel is not lost on the way


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(8, 6), (7, 5), (6, 6), (5, 5)])
def test_where_colours_do_not_tell_x_points_right(rng, shape):
    board = uq.Board(*shape, SQUARE)
    assert board.symmetry_order == (4 if shape == (6, 6) else 2)
    find = chessboard_finder(board)
    for roll in (-170, -80, 20, 130):
        T = facing(board, roll)
        _, pixels, _ = find(picture(board, T, rng))
        grid = pixels.reshape(shape[1], shape[0], 2)
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        assert right[0] > 0
        assert right[0] * down[1] - right[1] * down[0] > 0  # no mirror image
        if board.symmetry_order == 4:
            assert right[0] > abs(right[1]) * 0.8
        if abs(roll) < 30:
            np.testing.assert_allclose(pixels, projected(board, T), atol=0.15)


@pytest.mark.slow
def test_that_it_is_not_known_is_said(rng, tmp_path):
    board = uq.Board(8, 6, SQUARE)
    images = save(tmp_path, picture(board, facing(board), rng))
    with pytest.warns(InputWarning, match=r"chessboard of 8 x 6 .* looks the same after a half turn.*--images"):
        uq.detect_board(images, board)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "dictionary"), [((7, 5), "4X4_50"), ((6, 8), "5X5_100")])
def test_charuco_also_in_part(rng, tmp_path, shape, dictionary):
    board = uq.Board(*shape, 0.03, "charuco", 0.022, dictionary)
    T = facing(board, 130.0, distance=0.5)
    whole, part = picture(board, T, rng), picture(board, T, rng)
    part[:, 350:] = 128
    found = uq.detect_board(save(tmp_path, whole, part), board)
    assert found.image_size == SIZE and found.missing == ()
    counts = np.bincount(found.row)
    assert counts[0] == (shape[0] - 1) * (shape[1] - 1) and 6 <= counts[1] < counts[0]
    index = [int(np.argmin(np.abs(board.points - p).sum(axis=1))) for p in found.points]
    off = found.pixels - projected(board, T)[index]
    assert np.abs(off).max() < 0.2 and np.abs(off.mean(axis=0)).max() < 0.02  # no half pixel


def test_boards_of_old_releases_are_found_too(rng, tmp_path):
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    old = cv2.aruco.CharucoBoard((7, 6), 30.0, 22.0, words)
    old.setLegacyPattern(True)
    images = save(tmp_path, np.pad(old.generateImage((420, 360)), 40, constant_values=255))
    assert uq.detect_board(images, uq.Board(7, 6, "30mm", "charuco", "22mm")).m == 30


@pytest.mark.slow
def test_pictures_without_a_board_are_named_and_keep_their_row(rng, tmp_path):
    board = uq.Board(9, 6, "20mm")
    poses = write_pictures(tmp_path, board, rng, n=12, blank=range(3, 11))
    with pytest.warns(InputWarning, match=r"not found in 8 of 12 pictures, .*: img3\.png, .*, img10\.png"):
        found = uq.detect_board(str(tmp_path / "img" / "*.png"), board)
    assert found.missing[:2] == ("img3.png", "img4.png") and found.missing[-1] == "img10.png"
    np.testing.assert_array_equal(found.rows, [0, 1, 2, 11])
    assert found.names == ("img0.png", "img1.png", "img2.png", "img11.png")
    for k in (2, 11):  # 2 comes before 10: the pixels are those of the pose
        T = camera_to_board(poses.truth.camera[k], board)
        np.testing.assert_allclose(found.pixels[found.row == k], projected(board, T), atol=0.15)


def test_all_ways_to_name_pictures(tmp_path):
    for name in ("b2.png", "b10.png", "a1.jpg", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    expected = ["a1.jpg", "b2.png", "b10.png"]
    assert [p.name for p in picture_paths(tmp_path)] == expected
    assert [p.name for p in picture_paths(str(tmp_path / "*g"))] == expected
    assert [p.name for p in picture_paths([tmp_path / name for name in reversed(expected)])] == expected
    (tmp_path / "odd[1].png").write_bytes(b"x")
    assert [p.name for p in picture_paths(str(tmp_path / "odd[1].png"))] == ["odd[1].png"]  # a name, not a pattern
    with pytest.raises(InputError, match=r"No pictures found for .*nothing"):
        picture_paths(str(tmp_path / "nothing*.png"))
    with pytest.raises(InputError, match=r"every picture once, got .*b2\.png twice"):
        picture_paths([tmp_path / "b2.png", tmp_path / "." / "b2.png"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"Expected pictures .* in .*empty, got none"):
        picture_paths(tmp_path / "empty")
    with pytest.raises(InputError, match="got none"):
        picture_paths([])


@pytest.mark.slow
def test_what_is_no_picture_or_of_another_size_is_refused(rng, tmp_path):
    board = uq.Board(9, 6, SQUARE)
    good = picture(board, facing(board), rng)
    images = save(tmp_path, good, good[:400])
    with pytest.raises(InputError, match=r"one size: img0\.png has 640 x 480 pixels and img1\.png 640 x 400"):
        uq.detect_board(images, board)
    for content in (b"", b"not a picture", (tmp_path / "img0.png").read_bytes()[:100]):
        (tmp_path / "img1.png").write_bytes(content)
        with pytest.raises(InputError, match=r"img1\.png: expected a picture"):
            uq.detect_board(images, board)
    (tmp_path / "img1.png").unlink()
    with pytest.raises(InputError, match=r"No chessboard of 7 x 4 inner corners was found in any of 1 pictures"):
        uq.detect_board(images, uq.Board(7, 4, SQUARE))


@pytest.mark.slow
def test_sixteen_bits_and_colour(rng, tmp_path):
    board = uq.Board(9, 6, SQUARE)
    grey = picture(board, facing(board), rng)
    save(tmp_path, grey, grey.astype(np.uint16) * 16, np.stack([grey] * 3, axis=-1))  # 12 bits in 16
    # one by one, as a picture that is there twice is refused
    first, deep, colour = (uq.detect_board(str(tmp_path / f"img{k}.png"), board).pixels for k in range(3))
    np.testing.assert_allclose(deep, first, atol=0.06)
    np.testing.assert_allclose(colour, first, atol=0.02)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"columns": 2}, "`columns` to be an integer of at least 3"),
        ({"rows": 10**6}, "`rows` of the board to be at most 200"),
        ({"square": 0.0}, "`square` to be a length above 0"),
        ({"square": "20"}, "`square` to carry a unit"),
        ({"kind": "rings"}, "`kind` to be chessboard, charuco, "),
        ({"marker": 0.01}, "no markers"),
        ({"kind": "charuco"}, "Expected `marker`"),
        ({"kind": "charuco", "marker": 0.03}, "smaller than `square`"),
    ],
)
def test_boards_that_make_no_sense(arguments, message):
    with pytest.raises(InputError, match=message):
        uq.Board(**{"columns": 9, "rows": 6, "square": SQUARE} | arguments)


def test_dictionaries_that_do_not_exist_or_do_not_suffice(rng, tmp_path):
    images = save(tmp_path, np.full((100, 100), 255, np.uint8))
    with pytest.raises(InputError, match=r"`dictionary` to be one of .*4X4_50"):
        uq.detect_board(images, uq.Board(7, 5, 0.03, "charuco", 0.02, "9X9"))
    with pytest.raises(InputError, match="Expected `board` to be a Board"):
        uq.detect_board(images, (7, 5))


# ---------------------------------------------------------------------------------------------------- half turns


def confused(corners, board, labels, K):
    """The corners as if the board had been taken for turned by ``labels`` in each picture."""
    angle = 2 * np.pi / K * np.asarray(labels)[corners.picture]
    R = np.zeros((corners.m, 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
    R[:, 1, 0], R[:, 0, 1], R[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    middle = board.points.mean(axis=0)
    points = middle + (R @ (corners.points - middle)[..., None])[..., 0]
    return uq.Corners(corners.row, points, corners.pixels, corners.names, corners.image_size)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [(8, 6), (6, 6)])
@pytest.mark.parametrize("setup", ["eye-in-hand", "eye-to-hand"])
def test_robot_poses_tell_half_turns(rng, shape, setup):
    board = uq.Board(*shape, SQUARE)
    poses, corners = simulated_rig(board, rng)
    labels = rng.integers(0, board.symmetry_order, poses.n)
    labels[rng.permutation(poses.n)[:9]] = 0  # most are right
    wrong = uq.calibrate_camera(confused(corners, board, labels, board.symmetry_order), model="pinhole")
    right = uq.calibrate_camera(corners, model="pinhole")
    robot = poses.robot if setup == "eye-in-hand" else np.linalg.inv(poses.robot)
    given = uq.PosePairs(robot, wrong.poses, setup, camera_calibration=wrong)
    found = uq.resolve_board_rotation(given, board)
    seen = found.camera_calibration
    np.testing.assert_allclose(seen.corners.points, right.corners.points, atol=1e-12)
    np.testing.assert_allclose(difference(found.camera, right.poses), 0, atol=1e-6)
    assert seen.intrinsics == wrong.intrinsics
    # the covariance was carried over, not estimated anew
    whole = [np.asarray(cam.covariance) for cam in (seen, right)]
    assert_same_covariance(whole[0] + 1e-16 * np.eye(len(whole[0])), whole[1] + 1e-16 * np.eye(len(whole[0])), 0.01)


def test_turns_that_the_robot_does_not_tell_are_said(rng):
    board = uq.Board(8, 6, SQUARE)
    poses, corners = simulated_rig(board, rng)
    seen = uq.calibrate_camera(corners, model="pinhole")
    with pytest.warns(InputWarning, match="do not show which way up the chessboard of 8 x 6"):
        uq.resolve_board_rotation(
            uq.PosePairs(uq.simulate(poses.n, seed=99).robot, seen.poses, camera_calibration=seen), board
        )
    with pytest.raises(InputError, match="of a calibrated camera"):
        uq.resolve_board_rotation(poses, board)
    told = uq.PosePairs(poses.robot, seen.poses, camera_calibration=seen)
    assert uq.resolve_board_rotation(told, uq.Board(9, 6, SQUARE)) is told


@pytest.mark.slow
def test_corners_of_a_sharp_picture_are_found_as_well_as_of_a_blurred_one(rng):
    """Without smoothing off by 0.040 pixels, and by 0.054 where borders run along the pixels; so by 0.016 and 0.021."""
    board = uq.Board(9, 6, SQUARE)
    find = chessboard_finder(board)
    off = []
    for roll, tilt in ((0, (0.0, 0.0)), (3, (0.1, 0.0)), (40, (0.3, -0.25))):
        T = facing(board, roll, tilt)
        _, pixels, window = find(picture(board, T, rng))
        assert (window == window.astype(int)).all() and window.min() >= 8
        off.append(pixels - projected(board, T))
    assert np.sqrt(np.mean(np.square(off))) < 0.022


@pytest.mark.slow
def test_windows_end_at_the_rim_of_the_picture(rng):
    """The first column lies 6 pixels from the rim, where windows of 10 moved corners by up to 0.09 pixels."""
    board = uq.Board(9, 6, SQUARE)
    T = facing(board, 4, (0.2, 0.25))
    T[:3, 3] += [-(projected(board, T)[:, 0].min() - 6.0) * T[2, 3] / CAMERA[0, 0], 0, 0]
    _, pixels, window = chessboard_finder(board)(picture(board, T, rng))
    truth = projected(board, T)
    assert truth[:, 0].min() < 12
    assert (window <= np.maximum(pixels[:, 0] - 1, 2)).all() and window.max() > 8
    assert np.abs(pixels - truth).max() < 0.06


def test_windows_go_with_their_corners():
    row = np.repeat([1, 0], 4)
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]] * 2)
    corners = uq.Corners(row, points, points[:, :2], window=[5, 6, 7, 8, 1, 2, 3, 0])
    np.testing.assert_array_equal(corners.window, [1, 2, 3, 0, 5, 6, 7, 8])
    np.testing.assert_array_equal(without_pictures(corners, np.array([True, False])).window, [5, 6, 7, 8])
    board = uq.Board(11, 8, SQUARE)  # more corners than the start of a fit looks at
    seen = np.concatenate([projected(board, facing(board, roll)) for roll in (5.0, 40.0)])
    row, many = np.repeat([0, 1], 88), np.tile(board.points, (2, 1))
    assert not unlike_a_board(uq.Corners(row, many, seen, window=np.arange(176) % 9)).any()
    row = np.repeat([1, 0], 4)
    for wrong in ([1, 2], [1.5] * 8, [np.inf] * 8):
        with pytest.raises(uq.InputError, match="half widths in whole pixels"):
            uq.Corners(row, points, points[:, :2], window=wrong)
