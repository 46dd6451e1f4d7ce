"""Many outliers, large noise and noise along the view: input that is good, and that must be usable."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import uq_handeye as uq

POSES = 30
NOISE = uq.PoseNoise.isotropic(robot=("0.03deg", "0.2mm"), camera=("0.1deg", "1mm"))


def _measured(poses: uq.PosePairs, camera: NDArray[np.float64]) -> uq.PosePairs:
    """The poses as measured ones, without their truth."""
    return uq.PosePairs(poses.robot, camera, poses.setup)


def _with_wrong(poses: uq.PosePairs, share: float, rng: np.random.Generator) -> tuple[uq.PosePairs, list[int]]:
    """A share of the camera poses moved by 20 deg and 100 mm at random."""
    rows = np.sort(rng.choice(poses.n, round(share * poses.n), replace=False))
    camera = poses.camera.copy()
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.35, (len(rows), 3))).as_matrix()
    camera[rows, :3, :3] = camera[rows, :3, :3] @ turn
    camera[rows, :3, 3] += rng.normal(0.0, 0.1, (len(rows), 3))
    return _measured(poses, camera), rows.tolist()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_up_to_half_of_the_poses_may_be_wrong(share: float) -> None:
    poses = uq.simulate(POSES, noise=NOISE, seed=3)
    wrong, rows = _with_wrong(poses, share, np.random.default_rng(4))
    result = uq.calibrate(wrong)
    assert result.table is not None and poses.truth is not None
    assert sorted(result.table.rejected) == rows
    assert not any(finding.severity == "failure" for finding in result.findings)
    assert "input_checks.angles_disagree" not in {one.code for one in result.findings}
    assert np.linalg.norm(result.X[:3, 3] - poses.truth.X[:3, 3]) < 2e-3


def _noisy(n: int, seed: int, turn: float, shift: tuple[float, float, float]) -> uq.PosePairs:
    """Poses with camera noise per axis of the camera (rad, m)."""
    clean = uq.simulate(n, noise=uq.PoseNoise.isotropic(robot=("0.01deg", "0.05mm"), camera=(0.0, 0.0)), seed=seed)
    rng = np.random.default_rng(seed)
    camera = clean.camera.copy()
    camera[:, :3, :3] = camera[:, :3, :3] @ Rotation.from_rotvec(rng.normal(0.0, turn, (n, 3))).as_matrix()
    camera[:, :3, 3] += rng.normal(size=(n, 3)) * shift
    return uq.PosePairs(clean.robot, camera, clean.setup, truth=clean.truth)


@pytest.mark.filterwarnings("ignore::uq_handeye.InputWarning")
def test_large_noise_is_no_reason_to_refuse() -> None:
    poses = _noisy(25, 6, 0.02, (0.012, 0.012, 0.04))
    result = uq.calibrate(_measured(poses, poses.camera))
    assert not any(finding.severity == "failure" for finding in result.findings), result.findings
    assert result.table is not None and not result.table.flagged


def test_depth_noise_is_found() -> None:
    poses = _noisy(60, 6, 0.002, (0.0005, 0.0005, 0.004))
    result = uq.calibrate(_measured(poses, poses.camera))
    assert result.noise is not None and result.noise_estimate is not None
    (depth,) = [part for part in result.noise_estimate.of_model if part.name == "camera depth"]
    assert depth.low < 0.004 < depth.high and depth.size == pytest.approx(0.004, rel=0.3)
    (side,) = [part for part in result.noise_estimate.of_model if part.name == "camera translation"]
    assert side.size < 0.0015
