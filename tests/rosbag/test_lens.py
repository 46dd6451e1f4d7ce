"""Raw or rectified picture: what the corners of a tag say where a camera_info has the intrinsics of both."""

import numpy as np
import pytest
from fixtures.bags import CENTRE, FOCAL, START, Writer, pixels_of
from fixtures.commands import run
from scipy.spatial.transform import Rotation

from uq_handeye.errors import InputError, InputWarning
from uq_handeye.model.camera.models import MODELS
from uq_handeye.read.rosbag.camera_info import CameraInfo, camera_info_of, camera_info_yaml
from uq_handeye.read.rosbag.lens import lens_of
from uq_handeye.read.rosbag.recording import read_recording
from uq_handeye.read.rosbag.streams import camera_stream, read_bag
from uq_handeye.read.rosbag.tags import TagTrack

SIDE, D = 0.08, [-0.25, 0.08, 0.001, -0.0005, 0.0]
K = np.array([FOCAL, FOCAL, *CENTRE])


def seen(side, raw, n=60, seed=1, coefficients=D):
    """Return poses of a tag and its pixels in the raw or in the rectified picture."""
    rng = np.random.default_rng(seed)
    C = np.tile(np.eye(4), (n, 1, 1))
    C[:, :3, :3] = Rotation.from_euler("xyz", rng.uniform(-0.6, 0.6, (n, 3))).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    C[:, :3, 3] = rng.uniform([-0.15, -0.1, 0.45], [0.15, 0.1, 0.55], (n, 3))
    pixels = pixels_of(C, side)
    if raw:
        rays = np.concatenate([(pixels - CENTRE) / FOCAL, np.ones((n, 4, 1))], axis=2)
        pixels = MODELS["brown"].project(np.concatenate([K, coefficients, np.zeros(3)]), rays).pixels
    return C, pixels + 0.2 * rng.normal(size=pixels.shape)


def track_of(pixels):
    track = TagTrack("tag")
    for k, corners in enumerate(pixels):
        track.add(float(k), corners.ravel().tolist())
    return track


INFO = CameraInfo("cam", (1280, 720), "plumb_bob", K, np.array(D), K)


@pytest.mark.slow
@pytest.mark.parametrize("raw", [True, False])
def test_the_corners_say_which_picture_they_lie_in(raw):
    _, pixels = seen(SIDE, raw)
    track = track_of(pixels)
    found = lens_of(track, INFO, SIDE)
    assert found.info.rectified is not raw and not found.warning
    words = "K and D, of the raw picture" if raw else "P, of the rectified picture"
    assert found.note.startswith(f"intrinsics of camera_info: {words}; the corners fit to 0.")
    fits = [float(part.split()[0]) for part in found.note.split("fit to ")[1].split("picture, to ")]
    assert fits[0] < 0.25 and fits[1] > 1.3 * fits[0]
    assert lens_of(track, INFO, SIDE, given="raw").info.rectified is False
    assert lens_of(track, INFO, SIDE, given="rectified").info is INFO
    no_P = CameraInfo("cam", (1280, 720), "", K, np.array(D), np.zeros(4))
    assert lens_of(track, no_P, SIDE).info.lens()[1][4] == D[0]  # plumb_bob without a name
    with pytest.raises(InputError, match=r"--camera-matrix rectified: the camera_info has no matrix P"):
        lens_of(track, no_P, SIDE, given="rectified")


@pytest.mark.slow
def test_a_small_tag_does_not_decide_and_few_detections_do_not():
    for raw in (True, False):
        for seed in range(3):
            found = lens_of(track_of(seen(0.02, raw, 40, seed)[1]), INFO, 0.02)
            assert found.info is INFO
            assert "do not decide whether the tag was detected in the raw picture" in found.warning
            assert found.warning.endswith('give camera_matrix="raw" (--camera-matrix raw).')
    assert "do not decide" in lens_of(track_of(seen(SIDE, True, 6)[1]), INFO, SIDE).warning
    weak = CameraInfo("cam", (1280, 720), "plumb_bob", K, 0.03 * np.array(D), K)
    found = lens_of(track_of(seen(0.02, True, 40, coefficients=0.03 * np.array(D))[1]), weak, 0.02)
    assert not found.warning and "which does not decide; if it was the raw one, give --camera-matrix raw" in found.note


