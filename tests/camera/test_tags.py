"""AprilGrids, grids of markers and single tags: rendered pictures with known corners."""

import re
import warnings
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from fixtures.pictures import SIZE, facing, picture, projected, save

import uq_handeye as uq
from studies.common.pictures import Camera
from studies.common.pictures import picture as taken
from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.camera.description import board_of
from uq_handeye.model.camera.dictionaries import bits_of, dictionary_of, drawn_upside_down
from uq_handeye.model.camera.tags import layout_of, tag_finder

cv2 = pytest.importorskip("cv2")
APRILGRID = uq.Board(4, 3, 0.04, "aprilgrid", spacing=0.3)
GRID = uq.Board(4, 3, 0.04, "aruco", dictionary="5x5_100", spacing="10mm", first_id=8)
TAG = uq.Board(1, 1, "40mm", "apriltag", first_id=5)


def off(board, T, found):
    numbers, pixels, _ = found
    return pixels - projected(board, T)[numbers]


@pytest.mark.slow
@pytest.mark.parametrize("board", [APRILGRID, GRID], ids=["aprilgrid", "aruco"])
def test_corners_of_grids_at_every_angle_of_roll(rng, board):
    """Corners between black squares, as Kalibr's are, and alone."""
    find, away, inwards = tag_finder(board), [], []
    for roll in (7, 97, 220):
        T = facing(board, roll, distance=0.35)
        found = find(picture(board, T, rng))
        assert len(found[0]) > 0.6 * len(board.points)
        away.append(off(board, T, found))
        tag = projected(board, T)[layout_of(board).numbers].mean(axis=1)
        of = np.array([np.nonzero(layout_of(board).numbers == k)[0][0] for k in found[0]])
        inside = tag[of] - found[1]
        inwards.append((away[-1] * inside).sum(axis=1) / np.linalg.norm(inside, axis=1))
    away = np.concatenate(away)
    assert np.sqrt(np.mean(away**2)) < 0.03 and np.abs(away).max() < 0.12
    assert np.abs(away.mean(axis=0)).max() < 0.006  # no half pixel
    assert abs(np.concatenate(inwards).mean()) < 0.006  # no tag is too small or too large


@pytest.mark.slow
def test_black_squares_between_tags_make_chessboard_corners_and_alone_they_are_met_by_lines(rng):
    T = facing(APRILGRID, 7, distance=0.35)
    assert (tag_finder(APRILGRID)(picture(APRILGRID, T, rng))[2] > 0).all()
    T = facing(GRID, 7, distance=0.35)
    assert (tag_finder(GRID)(picture(GRID, T, rng))[2] < 0).all()


@pytest.mark.slow
def test_a_grid_seen_in_part_keeps_its_numbers(rng, tmp_path):
    T = facing(APRILGRID, 160, distance=0.4)
    part = picture(APRILGRID, T, rng)
    part[:, 340:] = 128
    found = uq.detect_board(save(tmp_path, part), APRILGRID)
    index = [int(np.argmin(np.abs(APRILGRID.points - p).sum(axis=1))) for p in found.points]
    assert 8 <= found.m < len(APRILGRID.points)
    assert np.abs(found.pixels - projected(APRILGRID, T)[index]).max() < 0.15


def test_the_frame_of_kalibr(rng):
    """Tag 0 is the lower left one; its lower left corner is Kalibr's origin, y up."""
    layout = layout_of(APRILGRID)
    height = 3 * 0.04 + 2 * 0.012
    tag = int(np.flatnonzero(layout.ids == 0)[0])
    np.testing.assert_allclose(layout.points[tag, 3], [0, height])
    tag = int(np.flatnonzero(layout.ids == 5)[0])  # the second of the second row from below
    np.testing.assert_allclose(layout.points[tag, 3], [0.052, height - 0.052])
    assert (np.abs(APRILGRID.points[1] - [0.04, 0, 0]) < 1e-12).all()  # row by row from the upper left


