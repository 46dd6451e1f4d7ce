"""X belongs to its intrinsics: what is written is one answer, and given numbers are tested by robot and pictures."""

import warnings

import numpy as np
import pytest

import uq_handeye as uq
from studies.camera_covariance import SIZE, board, recorded
from uq_handeye.calibration.camera_of_result import corrected_camera
from uq_handeye.core.geometry.se3 import inverse
from uq_handeye.errors import InputWarning
from uq_handeye.model.camera.calibrate import calibrate_camera

TRUTH = (1000.0, 1001.0, 650.0, 470.0)


def calibrated(seed, **options):
    corners, robot, X = recorded(
        np.random.default_rng(seed), pixel=0.1, parameters=np.array(TRUTH), points=board(), robot=None
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        seen = calibrate_camera(corners, SIZE, "pinhole", shape="flat", **options)
        result = uq.calibrate(uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen))
    return result, X


@pytest.mark.slow
def test_intrinsics_follow_the_robot():
    """The corrected intrinsics are right within a smaller covariance, and place the target where X and W have it."""
    result, _ = calibrated(1)
    seen, corrected = result.data.camera_calibration, corrected_camera(result)
    sd = np.array(list(corrected.std.values()))
    assert (sd < 0.7 * np.array(list(seen.std.values()))).all()
    off = np.array(list(corrected.intrinsics.values())) - TRUTH
    assert (np.abs(off) < 4 * sd).all()
    middle = np.append(board().mean(axis=0), 1.0)

    def rms(camera):
        placed = result.X @ camera.poses @ middle - inverse(result.data.robot) @ result.W @ middle
        return np.sqrt(np.mean(np.sum(placed[:, :3] ** 2, axis=1)))

    assert rms(corrected) < rms(seen)
    (moved,) = [one for one in result.findings if one.code == "calibration.intrinsics_moved"]
    assert moved.severity == "note"
    assert {one["name"]: one["after"] for one in moved.values["numbers_moved"]} == pytest.approx(corrected.intrinsics)


@pytest.mark.slow
def test_half_a_pixel_given_as_exact_is_found_with_the_robot():
    given = dict(zip(("fx", "fy", "cx", "cy"), TRUTH, strict=True))
    result, _ = calibrated(1, intrinsics=given, exact=True)
    assert not [one for one in result.findings if one.code == "camera.given_contradicted"]
    given |= {"cx": given["cx"] - 0.5, "cy": given["cy"] - 0.5}
    result, _ = calibrated(1, intrinsics=given, exact=True)
    (finding,) = [one for one in result.findings if one.code == "camera.given_contradicted"]
    assert finding.severity == "caution" and finding.values["explanations"][0] == "half a pixel"
    assert corrected_camera(result).intrinsics == pytest.approx(given)


@pytest.mark.slow
def test_pictures_upside_down_are_named():
    corners, robot, _ = recorded(np.random.default_rng(3), pixel=0.1, parameters=np.array(TRUTH), points=board())
    turned = [2, 7, 11]
    pixels = corners.pixels.copy()
    of = np.isin(corners.row, turned)
    pixels[of] = np.array(SIZE) - 1.0 - pixels[of]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        seen = calibrate_camera(uq.Corners(corners.row, corners.points, pixels), SIZE, "pinhole", shape="flat")
        result = uq.calibrate(uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen))
    (finding,) = [one for one in result.findings if one.code == "input_checks.turned_pictures"]
    assert finding.values["rows"] == turned and "are upside down" in str(finding)


@pytest.mark.slow
def test_mirrored_pictures_are_named():
    corners, robot, _ = recorded(np.random.default_rng(4), pixel=0.1, parameters=np.array(TRUTH), points=board())
    pixels = corners.pixels.copy()
    pixels[:, 0] = SIZE[0] - 1.0 - pixels[:, 0]
    # A detector orders the corners of a mirrored board from the other side.
    points = corners.points * [-1.0, 1.0, 1.0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        seen = calibrate_camera(uq.Corners(corners.row, points, pixels), SIZE, "pinhole", shape="flat")
        result = uq.calibrate(uq.PosePairs(robot[seen.rows], seen.poses, camera_calibration=seen))
    assert not result.usable and "the pictures seem to be mirrored" in result.headline


@pytest.mark.slow
def test_a_camera_of_wrong_intrinsics_makes_x_not_usable():
    given = dict(zip(("fx", "fy", "cx", "cy"), TRUTH, strict=True)) | {"cy": 520.0}
    result, _ = calibrated(1, intrinsics=given)
    assert not result.usable and "given intrinsics do not fit: cy off by 50" in result.headline
