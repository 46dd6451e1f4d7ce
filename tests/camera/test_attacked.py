"""Pictures and corners that no camera takes: one line that says what is wrong, whatever OpenCV makes of them."""

import cv2
import numpy as np
import pytest
from fixtures.commands import run

import uq_handeye as uq
from uq_handeye.model.camera.board import find_corners
from uq_handeye.model.camera.corners import Corners
from uq_handeye.model.camera.corners_file import corners_text, read_corners

GRID = np.array([[x, y, 0.0] for y in range(4) for x in range(5)]) * 0.03


def corners_of(pixels):
    rng = np.random.default_rng(1)
    n = len(pixels)
    return Corners(np.repeat(np.arange(n), len(GRID)), np.tile(GRID, (n, 1)), np.concatenate(pixels)), rng


def test_corners_in_one_place(tmp_path):
    corners, _ = corners_of([np.full((20, 2), 100.0 + k) for k in range(6)])
    with pytest.raises(uq.InputError, match=r"do not determine the focal length|No camera model fits"):
        uq.calibrate_camera(corners, (640, 480))


def test_pictures_of_a_few_pixels(tmp_path):
    for k, size in enumerate((1, 10)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.zeros((size, size), np.uint8))
    with pytest.raises(uq.InputError, match=r"0.png: expected a picture of at least 32 pixels a side, got 1 x 1"):
        find_corners(str(tmp_path / "*.png"), uq.Board(9, 6, 0.02), False)


@pytest.mark.parametrize("again", ["picture", "point"])
def test_what_is_given_again_is_named(tmp_path, again):
    """Eight copies of one picture would know the focal length three times better than the picture does."""
    rng = np.random.default_rng(2)
    pixels = [GRID[:, :2] * 5000 + rng.normal(300, 20, (20, 2)) for _ in range(5)]
    corners, _ = corners_of([*pixels, pixels[1]] if again == "picture" else pixels)
    text = corners_text(corners, np.ones(corners.m, bool))
    if again == "point":
        text += text.splitlines()[1] + "\n"
    path = tmp_path / "corners.csv"
    path.write_text(text, encoding="utf-8")
    words = r"row 1 and row 5 hold the same corners" if again == "picture" else "is twice in row 0"
    with pytest.raises(uq.InputError, match=words):
        read_corners(path)
    done = run("camera", path, "--image-size", "640x480")
    assert done.returncode == 2 and len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("what", ["png", "gif", "tiff"])
def test_decoders_are_not_heard(tmp_path, capfd, what):
    """libpng, libtiff and OpenCV write to descriptor 2 themselves; the one line is ours."""
    good = cv2.imencode(".png", np.zeros((100, 100), np.uint8))[1].tobytes()
    bad = {"png": good[:-30], "gif": b"GIF89a" + b"\xff\xff\xff\xff\0\0\0", "tiff": b"II*\0\x08\0\0\0" + b"\xff" * 4000}
    (tmp_path / f"a.{what}").write_bytes(bad[what])
    with pytest.raises(uq.InputError, match="expected a picture"):
        find_corners(str(tmp_path / "a.*"), uq.Board(9, 6, 0.02), False)
    assert capfd.readouterr().err == ""


@pytest.mark.slow
@pytest.mark.parametrize(("column", "value"), [(0, "1e30"), (1, "1e300"), (3, "-1e300"), (4, "1e300")])
def test_numbers_beyond_any_picture(tmp_path, column, value):
    corners, _ = corners_of([GRID[:, :2] * 5000 + k for k in range(4)])
    lines = corners_text(corners, np.ones(corners.m, bool)).splitlines()
    fields = lines[7].split(",")
    fields[column] = value
    lines[7] = ",".join(fields)
    (tmp_path / "corners.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    done = run("camera", tmp_path / "corners.csv", "--image-size", "640x480")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and len(done.stderr) < 300
    assert "to be finite and at most" in done.stderr
