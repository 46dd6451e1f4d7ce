"""Grids of chessboards are verified, another board is named, and pictures that are too large are refused."""

import struct

import numpy as np
import pytest

import uq_handeye as uq
from uq_handeye.model.camera import picture_files
from uq_handeye.model.camera.chessboard import is_grid, shown_size

cv2 = pytest.importorskip("cv2")
SQUARE = 36


def _flat(columns, rows, cut=0.0):
    """Picture of a board with so many inner corners, its outer squares ``cut`` off in part, and its corners."""
    j, i = np.indices(((rows + 1) * SQUARE, (columns + 1) * SQUARE)) // SQUARE
    board = np.where((i + j) % 2 == 0, 30, 230).astype(np.uint8)
    off = int(cut * SQUARE)
    board = board[off : board.shape[0] - off, off : board.shape[1] - off] if off else board
    margin = 60
    picture = cv2.copyMakeBorder(board, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=200)
    v, u = np.indices((rows, columns))
    corners = np.stack([(u + 1) * SQUARE, (v + 1) * SQUARE], axis=-1) - off + margin - 0.5
    return cv2.GaussianBlur(picture, (0, 0), 0.8), corners.astype(float)


@pytest.mark.parametrize("cut", [0.0, 0.5])
def test_a_true_grid_is_one_and_shifted_or_turned_ones_are_none(cut):
    picture, corners = _flat(9, 6, cut)
    assert is_grid(corners, picture)
    assert is_grid(corners[::-1, ::-1], picture) and is_grid(corners.swapaxes(0, 1), picture)
    beside = corners.copy()  # the cut edge of the board is taken for the last column
    beside[:, :-1], beside[:, -1] = corners[:, 1:], corners[:, -1] + [(1.0 - cut) * SQUARE, 0.0]
    if cut:
        assert not is_grid(beside, picture)
    part = corners[1:-1, 1:-1]  # as of a larger board
    assert cut or not is_grid(part, picture)
    far = corners + np.array([2.0 * SQUARE, 0.0])  # two columns beside the board
    assert not is_grid(far, picture)
    turned = np.stack(
        [
            corners[0, 0] + SQUARE * (a * np.array([1.0, 1.0]) + b * np.array([1.0, -1.0]))
            for b in range(4)
            for a in range(5)
        ]
    ).reshape(4, 5, 2)  # along the diagonals: one colour
    assert not is_grid(turned + np.array([0.0, 3.0 * SQUARE]), picture)


@pytest.mark.slow
def test_another_board_is_named(tmp_path):
    for k in range(4):
        picture, _ = _flat(11, 8)
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.roll(picture, k, axis=1))
    assert shown_size([picture]) == (11, 8)
    with pytest.raises(uq.InputError, match="the pictures show 11 x 8 corners"):
        uq.detect_board(str(tmp_path / "*.png"), uq.Board(9, 6, "20mm"))


def test_pictures_beyond_100_megapixels_are_refused_by_their_size(tmp_path, monkeypatch):
    head = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + b"IHDR" + struct.pack(">II", 30000, 20000)
    (tmp_path / "a.png").write_bytes(head + b"\x08\x00\x00\x00\x00")
    with pytest.raises(uq.InputError, match="30000 x 20000 pixels"):
        picture_files._picture(tmp_path / "a.png")
    cv2.imwrite(str(tmp_path / "b.jpg"), np.zeros((200, 300), np.uint8))
    monkeypatch.setattr(picture_files, "MAX_PICTURE_PIXELS", 50_000)
    with pytest.raises(uq.InputError, match="300 x 200 pixels"):
        picture_files._picture(tmp_path / "b.jpg")