@pytest.mark.slow
@pytest.mark.parametrize("family", ["16h5", "25h9", "36h11"])
def test_a_single_tag_stands_as_apriltag_has_it(rng, family):
    """The code is read from the upper left, whichever way OpenCV draws it."""
    first = {"16h5": 0x231B, "25h9": 0x155CBF1, "36h11": 0xD5D628584}[family]
    bits = bits_of(dictionary_of(f"tag{family}"), 0)
    bits = bits[::-1, ::-1] if drawn_upside_down(f"tag{family}") else bits
    assert int("".join(map(str, bits.astype(int).ravel())), 2) == first
    board = uq.Board(1, 1, 0.04, "apriltag", dictionary=family)
    for roll in (10, 190):
        T = facing(board, roll, distance=0.3)
        found = tag_finder(board)(picture(board, T, rng))
        assert np.abs(off(board, T, found)).max() < 0.08
    np.testing.assert_allclose(board.points[0], [-0.02, -0.02, 0])  # the middle is the origin


@pytest.mark.slow
def test_small_tags_are_not_drawn_together(rng):
    """cornerSubPix moves the corners of dark squares inwards by 0.2 pixels and more."""
    find, inwards = tag_finder(TAG), []
    for roll in range(0, 90, 18):
        T = facing(TAG, roll, distance=0.75)  # 40 pixels
        _, pixels, _ = find(picture(TAG, T, rng))
        truth = projected(TAG, T)
        inside = truth.mean(axis=0) - truth
        inwards += (((pixels - truth) * inside).sum(axis=1) / np.linalg.norm(inside, axis=1)).tolist()
    assert abs(np.mean(inwards)) < 0.015 and np.std(inwards) < 0.05


