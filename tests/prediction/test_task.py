"""Errors of a length, a plane and a point that the camera measures."""

from pathlib import Path

import numpy as np
import pytest
from fixtures.commands import run
from scipy.spatial.transform import Rotation

import uq_handeye as uq

NOISE = uq.PoseNoise.isotropic(robot=("0.02deg", "0.05mm"), camera=("0.1deg", "0.5mm"))


@pytest.fixture(scope="module")
def result() -> uq.Calibration:
    found = uq.calibrate(uq.simulate(20, noise=NOISE, seed=1), noise=NOISE)
    assert isinstance(found, uq.Calibration)
    return found


def test_the_measurement_is_that_of_drawn_corners(result: uq.Calibration) -> None:
    task = result.predict_task("100mm", "0.5m", "0.2px", "1000px")
    rng, f, d, half = np.random.default_rng(0), 1000.0, 0.5, 0.05
    corners = np.array([[x, y] for x in (-half, half) for y in (-half, half)])
    drawn = (corners * f / d + rng.normal(0.0, 0.2, (4000, 4, 2))) * d / f
    lengths = np.linalg.norm(drawn[:, 2] - drawn[:, 0], axis=-1)
    assert task["length"].measurement == pytest.approx(lengths.std(), rel=0.05)
    # the size of the square in the picture gives the distance: 8 numbers, of which the mean over the corners counts
    size = np.sqrt((drawn**2).sum(axis=(1, 2)))
    assert task["plane distance"].measurement == pytest.approx(d * size.std() / size.mean(), rel=0.05)


def test_the_plane_is_that_of_poses_fitted_to_drawn_corners(result: uq.Calibration) -> None:
    task = result.predict_task("100mm", "0.5m", "0.2px", "1000px")
    square = 0.05 * np.array([[x, y, 0.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])

    def pixels(pose: np.ndarray) -> np.ndarray:
        seen = Rotation.from_rotvec(pose[:3]).apply(square) + pose[3:] + [0.0, 0.0, 0.5]
        return np.asarray(1000.0 * (seen[:, :2] / seen[:, 2:]).ravel())

    J = np.array([(pixels(step) - pixels(-step)) / 2e-6 for step in 1e-6 * np.eye(6)]).T
    noise = np.random.default_rng(2).normal(0.0, 0.2, (8, 4000))
    found = np.linalg.lstsq(J, noise, rcond=None)[0]
    angle = np.sqrt((found[:2] ** 2).sum(axis=0).mean())  # about both axes of the plane
    assert task["plane angle"].measurement == pytest.approx(angle, rel=0.05)
    assert task["plane distance"].measurement == pytest.approx(found[5].std(), rel=0.05)


def test_the_calibration_is_that_of_the_points(result: uq.Calibration) -> None:
    task = result.predict_task(0.1, 0.5, 0.0, 1000.0)
    assert result.data is not None and result.data.poses is not None
    found = result.predict([0.0, 0.0, 0.5], robot=result.data.poses.robot)
    assert task["point"].calibration == pytest.approx(np.sqrt((found.std**2).sum(axis=-1).mean()))
    assert all(part.measurement == 0.0 for part in task.parts)
    assert task["length"].calibration < 0.1 / 0.5 * task["point"].calibration


def test_more_distance_and_more_noise(result: uq.Calibration) -> None:
    near, far = (result.predict_task(0.1, d, "0.2px", "1000px") for d in (0.5, 1.0))
    assert far["length"].measurement == pytest.approx(2 * near["length"].measurement)
    assert far["plane angle"].measurement > near["plane angle"].measurement


def test_the_focal_length_is_asked_for(result: uq.Calibration) -> None:
    with pytest.raises(uq.InputError, match="--focal-length"):
        result.predict_task(0.1, 0.5, 0.2)
    with pytest.raises(uq.InputError, match="above 0"):
        result.predict_task(0.1, "-1m", 0.2, 1000.0)


def test_on_the_command_line(result: uq.Calibration, tmp_path: Path) -> None:
    file = result.save(tmp_path / "result.json")
    asked = ["predict", str(file), "--length", "100mm", "--at", "0.5m", "--pixel-noise", "0.2px"]
    text = run(*asked, "--focal-length", "1000px").stdout
    assert "Error of the task" in text and "by the measurement" in text
    assert run(*asked).returncode == 2
    assert "--length needs --at" in run("predict", file, "--length", "100mm").stderr