def written(folder, n):
    C, pixels = seen(SIDE, True, n)
    with Writer(folder, "mcap", f"cell{n}") as bag:
        bag.camera_info("/camera_info", START, "cam", D)
        for k, (T, corners) in enumerate(zip(C, pixels, strict=True)):
            bag.tf(START + k, ("base", "tool0", np.linalg.inv(T)))
            bag.detections("/detections", START + k, "cam", [(0, corners)])
    return C, bag.path


@pytest.mark.slow
def test_a_bag_of_raw_detections(tmp_path):
    C, path = written(tmp_path, 60)
    found = camera_stream(read_recording(path), "cam:tag36h11_0", tag=SIDE)
    assert np.abs(found.stream.poses[:, :3, 3] - C[:, :3, 3]).max() < 5e-3
    assert "data: [-0.25, 0.08, 0.001, -0.0005, 0.0]" in camera_info_yaml(found.info)
    asked = {"robot": "base:tool0", "camera": "cam:tag36h11_0", "tag": SIDE}
    wrong = read_bag(path, **asked, camera_matrix="rectified")[1]
    assert np.abs(wrong.poses[:, :3, 3] - C[:, :3, 3]).max() > 5e-3
    with pytest.raises(InputError, match=r'Expected `camera_matrix` to be "raw"'):
        read_bag(path, **asked, camera_matrix="Raw")
    C, path = written(tmp_path, 6)
    with pytest.warns(InputWarning, match="do not decide"):
        read_bag(path, **asked)
    given = ("--camera", asked["camera"], "--tag", "80mm", "--camera-matrix", "raw", "-o", tmp_path / "tables")
    done = run("bag", path, *given)
    assert done.returncode == 0 and "K and D, of the raw picture, as given" in done.stderr
    assert "-0.25" in (tmp_path / "tables" / "camera_info.yaml").read_text()


def message(**fields):
    """A camera_info as a map."""
    P = [900.0, 0, 640, 0, 0, 900, 360, 0, 0, 0, 1, 0]
    given = {"header": {"frame_id": "cam"}, "width": 1280, "height": 720, "distortion_model": "rational_polynomial"}
    return given | {"k": [900.0, 0, 640, 0, 901, 360, 0, 0, 1], "d": [0.1] * 8, "p": P} | fields


def test_roi_and_binning_move_both_matrices():
    roi = {"x_offset": 100, "y_offset": 40, "width": 1000, "height": 600}
    info = camera_info_of(message(roi=roi, binning_x=2, binning_y=4))
    assert info.image_size == (500, 150)
    np.testing.assert_allclose(info.K, [450, 225.25, 0.5 * 540.5 - 0.5, 0.25 * 320.5 - 0.5])
    np.testing.assert_allclose(info.P, [450, 225, 0.5 * 540.5 - 0.5, 0.25 * 320.5 - 0.5])


def test_fourteen_coefficients_are_all_used():
    d = [0.1, -0.2, 1e-3, 2e-3, 0.01, 0.02, 0.03, 0.04, 0, 0, 0, 0, 0.005, -0.004]
    model, parameters = camera_info_of(message(d=d, p=[0.0] * 12)).lens()
    assert model.name == "brown_full" and parameters[4:].tolist() == d
    with pytest.raises(InputError, match="the model brown_full has the coefficients"):
        camera_info_of(message(d=[*d, 1.0], p=[0.0] * 12)).lens()
    with pytest.raises(InputError, match="four coefficients and no distortion_model"):
        camera_info_of(message(d=[0.1] * 4, distortion_model="", p=[0.0] * 12)).lens()


def test_the_second_camera_of_a_pair_is_named(rng):
    info = camera_info_of(message(p=[900.0, 0, 640, -54.0, 0, 900, 360, 0, 0, 0, 1, 0], d=[0.0] * 5))
    assert info.baseline == pytest.approx(0.06)
    found = lens_of(None, info, 0.04)
    assert "second camera of a rectified pair" in found.warning and "60 mm along x of the first one" in found.warning