def on_grey(paper_share, side, tilt, rng, table=70.0, scale=4):
    """Picture of tag 5 on paper that ends ``paper_share`` of the side beyond it, on grey; and its corners."""
    words = dictionary_of("36h11")
    cell = 20
    bits = bits_of(words, 5)
    bits = bits[::-1, ::-1] if drawn_upside_down("36h11") else bits
    tag = cv2.resize(255 * bits.astype(np.uint8), None, fx=cell, fy=cell, interpolation=cv2.INTER_NEAREST)
    tag = cv2.copyMakeBorder(tag, *4 * [cell], cv2.BORDER_CONSTANT, value=20)
    rim = round(paper_share * len(tag))
    drawn = cv2.copyMakeBorder(np.minimum(tag, 235), *4 * [rim], cv2.BORDER_CONSTANT, value=235).astype(np.float32)
    T = facing(TAG, rng.uniform(0, 360), tilt, distance=750 * 0.04 / side)
    corners = projected(TAG, T)
    of_print = np.float32([[0, 0], [len(tag), 0], [0, len(tag)], [len(tag), len(tag)]]) + rim - 0.5
    H = cv2.getPerspectiveTransform(of_print, np.float32(scale * (corners + 0.5) - 0.5))
    size = (scale * SIZE[0], scale * SIZE[1])
    seen = cv2.warpPerspective(drawn, H, size, flags=cv2.INTER_LINEAR, borderValue=table)
    seen = cv2.GaussianBlur(cv2.resize(seen, SIZE, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    return np.clip(seen + rng.normal(0, 3, seen.shape), 0, 255).astype(np.uint8), corners


@pytest.mark.slow
def test_small_tags_on_grey_paper_with_a_narrow_rim_are_found(rng):
    """The rim of the paper is as near as the bits: neither is taken for the edge."""
    find, away = tag_finder(TAG), []
    for k in range(12):
        tilt = rng.uniform(-0.55, 0.55, 2)
        seen, corners = on_grey(1 / 8, 46 + k, tilt, rng)
        _, pixels, _ = find(seen)
        away.append(pixels - corners)
    assert np.sqrt(np.mean(np.square(away))) < 0.04 and np.abs(away).max() < 0.15


@pytest.mark.slow
def test_tags_without_white_are_said_to_have_unclear_edges(rng, tmp_path):
    narrow, wide = (on_grey(share, 50, (0.3, 0.2), rng)[0] for share in (1 / 30, 1 / 4))
    said = r"Tags are in 1 of 2 pictures with edges that are too small or not clear.*\(sides of 4\d px\): img1\.png\."
    with pytest.warns(InputWarning, match=said) as caught:
        uq.detect_board(save(tmp_path, wide, narrow), TAG)
    assert len(caught) == 1
    with pytest.raises(InputError, match="Tags are in 2 of 2 pictures with edges"):
        uq.detect_board(save(tmp_path, narrow, narrow), TAG)


@pytest.mark.slow
def test_other_tags_are_left_alone(rng):
    T = facing(TAG, 10, distance=0.3)
    assert tag_finder(uq.Board(1, 1, "40mm", "apriltag", first_id=6))(picture(TAG, T, rng)) is None
    assert tag_finder(uq.Board(1, 1, "40mm", "apriltag"))(picture(TAG, T, rng)) is not None


@pytest.mark.slow
@pytest.mark.parametrize("printed", [APRILGRID, GRID], ids=["aprilgrid", "aruco"])
def test_the_pictures_contradict_a_wrong_grid(rng, tmp_path, printed):
    images = save(tmp_path, *(picture(printed, facing(printed, roll, distance=0.45), rng) for roll in (7, 97)))

    def said(**other):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            with suppress(InputError):
                uq.detect_board(images, replace(printed, **other))
        return " | ".join(str(item.message) for item in caught)

    assert said() == ""
    wrong = 0.22 if printed is APRILGRID else "6mm"
    assert re.search(r"of their side apart, not 0\.(22|15).*--spacing", said(spacing=wrong))
    assert "lie in rows of 4, not of 5: give columns and rows, --board 4xROWS" in said(columns=5)
    if printed is APRILGRID:
        assert "grow upwards, as those of Kalibr: it is kind='aprilgrid' (--pattern aprilgrid)" in said(
            kind="aruco", dictionary="36h11", spacing="12mm"
        )


@pytest.mark.slow
def test_of_several_tags_the_commonest_is_taken_and_they_are_named(rng, tmp_path):
    one, other = (uq.Board(1, 1, "40mm", "apriltag", first_id=k) for k in (5, 6))
    pictures = []
    for roll, both in ((10, True), (30, True), (50, False)):
        T = facing(one, roll, distance=0.5)
        seen = picture(one, T, rng)
        if both:  # larger, on the right
            T_other = T.copy()
            T_other[:3, 3] = [0.08, 0.0, 0.35]
            beside = picture(other, T_other, rng)
            seen[:, 390:] = beside[:, 390:]
        pictures.append(seen)
    any_tag = uq.Board(1, 1, "40mm", "apriltag")
    with pytest.warns(InputWarning, match=r"Several tags.*: 5 \(3 pictures\), 6 \(2 pictures\). Tag 5 was taken"):
        found = uq.detect_board(save(tmp_path, *pictures), any_tag)
    assert found.n == 3 and "first_id=5" in found.board
    assert (found.pixels[:, 0] < 390).all()
    middle = picture(one, facing(one, 10, distance=0.5), rng)
    shifted = np.full_like(middle, 255)
    shifted[:, :320], shifted[:, 320:] = middle[:, 160:480], middle[:, 160:480]
    (tmp_path / "twice").mkdir()
    with pytest.warns(InputWarning, match="Tag 5 is more than once in 1 picture,"):
        uq.detect_board(save(tmp_path / "twice", shifted), any_tag)


@pytest.mark.slow
def test_a_board_that_is_not_found_names_the_tags_that_are(rng, tmp_path):
    images = save(tmp_path, picture(GRID, facing(GRID, 7, distance=0.45), rng))
    with pytest.raises(InputError, match=r"tags of 5X5_50: 8, 9, 10, 11, 12, 13 and more \(--dictionary 5X5_50\)\.$"):
        uq.detect_board(images, replace(GRID, dictionary="4X4_50"))
    images = save(tmp_path, picture(TAG, facing(TAG, 7, distance=0.4), rng))
    with pytest.raises(InputError, match=r"tags of APRILTAG_36H11: 5 \(--dictionary APRILTAG_36H11\)\.$"):
        uq.detect_board(images, replace(TAG, dictionary="25h9"))


@pytest.mark.slow
def test_other_boards_and_mirror_images_are_named(rng, tmp_path):
    board = uq.Board(9, 6, 0.015, "charuco", marker=0.011)
    seen = picture(board, facing(board, 7, distance=0.45), rng)
    images = save(tmp_path, seen)
    with pytest.raises(InputError, match=r"tags of 4X4_50: 0, 1.*name its kind \(--pattern charuco"):
        uq.detect_board(images, uq.Board(9, 6, 0.015))
    with pytest.raises(InputError, match=r"of the dictionary that was looked for: check columns, rows and kind"):
        uq.detect_board(images, replace(board, columns=6, rows=9))
    save(tmp_path, np.ascontiguousarray(seen[:, ::-1]))
    with pytest.raises(InputError, match=r"mirror images: mirrored, they show tags of 4X4_50\. Flip them\.$"):
        uq.detect_board(images, board)


@pytest.mark.slow
def test_an_aprilgrid_with_one_cell_of_border_and_without_squares_is_found_too(rng):
    print_of_one_row = uq.Board(3, 1, 0.04, "aruco", dictionary="36h11", spacing=0.01)
    board = uq.Board(3, 1, 0.04, "aprilgrid", spacing=0.25)
    T = facing(board, 30, distance=0.4)
    found = tag_finder(board)(picture(print_of_one_row, T, rng))
    assert len(found[0]) == 12 and (found[2] < 0).all()
    assert np.abs(off(board, T, found)).max() < 0.1


def test_grids_that_opencv_draws_are_found_whichever_way_up_its_apriltags_are(rng):
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    grid = cv2.aruco.GridBoard((4, 3), 40.0, 10.0, words)
    drawn = np.pad(grid.generateImage((4 * 80 + 60, 3 * 80 + 40)), 30, constant_values=255)
    found = tag_finder(uq.Board(4, 3, 0.04, "aruco", dictionary="36h11", spacing=0.01))(drawn)
    numbers, pixels, _ = found
    assert len(numbers) == 48
    expected = uq.Board(4, 3, 80, "aruco", spacing=20).points[numbers, :2] + 29.5
    assert np.abs(pixels - expected).max() < 0.3
    ids = np.array(grid.getIds()).ravel()
    np.testing.assert_array_equal(ids, layout_of(GRID).ids - 8)
    np.testing.assert_allclose(np.array(grid.getObjPoints())[..., :2] / 1e3, layout_of(GRID).points, atol=1e-9)


@pytest.mark.parametrize("board", [APRILGRID, GRID, TAG, uq.Board(1, 1, 0.1, "aruco")], ids=str)
def test_text_is_read_back(board):
    assert board_of(board.text) == board and board.symmetry_order == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"kind": "aprilgrid"}, "Expected `spacing`"),
        ({"kind": "aprilgrid", "spacing": 30}, "smaller than 3 sides"),
        ({"kind": "aruco", "spacing": 0.3}, "in metres"),
        ({"kind": "aprilgrid", "spacing": 0.3, "dictionary": "4X4_50"}, "of AprilTags"),
        ({"kind": "apriltag"}, "single apriltag to be 1"),
        ({"kind": "apriltag", "columns": 1, "rows": 1, "spacing": 0.3}, "no `spacing`"),
        ({"kind": "aprilgrid", "marker": 0.02, "spacing": 0.3}, "leave `marker` out"),
        ({"kind": "chessboard", "first_id": 3}, "no `first_id`"),
    ],
)
def test_tags_that_make_no_sense(arguments, message):
    with pytest.raises(InputError, match=message):
        uq.Board(**{"columns": 6, "rows": 4, "square": 0.04} | arguments)


def test_more_tags_than_the_dictionary_has_are_refused():
    with pytest.raises(InputError, match="tags up to 99, and 4X4_50 has 50"):
        tag_finder(uq.Board(10, 10, 0.04, "aruco", spacing=0.01))


@pytest.mark.slow
def test_lines_through_bent_edges_are_moved_back(rng):
    """A lens bends the edges that lines go through; with the camera known the corners are where they should be."""
    camera = np.array([500.0, 500, 320, 240, -0.25, 0.05, 0, 0, 0, 0, 0, 0])
    lens, find, before, after = Camera("brown", camera, SIZE), tag_finder(GRID), [], []
    rows, points, pixels, windows, truth = [], [], [], [], []
    for k, (roll, tilt) in enumerate(((5, (0.4, 0.1)), (80, (-0.3, 0.4)), (200, (0.1, -0.45)), (300, (0.3, 0.3)))):
        T = facing(GRID, roll, tilt, 0.22)
        numbers, where, window = find(taken(lens, GRID, T, rng))
        rows += [k] * len(numbers)
        points.append(GRID.points[numbers]), pixels.append(where), windows.append(window)
        truth.append(lens.seen(GRID.points[numbers], T))
    corners = uq.Corners(rows, *map(np.concatenate, (points, pixels)), image_size=SIZE, window=np.concatenate(windows))
    cam = uq.calibrate_camera(corners, model="brown", coefficients=("k1", "k2"), shape="flat")
    before, after = (np.sqrt(np.mean((c.pixels - np.concatenate(truth)) ** 2)) for c in (corners, cam.corners))
    assert after < 0.02 < 2 * after < before
